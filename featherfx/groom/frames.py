"""Mirror images of feathers, and places along a polyline. Batches first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import arc_lengths


@dataclass(frozen=True)
class Mirror:
    """A plane. normal: (3,) unit. distance: m, from the origin along the normal."""

    normal: Array
    distance: float = 0.0

    def points(self, points: Array) -> Array:
        """(..., 3) points mirrored."""
        above = points @ self.normal - self.distance
        return np.asarray(points - 2.0 * above[..., None] * self.normal)

    def directions(self, vectors: Array) -> Array:
        """(3,) direction mirrored."""
        return np.asarray(vectors - 2.0 * (vectors @ self.normal) * self.normal)

    def rotation_vectors(self, vectors: Array) -> Array:
        """(3,) rotation vector mirrored: it changes its sense, too."""
        return -self.directions(vectors)

    def screw(self, screw: Array) -> Array:
        """(6,) rotation vector and velocity of the origin, mirrored."""
        turning = screw[:3]
        there = 2.0 * self.distance * self.normal  # whose image the origin is
        velocity = screw[3:] + np.cross(turning, there)
        return np.concatenate([self.rotation_vectors(turning), self.directions(velocity)])

    def frames(self, rotation: Array) -> Array:
        """(..., 3, 3) frames of feathers mirrored, right-handed, dorsal still dorsal.

        x and z of the feather are mirrored, and y follows from them, so that the leading vane
        changes to the other side of its frame.
        """
        reflection = np.eye(3) - 2.0 * np.outer(self.normal, self.normal)
        return np.asarray(reflection @ rotation * (1.0, -1.0, 1.0))


def along_polyline(points: Array, fraction: Array) -> Array:
    """(n, 3) points at fractions of a polyline's length. points: (k, 3), k >= 2."""
    station = arc_lengths(points)
    at = np.asarray(fraction, dtype=float) * station[-1]
    return np.column_stack([np.interp(at, station, points[:, axis]) for axis in range(3)])
