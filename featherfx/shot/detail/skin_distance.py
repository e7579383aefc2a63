"""Distances along a skin between the roots of feathers, over a graph.

Nodes are the skin's points and the roots. Edges are those of the skin's triangles, from every root
to the corners of the triangle that it is nearest to, and straight between roots near each other
whose triangles share a corner. Shortest ways over edges are never shorter than geodesics and, on
even meshes, up to about a tenth longer; weights that fall smoothly with distance need no more.
They do not leap from a leg to the belly, as straight distances do. Without a skin, straight
distances are taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.skin.skin import closest

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_NEAR_ROOTS = 12
# corners of one point of the skin may differ by rounding, m
_WELD_DIGITS = 9
# rows of distances that are held at once
_SOURCES_AT_ONCE = 256


def root_distances(
    roots: Array, sources: Indices, corners: Array | None, reach: float
) -> tuple[Indices, Indices, Array]:
    """Ways from some of the roots, by their numbers, to all roots (F, 3) m that are within reach.

    Returns source (K,), its place in sources; root (K,); and distance (K,) m. corners: (T, 3, 3) m
    of the skin, or None for straight distances. reach: m. Parts of a skin that do not hang
    together are out of reach of each other.
    """
    graph = None if corners is None or not len(corners) else _graph(roots, corners)
    found = []
    for start in range(0, len(sources), _SOURCES_AT_ONCE):
        some = sources[start : start + _SOURCES_AT_ONCE]
        ways = _straight(roots, some) if graph is None else _along(*graph, some, reach)
        source, root = np.nonzero(ways <= reach)
        found.append((start + source, root, ways[source, root]))
    source, root, way = (np.concatenate(part) for part in zip(*found, strict=True))
    return source, root, way


def _straight(roots: Array, sources: Indices) -> Array:
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(roots[sources], roots))


def _along(graph: Any, first: int, sources: Indices, reach: float) -> Array:
    from scipy.sparse.csgraph import dijkstra

    ways = dijkstra(graph, directed=False, indices=first + sources, limit=reach)
    return np.asarray(ways[:, first:])


def _graph(roots: Array, corners: Array) -> tuple[Any, int]:
    """Sparse graph of lengths, and the number of the first root's node."""
    from scipy import sparse
    from scipy.spatial import cKDTree

    points, number = np.unique(
        np.round(corners.reshape(-1, 3), _WELD_DIGITS), axis=0, return_inverse=True
    )
    triangles = number.reshape(-1, 3)
    on, _ = closest(roots, corners)
    first, count = len(points), len(points) + len(roots)
    every, own = first + np.arange(len(roots)), triangles[on]
    ends = [triangles[:, (k, (k + 1) % 3)] for k in range(3)]
    ends += [np.column_stack([every, own[:, k]]) for k in range(3)]
    _, near = cKDTree(roots).query(roots, k=min(_NEAR_ROOTS + 1, len(roots)))
    near = near.reshape(len(roots), -1)
    pairs = np.column_stack([np.repeat(np.arange(len(roots)), near.shape[1]), near.ravel()])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    shared = (own[pairs[:, 0], :, None] == own[pairs[:, 1], None, :]).any(axis=(1, 2))
    ends.append(first + pairs[shared])
    edges = np.unique(np.sort(np.concatenate(ends), axis=1), axis=0)
    places = np.concatenate([points, roots])
    lengths = np.linalg.norm(places[edges[:, 0]] - places[edges[:, 1]], axis=1)
    # an edge without length would be no edge to the graph's routines
    lengths = np.maximum(lengths, 1e-12)
    graph = sparse.coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(count, count))
    return graph.tocsr(), first
