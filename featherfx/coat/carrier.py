"""The carrier of a coat: the skin without its creases, in any pose.

    (M + L) x = M x0,   L = int a(x)^2 grad u . grad v

M lumps areas, L is the cotangent stiffness, a (m) the reach of the smoothing. What that takes off
the skin is given back along the normals, smoothed alike, so that the carrier lies on the skin or
above it. Normals are smoothed the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, face_products, unit

# relative, of the mean area of vertices: keeps vertices without area in the matrix
_MIN_MASS = 1e-9
_NO_AREA = 1e-30  # m^2, twice the area of a triangle that has none


class TriangleElements(NamedTuple):
    """Linear elements of T triangles.

    gradients: (T, 3, 3) 1/m, of the hat function of each corner. normals: (T, 3) unit. areas: (T,)
    m^2. masses: (V,) m^2, a third of the triangles around each vertex.
    """

    gradients: Array
    normals: Array
    areas: Array
    masses: Array


@dataclass(frozen=True)
class CoatMesh:
    """A skin on which a coat grows: what stays while it moves.

    points: (V, 3) m, at rest, each place once. faces: (T, 3). neighbours: (T, 3) the triangle
    across the edge opposite each corner, -1 at a border. masses: (V,) m^2. smooth: solves
    (M + L) x = b for b (V, 3).
    """

    points: Array
    faces: Indices
    neighbours: Indices
    masses: Array
    smooth: Callable[[Array], Array]


@dataclass(frozen=True)
class Carrier:
    """A smoothed skin in one pose.

    points: (V, 3) m. normals: (V, 6), the smoothed unit normals, then those of the mesh itself.
    elements: of its triangles.
    """

    points: Array
    normals: Array
    elements: TriangleElements


def make_elements(points: Array, faces: Indices) -> TriangleElements:
    """Build the linear elements of a mesh. points: (V, 3) m. faces: (T, 3)."""
    corners = points[faces]
    products = face_products(corners)
    twice = np.linalg.norm(products, axis=1)
    normals = products / np.maximum(twice, _NO_AREA)[:, None]
    opposite = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    gradients = np.cross(normals[:, None], opposite) / np.maximum(twice, _NO_AREA)[:, None, None]
    thirds = np.repeat(twice / 6.0, 3)
    masses = np.bincount(faces.ravel(), thirds, len(points))
    return TriangleElements(gradients, normals, 0.5 * twice, masses + _MIN_MASS * masses.mean())


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
    return lambda right: np.asarray(found.solve(np.ascontiguousarray(right)))


def weld(corners: Array) -> tuple[Array, Indices]:
    """Return the places (V, 3) of corners (T, 3, 3), each once, and the triangles (T, 3)."""
    points, number = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return points, number.reshape(-1, 3)


def make_mesh(points: Array, faces: Indices, reach: Array | float) -> CoatMesh:
    """Prepare a skin. points: (V, 3) m. faces: (T, 3). reach: (T,) m, of the smoothing."""
    from scipy.sparse import diags_array

    elements = make_elements(points, faces)
    weights = np.broadcast_to(np.square(reach), len(faces)).astype(float)
    matrix = diags_array(elements.masses) + make_stiffness(elements, faces, weights)
    return CoatMesh(points, faces, find_neighbours(faces), elements.masses, factorise(matrix))


def find_neighbours(faces: Indices) -> Indices:
    """Return (T, 3) the triangle across the edge opposite each corner, -1 where not just one is."""
    edges = np.concatenate([faces[:, [(i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    edges = np.sort(edges, axis=1)
    _, edge, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    paired = order[(count == 2)[edge.ravel()[order]]].reshape(-1, 2)
    found = np.full(len(edges), -1)
    found[paired[:, 0]], found[paired[:, 1]] = paired[:, 1] % len(faces), paired[:, 0] % len(faces)
    return np.ascontiguousarray(found.reshape(3, -1).T)


def pose_carrier(mesh: CoatMesh, points: Array) -> Carrier:
    """Smooth a skin in a pose. points: (V, 3) m."""
    masses = mesh.masses[:, None]
    soft = mesh.smooth(masses * points)
    normals = _vertex_normals(soft, mesh.faces)
    lost = np.maximum(dots(points - soft, normals), 0.0)[:, None]
    soft = soft + mesh.smooth(masses * lost) * normals
    own = _vertex_normals(soft, mesh.faces)
    smooth = unit(mesh.smooth(masses * own))
    return Carrier(soft, np.hstack([smooth, own]), make_elements(soft, mesh.faces))


def _vertex_normals(points: Array, faces: Indices) -> Array:
    """Return (V, 3) unit normals, the mean of the triangles around by their area."""
    products = face_products(points[faces])
    summed = [
        np.bincount(faces.ravel(), np.repeat(products[:, k], 3), len(points)) for k in range(3)
    ]
    return np.asarray(unit(np.stack(summed, axis=1)))
