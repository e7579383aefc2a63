"""Strain of the vane across its barbs, from the points of a cache alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def strain_across_barbs(rest: Array, points: Array, triangles: Indices, along: Array) -> Array:
    """(T,) Green-Lagrange strain across the barb, no unit: half of (stretch squared - 1).

    rest, points: (V, 3) of any one unit. triangles: (T, 3). along: (T, 3) rest direction of the
    barb. Triangles without area have strain 0.
    """
    rest_edges = rest[triangles[:, 1:]] - rest[triangles[:, :1]]
    edges = points[triangles[:, 1:]] - points[triangles[:, :1]]
    normal = np.cross(rest_edges[:, 0], rest_edges[:, 1])
    area = np.linalg.norm(normal, axis=1)
    valid = area > 0
    across = np.cross(normal / np.where(valid, area, 1)[:, None], along)
    size = np.linalg.norm(across, axis=1)
    valid &= size > 0
    across /= np.where(size > 0, size, 1)[:, None]
    # The material direction "across" in terms of the two edges: solved in the triangle's plane.
    gram = np.einsum("tik,tjk->tij", rest_edges, rest_edges)
    gram[~valid] = np.eye(2)
    parts = np.linalg.solve(gram, np.einsum("tik,tk->ti", rest_edges, across)[..., None])
    stretched = np.einsum("ti,tik->tk", parts[..., 0], edges)
    strain = 0.5 * ((stretched**2).sum(axis=1) - 1)
    return np.where(valid, strain, 0.0)
