"""The carrier of a coat: the skin without its creases, in any pose.

    (M + L) x = M x0,   L = int a(x)^2 grad u . grad v

M lumps areas, L is the cotangent stiffness, a (m) the reach of the smoothing. What that takes off
the skin is given back along the normals, smoothed alike, so that the carrier lies on the skin or
above it. Normals are smoothed the same way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.surface_elements import (
    TriangleElements,
    find_vertex_normals,
    make_elements,
    make_smoother,
)
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, unit


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


def make_mesh(points: Array, faces: Indices, reach: Array | float) -> CoatMesh:
    """Prepare a skin. points: (V, 3) m. faces: (T, 3). reach: (T,) m, of the smoothing."""
    elements = make_elements(points, faces)
    smooth = make_smoother(elements, faces, reach)
    return CoatMesh(points, faces, find_neighbours(faces), elements.masses, smooth)


def find_neighbours(faces: Indices) -> Indices:
    """Return (T, 3) the triangle across the edge opposite each corner, -1 where not just one is."""
    edges = np.concatenate([faces[:, [(i + 1) % 3, (i + 2) % 3]] for i in range(3)])
    edges = np.sort(edges, axis=1)
    numbers = edges @ [faces.max(initial=0) + 1, 1]
    _, edge, count = np.unique(numbers, return_inverse=True, return_counts=True)
    order = np.argsort(edge.ravel(), kind="stable")
    paired = order[(count == 2)[edge.ravel()[order]]].reshape(-1, 2)
    found = np.full(len(edges), -1)
    found[paired[:, 0]], found[paired[:, 1]] = paired[:, 1] % len(faces), paired[:, 0] % len(faces)
    return np.ascontiguousarray(found.reshape(3, -1).T)


def pose_carrier(mesh: CoatMesh, points: Array) -> Carrier:
    """Smooth a skin in a pose. points: (V, 3) m."""
    masses = mesh.masses[:, None]
    soft = mesh.smooth(masses * points)
    normals = find_vertex_normals(soft, mesh.faces)
    lost = np.maximum(dots(points - soft, normals), 0.0)[:, None]
    soft = soft + mesh.smooth(masses * lost) * normals
    own = find_vertex_normals(soft, mesh.faces)
    smooth = unit(mesh.smooth(masses * own))
    return Carrier(soft, np.hstack([smooth, own]), make_elements(soft, mesh.faces))
