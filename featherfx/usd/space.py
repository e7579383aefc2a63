"""Units, up axis and origin of a stage: from the world, metres and z up, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from featherfx.algebra.types import Array
from featherfx.usd.write.options import StageOptions

# m from the world's origin, beyond which points of single precision would be coarse
_MAX_DISTANCE = 100.0


@dataclass(frozen=True)
class StageSpace:
    """Units, up axis and origin of a stage.

    meters_per_unit: m, length of one stage unit. up_axis: "Y" or "Z". origin: m, world, position of
    the root prim; points are written relative to it.
    """

    meters_per_unit: float = 1.0
    up_axis: str = "Z"
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @staticmethod
    def from_options(options: StageOptions) -> StageSpace:
        """Return the space of options; default: metres and "Z"."""
        unit, axis = options.meters_per_unit, options.up_axis
        return StageSpace(1.0 if unit is None else unit, "Z" if axis is None else axis)

    @property
    def is_moved(self) -> bool:
        """Return whether the root prim stands away from the world's origin."""
        return self.origin != (0.0, 0.0, 0.0)

    @property
    def to_world(self) -> Array:
        """Return (3, 3) from the stage to the world, metres and z up, for row vectors."""
        turn = np.eye(3)
        if self.up_axis == "Y":
            turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return self.meters_per_unit * turn

    def directions(self, vectors: Array) -> Array:
        """Return (..., 3) directions, rotated but not scaled."""
        if self.up_axis == "Z":
            return vectors
        # A quarter turn about x: a proper rotation, so that windings keep their sense.
        return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)

    def positions(self, points: Array) -> Array:
        """Return (..., 3) m (or m/s), rotated and scaled to stage units."""
        return self.directions(points) / self.meters_per_unit

    def lengths(self, values: Array) -> Array:
        """Return lengths in m, in stage units."""
        return values / self.meters_per_unit


def choose_origin(positions: ArrayLike) -> tuple[float, float, float]:
    """Return the origin of the root prim for feathers at (N, 3) positions, m.

    It is the world's origin unless the feathers are far from it, else their middle in whole metres.
    """
    middle: Array = np.round(np.reshape(positions, (-1, 3)).mean(axis=0))
    if np.linalg.norm(middle) <= _MAX_DISTANCE:
        return 0.0, 0.0, 0.0
    return float(middle[0]), float(middle[1]), float(middle[2])
