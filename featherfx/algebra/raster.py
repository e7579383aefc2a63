"""Nodes of a lattice in the triangles of a plane."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices

_AT_ONCE = 4_000_000  # nodes in boxes around triangles
_RIM = 1e-9  # share of a triangle, by which its rim counts as within


class Within(NamedTuple):
    """K nodes within triangles. triangle, i, j: (K,). u, v: (K,) shares of its second and third
    corner."""

    triangle: Indices
    i: Indices
    j: Indices
    u: Array
    v: Array


def nodes_within(corners: Array, shape: tuple[int, int]) -> Iterator[Within]:
    """Nodes (i, j) of a lattice of a shape within triangles (T, 3, 2), in pieces.

    corners: in steps of the lattice, from its first node.
    """
    start = np.maximum(np.ceil(corners.min(axis=1) - 1e-6).astype(np.int64), 0)
    end = np.minimum(np.floor(corners.max(axis=1) + 1e-6).astype(np.int64) + 1, shape)
    wide = np.maximum(end - start, 0)
    ends = np.cumsum(wide.prod(axis=1))
    low = 0
    while low < len(corners):
        before = ends[low - 1] if low else 0
        high = max(int(np.searchsorted(ends, before + _AT_ONCE, "right")), low + 1)
        yield _within(corners[low:high], start[low:high], wide[low:high], low)
        low = high


def _within(corners: Array, start: Indices, wide: Indices, offset: int) -> Within:
    count = wide.prod(axis=1)
    t = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(t)) - np.repeat(np.cumsum(count) - count, count)
    i, j = start[t, 0] + number // wide[t, 1], start[t, 1] + number % wide[t, 1]
    sides = corners[:, 1:] - corners[:, :1]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    inverse = np.where(np.abs(area) < 1e-9, np.nan, 1.0 / np.where(area == 0.0, 1.0, area))
    away = np.stack([i, j], axis=1) - corners[t, 0]
    first, second = sides[t, 0], sides[t, 1]
    u = (away[:, 0] * second[:, 1] - away[:, 1] * second[:, 0]) * inverse[t]
    v = (first[:, 0] * away[:, 1] - first[:, 1] * away[:, 0]) * inverse[t]
    inside = (u >= -_RIM) & (v >= -_RIM) & (u + v <= 1.0 + _RIM)
    return Within(t[inside] + offset, i[inside], j[inside], u[inside], v[inside])
