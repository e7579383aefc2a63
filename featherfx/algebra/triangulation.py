"""Triangles of polygons, and the sides of polygon meshes.

A fan from the first corner covers a flat polygon exactly where all its triangles face as the
polygon does. Other polygons are cut by ears (Meisters 1975), the best shaped one first.
Quadrangles that are not flat are cut along their shorter diagonal. So corners in a row on one edge
get triangles with area, and the corner that the list of a polygon begins with is of no account.

Windings agree within each connected component. Faces are connected over edges that two of them
share. Edges of one face alone are joined by place, since seams of textures split points. A
component that no edge ends is closed: it is a volume, and its outside is counter-clockwise whatever
its author's winding. An open component keeps the winding of the larger part of its area.

Linear finite elements on the triangles of a surface.

Hat functions, their gradients, lumped masses and the cotangent stiffness (Pinkall and Polthier
1993), and the factors of sparse systems that these make.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import cross_columns, dots, triangle_edges

# of a polygon's area: a triangle with less, or turned round, is none of it
_MIN_AREA_RATIO = 1e-9
_MIN_BEND = 1e-4  # rad, between triangles of a fan, from which on a polygon is not flat
_MIN_SHORTER_RATIO = 1e-4  # of a squared diagonal: by how much the other one is shorter
# of a quadrangle; where it leaves it farther than the fan does, the fan stays
_OTHER_DIAGONAL = np.array([[1, 2, 3], [3, 0, 1]])


def triangulate(counts: Indices, indices: Indices, points: Array) -> tuple[Indices, Indices, Array]:
    """Return triangles of polygons: (T, 3) places in the list of corners, and (T,) faces, in their
    order; and (F, 3) normals of the faces, twice their area long.

    counts: (F,) corners of each face. indices: (C,) of these among points (V, 3). Windings stay as
    they are.
    """
    cuts = np.maximum(counts - 2, 0)
    face = np.repeat(np.arange(len(counts)), cuts)
    starts = np.cumsum(counts) - counts
    first = np.cumsum(cuts) - cuts
    places = np.empty((len(face), 3), dtype=np.int64)
    places[:, 0] = starts[face]
    places[:, 1] = places[:, 0] + np.arange(1, len(face) + 1) - first[face]
    places[:, 2] = places[:, 1] + 1
    edges = triangle_edges(points, indices[places])
    products = cross_columns(*edges)
    sums = [np.bincount(face, axis, len(counts)) for axis in products]
    normals: Array = np.stack(sums, axis=1).astype(float, copy=False)
    products = products.T
    # in a plane, triangles that face as the first one does are those of a fan that fits
    later = np.flatnonzero(np.arange(len(face)) != first[face])
    cut_off, lead = products[later], products[first[face[later]]]
    along, size = dots(cut_off, lead), dots(cut_off, cut_off) * dots(lead, lead)
    is_bent = (along <= 0.0) | (along**2 < (1.0 - _MIN_BEND**2) * size)
    is_cut = np.zeros(len(counts), dtype=np.bool_)
    is_cut[face[later[is_bent]]] = True
    is_cut &= dots(normals, normals) > 0.0
    for count in set(counts[is_cut].tolist()):
        alike = np.flatnonzero(is_cut & (counts == count))
        own = starts[alike][:, None] + np.arange(count)
        cuts = first[alike][:, None] + np.arange(count - 2)
        if count == 4:
            ways = edges[0][:, cuts[:, 0]], edges[1][:, cuts[:, 0]], edges[1][:, cuts[:, 1]]
            chosen = _find_other_diagonals(*ways, normals[alike].T)
            places[cuts[chosen]] = own[chosen][:, _OTHER_DIAGONAL]
            continue
        corners = points[indices[own]]
        # from one corner on whatever the list begins with, since ears may be equally well shaped
        begin = np.lexsort((*corners.reshape(-1, 3).T, np.repeat(alike, count)))[::count] % count
        own = np.take_along_axis(own, (begin[:, None] + np.arange(count)) % count, axis=1)
        ears = _cut_ears(_flatten(points[indices[own]], normals[alike]))
        places[cuts] = np.take_along_axis(own[:, None], ears, axis=2)
    return places, face, normals


def _find_other_diagonals(b: Array, c: Array, d: Array, normals: Array) -> Indices:
    """Return which quadrangles are cut from their second corner to the fourth.

    They are where that diagonal alone fits, or fits better, and where it is shorter and both fit.
    b, c, d: (3, M) from the first corner to the others. normals: (3, M) of the quadrangles.
    """
    squares = _dot_columns(normals, normals)
    fits = []
    for one, two in ((b, c), (b, d)):
        area = _dot_columns(cross_columns(one, two), normals)
        fits.append(np.minimum(area, squares - area))
    own, other = (_dot_columns(way, way) for way in (c, d - b))
    is_shorter = other < (1.0 - _MIN_SHORTER_RATIO) * own
    both = np.minimum(*fits) > _MIN_AREA_RATIO * squares
    return np.flatnonzero(np.where(both, is_shorter, fits[1] > fits[0]))


def _dot_columns(first: Array, second: Array) -> Array:
    return np.asarray(np.einsum("cm,cm->m", first, second))


def _flatten(polygons: Array, normals: Array) -> Array:
    """Return (M, k, 2) polygons (M, k, 3) seen along their normals (M, 3), counter-clockwise."""
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    right = np.cross(axis, normals)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(normals, right)], axis=2)
    return np.asarray((polygons - polygons[:, :1]) @ axes)


def _cut_ears(polygons: Array) -> Indices:
    """Return (M, k - 2, 3) corner numbers of the ears of polygons (M, k, 2)."""
    many, size = polygons.shape[:2]
    area = np.abs(_doubled_areas(polygons, np.roll(polygons, -1, axis=1), polygons[:, :1]))
    least = _MIN_AREA_RATIO * area.sum(axis=1)
    left = np.tile(np.arange(size), (many, 1))
    rows = np.arange(many)
    scores = np.stack([_rate(polygons, left, np.full(many, k), least) for k in range(size)], axis=1)
    ears = []
    for remaining in range(size, 3, -1):
        tip = scores.argmax(axis=1)
        before, after = (tip - 1) % remaining, (tip + 1) % remaining
        ears.append(np.stack([left[rows, k] for k in (before, tip, after)], axis=1))
        others = np.arange(remaining) != tip[:, None]
        left, scores = (each[others].reshape(many, -1) for each in (left, scores))
        for side in (tip - 1, tip):
            side = side % (remaining - 1)
            scores[rows, side] = _rate(polygons, left, side, least)
    return np.stack([*ears, left], axis=1)


def _rate(polygons: Array, left: Indices, tip: Indices, least: Array) -> Array:
    """Return (M,) how well shaped the ears at tips (M,) are; below 0 where one is none.

    left: (M, k) corners that remain. least: (M,) twice the area that an ear has at least.
    """
    rows, count = np.arange(len(left)), left.shape[1]
    points = polygons[rows[:, None], left]
    a, b, c = (points[rows, (tip + step) % count][:, None] for step in (-1, 0, 1))
    area = _doubled_areas(a, b, c)[:, 0]
    sides = sum(((one - other) ** 2).sum(axis=(1, 2)) for one, other in ((a, b), (b, c), (c, a)))
    quality = area / np.where(sides > 0.0, sides, 1.0)
    within = np.ones(points.shape[:2], dtype=np.bool_)
    for one, other in ((a, b), (b, c), (c, a)):
        within &= _doubled_areas(one, other, points) >= -least[:, None]
    for corner in (a, b, c):
        within &= (points != corner).any(axis=2)
    # (M, k) whether polygons turn left at their corners (M, k, 2)
    before, after = np.roll(points, 1, axis=1), np.roll(points, -1, axis=1)
    within &= ~np.asarray(_doubled_areas(before, points, after) > least[:, None])
    blocked = within.any(axis=1)
    # rounded, so that a turn of the mesh changes no choice between equals
    found: Array = np.where(area > least, quality - 2.0 * blocked, quality - 4.0)
    return found.round(6)


def _doubled_areas(a: Array, b: Array, c: Array) -> Array:
    """Return twice the signed areas of triangles with corners (..., 2)."""
    first, second = b - a, c - a
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])


class FaceSides(NamedTuple):
    """Sides of faces (F,).

    closed: whether their component is. turned: whether windings agree with this one changed.
    border: whether an edge is not shared by two.
    """

    closed: Flags
    turned: Flags
    border: Flags


class _SharedEdges(NamedTuple):
    """Edges (E,) that two faces share: those, and whether their windings agree.

    is_border: (F,) faces with an edge of their own, or of more than two.
    """

    first: Indices
    second: Indices
    agree: Flags
    is_border: Flags


def orient(counts: Indices, indices: Indices, points: Array, normals: Array) -> FaceSides:
    """Return the sides of faces with counts (F,) of corners, 1 or more, at points (V, 3).

    normals: (F, 3) of the faces, twice their area long.
    """
    starts = np.cumsum(counts) - counts
    following = np.arange(1, len(indices) + 1)
    following[starts - 1] -= np.roll(counts, 1)
    edges = _find_shared_edges(indices, indices[following], counts, points)
    component = _connect(edges.first, edges.second, len(counts))
    is_closed = np.bincount(component, edges.is_border)[component] == 0.0
    turned = np.zeros(len(counts), dtype=np.bool_)
    if not edges.agree.all():
        turned = _agree(edges, normals)
    if is_closed.any():
        corners = points[indices[starts]]
        volumes = dots(normals, corners - corners[:1])
        outward = np.bincount(component, np.where(turned, -volumes, volumes))
        turned = turned ^ (is_closed & (outward < 0.0)[component])
    return FaceSides(is_closed, turned, edges.is_border)


def _find_shared_edges(
    start: Indices, end: Indices, counts: Indices, points: Array
) -> _SharedEdges:
    """Return the shared edges of faces with counts (F,) of edges from start to end (C,)."""
    face = np.repeat(np.arange(len(counts)), counts)
    if (start == end).any():
        start, end, face = (each[start != end] for each in (start, end, face))
    one, other, alone = _pair_up(start, end)
    if len(alone):
        ends = np.concatenate([start[alone], end[alone]])
        place = np.unique(points[ends], axis=0, return_inverse=True)[1].reshape(2, -1)
        first, second, rest = _pair_up(*place)
        start = start.copy()
        start[alone] = place[0]
        one, other = np.append(one, alone[first]), np.append(other, alone[second])
        alone = alone[rest]
    is_border = np.zeros(len(counts), dtype=np.bool_)
    is_border[face[alone]] = True
    first, second = face[one], face[other]
    return _SharedEdges(first, second, (start[one] != start[other]) | (first == second), is_border)


def _pair_up(start: Indices, end: Indices) -> tuple[Indices, Indices, Indices]:
    """Return numbers (P,), (P,) of edges that two faces share, and of those without a partner.

    start, end: (E,) points of the edges. Where four or six faces meet at an edge, two or three
    volumes touch.
    """
    key, high = np.minimum(start, end), np.maximum(start, end)
    key *= int(high.max(initial=0)) + 1
    key += high
    order = np.argsort(key, kind="stable")
    key = key[order]
    starts = np.flatnonzero(np.append(True, key[1:] != key[:-1])[: len(key)])
    uses = np.diff(starts, append=len(order))
    twice = starts[uses == 2]
    alone = np.zeros(0, dtype=np.int64)
    if 2 * len(twice) < len(order):
        alone = np.sort(order[np.repeat(uses % 2 == 1, uses)])
    return order[twice], order[twice + 1], alone


def _connect(first: Indices, second: Indices, count: int) -> Indices:
    """Return (count,) the least number of those that pairs connect with each of count things."""
    label = np.arange(count)
    while len(first):
        low = np.minimum(label[first], label[second])
        np.minimum.at(label, label[first], low)
        np.minimum.at(label, label[second], low)
        while (ahead := label[label]).tobytes() != label.tobytes():
            label = ahead
        apart = label[first] != label[second]
        first, second = first[apart], second[apart]
    return label


def _agree(edges: _SharedEdges, normals: Array) -> Flags:
    """Return (F,) the faces to turn so that windings agree in each component.

    Each face stands twice in a graph, as it is and turned round; an edge connects those that
    agree. A component without two sides, such as a Moebius strip, stays as it is.
    """
    count = len(normals)
    own, other = edges.first, edges.second + np.where(edges.agree, 0, count)
    opposite = edges.second + np.where(edges.agree, count, 0)
    twofold = _connect(
        np.concatenate([own, own + count]), np.concatenate([other, opposite]), 2 * count
    )
    as_it_is, as_turned = twofold[:count], twofold[count:]
    area = np.linalg.norm(normals, axis=1)
    weights = np.bincount(as_it_is, area, twofold.max() + 1)
    return np.asarray((as_it_is != as_turned) & (weights[as_it_is] < weights[as_turned]))


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
