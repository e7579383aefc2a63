"""A folded wing is no board: it bends round the body, about a line along its feathers.

Each feather is carried over rigidly, by the turn and the shift of a cylinder at the middle of its
shaft, so that feathers that lay on each other in the plane still do where their vanes are as hollow
as the cylinder. Along the feathers the wing is as curved as these are: each goes on where the arc
that all share has come to at its root. An open wing is flat, and bends late as it folds, when its
fan is nearly closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import vectors_to_frames

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bow:
    """A cylinder that touches the folded wing's plane. middle: (3,) m, where it does. along,
    across, dorsal: (3,) units, the axis, the way to the outer feathers, and out of the plane.
    radius: m. edge: m, across, from where on it is flat: the hand with its primaries. curvature:
    1/m, of all shafts."""

    middle: Array
    along: Array
    across: Array
    dorsal: Array
    radius: float
    edge: float
    curvature: float

    def ways(self, positions: Array, rotations: Array, lengths: Array) -> Array:
        """(N,) m, of the middles of shafts across the cylinder."""
        middles = positions + 0.5 * lengths[:, None] * rotations[:, :, 0]
        return np.asarray((middles - self.middle) @ self.across)

    def bent(self, ways: Array, roots: Array, positions: Array) -> tuple[Array, Array]:
        """The (N, 3, 3) turns and the new places (N, 3) m of positions in the plane.

        ways: (N,) m across. roots: (N, 3) m, of the flight feathers that they belong to.
        """
        ways = np.minimum(ways, self.edge)
        sense = float(np.cross(self.across, self.dorsal) @ self.along)
        # outwards is down the cylinder: the dorsal side turns towards `across`
        turns = vectors_to_frames(np.outer(-sense * ways / self.radius, self.along))
        arcs, positions = self._along_arc(roots, positions)
        centre = self.middle - self.radius * self.dorsal
        flat = positions - np.outer(ways, self.across) - centre
        return turns @ arcs, centre + np.einsum("nij,nj->ni", turns, flat)

    def _along_arc(self, roots: Array, positions: Array) -> tuple[Array, Array]:
        if self.curvature == 0.0:
            return np.eye(3), positions
        ways = (roots - self.middle) @ self.along
        turns = vectors_to_frames(
            np.outer(ways * self.curvature, np.cross(self.dorsal, self.along))
        )
        centre = self.middle - self.dorsal / self.curvature
        flat = positions - np.outer(ways, self.along) - centre
        return turns, centre + np.einsum("nij,nj->ni", turns, flat)


_FLATTEST = 1e-6  # rad, for a wing that bends along its feathers alone


def bow_share(fold: Array | float) -> Any:
    """How much of its bow a wing has at a fold: its sixth power, so late that fans are closed."""
    return np.maximum(fold, 0.0) ** 6


def bow_of(
    points: Array, shafts: Array, dorsal: Array, degrees: float, curvature: float
) -> Bow | None:
    """The bow of a folded wing; None for a flat one.

    points: (N, 3) m, middles of the flight feathers of the arm from the innermost outwards, and
    shafts: (N, 3) units. dorsal: (3,). degrees: between the first and the last. curvature: 1/m, of
    all shafts.
    """
    if len(points) < 2 or (degrees == 0.0 and curvature == 0.0):
        return None
    along = shafts.sum(axis=0)
    along /= np.linalg.norm(along)
    across = np.cross(dorsal, along)
    ways = points @ across
    if ways[-1] < ways[0]:
        across, ways = -across, -ways
    half = 0.5 * (ways[-1] - ways[0])
    middle = points[0] + half * across
    radius = 2.0 * half / max(np.radians(degrees), _FLATTEST)
    return Bow(middle, along, across, dorsal, radius, half, curvature)
