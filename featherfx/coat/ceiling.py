"""The ceiling of a coat: feathers that lie over it, such as a folded wing, bound how far it rises.

With y the points of these feathers, over their feet x on the carrier by heights H, there is room at
x' for a rise of

    min (0.8 H + m |x' - x|) - T (1 + d) - a,    |x' - x| along edges of the skin
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, unit
from featherfx.coat.coat import Coat
from featherfx.coat.leaf_kernels import DOWN_SHARE
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import closest

# of the height of what lies above, that a coat fills
_FILLED_RATIO = 0.8
# m: rise of the ceiling over the distance from what lies above
_SLOPE = 0.5
# of the feathers' length there: what is higher bounds nothing
_MAX_HEIGHT = 1.0


def find_ceiling(coat: Coat, above: Array) -> Array:
    """Return (V,) m, by which a coat may rise at the vertices of its skin, inf where nothing is
    near. above: (N, 3) m, points that may lie over it, at rest."""
    faces, rest, fields = coat.mesh.faces, coat.rest, coat.fields
    found = np.full(len(rest.points), np.inf)
    if not len(above):
        return found
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
    edges = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    edges = np.concatenate([edges, edges[:, ::-1]])
    steps = _SLOPE * np.linalg.norm(np.diff(rest.points[edges], axis=1)[:, 0], axis=1)
    before = np.zeros_like(found)
    while (found != before).any():
        before = found.copy()
        np.minimum.at(found, edges[:, 0], before[edges[:, 1]] + steps)
        found[found > 2.0 * _MAX_HEIGHT * fields.length] = np.inf
    return np.maximum(found - (1.0 + DOWN_SHARE) * fields.thickness - fields.lift, 0.0)


def limit_rises(rises: Array, ceiling: Array) -> Array:
    """Return (V,) m, rises that stay below a ceiling, smoothly. rises: (V,) m."""
    up = np.maximum(rises, 0.0)
    ratio = up / np.maximum(ceiling, np.finfo(float).tiny)
    return np.minimum(rises, 0.0) + up / (1.0 + np.minimum(ratio, 1e9) ** 4) ** 0.25
