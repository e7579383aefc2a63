"""The barb grid of a cached mesh, which its texture coordinates tell."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.algebra.vectors import face_products
from featherfx.errors import InputError, Problem
from featherfx.feather.types import LEADING, TRAILING
from featherfx.usd.read.cached_feather import CachedFeather


@dataclass(frozen=True)
class BarbGrid:
    """The barb grid of one mesh of V points, n rows and m columns.

    tube: (K,) points of the rachis's surface, row by row, and first: (n,) first index of each row
    among them; a row's rachis point is their mean. nodes: (2, n, m + 1) points of the left and
    right barbs, root first; V + i is the rachis point of row i. row, node: (V,) where each point
    is, node as of RowPoints with left barbs first.
    """

    tube: Indices
    first: Indices
    nodes: Indices
    row: Indices
    node: Indices

    def values(self, points: Array | Floats) -> tuple[Floats, Floats, Floats]:
        """Return rachis (n, 3), left and right barbs (n, m, 3) of surface points (V, 3)."""
        counts = np.diff(self.first, append=len(self.tube))
        rachis = np.add.reduceat(points[self.tube], self.first, axis=0, dtype=float)
        rachis /= counts[:, None]
        left, right = np.concatenate([points, rachis.astype(points.dtype)])[self.nodes]
        return left[:, 0], left[:, 1:], right[:, 1:]


def find_grid(path: str | Path, feather: CachedFeather, pose: Any) -> BarbGrid:
    """Return rows and columns from the texture coordinates.

    v is the row, u - 1/2 counts barb nodes.
    """
    problem = Problem(
        str(path), feather.path, "has no barb grid with st and sides. Give a cache of featherfx"
    )
    if feather.st is None:
        raise InputError(problem)
    vane = np.unique(feather.triangles[feather.side != 2])
    tube = np.unique(feather.triangles[feather.side == 2])
    if len(vane) == 0 or len(tube) == 0:
        raise InputError(problem)
    across = feather.st[vane, 0].astype(float) - 0.5
    steps = np.unique(np.round(np.abs(across[np.abs(across) > 1e-5]), 6))
    columns = round(0.5 / steps[0]) if len(steps) else 0
    node = np.round(across * 2 * columns).astype(int)
    whole = columns > 0 and np.allclose(node / (2.0 * columns), across, atol=1e-4)
    if not whole or np.abs(node).max() > columns:
        raise InputError(problem)
    stations, row = np.unique(feather.st[tube, 1], return_inverse=True)
    row_of_vane = np.searchsorted(stations, feather.st[vane, 1])
    if not np.isin(feather.st[vane, 1], stations).all():
        raise InputError(problem)
    # what no triangle uses, as in the calamus, is the row's rachis point
    rachis = len(pose.points) + np.arange(len(stations))
    nodes = np.tile(rachis[:, None], (2, 1, columns + 1))
    for side, sign in ((LEADING, 1), (TRAILING, -1)):
        # of lips at one place the barb's own, which come first, count
        own = np.flatnonzero(node * sign > 0)[::-1]
        nodes[side, row_of_vane[own], np.abs(node[own])] = vane[own]
    order = np.argsort(row, kind="stable")
    rows, numbers = np.zeros((2, len(pose.points)), dtype=np.int64)
    rows[tube], rows[vane], numbers[vane] = row, row_of_vane, node
    first = np.searchsorted(row[order], np.arange(len(stations)))
    grid = BarbGrid(tube[order], first, nodes, rows, _node_numbers(numbers, columns))
    if not _leading_is_right(grid, feather, pose):
        return grid
    return replace(grid, nodes=nodes[::-1], node=_node_numbers(-numbers, columns))


def _node_numbers(places: Indices, columns: int) -> Indices:
    """(V,) numbers of nodes in their rows from places along the barbs, of second ones below 0."""
    return np.where(places < 0, columns - places, places)


def _leading_is_right(grid: BarbGrid, feather: CachedFeather, pose: Any) -> bool:
    """Return whether the leading side of a grid is the right one, seen from dorsal."""
    points = pose.points.astype(float)
    rachis, leading, trailing = grid.values(pose.points)
    tangent, apart = np.gradient(rachis, axis=0), leading[:, -1] - trailing[:, -1]
    corners = points[feather.triangles[feather.side != 2]]
    dorsal = face_products(corners).sum(axis=0)
    return float((np.cross(dorsal, tangent) * apart).sum()) < 0.0
