"""Frames of a shot: time codes of stages over them, and poses of feathers.

A frame is the time code of its number, but for cuts.
Frames are counted from 0 s on. A cut from frame k to k + 1 happens right after k: until then
everything is as the frames before lead it, from then on as the frames after do. So nothing moves
between the two poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import repeat
from math import isfinite
from typing import NamedTuple

import numpy as np

from featherfx.algebra.interpolation import Knots
from featherfx.algebra.types import Array
from featherfx.errors import require_type
from featherfx.feather.types import Feather, RowPoints, both, turned
from featherfx.groom.keys.problems import nearest
from featherfx.mechanics.model import Gaps

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


# feathers whose points are copied to be looked at in one call
_LOOKED_AT = 64


class FeatherPose(NamedTuple):
    """Nodes and directors of one feather, world frame, and their rates per second.

    gaps: of a vane whose hooks may slip, else None. clumped: how far barbs that are drawn come
    together, 0 to 1, and in how many clumps a vane.
    """

    points: RowPoints
    velocities: RowPoints
    accelerations: RowPoints
    gaps: Gaps | None = None
    clumped: tuple[float, int] = (0.0, 1)

    @staticmethod
    def each(moving: Sequence[RowPoints]) -> Iterator[FeatherPose]:
        """Those of points and both rates (F, ...) of many feathers, as quickly as Python can; rates
        that are left out are nan."""
        none = repeat(both(lambda x: np.full(x.shape[1:], np.nan), moving[0]))
        parts = [*(part.each() for part in moving), none, none][:3]
        values = zip(*parts, repeat(None), repeat((0.0, 1)), strict=False)
        return map(tuple.__new__, repeat(FeatherPose), values)


@dataclass(frozen=True)
class Frame:
    """One frame of every feather, handed to a sink.

    number: frame number; fractional between two frames. time: s since the first frame. poses: of
    the feathers. ids, feathers: theirs.
    """

    number: float
    time: float
    poses: tuple[FeatherPose, ...] = field(repr=False)
    ids: Sequence[str] = field(default=(), repr=False)
    feathers: Sequence[Feather] = field(default=(), repr=False)

    def in_seconds_of(self, ratio: float) -> Frame:
        """Return the frame with rates per second of a stage whose seconds have so many times the
        time codes."""
        poses = (
            each._replace(
                velocities=RowPoints(*(ratio * part for part in each.velocities)),
                accelerations=RowPoints(*(ratio**2 * part for part in each.accelerations)),
            )
            for each in self.poses
        )
        return replace(self, poses=tuple(poses))

    @property
    def points(self) -> Mapping[str, Array]:
        """(V, 3) m, world, of each feather's mesh by its id; computed when it is looked up."""
        return MeshPoints(self, "points")

    @property
    def velocities(self) -> Mapping[str, Array]:
        """The first rates of points, m/s."""
        return MeshPoints(self, "velocities")

    @property
    def accelerations(self) -> Mapping[str, Array]:
        """The second rates of points, m/s^2."""
        return MeshPoints(self, "accelerations")

    @property
    def rows(self) -> tuple[Array, ...]:
        """(n, 3 + 2 m, 3) of every feather, m and unit vectors, as RowPoints.rows gives them."""
        return tuple(pose.points.rows() for pose in self.poses)

    @property
    def row_velocities(self) -> tuple[Array, ...]:
        """The first rates of rows, per second."""
        return tuple(pose.velocities.rows() for pose in self.poses)

    @property
    def row_accelerations(self) -> tuple[Array, ...]:
        """The second rates of rows, per second squared."""
        return tuple(pose.accelerations.rows() for pose in self.poses)


class MeshPoints(Mapping[str, Array]):
    """Points of the meshes of a frame, or their rates, by feather id. part: which of a pose."""

    def __init__(self, frame: Frame, part: str) -> None:
        self._frame, self._part = frame, part

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self._frame.ids)}

    def __getitem__(self, name: str) -> Array:
        require_type("id", name, str, f"an id, such as {next(iter(self._numbers), '')!r}")
        if name not in self._numbers:
            raise KeyError(f"no feather {name!r}, {nearest(str(name), self._numbers)}")
        number = self._numbers[name]
        surface = self._frame.feathers[number].surface
        return surface.points(getattr(self._frame.poses[number], self._part))

    def __iter__(self) -> Iterator[str]:
        return iter(self._frame.ids)

    def __len__(self) -> int:
        return len(self._frame.ids)


def place(points: RowPoints, position: Array, rotation: Array) -> RowPoints:
    """Place what is given in the feather frame in the world frame.

    position: (3,) m and rotation: (3, 3) of the root.
    """
    return turned(rotation.T, points).shifted(position)


def not_finite(poses: Sequence[FeatherPose]) -> int | None:
    """Place of the first that has a point which is not finite. All are of one grid."""
    for first in range(0, len(poses), _LOOKED_AT):
        some = poses[first : first + _LOOKED_AT]
        parts = zip(*(pose.points for pose in some), strict=True)
        if not all(_finite(np.concatenate(each)) for each in parts):
            bad = (k for k, pose in enumerate(some) if not all(map(_finite, pose.points)))
            return first + next(bad)
    return None


def _finite(part: Array) -> bool:
    """Return whether all numbers are; they have no finite sum where one is not. By np.sum, as a
    product of long arrays wakes the threads of BLAS, which wait busily for each other."""
    return isfinite(np.sum(part)) or bool(np.isfinite(part).all())


def sample_number(first: int, index: int, subframes: int) -> float:
    """Frame number of a sample, 0 at the first frame; the same for the same place in time.

    Whole frames are integers. The fraction is divided by itself, so that the number does not
    depend on where the counting began.
    """
    whole, part = divmod(index, subframes)
    return first + whole + part / subframes if part else first + whole
