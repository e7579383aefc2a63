"""Search trees; scipy is imported where something is searched, not where files are read."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices


def search_tree(points: Array) -> Any:
    """k-d tree (scipy) of points (N, 3)."""
    from scipy.spatial import cKDTree

    return cKDTree(points)


class SizeClass(NamedTuple):
    """Triangles of about one size. members: (M,) numbers. tree: of their centres. radii: (M,)."""

    members: Indices
    tree: Any
    radii: Array


def size_classes(corners: Array) -> list[SizeClass]:
    """Triangles (T, 3, 3) by powers of two of their radius: large ones widen no other search."""
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    sizes = np.floor(np.log2(np.maximum(radii, 1e-300)))
    members = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [SizeClass(each, search_tree(centres[each]), radii[each]) for each in members]
