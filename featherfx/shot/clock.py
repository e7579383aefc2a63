"""Time codes of stages over a shot: a frame is the time code of its number, but for cuts.

Frames are counted from 0 s on. A cut from frame k to k + 1 happens right after k: until then
everything is as the frames before lead it, from then on as the frames after do. So nothing moves
between the two poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from featherfx.algebra.interpolation import Knots

MIN_RATE, MAX_RATE = 1.0, 1000.0  # 1/s, frames of a shot
_FRAME_TOLERANCE = 1e-6  # frames, as near a time is a frame
_NUDGE = 1e-8  # frames, from a cut to right after it
_REACH = 3  # frames of a stage on either side that interpolation looks at


@dataclass(frozen=True)
class FrameCuts:
    """Cuts of a shot; of this class there are none."""

    def is_cut(self, k: int) -> bool:
        """Return whether there is a cut from frame k to k + 1."""
        return False

    def ends(self, place: float, reach: int) -> tuple[float, float]:
        """Return the first and last frame of what has no cut around a place in frames; infinite
        where none is within reach."""
        k = math.ceil(place - 0.1 * _NUDGE) - 1
        first = (j + 1.0 for j in range(k, k - reach - 1, -1) if self.is_cut(j))
        last = (float(j) for j in range(k + 1, k + reach + 2) if self.is_cut(j))
        return next(first, -math.inf), next(last, math.inf)

    def between(self, start: float, end: float) -> bool:
        """Return whether there is a cut on the way from one place in frames to another."""
        return any(map(self.is_cut, range(math.ceil(start - 1e-6), math.ceil(end - 1e-6))))

    def held(self, place: float) -> float:
        """Return the place of what has no motion to go on with: within a cut, its end."""
        k = math.floor(place)
        return k + 1.0 if k < place and self.is_cut(k) else place

    def begins(self, place: float) -> bool:
        """Return whether a cut is right after a place in frames."""
        k = round(place)
        return abs(place - k) < _FRAME_TOLERANCE and self.is_cut(k)

    def after(self, place: float) -> float:
        """Return a place, or right after it where a cut is there."""
        return round(place) + _NUDGE if self.begins(place) else place


NO_CUTS = FrameCuts()


@dataclass(frozen=True)
class StageClock:
    """Time codes of a stage over a shot. start: time code at 0 s. step: time codes of a frame.
    frames_per_second: 1/s, of the shot."""

    start: float = 0.0
    step: float = 1.0
    frames_per_second: float = 1.0
    cuts: FrameCuts = NO_CUTS

    def code(self, time: float) -> float:
        """Return the time code at a time in s since the first frame."""
        return self.start + time * self.frames_per_second * self.step

    def held(self, time: float) -> float:
        """Return the time code of what has no motion to go on with; within a cut, its end."""
        return self.start + self.cuts.held(time * self.frames_per_second) * self.step

    def begins(self, time: float) -> bool:
        """Return whether a cut is right after a time."""
        return self.cuts.begins(time * self.frames_per_second)

    def after(self, time: float) -> float:
        """Return a time, or right after it where a cut is there."""
        return self.cuts.after(time * self.frames_per_second) / self.frames_per_second

    @property
    def grid(self) -> tuple[float, float]:
        """Return a time code and the distance of the stage's own frames: the shot's, or whole time
        codes where these are between them."""
        if abs(self.step - round(self.step)) < _FRAME_TOLERANCE:
            return self.start, self.step
        return float(math.floor(self.start)), 1.0

    def own(self, place: float) -> float:
        """Return the number of the stage's own frames at a place in frames of the shot."""
        first, distance = self.grid
        return (self.start + place * self.step - first) / distance

    def knots(
        self, sampled: tuple[float, float], span: tuple[int, int], is_linear: bool = False
    ) -> Knots:
        """Return the stage's own frames. span: first and last frame of the shot, from 0 s on.

        Where the shot goes beyond the samples the stage holds the last, and motion comes to rest
        there; else it goes on.
        """
        start, distance = self.grid
        low, high = ((code - start) / distance for code in sampled)
        return Knots(
            start,
            distance,
            math.ceil(low - 1e-6) if low < self.own(span[0]) + 1e-6 else None,
            math.floor(high + 1e-6) if high > self.own(span[1]) - 1e-6 else None,
            is_linear=is_linear,
        )

    def ends(self, code: float) -> tuple[float, float]:
        """Return the numbers of the stage's first and last own frame of what has no cut around a
        time code; infinite where none is near."""
        reach = math.ceil(_REACH * self.grid[1] / self.step) + 1
        first, last = self.cuts.ends((code - self.start) / self.step, reach)
        low = first if math.isinf(first) else math.ceil(self.own(first) - _FRAME_TOLERANCE)
        high = last if math.isinf(last) else math.floor(self.own(last) + _FRAME_TOLERANCE)
        return low, max(low, high)
