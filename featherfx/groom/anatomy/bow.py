"""A folded wing is no board: it bends round the body, about a line along its feathers.

Each feather is carried over rigidly, as by a cylinder at the middle of its shaft, so that feathers
that lay on each other in the plane still do where their vanes are as hollow as the cylinder. How it
is carried belongs to the forearm: while a fan opens, all that turned as one still does. Along the
feathers the wing is as curved as these are: each goes on where the arc that all share has come to
at its root. An open wing is flat, and bends late as it folds, when its fan is nearly closed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.algebra.rotation import screws_of, vectors_to_frames
from featherfx.algebra.types import Array
from featherfx.groom.types import FeatherKind


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

    def screws(self, ways: Array, roots: Array) -> Array:
        """(N, 6) as of `motions`."""
        return screws_of(*self.motions(ways, roots))

    def motions(self, ways: Array, roots: Array) -> tuple[Array, Array]:
        """Return turns (N, 3, 3) and shifts (N, 3) m from the plane to the cylinder.

        ways: (N,) m across. roots: (N, 3) m, of the flight feathers that they belong to.
        """
        ways = np.minimum(ways, self.edge)
        sense = float(np.cross(self.across, self.dorsal) @ self.along)
        # outwards is down the cylinder: the dorsal side turns towards `across`
        turns = vectors_to_frames(np.outer(-sense * ways / self.radius, self.along))
        centre = self.middle - self.radius * self.dorsal
        shifts = _about(centre, turns, np.outer(ways, self.across))
        arcs, before = self._arcs(roots)
        return turns @ arcs, np.einsum("nij,nj->ni", turns, before) + shifts

    def _arcs(self, roots: Array) -> tuple[Array, Array]:
        if self.curvature == 0.0:
            return np.tile(np.eye(3), (len(roots), 1, 1)), np.zeros_like(roots)
        ways = (roots - self.middle) @ self.along
        axis = np.cross(self.dorsal, self.along)
        turns = vectors_to_frames(np.outer(ways * self.curvature, axis))
        centre = self.middle - self.dorsal / self.curvature
        return turns, _about(centre, turns, np.outer(ways, self.along))


def _about(centre: Array, turns: Array, back: Array) -> Array:
    """(N, 3) shifts of motions that go back (N, 3) and turn (N, 3, 3) about a centre (3,)."""
    return np.asarray(centre - np.einsum("nij,nj->ni", turns, back + centre))


def wrapped(kind: FeatherKind, sizes: Array, within: Array) -> Array:
    """(N, 2) share of the leading and of the trailing vane that lies inwards of the bow's edge.

    sizes: (N,) m, factors of the outlines' widths. within: (N,) m, from the shaft outwards to the
    edge.
    """
    widest = [max(y for _, y in vane.outline) for vane in (kind.leading, kind.trailing)]
    return np.clip(within[:, None] / np.outer(sizes, widest) + (0.0, 1.0), 0.0, 1.0)


_FLATTEST = 1e-6  # rad, for a wing that bends along its feathers alone


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
