"""Feathers on a curved skin: how far it falls off beneath them, and turns that lay them along it.

A feather bends about two axes at most, a skin also twists beneath it: feathers that stand by the
skin at their roots alone are askew on a neck, by 14 deg one way or the other in a tenth of the
pigeon's. So each is raised and rolled by the least squares over some of its places (linearised,
those far off counting less: Huber 1964).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, unit, vectors_to_frames
from featherfx.groom.skin.points import SkinSurface, SurfacePoints

# a skin that falls off further is not followed
_MAX_TURNING = 45.0  # deg
# in feather lengths, of a contour feather's middle barbs: where one begins on the shaft, its way
# forward and to the side
BARB_SAMPLE_ROW, _BARB = 0.3, (0.3, 0.25)
# places along the shaft and to its sides, in feather lengths
_PLACES = np.array(
    [(0.3, 0.0), (0.6, 0.0), (0.9, 0.0), (0.5, 0.2), (0.5, -0.2), (0.8, 0.2), (0.8, -0.2)]
)
_FAR = 0.1  # of a feather's length, from which on a place counts less
_MAX_LAID = np.radians(20.0)
_ROUNDS = 3


class SkinBends(NamedTuple):
    """Bends of feathers on a skin, (N,) deg. along: rachis to the tip. across: barbs."""

    along: Array
    across: Array


def bends_of_skin(points: SurfacePoints, direction: Array, length: Array) -> SkinBends:
    """Measure how a skin falls off beneath feathers, from root to tip and from rachis to edge.

    At least 0. Where the skin ends before the tip does, what the first half shows counts.
    direction: (N, 3) unit. length: (N,) m.
    """
    surface = points.surface
    half = _fall(surface, points.position, points.normal, 0.5 * length[:, None] * direction)
    whole = _fall(surface, points.position, points.normal, length[:, None] * direction)
    start = points.position + BARB_SAMPLE_ROW * length[:, None] * direction
    normal = surface.normals_near(start)
    forward, side = _BARB
    aside = side * np.cross(points.normal, direction)
    ways = [length[:, None] * (forward * direction + sign * aside) for sign in (1.0, -1.0)]
    across = 0.5 * sum(_fall(surface, start, normal, way) for way in ways)
    return SkinBends(np.minimum(whole, 2.0 * half), np.asarray(across))


def _fall(surface: SkinSurface, start: Array, normal: Array, way: Array) -> Array:
    """(N,) deg, by which the skin's normal leans towards a way (N, 3) m, at its end."""
    ends = surface.normals_near(start + way)
    ahead = dots(ends, unit(way - dots(way, normal)[:, None] * normal))
    return np.clip(np.degrees(np.arctan2(ahead, dots(ends, normal))), 0.0, _MAX_TURNING)


def laid_along(
    points: SurfacePoints, rotations: Array, length: Array, tilt: Array, bends: SkinBends
) -> Array:
    """Frames (N, 3, 3) of feathers, raised and rolled to lie at a tilt (N,) deg to the skin all
    along. length: (N,) m."""
    local = _shape(bends)
    wanted = local[:, :, 0] * np.sin(np.radians(tilt))[:, None]
    for _ in range(_ROUNDS):
        world = points.position[:, None] + length[:, None, None] * np.einsum(
            "nij,nkj->nki", rotations, local
        )
        heights = points.surface.heights_near(world.reshape(-1, 3)).reshape(wanted.shape)
        astray = heights / length[:, None] - wanted
        weights = _FAR / np.maximum(np.abs(astray), _FAR)
        sides = local[:, :, :2]
        normal_matrix = np.einsum("nk,nki,nkj->nij", weights, sides, sides)
        pulls = -np.einsum("nk,nki,nk->ni", weights, sides, astray)
        raised, rolled = np.linalg.solve(normal_matrix, pulls[:, :, None])[:, :, 0].T
        turns = np.stack([rolled, -raised, np.zeros(len(raised))], axis=1)
        size = np.maximum(np.linalg.norm(turns, axis=1, keepdims=True), _MAX_LAID)
        rotations = rotations @ vectors_to_frames(turns * _MAX_LAID / size)
    return rotations


def _shape(bends: SkinBends) -> Array:
    """(N, K, 3) places of feathers whose shafts and barbs are arcs, in lengths, in their frames."""
    x, y = _PLACES.T
    along = np.radians(bends.along)[:, None]
    # a barb that goes forward as well bends away from the shaft's tangent where it begins
    across = np.radians(bends.across)[:, None] / np.hypot(*_BARB)
    aside = np.abs(y)
    ahead = _BARB[0] / _BARB[1] * aside
    root = x - ahead
    low = 0.5 * along * root**2 + along * root * ahead + 0.5 * across * (ahead**2 + aside**2)
    return np.stack(np.broadcast_arrays(x, y, -low), axis=2)
