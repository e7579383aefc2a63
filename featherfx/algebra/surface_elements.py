"""Linear finite elements on the triangles of a surface.

Hat functions, their gradients, lumped masses and the cotangent stiffness (Pinkall and Polthier
1993), and the factors of sparse systems that these make.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices

# relative, of the mean area of vertices: keeps vertices without area in the matrix
_MIN_MASS = 1e-9


class TriangleElements(NamedTuple):
    """Linear elements of T triangles.

    gradients: (T, 3, 3) 1/m, of the hat function of each corner. normals: (T, 3) unit. areas: (T,)
    m^2. masses: (V,) m^2, a third of the triangles around each vertex.
    """

    gradients: Array
    normals: Array
    areas: Array
    masses: Array


def make_elements(points: Array, faces: Indices) -> TriangleElements:
    """Build the linear elements of a mesh. points: (V, 3) m. faces: (T, 3)."""
    from featherfx.algebra.element_kernels import fill_elements

    count = len(faces)
    found = TriangleElements(
        gradients=np.empty((count, 3, 3)),
        normals=np.empty((count, 3)),
        areas=np.empty(count),
        masses=np.empty(len(points)),
    )
    fill_elements(np.ascontiguousarray(points), faces, found)
    return found._replace(masses=found.masses + _MIN_MASS * found.masses.mean())


def make_stiffness(elements: TriangleElements, faces: Indices, weights: Array | None = None) -> Any:
    """Assemble (V, V) int grad u . W grad v. weights: (T,) or (T, 3, 3), default 1."""
    from scipy.sparse import csc_array  # heavy, and only for this

    flux = elements.gradients
    if weights is not None and weights.ndim == 1:
        flux = weights[:, None, None] * flux
    elif weights is not None:
        flux = flux @ weights  # symmetric
    local = elements.areas[:, None, None] * (flux @ elements.gradients.transpose(0, 2, 1))
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    count = len(elements.masses)
    return csc_array((local.ravel(), (rows, columns)), shape=(count, count))


def factorise(matrix: Any) -> Callable[[Array], Array]:
    """Factorise a symmetric positive definite matrix; return its solver for (V,) or (V, K)."""
    from scipy.sparse.linalg import splu

    options = {"SymmetricMode": True}
    found = splu(matrix.tocsc(), "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    # rows in order as they came: of another order, kernels would be compiled once more
    return lambda right: np.ascontiguousarray(found.solve(np.ascontiguousarray(right)))


def make_smoother(
    elements: TriangleElements, faces: Indices, reach: Array | float
) -> Callable[[Array], Array]:
    """Factorise M + int reach^2 grad u . grad v; M lumps areas. reach: (T,) or one, m."""
    from scipy.sparse import diags_array

    weights = np.broadcast_to(np.square(reach), len(faces))
    return factorise(diags_array(elements.masses) + make_stiffness(elements, faces, weights))


def find_edges(faces: Indices) -> Indices:
    """Return (3 T, 2) the edges of triangles (T, 3), as these go round."""
    return np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])


def spread_heights(
    points: Array, faces: Indices, heights: Array, slope: float, floor: Array | float = -np.inf
) -> Array:
    """Return (V,) the least heights that are nowhere below heights (V,) and fall by no more than a
    slope along edges; -inf where they would be below a floor."""
    edges = find_edges(faces)
    edges = np.concatenate([edges, edges[:, ::-1]])
    falls = slope * np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1)
    found, before = heights.copy(), np.full_like(heights, np.nan)
    while (found != before).any():
        before = found.copy()
        np.maximum.at(found, edges[:, 0], before[edges[:, 1]] - falls)
        found[found < floor] = -np.inf
    return found


def find_vertex_normals(points: Array, faces: Indices) -> Array:
    """Return (V, 3) unit normals, the mean of the triangles around by their area."""
    from featherfx.algebra.element_kernels import fill_normals

    normals = np.empty_like(points)
    fill_normals(points, faces, normals)
    return normals


def weld(corners: Array) -> tuple[Array, Indices]:
    """Return the places (V, 3) of corners (T, 3, 3), each once, and the triangles (T, 3)."""
    points, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return points, number.reshape(-1, 3)
