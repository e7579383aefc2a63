"""The way into a shot: its motion, brought up from rest before the first frame.

A body that moves at the first frame did so before. Over the frames of the preroll it swings from
the pose of the first frame back along the way that leads there, which its samples or their
continuation tell, and forth again to its full speed. So feathers settle in a pose that the shot
has, nothing turns or folds farther back than it goes in a fifth of the preroll, and speed and
acceleration at the end are those of the shot. The way that all roots have in common is no pose,
and to go back on it would be wind from behind: it is gone forwards only, from half a preroll's
length back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.shot.roots import RootFrames, Roots, some_roots

# of the error tolerance: what moves less before the first frame is at rest
STILL = 1e-3
# of the preroll, how far back the swing goes: -(min of u^3 (-4 + 7 u - 3 u^2)), at u = 2/3
_BACK = 16.0 / 81.0
# of a preroll, the step by which the speed at its end is found
_STEP = 1e-3


class RunUp(NamedTuple):
    """The time in which what moves is brought up from rest.

    duration: s. velocity: (3,) m/s, that all of it has in common at the end. end: s since the first
    frame, 0 or before it.
    """

    duration: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    end: float = 0.0

    @property
    def back(self) -> float:
        """Return the time (s) that the swing goes back to."""
        return self.end - _BACK * self.duration

    def own(self, time: float) -> float:
        """Return the time (s) whose pose a body has at a time of the shot.

        From the end on they are the same. Before, it starts and ends there, with rates 0 and 1 and
        no second ones.
        """
        if time >= self.end or self.duration == 0.0:
            return time
        u = self._fraction(time)
        return self.end + self.duration * u**3 * (u * (7.0 - 3.0 * u) - 4.0)

    def shift(self, time: float) -> Array:
        """(3,) m, by which that pose is farther back at a time (s), so that the body flies forwards
        only, at a speed that rises as 10 u^3 - 15 u^4 + 6 u^5."""
        if time >= self.end or self.duration == 0.0:
            return np.zeros(3)
        u = self._fraction(time)
        flown = self.end + self.duration * (u**4 * (2.5 + u * (u - 3.0)) - 0.5)
        return (flown - self.own(time)) * np.array(self.velocity)

    def _fraction(self, time: float) -> float:
        return max(1.0 + (time - self.end) / self.duration, 0.0)


# of what begins at rest
NO_RUN_UP = RunUp()


class RunUpRoots(NamedTuple):
    """Roots whose motion is brought up from rest before the first frame."""

    motion: Roots
    run_up: RunUp

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame."""
        positions, rotations = self.motion.frames(self.run_up.own(time))
        return RootFrames(positions + self.run_up.shift(time), rotations)

    def some(self, chosen: Indices) -> Roots:
        """Return those of feathers (K,), by numbers in ascending order."""
        return self._replace(motion=some_roots(self.motion, chosen))


def run_up_of(motion: Roots, duration: float, tolerance: float, end: float = 0.0) -> RunUp | None:
    """Find how a motion is brought up within a duration (s) before a time (s, end); None where no
    root moves there by more than a small part of a tolerance (m)."""
    back, middle, last = (
        motion.frames(end - fraction * duration) for fraction in (_BACK, 0.5 * _BACK, 0.0)
    )
    if not any(
        bool(np.abs(now - end).max(initial=0.0) > STILL * tolerance)
        for each in (back, middle)
        for now, end in zip(each, last, strict=True)
    ):
        return None
    step = _STEP * duration
    velocities = (last.positions - motion.frames(end - step).positions) / step
    low, high = velocities.min(axis=0), velocities.max(axis=0)
    x, y, z = np.clip(0.0, low, high).tolist()
    return RunUp(duration, (x, y, z), end)
