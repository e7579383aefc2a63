"""Subdivision surfaces: the points of a limit surface as one sparse matrix of the cage's points.

Schemes, creases, corners, boundaries and face-varying values are those of USD (OpenSubdiv): Catmull
and Clark 1978, Loop 1987, bilinear; semi-sharp creases of DeRose, Kass and Truong 1998. Refined
points are moved to the limit by the eigenvectors of the scheme (Halstead, Kass and DeRose 1993).
Topology alone determines the matrix, so it is built once and applied to the points of each frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from featherfx.algebra.sparse import Rows
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, unit

_INFINITE = 10.0  # sharpness from which on an edge or corner stays sharp at every level
_SMOOTH_TRIANGLE = 0.47  # weight of a triangle in edge points, by the rule `smooth`; else 0.25
MAX_REFINED_FACES = 200_000


class Sharp(NamedTuple):
    """Sharp edges (K, 2) or points (K,) of a mesh, and sharpness (K,): 10 and more is for good."""

    places: Indices
    sharpness: Array


_NO_EDGES = Sharp(np.zeros((0, 2), np.int64), np.zeros(0))
_NO_CORNERS = Sharp(np.zeros(0, np.int64), np.zeros(0))


class Rules(NamedTuple):
    """Rules by which a mesh is subdivided, in USD's words.

    scheme: catmullClark, loop (of triangles alone) or bilinear. boundary: none (faces at open
    borders are not drawn), edgeOnly or edgeAndCorner. smooth_triangles: the rule `smooth` for
    triangles. holes: numbers of faces that are not drawn. is_linear: whether what is refined lies
    between points in lines, whatever the scheme.
    """

    scheme: str = "catmullClark"
    boundary: str = "edgeAndCorner"
    smooth_triangles: bool = False
    holes: Indices = _NO_CORNERS.places
    creases: Sharp = _NO_EDGES
    corners: Sharp = _NO_CORNERS
    is_linear: bool = False


@dataclass(frozen=True)
class Cage:
    """A mesh of F faces, C corners and V points that is subdivided.

    counts: (F,) corners of each face. indices: (C,) their points. rules: of the subdivision, with
    creases as they are at this level. corner_sharpness: (V,). hidden: (F,) faces that are not
    drawn.
    """

    counts: Indices
    indices: Indices
    rules: Rules
    corner_sharpness: Array
    hidden: Flags


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


def make_cage(counts: Indices, indices: Indices, size: int, rules: Rules) -> Cage:
    """Return the cage of a mesh with `size` points."""
    sharpness = np.zeros(size)
    sharpness[rules.corners.places] = _rounded(rules.corners.sharpness)
    places = np.sort(rules.creases.places, axis=1)
    rules = rules._replace(creases=Sharp(places, _rounded(rules.creases.sharpness)))
    hidden = np.zeros(len(counts), np.bool_)
    cage = Cage(counts, indices, rules, sharpness, hidden)
    mesh = _Edges(cage)
    if rules.boundary == "none" and rules.scheme != "bilinear":
        at_border = np.zeros(size, np.bool_)
        at_border[mesh.ends[(mesh.faces == 1) & np.isfinite(mesh.given)]] = True
        hidden[mesh.face[at_border[indices]]] = True
    hidden[rules.holes] = True
    faces = np.bincount(indices, minlength=size)
    if rules.boundary == "edgeAndCorner":
        sharpness[faces == 1] = np.inf
    # points at edges where faces do not go on are sharp, but for those along a fin
    torn, border, every = (
        _count_edges(mesh, each) for each in (mesh.torn, mesh.faces == 1, mesh.faces > 0)
    )
    along = (torn == 2) & (border == 0) & (faces > every)
    sharpness[(torn > 0) & ~along] = np.inf
    return cage


def make_value_cage(cage: Cage, values: Indices, rule: str) -> tuple[Cage, Indices]:
    """Return the cage of a face-varying primvar, and (W,) the value of each of its points.

    values: (C,) numbers of the values of the corners. rule: faceVaryingLinearInterpolation of USD:
    none, cornersOnly, cornersPlus1, cornersPlus2, boundaries or all.
    """
    size = len(cage.corner_sharpness)
    span = int(values.max(initial=0)) + 1
    keys, own = np.unique(cage.indices * span + values, return_inverse=True)
    vertex, value, own = keys // span, keys % span, own.reshape(-1).astype(np.int64)
    outer, corners = _Edges(cage), cage.corner_sharpness[vertex]
    # creases of the mesh count in the plane of the values, too
    creased = np.flatnonzero(outer.given[outer.edge] > 0.0)
    ends = np.stack([own[creased], own[outer.after[creased]]], axis=1)
    creases = Sharp(np.sort(ends, axis=1), outer.given[outer.edge[creased]])
    rules = cage.rules._replace(creases=creases, is_linear=rule == "all")
    inner = Cage(cage.counts, own, rules, corners, cage.hidden)
    if rule == "all":
        return inner, value
    mesh = _Edges(inner)
    # an edge whose faces disagree on values is a seam; both its ends are at it
    seam = (outer.faces[outer.edge] > 1) & (mesh.faces[mesh.edge] == 1)
    at_seam, at_border = np.zeros(size, np.bool_), np.zeros(size, np.bool_)
    at_seam[outer.ends[outer.edge[seam]]] = True
    at_border[outer.ends[outer.faces == 1]] = True
    siblings = np.bincount(vertex, minlength=size)
    faces = np.bincount(own, minlength=len(vertex))
    lone = np.zeros(size, np.bool_)
    lone[vertex[faces == 1]] = True
    torn = np.zeros(size, np.bool_)
    torn[vertex[_count_edges(mesh, np.isinf(mesh.sharpness)) > 2]] = True
    corner = np.zeros(len(vertex), np.bool_)
    if rule != "none":
        corner |= (faces == 1) & (at_seam | at_border)[vertex]
    if rule in ("cornersPlus1", "cornersPlus2"):
        corner |= (at_seam & ((siblings > 2) | ((siblings == 2) & torn)))[vertex]
    if rule == "cornersPlus2":
        corner |= (at_seam & (siblings == 2) & lone)[vertex]
        corner |= (at_seam & (siblings == 1) & ~at_border)[vertex]
    if rule == "boundaries":
        corner |= (at_seam | at_border)[vertex]
    return replace(inner, corner_sharpness=np.where(corner, np.inf, corners)), value


def refine(cage: Cage, levels: int) -> Refinement:
    """Return a cage split `levels` times, its points moved to the limit surface; without holes."""
    matrix: Any = sparse.identity(len(cage.corner_sharpness), format="csr")
    parent = np.arange(len(cage.counts))
    for _ in range(levels):
        step, cage, faces = _split(cage)
        matrix, parent = step @ matrix, parent[faces]
    return _drawn(cage, levels, _limit(_Edges(cage)) @ matrix, parent)


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
        mesh = _Edges(cage)
        limit = _limit(mesh) @ matrix
        off = _estimate_distance(mesh, np.asarray(matrix @ points), np.asarray(limit @ points))
        if off <= tolerance or 4 * len(cage.counts) > max_faces:
            return _drawn(cage, levels, limit, parent), off
        step, cage, faces = _split(cage)
        matrix, parent, levels = step @ matrix, parent[faces], levels + 1


def measure_cage_distance(cage: Cage, points: Array) -> float:
    """Return the largest distance (m) of a cage's drawn points (V, 3) to the surface: of each to
    its limit, along the normal there, and in full at borders."""
    mesh = _Edges(cage)
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
    after, before = _turns(counts)
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
    after, before = _turns(counts)
    area = np.zeros_like(points)
    for axis in range(3):
        u, v = points[indices, (axis + 1) % 3], points[indices, (axis + 2) % 3]
        product = (u[after] - u) * (v[before] - v) - (v[after] - v) * (u[before] - u)
        area[:, axis] = np.bincount(indices, product, len(points))
    return np.asarray(unit(area))


def _turns(counts: Indices) -> tuple[Indices, Indices]:
    """(C,) places of the corners after and before each in its face."""
    corner = np.arange(counts.sum())
    used = counts[counts > 0]
    first = np.cumsum(used) - used
    after, before = corner + 1, corner - 1
    after[first + used - 1], before[first] = first, first + used - 1
    return after, before


class _Edges:
    """The E edges of a cage of C corners.

    face, after, before, edge: (C,) of each corner its face, the places of the corners after and
    before it in it, and the edge to the one after it.
    ends: (E, 2) points. faces: (E,) how many use an edge. torn: (E,) whether they are more than
    two, or disagree on the outside. given: (E,) sharpness as of the cage; sharpness: (E,), infinite
    at torn edges and at borders."""

    def __init__(self, cage: Cage) -> None:
        self.cage, counts, indices = cage, cage.counts, cage.indices
        size = len(cage.corner_sharpness)
        self.face = np.repeat(np.arange(len(counts)), counts)
        self.after, self.before = _turns(counts)
        following = indices[self.after]
        low, high = np.minimum(indices, following), np.maximum(indices, following)
        keys, edge = np.unique(low * size + high, return_inverse=True)
        self.edge = edge.reshape(-1).astype(np.int64)
        self.ends = np.stack([keys // size, keys % size], axis=1)
        self.faces = np.bincount(self.edge, minlength=len(keys))
        sense = np.bincount(self.edge, np.where(indices == low, 1.0, -1.0), len(keys))
        self.given = np.zeros(len(keys))
        places, sharpness = cage.rules.creases
        if len(places):
            wanted = places[:, 0] * size + places[:, 1]
            place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            there = keys[place] == wanted
            np.maximum.at(self.given, place[there], sharpness[there])
        self.is_linear = cage.rules.is_linear or cage.rules.scheme == "bilinear"
        self.torn = (self.faces > 2) | ((self.faces == 2) & (sense != 0.0))
        smooth = (self.faces == 2) & ~self.torn & (not self.is_linear)
        self.sharpness = np.where(smooth, _rounded(self.given), np.inf)

    @cached_property
    def centres(self) -> Any:
        """(F, V) means of the faces."""
        weights = np.repeat(1.0 / np.maximum(self.cage.counts, 1), self.cage.counts)
        return _matrix(self.face, self.cage.indices, weights, (len(self.cage.counts), self.size))

    @cached_property
    def around(self) -> Any:
        """(V, F) 1 where a face is at a point."""
        return _matrix(
            self.cage.indices,
            self.face,
            np.ones(len(self.face)),
            (self.size, len(self.cage.counts)),
        )

    @property
    def size(self) -> int:
        return len(self.cage.corner_sharpness)

    def neighbours(self, chosen: Flags) -> Any:
        """(V, V) 1 where one of the chosen edges (E,) joins two points."""
        first, second = self.ends[chosen].T
        rows, columns = np.concatenate([first, second]), np.concatenate([second, first])
        return _matrix(rows, columns, np.ones(len(rows)), (self.size, self.size))


def _matrix(rows: Indices, columns: Indices, weights: Array, shape: tuple[int, int]) -> Any:
    return sparse.csr_matrix((weights, (rows, columns)), shape=shape)


def _rounded(sharpness: Array) -> Array:
    """Sharpness without end for all that never decays."""
    return np.where(sharpness >= _INFINITE, np.inf, np.maximum(sharpness, 0.0))


def _count_edges(mesh: _Edges, chosen: Flags) -> Indices:
    """(V,) how many of the chosen edges (E,) each point has."""
    return np.bincount(mesh.ends[chosen].ravel(), minlength=mesh.size)


def _split(cage: Cage) -> tuple[Any, Cage, Indices]:
    """Return the matrix to the points of one level, its cage, and the faces its faces are part of.

    Points stand in the order points, edges, faces; children in the order of corners.
    """
    mesh, size = _Edges(cage), len(cage.corner_sharpness)
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
    worn = _worn(_rounded(mesh.given))
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


def _edge_points(mesh: _Edges) -> Any:
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
        return _matrix(
            rows, np.concatenate([mesh.ends.ravel(), across]), weights, (count, mesh.size)
        )
    share = np.full(count, 0.25)
    if cage.rules.smooth_triangles:
        each = np.where(cage.counts[mesh.face] == 3, _SMOOTH_TRIANGLE, 0.25)
        share = np.bincount(mesh.edge, each, count) / np.maximum(mesh.faces, 1)
    share = share * (1.0 - sharp)
    faces = _matrix(mesh.edge, mesh.face, share[mesh.edge], (count, len(cage.counts)))
    ends = _matrix(
        np.repeat(np.arange(count), 2),
        mesh.ends.ravel(),
        np.repeat(0.5 - share, 2),
        (count, mesh.size),
    )
    return ends + faces @ mesh.centres


def _vertex_points(mesh: _Edges) -> Any:
    """(V, V) the new points of the points, between the rules before and after a level."""
    cage, size = mesh.cage, mesh.size
    if mesh.is_linear:
        return sparse.identity(size, format="csr")
    before, after = mesh.sharpness, _worn(mesh.sharpness)
    corner, worn = cage.corner_sharpness, _worn(cage.corner_sharpness)
    count, count_after = (_count_edges(mesh, each > 0.0) for each in (before, after))
    # the mean sharpness of what becomes smooth is the weight of the rule before
    fading = (before > 0.0) & (after == 0.0)
    total = np.bincount(mesh.ends[fading].ravel(), np.repeat(before[fading], 2), size)
    many = _count_edges(mesh, fading).astype(np.float64)
    soft = (corner > 0.0) & (worn == 0.0)
    total, many = total + np.where(soft, corner, 0.0), many + soft
    weight = np.where(many > 0.0, np.minimum(total / np.maximum(many, 1.0), 1.0), 1.0)
    result = _ruled(mesh, corner, count, before > 0.0, weight)
    if (weight < 1.0).any():
        result = result + _ruled(mesh, worn, count_after, after > 0.0, 1.0 - weight)
    return result


def _ruled(mesh: _Edges, corner: Array, count: Indices, sharp: Flags, weight: Array) -> Any:
    """(V, V) weighted (V,) rules: corner, crease where two edges are sharp, else smooth."""
    is_corner = (corner > 0.0) | (count > 2)
    is_crease = ~is_corner & (count == 2)
    smooth = np.where(is_corner | is_crease, 0.0, weight)
    n = np.maximum(_count_edges(mesh, mesh.faces > 0), 3)
    own = np.where(is_corner, weight, np.where(is_crease, 0.75 * weight, 0.0))
    result = _scaled(mesh.neighbours(sharp), np.where(is_crease, 0.125 * weight, 0.0))
    everyone = mesh.neighbours(mesh.faces > 0)
    if mesh.cage.rules.scheme == "loop":
        beta = _loop_weight(n)
        own = own + smooth * (1.0 - n * beta)
        result = result + _scaled(everyone, smooth * beta)
    else:
        own = own + smooth * (n - 2.0) / n
        result = result + _scaled(everyone, smooth / n**2)
        result = result + _scaled(mesh.around, smooth / n**2) @ mesh.centres
    return result + sparse.diags(own, format="csr")


def _loop_weight(n: Array) -> Array:
    """Weight of each of n neighbours of a smooth point (Loop 1987)."""
    return (0.625 - (0.375 + 0.25 * np.cos(2.0 * np.pi / n)) ** 2) / n


def _loop_limit_weight(n: Array) -> Array:
    """Weight of each of n neighbours in the limit of a smooth point."""
    return 1.0 / (0.375 / _loop_weight(n) + n)


def _scaled(matrix: Any, rows: Array) -> Any:
    return sparse.diags(rows, format="csr") @ matrix


def _limit(mesh: _Edges) -> Any:
    """(V, V) from the points of a level to their limits; what is sharp counts as sharp for good.

    A smooth point of n edges tends to ((n - 1) v + 2 e + 4 f) / (n + 5), with e the mean of its
    neighbours and f of the faces around it; by Loop to v + n x (e - v), x = 1 / (3 / (8 b) + n),
    with b the weight of a neighbour; on a crease to (4 v + e0 + e1) / 6.
    """
    cage, size = mesh.cage, mesh.size
    if mesh.is_linear:
        return sparse.identity(size, format="csr")
    sharp = mesh.sharpness > 0.0
    count = _count_edges(mesh, sharp)
    is_corner = (cage.corner_sharpness > 0.0) | (count > 2)
    everyone = mesh.faces > 0
    n = _count_edges(mesh, everyone).astype(np.float64)
    is_corner |= n < 2
    is_crease = ~is_corner & (count == 2)
    smooth = np.where(is_corner | is_crease, 0.0, 1.0)
    own = np.where(is_corner, 1.0, np.where(is_crease, 2.0 / 3.0, 0.0))
    result = _scaled(mesh.neighbours(sharp), np.where(is_crease, 1.0 / 6.0, 0.0))
    n = np.maximum(n, 1.0)
    if cage.rules.scheme == "loop":
        share = _loop_limit_weight(n)
        result = result + _scaled(mesh.neighbours(everyone), smooth * share)
        own = own + smooth * (1.0 - n * share)
    else:
        own = own + smooth * (n - 1.0) / (n + 5.0)
        result = result + _scaled(mesh.neighbours(everyone), smooth * 2.0 / (n * (n + 5.0)))
        around = _scaled(mesh.around, smooth * 4.0 / (n * (n + 5.0)))
        result = result + around @ mesh.centres
    return result + sparse.diags(own, format="csr")


def _estimate_distance(mesh: _Edges, points: Array, limit: Array) -> float:
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


def _area_vectors(mesh: _Edges, corners: Array) -> Array:
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
