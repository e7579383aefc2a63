"""Frames of a shot, and poses of feathers."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import repeat
from math import isfinite
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import require_type
from featherfx.feather.types import Feather, RowPoints, turned
from featherfx.groom.keys.problems import nearest
from featherfx.mechanics.model import Gaps

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
    def each(moving: Iterable[RowPoints]) -> Iterator[FeatherPose]:
        """Those of points and both rates (F, ...) of many feathers, as quickly as Python can."""
        rest = repeat(None), repeat((0.0, 1))
        return map(
            tuple.__new__,
            repeat(FeatherPose),
            zip(*(part.each() for part in moving), *rest, strict=False),
        )


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
