"""Faults of meshes that feathers grow on."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.files.disk_cache import kept
from featherfx.groom.skin.field import size_classes

_MAX_NAMED = 5
_AT_ONCE = 2_000_000  # pairs of a point and a triangle


class GroomedMesh(Protocol):
    """A mesh: rest (V, 3) m, triangles (T, 3), face (T,) of each.

    border: (T,) those with an edge of their own. turned: faces that were turned round.
    """

    rest: Array
    triangles: Indices
    face: Indices
    border: Flags
    turned: Indices


def skin_doubts(mesh: GroomedMesh) -> list[str]:
    """Return doubts about a mesh: open borders, turned faces, and faces that cross."""
    doubts = []
    if mesh.border.any():
        doubts.append(
            f"is not closed at {_faces(mesh.face[mesh.border])}; feathers there show their roots "
            "from below"
        )
    if len(mesh.turned):
        doubts.append(
            f"{_faces(mesh.turned)}: wound against the surface, read turned round; reverse "
            "these faces, or set the orientation of the mesh"
        )
    crossing = crossing_triangles(mesh.rest, mesh.triangles)
    if len(crossing):
        doubts.append(
            f"passes through itself: {len(crossing)} pairs of triangles, "
            f"{_faces(mesh.face[crossing.ravel()])}; roots inside the body are left out"
        )
    return doubts


def signed_volume(corners: Array) -> float:
    """m^3, enclosed by triangles (T, 3, 3); negative where they look inwards."""
    products = np.cross(corners[:, 1], corners[:, 2])
    return float(np.einsum("tc,tc->", corners[:, 0], products) / 6.0)


def crossing_triangles(points: Array, triangles: Indices) -> Indices:
    """(K, 2) pairs of triangles that pass through each other; see _crossing."""
    inputs = [points, triangles]
    return kept("crossings", inputs, lambda: {"pairs": _crossing(points, triangles)})["pairs"]


def _crossing(points: Array, triangles: Indices) -> Indices:
    """(K, 2) pairs of triangles without a common point that pass through each other."""
    corners = points[triangles]
    pairs = _near_pairs(corners)
    shared = (triangles[pairs[:, 0], :, None] == triangles[pairs[:, 1], None, :]).any(axis=(1, 2))
    pairs = pairs[~shared]
    apart = (corners[pairs[:, 0]].min(axis=1) > corners[pairs[:, 1]].max(axis=1)).any(axis=1)
    apart |= (corners[pairs[:, 1]].min(axis=1) > corners[pairs[:, 0]].max(axis=1)).any(axis=1)
    pairs = pairs[~apart]
    found = np.zeros(len(pairs), dtype=np.bool_)
    for one, other in ((0, 1), (1, 0)):
        for edge in range(3):
            start = corners[pairs[:, one], edge]
            end = corners[pairs[:, one], (edge + 1) % 3]
            found |= _pierced(start, end, corners[pairs[:, other]])
    return pairs[found]


def within(points: Array, corners: Array) -> Flags:
    """(N,) whether points (N, 3) lie inside triangles (T, 3, 3), however these cross each other.

    By the winding number: the sum of the solid angles of all triangles over 4 pi (Jacobson 2013;
    solid angle by Van Oosterom and Strackee 1983). Work grows as N times T.
    """
    inside = np.zeros(len(points), dtype=np.bool_)
    step = max(1, _AT_ONCE // max(len(corners), 1))
    for start in range(0, len(points), step):
        block = slice(start, start + step)
        a, b, c = np.moveaxis(corners[None] - points[block, None, None], 2, 0)
        na, nb, nc = (np.linalg.norm(each, axis=2) for each in (a, b, c))
        volume = np.einsum("ntc,ntc->nt", a, np.cross(b, c))
        bulk = na * nb * nc
        for first, second, other in ((a, b, nc), (b, c, na), (c, a, nb)):
            bulk = bulk + np.einsum("ntc,ntc->nt", first, second) * other
        winding = np.arctan2(volume, bulk).sum(axis=1) / (2.0 * np.pi)
        inside[block] = winding > 0.5
    return inside


def _near_pairs(corners: Array) -> Indices:
    """(K, 2) pairs whose bounding spheres meet; by classes of size."""
    classes = size_classes(corners)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for i, first in enumerate(classes):
        for j, second in enumerate(classes[: i + 1]):
            reach = first.radii.max() + second.radii.max()
            near = first.tree.sparse_distance_matrix(second.tree, reach, output_type="ndarray")
            a, b = first.members[near["i"]], second.members[near["j"]]
            meet = near["v"] <= first.radii[near["i"]] + second.radii[near["j"]]
            kept = meet & ((i != j) | (a < b))
            found.append(np.stack([a[kept], b[kept]], axis=1))
    return np.concatenate(found)


def _pierced(start: Array, end: Array, corners: Array) -> Flags:
    """(K,) whether a segment passes through the inside of a triangle (Moeller, Trumbore 1997)."""
    along = end - start
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(along, second)
    determinant = (first * across).sum(axis=1)
    sound = np.abs(determinant) > 1e-30
    inverse = 1.0 / np.where(sound, determinant, 1.0)
    away = start - corners[:, 0]
    u = (away * across).sum(axis=1) * inverse
    turned = np.cross(away, first)
    v = (along * turned).sum(axis=1) * inverse
    t = (second * turned).sum(axis=1) * inverse
    return sound & (u > 0.0) & (v > 0.0) & (u + v < 1.0) & (t > 0.0) & (t < 1.0)


def _faces(faces: Indices) -> str:
    named = np.unique(faces)
    more = f" and {len(named) - _MAX_NAMED} more" if len(named) > _MAX_NAMED else ""
    several = "faces" if len(named) > 1 else "face"
    return f"{several} " + ", ".join(str(each) for each in named[:_MAX_NAMED]) + more
