"""The ceiling of a coat bounds how far it rises: by feathers over it, such as a folded wing, and
where the skin is hollow.

With y the points of these feathers, over their feet x on the carrier by heights H, there is room at
x' for a rise of

    (min (0.8 H + m |x' - x|) - T (d + s) - a w) / v,    |x' - x| along edges of the skin

with w and v at the greatest s of the leaves there.
Ways n from a hollow skin meet at the height H where det (1 + H grad n) = 0.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.surface_elements import spread_heights
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, unit
from featherfx.coat.coat import Coat
from featherfx.coat.leaf_kernels import DOWN_SHARE, HINGE
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import closest

# of the height of what lies above, and of that where ways from the skin meet, that a coat fills
_FILLED_RATIO, _MEETING_RATIO = 0.8, 0.4
# m: rise of the ceiling over the distance from what lies above
_SLOPE = 0.5
# of the feathers' length there: what is higher bounds nothing
_MAX_HEIGHT = 1.0


def find_ceiling(coat: Coat, above: Array, reach: Array, ways: Array) -> Array:
    """Return (V,) m, by which a coat may rise at the vertices of its skin, inf where nothing is
    near.

    above: (N, 3) m, points that may lie over it, at rest. reach: (V,) greatest s there. ways:
    (V, 3) unit, along which it rises.
    """
    faces, rest, fields = coat.mesh.faces, coat.rest, coat.fields
    found = np.full(len(rest.points), np.inf)
    np.minimum.at(found, faces, _MEETING_RATIO * _find_meetings(coat, ways)[:, None])
    if len(above):
        away, _ = search_tree(rest.points).query(above)
        above = above[away < 2.0 * _MAX_HEIGHT * fields.length.max()]
        triangle, place = closest(above, rest.points[faces])
        corners = faces[triangle]
        foot, normal, length = (
            np.einsum("nk,nk...->n...", place, each[corners])
            for each in (rest.points, rest.normals[:, :3], fields.length)
        )
        height = dots(above - foot, unit(normal))
        near = (height > 0.0) & (height < _MAX_HEIGHT * length)
        for k in range(3):
            own = corners[near, k]
            away = np.linalg.norm(rest.points[own] - foot[near], axis=1)
            np.minimum.at(found, own, _FILLED_RATIO * height[near] + _SLOPE * away)
    floor = -2.0 * _MAX_HEIGHT * fields.length
    found = -spread_heights(rest.points, faces, -found, _SLOPE, floor)
    room = found - (DOWN_SHARE + reach) * fields.thickness - fields.lift * reach**2
    return np.asarray(np.maximum(room, 0.0) * (reach + HINGE) / ((1.0 + HINGE) * reach**2))


def _find_meetings(coat: Coat, ways: Array) -> Array:
    """Return (T,) m, heights at which ways (V, 3) from a triangle meet, inf where they part."""
    turns = np.einsum("tki,tkj->tij", coat.rest.elements.gradients, ways[coat.mesh.faces])
    trace, square = np.trace(turns, axis1=1, axis2=2), np.einsum("tij,tji->t", turns, turns)
    # the lesser principal curvature, of 1 + H trace + H^2 det = 0
    least = 0.5 * (trace - np.sqrt(np.maximum(2.0 * square - trace * trace, 0.0)))
    return np.asarray(1.0 / np.maximum(-least, np.finfo(float).tiny))


def limit_rises(rises: Array, ceiling: Array) -> Array:
    """Return (V,) m, rises that stay below a ceiling, smoothly. rises: (V,) m."""
    up = np.maximum(rises, 0.0)
    ratio = up / np.maximum(ceiling, np.finfo(float).tiny)
    return np.minimum(rises, 0.0) + up / np.hypot(1.0, ratio)
