"""Rows of vectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices


def unit(vectors: Any) -> Any:
    """Vectors (..., k) over their lengths; those without length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def dots(first: Array, second: Array | Indices) -> Array:
    """(N,) products of rows (N, k)."""
    return np.asarray(np.einsum("nk,nk->n", first, second))


def face_products(corners: Array) -> Array:
    """(T, 3) normals of triangles (T, 3, 3), twice their area long."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.cross(first, second)
