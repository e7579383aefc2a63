"""The carrier of a coat: the skin without its creases, in any pose.

    (M + L) x = M x0,   L = int a(x)^2 grad u . grad v

M lumps areas, L is the cotangent stiffness, a (m) the reach of the smoothing. What that takes off
the skin is given back along the normals, smoothed alike, so that the carrier lies on the skin or
above it. Normals are smoothed the same way.

Finer triangles of a skin that is coarse for its coat, on curves through its corners.

An edge from a to b with unit normals n at its ends is split at the middle of the cubic that leaves
both ends square to these (curved PN triangles, Vlachos et al. 2001):

    (a + b) / 2 + ((a - b) . n_a n_a + (b - a) . n_b n_b) / 8

Both triangles at an edge split it alike, so that none opens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.triangulation import (
    TriangleElements,
    find_vertex_normals,
    make_elements,
    make_smoother,
)
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, unit
from featherfx.groom.skin.field import search_tree


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


# of the length of the nearest feather: longest edge, so that it bends over two facets and more, and
# reach beyond which edges stay
_LONGEST, _REACH = 0.5, 2.0
_ROUNDS = 12  # that halve an edge


def refine(points: Array, faces: Indices, roots: Array, lengths: Array) -> tuple[Array, Indices]:
    """Split edges that are long for the feathers around, until none is.

    points: (V, 3) m, each place once. faces: (T, 3). roots: (F, 3) m and lengths: (F,) m, of
    feathers.
    """
    tree = search_tree(roots)
    for _ in range(_ROUNDS):
        pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1)
        numbers, of_face = np.unique(pairs @ [len(points), 1], return_inverse=True)
        edges = np.stack(np.divmod(numbers, len(points)), axis=1)
        a, b = points[edges[:, 0]], points[edges[:, 1]]
        size = np.linalg.norm(b - a, axis=1)
        away, near = tree.query(0.5 * (a + b))
        long = (size > _LONGEST * lengths[near]) & (away < 0.5 * size + _REACH * lengths[near])
        if not long.any():
            break
        normals = find_vertex_normals(points, faces)
        first, last = (normals[edges[:, k]] for k in range(2))
        lean = dots(a - b, first)[:, None] * first + dots(b - a, last)[:, None] * last
        number = np.where(long, len(points) + np.cumsum(long) - 1, -1)
        points = np.concatenate([points, (0.5 * (a + b) + lean / 8.0)[long]])
        faces = _split(faces, number[of_face.reshape(faces.shape)])
    return points, faces


def _split(faces: Indices, middles: Indices) -> Indices:
    """Split triangles (T, 3) at middles (T, 3) of the edges from each corner on, -1 where whole."""
    found = []
    count = (middles >= 0).sum(axis=1)
    found.append(faces[count == 0])
    for wanted, first in ((1, [True, False, False]), (2, [True, True, False])):
        for turn in range(3):
            own = (count == wanted) & ((np.roll(middles, -turn, axis=1) >= 0) == first).all(axis=1)
            a, b, c = np.roll(faces[own], -turn, axis=1).T
            p, q, _ = np.roll(middles[own], -turn, axis=1).T
            if wanted == 1:
                found += [np.stack(each, axis=1) for each in ((a, p, c), (p, b, c))]
            else:
                found += [np.stack(each, axis=1) for each in ((p, b, q), (a, p, q), (a, q, c))]
    a, b, c = faces[count == 3].T
    p, q, r = middles[count == 3].T
    thirds = (a, p, r), (p, b, q), (r, q, c), (p, q, r)
    return np.concatenate([*found, *(np.stack(each, axis=1) for each in thirds)])
