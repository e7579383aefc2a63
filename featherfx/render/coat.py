"""Shading of plumage as one surface, where its feathers are small in the image.

Light that enters a coat is scattered by many vanes that lie on each other before it leaves, so
that neighbours are lit alike; and what of a feather is smaller than a few pixels is no shape of its
own. Each feather has a normal of the coat about it at a few places along its shaft, the mean over
vanes near there that look the same way, towards which its own normals are drawn.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import unit

_PLACES = 4  # along a feather, at the middles of as many equal parts of it
_NEAR = 32  # places of vanes that are looked at
_MOST = 0.75  # how far normals are drawn towards the coat's, at most
_SMALL = 120.0  # pixels, length of a feather up to which they are


def coat_fractions(pixels: Array) -> Array:
    """(N,) how far the normals of feathers are drawn towards the coat's. pixels: (N,) lengths."""
    return np.asarray(_MOST * np.minimum(_SMALL / np.maximum(pixels, 1e-9), 1.0))


def coat_normals(points: Array, triangles: Indices, owner: Indices, heights: Array) -> Array:
    """(N, _PLACES, 3) units, dorsal, of the coat about each feather; zero where it has no vane.

    points: (V, 3) m. triangles: (T, 3) of vanes. owner: (T,) feather, ascending, N of the last and
    1. heights: (T,) of the triangles' middles, 0 to 1 along the feather.
    """
    first, second, third = (points[triangles[:, k]] for k in range(3))
    crossed = np.cross(second - first, third - first)
    count = _PLACES * (int(owner[-1]) + 1)
    cell = _PLACES * owner + np.minimum((heights * _PLACES).astype(np.int64), _PLACES - 1)
    area = np.linalg.norm(crossed, axis=1)
    middles = _summed((first + second + third) / 3.0 * area[:, None], cell, count)
    own = unit(_summed(crossed, cell, count))
    total = np.bincount(cell, area, count)
    there = np.flatnonzero(total > 0.0)
    places = middles[there] / total[there, None]
    distance, near = cKDTree(places).query(places, k=min(_NEAR, len(places)))
    distance, near = distance.reshape(len(places), -1), near.reshape(len(places), -1)
    reach = np.maximum(distance[:, [-1]], 1e-12)
    alike = np.einsum("nc,nkc->nk", own[there], own[there][near])
    weight = (1.0 - 0.9 * (distance / reach) ** 2) * np.maximum(alike, 0.0)
    result = np.zeros((count, 3))
    result[there] = unit(np.einsum("nk,nkc->nc", weight, own[there][near]))
    return result.reshape(-1, _PLACES, 3)


def _summed(values: Array, cell: Indices, count: int) -> Array:
    """(count, 3) sums of values (T, 3) by cell."""
    return np.stack([np.bincount(cell, values[:, k], count) for k in range(3)], axis=1)


def drawn_towards(normals: Array, coat: Array, heights: Array, fractions: Array) -> Array:
    """Normals (n, B, S, 3) of barbs at heights (B,) of n feathers, drawn towards those of the coat.

    coat: (n, _PLACES, 3). fractions: (n,).
    """
    at = np.clip(heights * _PLACES - 0.5, 0.0, _PLACES - 1.0)
    low = np.minimum(at.astype(int), _PLACES - 2)
    part = (at - low)[:, None]
    there = ((1.0 - part) * coat[:, low] + part * coat[:, low + 1])[:, :, None]
    own = unit(normals)
    own = np.where((own * there).sum(axis=-1, keepdims=True) < 0.0, -own, own)
    return mixed(own, there, fractions)


def mixed(first: Array, second: Array, fractions: Array) -> Array:
    """(n, ...) units between first and second (n, B, S, 3). fractions: (n,) of the second."""
    part = fractions[:, None, None, None]
    return np.asarray(unit((1.0 - part) * first + part * second))
