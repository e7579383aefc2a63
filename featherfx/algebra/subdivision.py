"""Subdivision surfaces: the points of a limit surface as one sparse matrix of the cage's points.

Schemes, creases, corners, boundaries and face-varying values are those of USD (OpenSubdiv): Catmull
and Clark 1978, Loop 1987, bilinear; semi-sharp creases of DeRose, Kass and Truong 1998. Refined
points are moved to the limit by the eigenvectors of the scheme (Halstead, Kass and DeRose 1993).
Topology alone determines the matrix, so it is built once and applied to the points of each frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from featherfx.algebra.interpolation import Rows
from featherfx.algebra.subdivision_cage import (
    Cage,
    CageEdges,
    Sharp,
    count_edges,
    find_turns,
    make_matrix,
    round_sharpness,
)
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, unit

_SMOOTH_TRIANGLE = 0.47  # weight of a triangle in edge points, by the rule `smooth`; else 0.25
MAX_REFINED_FACES = 200_000


@dataclass(frozen=True)
class Refinement:
    """A cage after some levels, without holes.

    levels: how many. matrix: from V points of the cage to R on the limit surface. counts: (G,)
    corners of each face. indices: their points. parent: (G,) their faces of the cage.
    """

    levels: int
    matrix: Rows
    counts: Indices
    indices: Indices
    parent: Indices


def refine(cage: Cage, levels: int) -> Refinement:
    """Return a cage split `levels` times, its points moved to the limit surface; without holes."""
    matrix: Any = sparse.identity(len(cage.corner_sharpness), format="csr")
    parent = np.arange(len(cage.counts))
    for _ in range(levels):
        step, cage, faces = _split(cage)
        matrix, parent = step @ matrix, parent[faces]
    return _drawn(cage, levels, _limit(CageEdges(cage)) @ matrix, parent)


def refine_within(
    cage: Cage, points: Array, tolerance: float, max_faces: int = MAX_REFINED_FACES
) -> tuple[Refinement, float]:
    """Return a refinement whose faces are at most `tolerance` from the limit surface, and how far
    they are (m), by an estimate that is too large rather than too small.

    points: (V, 3) m. Levels end where there are more than max_faces; the distance is then larger.
    """
    matrix: Any = sparse.identity(len(points), format="csr")
    parent, levels = np.arange(len(cage.counts)), 0
    while True:
        mesh = CageEdges(cage)
        limit = _limit(mesh) @ matrix
        off = _estimate_distance(mesh, np.asarray(matrix @ points), np.asarray(limit @ points))
        if off <= tolerance or 4 * len(cage.counts) > max_faces:
            return _drawn(cage, levels, limit, parent), off
        step, cage, faces = _split(cage)
        matrix, parent, levels = step @ matrix, parent[faces], levels + 1


def measure_cage_distance(cage: Cage, points: Array) -> float:
    """Return the largest distance (m) of a cage's drawn points (V, 3) to the surface: of each to
    its limit, along the normal there, and in full at borders."""
    mesh = CageEdges(cage)
    moved = np.asarray(_limit(mesh) @ points) - points
    off = np.abs(dots(moved, _point_normals(cage.counts, cage.indices, points)))
    border = mesh.ends[mesh.faces == 1]
    off[border] = np.linalg.norm(moved[border], axis=2)
    return float(off[cage.indices[~cage.hidden[mesh.face]]].max(initial=0.0))


def estimate_cage_distance(counts: Indices, indices: Indices, points: Array, scheme: str) -> float:
    """Return the distance of measure_cage_distance were all smooth and closed, without edges: a
    second for a million faces. What creases and corners hold is nearer."""
    if scheme == "bilinear":
        return 0.0
    face = np.repeat(np.arange(len(counts)), counts)
    after, before = find_turns(counts)
    moved = np.zeros_like(points)
    many = np.maximum(np.bincount(indices, minlength=len(points)), 1).astype(np.float64)
    for axis in range(3):
        own = np.ascontiguousarray(points[:, axis])
        here = own[indices]
        sides = 0.5 * np.bincount(indices, here[after] + here[before], len(points)) / many - own
        if scheme == "loop":
            moved[:, axis] = many * _loop_limit_weight(many) * sides
            continue
        mean = np.bincount(face, here, len(counts)) / np.maximum(counts, 1)
        centre = np.bincount(indices, mean[face], len(points)) / many - own
        moved[:, axis] = (2.0 * sides + 4.0 * centre) / (many + 5.0)
    return float(np.abs(dots(moved, _point_normals(counts, indices, points))).max(initial=0.0))


def _point_normals(counts: Indices, indices: Indices, points: Array) -> Array:
    """(V, 3) unit or zero, of the faces around points (V, 3) by area."""
    after, before = find_turns(counts)
    area = np.zeros_like(points)
    for axis in range(3):
        u, v = points[indices, (axis + 1) % 3], points[indices, (axis + 2) % 3]
        product = (u[after] - u) * (v[before] - v) - (v[after] - v) * (u[before] - u)
        area[:, axis] = np.bincount(indices, product, len(points))
    return np.asarray(unit(area))


def _split(cage: Cage) -> tuple[Any, Cage, Indices]:
    """Return the matrix to the points of one level, its cage, and the faces its faces are part of.

    Points stand in the order points, edges, faces; children in the order of corners.
    """
    mesh, size = CageEdges(cage), len(cage.corner_sharpness)
    count = len(mesh.ends)
    middle = size + mesh.edge
    blocks = [_vertex_points(mesh), _edge_points(mesh)]
    if cage.rules.scheme == "loop":
        own = np.stack([cage.indices, middle, middle[mesh.before]], axis=1)
        inner = middle.reshape(-1, 3)
        indices = np.concatenate([own, inner])
        parent = np.concatenate([mesh.face, np.arange(len(cage.counts))])
        total = size + count
    else:
        blocks.append(mesh.centres)
        centre = size + count + mesh.face
        indices = np.stack([cage.indices, middle, centre, middle[mesh.before]], axis=1)
        parent, total = mesh.face, size + count + len(cage.counts)
    worn = _worn(round_sharpness(mesh.given))
    kept = np.flatnonzero(worn > 0.0)
    halves = np.concatenate(
        [
            np.stack([mesh.ends[kept, 0], size + kept], axis=1),
            np.stack([mesh.ends[kept, 1], size + kept], axis=1),
        ]
    )
    child = replace(
        cage,
        counts=np.full(len(indices), indices.shape[1]),
        indices=indices.ravel(),
        rules=cage.rules._replace(creases=Sharp(halves, np.tile(worn[kept], 2))),
        corner_sharpness=np.concatenate([_worn(cage.corner_sharpness), np.zeros(total - size)]),
        hidden=cage.hidden[parent],
    )
    return sparse.vstack(blocks, format="csr"), child, parent


def _worn(sharpness: Array) -> Array:
    """Sharpness at the next level."""
    return np.maximum(sharpness - 1.0, 0.0)


def _edge_points(mesh: CageEdges) -> Any:
    """(E, V) between a smooth edge point and the middle, by sharpness."""
    cage, count = mesh.cage, len(mesh.ends)
    sharp = np.clip(mesh.sharpness, 0.0, 1.0)
    if cage.rules.scheme == "loop":
        # 3/8 of the ends, 1/8 of the points across
        rows = np.concatenate([np.repeat(np.arange(count), 2), mesh.edge])
        across = cage.indices[mesh.before]
        smooth = 1.0 - sharp
        weights = np.concatenate(
            [np.repeat(0.375 * smooth + 0.5 * sharp, 2), 0.125 * smooth[mesh.edge]]
        )
        return make_matrix(
            rows, np.concatenate([mesh.ends.ravel(), across]), weights, (count, mesh.size)
        )
    share = np.full(count, 0.25)
    if cage.rules.smooth_triangles:
        each = np.where(cage.counts[mesh.face] == 3, _SMOOTH_TRIANGLE, 0.25)
        share = np.bincount(mesh.edge, each, count) / np.maximum(mesh.faces, 1)
    share = share * (1.0 - sharp)
    faces = make_matrix(mesh.edge, mesh.face, share[mesh.edge], (count, len(cage.counts)))
    ends = make_matrix(
        np.repeat(np.arange(count), 2),
        mesh.ends.ravel(),
        np.repeat(0.5 - share, 2),
        (count, mesh.size),
    )
    return ends + faces @ mesh.centres


def _vertex_points(mesh: CageEdges) -> Any:
    """(V, V) the new points of the points, between the rules before and after a level."""
    cage, size = mesh.cage, mesh.size
    if mesh.is_linear:
        return sparse.identity(size, format="csr")
    before, after = mesh.sharpness, _worn(mesh.sharpness)
    corner, worn = cage.corner_sharpness, _worn(cage.corner_sharpness)
    count, count_after = (count_edges(mesh, each > 0.0) for each in (before, after))
    # the mean sharpness of what becomes smooth is the weight of the rule before
    fading = (before > 0.0) & (after == 0.0)
    total = np.bincount(mesh.ends[fading].ravel(), np.repeat(before[fading], 2), size)
    many = count_edges(mesh, fading).astype(np.float64)
    soft = (corner > 0.0) & (worn == 0.0)
    total, many = total + np.where(soft, corner, 0.0), many + soft
    weight = np.where(many > 0.0, np.minimum(total / np.maximum(many, 1.0), 1.0), 1.0)
    n = np.maximum(count_edges(mesh, mesh.faces > 0), 2).astype(np.float64)
    is_loop = cage.rules.scheme == "loop"
    smooth = (_loop_weight(n), 0.0 * n) if is_loop else (n**-2, n**-2)
    result = _blend(mesh, before > 0.0, (corner > 0.0) | (count > 2), weight, 0.125, smooth)
    if (weight < 1.0).any():
        is_corner = (worn > 0.0) | (count_after > 2)
        result = result + _blend(mesh, after > 0.0, is_corner, 1.0 - weight, 0.125, smooth)
    return result


def _loop_weight(n: Array) -> Array:
    """Weight of each of n neighbours of a smooth point (Loop 1987)."""
    return (0.625 - (0.375 + 0.25 * np.cos(2.0 * np.pi / n)) ** 2) / n


def _loop_limit_weight(n: Array) -> Array:
    """Weight of each of n neighbours in the limit of a smooth point."""
    return 1.0 / (0.375 / _loop_weight(n) + n)


def _blend(
    mesh: CageEdges,
    sharp: Flags,
    is_corner: Flags,
    weight: Array,
    crease: float,
    smooth: tuple[Array, Array],
) -> Any:
    """(V, V) means of points and those around them, times weight (V,).

    A corner stays. A point on a crease, of two sharp edges (E,), has the weight `crease` for the
    other end of either. Others have the weights `smooth` (V,) for each neighbour and each face.
    """
    is_crease = ~is_corner & (count_edges(mesh, sharp) == 2)
    everyone = mesh.faces > 0
    on_crease, smoothed = weight * is_crease, weight * ~(is_corner | is_crease)
    rounds = count_edges(mesh, everyone) * (smooth[0] + smooth[1])
    own = weight - 2.0 * crease * on_crease - rounds * smoothed
    result = sparse.diags(own, format="csr") + _scaled(mesh.neighbours(sharp), crease * on_crease)
    result = result + _scaled(mesh.neighbours(everyone), smooth[0] * smoothed)
    if smooth[1].any():
        result = result + _scaled(mesh.around, smooth[1] * smoothed) @ mesh.centres
    return result


def _scaled(matrix: Any, rows: Array) -> Any:
    return sparse.diags(rows, format="csr") @ matrix


def _limit(mesh: CageEdges) -> Any:
    """(V, V) from the points of a level to their limits; what is sharp counts as sharp for good.

    A smooth point of n edges tends to ((n - 1) v + 2 e + 4 f) / (n + 5), with e the mean of its
    neighbours and f of the faces around it; by Loop to v + n x (e - v), x = 1 / (3 / (8 b) + n),
    with b the weight of a neighbour; on a crease to (4 v + e0 + e1) / 6.
    """
    cage = mesh.cage
    if mesh.is_linear:
        return sparse.identity(mesh.size, format="csr")
    sharp = mesh.sharpness > 0.0
    n = count_edges(mesh, mesh.faces > 0).astype(np.float64)
    is_corner = (cage.corner_sharpness > 0.0) | (count_edges(mesh, sharp) > 2) | (n < 2)
    n = np.maximum(n, 1.0)
    if cage.rules.scheme == "loop":
        smooth = _loop_limit_weight(n), 0.0 * n
    else:
        smooth = 2.0 / (n * (n + 5.0)), 4.0 / (n * (n + 5.0))
    return _blend(mesh, sharp, is_corner, np.ones(mesh.size), 1.0 / 6.0, smooth)


def _estimate_distance(mesh: CageEdges, points: Array, limit: Array) -> float:
    """Return how far flat faces between limit points (V, 3) may be from the surface, m.

    points: (V, 3) of the level. The next level's points, one step from the limit themselves, stand
    for the surface: for an even bend they are a third too far from the faces.
    """
    cage = mesh.cage
    shown = np.flatnonzero(~cage.hidden[mesh.face])
    corners, edge, face = limit[cage.indices], mesh.edge[shown], mesh.face[shown]
    normal = unit(_area_vectors(mesh, corners))[face]
    start, end = corners[shown], corners[mesh.after[shown]]
    away = np.asarray(_edge_points(mesh) @ points)[edge] - 0.5 * (start + end)
    # within the surface an edge may slide along it, but for those of borders
    along = unit(end - start)
    across = np.linalg.norm(away - dots(away, along)[:, None] * along, axis=1)
    off = np.where(mesh.faces[edge] == 1, across, np.abs(dots(away, normal))).max(initial=0.0)
    if cage.rules.scheme != "loop":
        # the middle of a quad's diagonal lies on one of its triangles
        quad = cage.counts[face] == 4
        other = corners[mesh.after[mesh.after[shown]]]
        flat = np.where(
            quad[:, None], 0.5 * (start + other), np.asarray(mesh.centres @ limit)[face]
        )
        centre = np.asarray(mesh.centres @ points)[face]
        off = max(off, np.abs(dots(centre - flat, normal)).max(initial=0.0))
    return float(off)


def _area_vectors(mesh: CageEdges, corners: Array) -> Array:
    """(F, 3) twice the areas of faces with corners (C, 3), along their normals."""
    products = np.cross(corners, corners[mesh.after])
    return np.stack([np.bincount(mesh.face, each, len(mesh.cage.counts)) for each in products.T], 1)


def _drawn(cage: Cage, levels: int, matrix: Any, parent: Indices) -> Refinement:
    """Return what is left without holes; points stay, so that their numbers do."""
    shown = ~cage.hidden
    corners = np.repeat(shown, cage.counts)
    matrix = matrix.tocsr()
    matrix.sort_indices()
    rows = Rows(matrix.data, matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64))
    return Refinement(levels, rows, cage.counts[shown], cage.indices[corners], parent[shown])
