"""A moving triangle mesh that feathers bump into: its pose over an interval, in a grid of cubes."""

from __future__ import annotations

import numpy as np

from featherfx.jit.compiled import KernelModule
from featherfx.solver.contact.types import Array, CubeGrid, Indices, Wall

wall_kernels = KernelModule("featherfx.solver.contact.wall_kernels")

_MAX_CUBES = 200_000


def wall_of(
    start: Array,
    end: Array,
    triangles: Indices,
    reach: float,
    beginning: bool = False,
    is_open: bool = False,
) -> Wall:
    """The wall of a mesh (V, 3), m, with triangles (T, 3).

    reach: m, distance at which its triangles are found; at least the way of a node against the
    wall in the interval. beginning: whether nodes inside are to be left alone until they come out.
    is_open: whether it is a sheet, which has the side on which a node comes.
    """
    corners = start[triangles]
    low = corners.min(axis=(0, 1)) - reach
    size = corners.max(axis=(0, 1)) + reach - low
    edges = np.linalg.norm(np.roll(corners, 1, axis=1) - corners, axis=2)
    edge = max(float(np.median(edges)), reach, float(np.prod(size) / _MAX_CUBES) ** (1.0 / 3.0))
    cubes = np.maximum(np.ceil(size / edge), 1.0).astype(np.int64)
    grid = CubeGrid(low, edge, float(reach), cubes)
    counts = np.zeros(int(cubes.prod()), dtype=np.int64)
    wall_kernels.count_cells(start, triangles, grid, counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    items = np.zeros(int(first[-1]), dtype=np.int64)
    wall_kernels.fill_cells(start, triangles, grid, first[:-1].copy(), items)
    return Wall(
        np.ascontiguousarray(start, dtype=float),
        np.ascontiguousarray(end, dtype=float),
        np.ascontiguousarray(triangles, dtype=np.int64),
        grid,
        first,
        items,
        int(beginning),
        int(is_open),
    )
