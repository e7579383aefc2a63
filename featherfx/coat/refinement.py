"""Finer triangles of a skin that is coarse for its coat, on curves through its corners.

An edge from a to b with unit normals n at its ends is split at the middle of the cubic that leaves
both ends square to these (curved PN triangles, Vlachos et al. 2001):

    (a + b) / 2 + ((a - b) . n_a n_a + (b - a) . n_b n_b) / 8

Both triangles at an edge split it alike, so that none opens.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.surface_elements import find_vertex_normals
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.groom.skin.field import search_tree

# of the length of the nearest feather: longest edge, so that it bends over two facets and more, and
# reach beyond which edges stay
_LONGEST, _REACH = 0.5, 2.0
_ROUNDS = 12  # that halve an edge


def refine(points: Array, faces: Indices, roots: Array, lengths: Array) -> tuple[Array, Indices]:
    """Split edges that are long for the feathers around, until none is.

    points: (V, 3) m, each place once. faces: (T, 3). roots: (F, 3) m and lengths: (F,) m, of
    feathers.
    """
    tree = search_tree(roots)
    for _ in range(_ROUNDS):
        pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
        edges, of_face = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        size = np.linalg.norm(b - a, axis=1)
        away, near = tree.query(0.5 * (a + b))
        long = (size > _LONGEST * lengths[near]) & (away < 0.5 * size + _REACH * lengths[near])
        if not long.any():
            break
        normals = find_vertex_normals(points, faces)
        first, last = (normals[edges[:, k]] for k in range(2))
        lean = dots(a - b, first)[:, None] * first + dots(b - a, last)[:, None] * last
        number = np.where(long, len(points) + np.cumsum(long) - 1, -1)
        points = np.concatenate([points, (0.5 * (a + b) + lean / 8.0)[long]])
        faces = _split(faces, number[of_face.reshape(faces.shape)])
    return points, faces


def _split(faces: Indices, middles: Indices) -> Indices:
    """Split triangles (T, 3) at middles (T, 3) of the edges from each corner on, -1 where whole."""
    found = []
    count = (middles >= 0).sum(axis=1)
    found.append(faces[count == 0])
    for wanted, first in ((1, [True, False, False]), (2, [True, True, False])):
        for turn in range(3):
            own = (count == wanted) & ((np.roll(middles, -turn, axis=1) >= 0) == first).all(axis=1)
            a, b, c = np.roll(faces[own], -turn, axis=1).T
            p, q, _ = np.roll(middles[own], -turn, axis=1).T
            if wanted == 1:
                found += [np.stack(each, axis=1) for each in ((a, p, c), (p, b, c))]
            else:
                found += [np.stack(each, axis=1) for each in ((p, b, q), (a, p, q), (a, q, c))]
    a, b, c = faces[count == 3].T
    p, q, r = middles[count == 3].T
    thirds = (a, p, r), (p, b, q), (r, q, c), (p, q, r)
    return np.concatenate([*found, *(np.stack(each, axis=1) for each in thirds)])
