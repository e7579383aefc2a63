"""Rows of vectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices


def unit(vectors: Any) -> Any:
    """Vectors (..., k) over their lengths; those without length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def distinct(numbers: Indices) -> Indices:
    """Return integers (...), each once, ascending: np.unique of newer NumPy hashes them, which
    takes longer than to sort."""
    found = np.sort(numbers, axis=None)
    return found[np.append(True, found[1:] != found[:-1])[: len(found)]]


def dots(first: Array, second: Array | Indices) -> Array:
    """(N,) products of rows (N, k)."""
    return np.asarray(np.einsum("nk,nk->n", first, second))


def applied(matrices: Array, vectors: Array) -> Array:
    """(K, 3, 3) matrices times (K, 3) vectors."""
    return np.asarray((matrices @ vectors[:, :, None])[..., 0])


def cross_columns(first: Array, second: Array) -> Array:
    """(3, N) cross products of the columns of (3, N)."""
    (x, y, z), (u, v, w) = first, second
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def triangle_edges(points: Array, triangles: Indices) -> tuple[Array, Array]:
    """(3, T), (3, T) ways from the first corners of triangles (T, 3) of points (V, 3) to the
    second and third ones."""
    columns = np.ascontiguousarray(points.T)
    start, first, second = (columns.take(corner, axis=1) for corner in triangles.T)
    first -= start
    second -= start
    return first, second


def arc_lengths(points: Array) -> Array:
    """(k,) lengths of a polyline (k, D) from its first point to each."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def face_products(corners: Array) -> Array:
    """(T, 3) normals of triangles (T, 3, 3), twice their area long."""
    a, b, c = (corners[:, k].T for k in range(3))
    return cross_columns(b - a, c - a).T


def vertex_normals(points: Array, triangles: Indices) -> Array:
    """(V, 3) unit, the mean of the triangles around weighted by area; zero where there are none."""
    sums = [
        sum(np.bincount(corner, each, len(points)) for corner in triangles.T)
        for each in face_products(points[triangles]).T
    ]
    return np.asarray(unit(np.stack(sums, axis=1)))
