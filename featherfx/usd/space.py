"""The stage's units and up axis: world frame (metres, z up) to stage coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.usd.write.options import StageOptions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StageSpace:
    """meters_per_unit: m, length of one stage unit. up_axis: "Y" or "Z"."""

    meters_per_unit: float = 1.0
    up_axis: str = "Z"

    @staticmethod
    def of(options: StageOptions) -> StageSpace:
        """As options say: metres and "Z" where they leave it open."""
        unit, axis = options.meters_per_unit, options.up_axis
        return StageSpace(1.0 if unit is None else unit, "Z" if axis is None else axis)

    def directions(self, vectors: Array) -> Array:
        """(..., 3) directions, turned but not scaled."""
        if self.up_axis == "Z":
            return vectors
        # A quarter turn about x: a proper rotation, so that windings keep their sense.
        return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)

    def positions(self, points: Array) -> Array:
        """(..., 3) m (or m/s), turned and scaled to stage units."""
        return self.directions(points) / self.meters_per_unit

    def lengths(self, values: Array) -> Array:
        """Lengths in m, in stage units."""
        return values / self.meters_per_unit
