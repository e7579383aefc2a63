"""Rotations of roots on a deforming skin: one smooth field over the surface.

Two sides and the normal of a triangle against those at rest are its deformation gradient. A root
takes a weighted mean of the gradients around it and turns by the rotation of its polar
decomposition (Higham 1986), so that stretch and shear of the skin turn roots no more than they
must. The weights are those of the triangles at the three corners of the root's own, interpolated
within it, and of all triangles within a radius that hang together with it and face its way; they
fall off smoothly with the distance. Each share is continuous as the root moves over edges, and so
is the field. The weights are made to have their centre at the root, so that even bending turns
roots evenly, on any mesh and up to its borders.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, face_products, rotation_part, unit
from featherfx.jit.compiled import kernel

# of Newton's iteration for the rotation of a matrix: steps at most, change at which it has ended,
# and least determinant over the cube of the matrix's size, below which it is not tried
_MAX_POLAR_STEPS, _POLAR_TOLERANCE, _MIN_DETERMINANT_RATIO = 40, 1e-15, 1e-9


@kernel
def fill_gradients(corners, side, inverse, out):
    """Deformation gradients (U, 9) of triangles with corners (U, 3, 3): their sides and unit
    normal, times side, times inverse (U, 3, 3)."""
    for u in range(corners.shape[0]):
        a, b, c = corners[u, 0], corners[u, 1], corners[u, 2]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        k, m, n = y * r - z * q, z * p - x * r, x * q - y * p
        size = sqrt(k * k + m * m + n * n)
        scale = side / size if size > 0.0 else side
        k, m, n = k * scale, m * scale, n * scale
        own = inverse[u]
        for j in range(3):
            out[u, j] = x * own[0, j] + p * own[1, j] + k * own[2, j]
            out[u, 3 + j] = y * own[0, j] + q * own[1, j] + m * own[2, j]
            out[u, 6 + j] = z * own[0, j] + r * own[1, j] + n * own[2, j]


@kernel
def fill_means(values, starts, places, weights, out):
    """Weighted sums (F, 9) of values (U, 9) at the places from starts[f] to the next start."""
    count, end = starts.shape[0], places.shape[0]
    for f in range(count):
        for j in range(9):
            out[f, j] = 0.0
        for k in range(starts[f], starts[f + 1] if f + 1 < count else end):
            weight, u = weights[k], places[k]
            for j in range(9):
                out[f, j] += weight * values[u, j]


@kernel
def fill_rotations(matrices, scratch, out):
    """Proper rotations (F, 9) nearest to matrices (F, 9), by Newton's iteration (Higham 1986); how
    many were not found, whose first number is then nan. scratch: (9,)."""
    missing = 0
    for f in range(matrices.shape[0]):
        now, inverse = out[f], scratch
        size = 0.0
        for j in range(9):
            now[j] = matrices[f, j]
            size += now[j] * now[j]
        size = sqrt(size)
        found = False
        for _ in range(_MAX_POLAR_STEPS):
            # cofactors, which over the determinant are the inverse's transpose
            inverse[0] = now[4] * now[8] - now[5] * now[7]
            inverse[1] = now[5] * now[6] - now[3] * now[8]
            inverse[2] = now[3] * now[7] - now[4] * now[6]
            inverse[3] = now[2] * now[7] - now[1] * now[8]
            inverse[4] = now[0] * now[8] - now[2] * now[6]
            inverse[5] = now[1] * now[6] - now[0] * now[7]
            inverse[6] = now[1] * now[5] - now[2] * now[4]
            inverse[7] = now[2] * now[3] - now[0] * now[5]
            inverse[8] = now[0] * now[4] - now[1] * now[3]
            det = now[0] * inverse[0] + now[1] * inverse[1] + now[2] * inverse[2]
            if not det > _MIN_DETERMINANT_RATIO * size * size * size:
                break
            own, other = 0.0, 0.0
            for j in range(9):
                inverse[j] /= det
                own += now[j] * now[j]
                other += inverse[j] * inverse[j]
            scale = sqrt(sqrt(other / own))
            change = 0.0
            for j in range(9):
                after = 0.5 * (scale * now[j] + inverse[j] / scale)
                change += (after - now[j]) * (after - now[j])
                now[j] = after
            size = sqrt(3.0)
            # it converges quadratically, so that what is left is the square of the last change
            if change <= _POLAR_TOLERANCE:
                found = True
                break
        if not found:
            now[0] = float("nan")
            missing += 1
    return missing


@kernel
def has_flat(corners, thinnest):
    """Return True if any of triangles (U, 3, 3) is flat or not finite.

    thinnest: least height of a triangle over its longest side."""
    for u in range(corners.shape[0]):
        doubled, longest = _measure(corners[u])
        # a little more than asked for, so that none is missed by round-off
        if not doubled > 1.01 * thinnest * longest:
            return True
    return False


@kernel
def fill_sound(corners, rest, thinnest, crushed, sound):
    """Return whether all triangles (U, 3, 3) m have an area as at rest (U, 3, 3). Written: sound
    (U,), 1 of those, falling smoothly to 0 from a part (crushed) of their area at rest on, and
    where they are as flat as has_flat says."""
    all_sound = True
    for u in range(corners.shape[0]):
        doubled, longest = _measure(corners[u])
        then, _ = _measure(rest[u])
        sound[u] = 0.0
        if doubled > thinnest * longest:
            part = min(doubled / (crushed * then), 1.0) if then > 0.0 else 1.0
            sound[u] = part * part * (3.0 - 2.0 * part)
        all_sound = all_sound and sound[u] == 1.0
    return all_sound


@kernel
def _measure(corners):
    """Twice the area of a triangle (3, 3) m, m^2, and its longest side squared."""
    a, b, c = corners[0], corners[1], corners[2]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    p, q, r = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    k, m, n = y * r - z * q, z * p - x * r, x * q - y * p
    last = (p - x) ** 2 + (q - y) ** 2 + (r - z) ** 2
    longest = max(x * x + y * y + z * z, p * p + q * q + r * r, last)
    return sqrt(k * k + m * m + n * n), longest


@kernel
def find_hanging(start, start_corners, root, corners, reached, hanging):
    """Mark triangles (N,) around roots that hang together with those (M,) at them.

    start: (M,) and root: (N,) of each, ascending. start_corners: (M, 3) and corners: (N, 3), their
    vertices. reached: (V,) last root from which each vertex was, -1. hanging: (N,) False.
    """
    s, low = 0, 0
    while low < root.shape[0]:
        own, high = root[low], low
        while high < root.shape[0] and root[high] == own:
            high += 1
        while s < start.shape[0] and start[s] <= own:
            for k in range(3):
                reached[start_corners[s, k]] = start[s]
            s += 1
        moved = True
        while moved:
            moved = False
            for n in range(low, high):
                c = corners[n]
                if not hanging[n] and own in (reached[c[0]], reached[c[1]], reached[c[2]]):
                    hanging[n] = moved = True
                    for k in range(3):
                        reached[c[k]] = own
        low = high


# of the mean square distance, by which the centring of weights is held back where triangles stand
# in a line
_STIFFNESS = 1e-3
# of a weight, by which the centring may change it; at borders some become negative
_MAX_CHANGE = 3.0


class _Pairs(NamedTuple):
    """Pairs of a root and a triangle, (N,) each, by root, and the weight of each."""

    root: Indices
    triangle: Indices
    weight: Array


@dataclass(frozen=True)
class TurnField:
    """The turning of F roots by U triangles.

    starts: (F,) where the pairs of each root start. places: (N,) triangles of the pairs. weights:
    (N,), adding up to 1 for each root. inverse: (U, 3, 3), inverse of tangents and normal at rest.
    upright: (F, 3, 3) frames at rest of the direction along and the normal.
    """

    starts: Indices
    places: Indices
    weights: Array
    inverse: Array
    upright: Array

    def turns(self, corners: Array, mirrored: bool) -> Array:
        """(F, 3, 3) rotations since rest. corners: (U, 3, 3) m, now; mirrored: as of `follow`, and
        the normal of a triangle then keeps its side of the skin."""
        # what is only checked does without compiled code

        gradients, mean = np.empty((len(corners), 9)), np.empty((len(self.starts), 9))
        fill_gradients(corners, -1.0 if mirrored else 1.0, self.inverse, gradients)
        fill_means(gradients, self.starts, self.places, self.weights, mean)
        whole = mean.reshape(-1, 3, 3)
        if mirrored:
            along, normal = (whole @ self.upright)[:, :, [0, 2]].transpose(2, 0, 1)
            return upright_frames(along, normal) @ self.upright.transpose(0, 2, 1)
        found = np.empty_like(mean)
        missing = fill_rotations(mean, np.empty(9), found)
        turns = found.reshape(-1, 3, 3)
        if missing:
            crushed = np.isnan(found[:, 0])
            turns[crushed] = rotation_part(whole[crushed])
        return turns

    def some(self, kept: Flags) -> TurnField:
        """Those of the roots that are kept, (F,)."""
        sizes = np.diff(self.starts, append=len(self.places))
        pairs = np.repeat(kept, sizes)
        return TurnField(
            starts=np.cumsum(sizes[kept]) - sizes[kept],
            places=self.places[pairs],
            weights=self.weights[pairs],
            inverse=self.inverse,
            upright=self.upright[kept],
        )


def tangents(corners: Array) -> Array:
    """(F, 3, 3) columns: two sides of each triangle and its unit normal. corners: (F, 3, 3)."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(first, second)
    normal = unit(normal)
    return np.stack([first, second, normal], axis=2)


def upright_frames(along: Array, normal: Array) -> Array:
    """(F, 3, 3) right-handed frames: x as near to along as may be, z the normal; (F, 3) each."""
    z = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    x = along - dots(along, z)[:, None] * z
    size = np.linalg.norm(x, axis=1, keepdims=True)
    # a shaft that stands square on the skin has no direction along it
    other = np.cross(z, np.eye(3)[np.argmin(np.abs(z), axis=1)])
    x = np.where(size > 1e-9 * np.linalg.norm(along, axis=1, keepdims=True), x, other)
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def turn_field(
    triangle: Indices,
    barycentric: Array,
    points: Array,
    triangles: Indices,
    radius: Array,
    along: Array,
) -> tuple[TurnField, Indices]:
    """The field of F roots, and the numbers (U,) of the triangles that it takes, ascending.

    triangle: (F,), barycentric: (F, 3): places of the roots. points: (V, 3) m at rest, triangles:
    (T, 3). radius: (F,) m. along: (F, 3).
    """
    corners = points[triangles]
    products = face_products(corners)
    areas = np.linalg.norm(products, axis=1)
    normals, centres = products / areas[:, None], corners.mean(axis=1)
    places = np.einsum("fk,fkc->fc", barycentric, corners[triangle])
    # seams have their points twice
    _, welded = np.unique(points, axis=0, return_inverse=True)
    joined = welded.ravel()[triangles]
    at_corners = _at_corners(triangle, barycentric, joined, areas)
    facing = unit(_sums(at_corners, normals[at_corners.triangle], len(triangle)))
    around = _within(places, facing, radius, centres, normals, areas)
    hanging = _hanging(around, at_corners, joined)
    pairs = _merged(at_corners, around, hanging, len(triangles))
    offsets = centres[pairs.triangle] - places[pairs.root]
    weights = _centred(pairs, offsets, facing, len(triangle))
    used, own = np.unique(pairs.triangle, return_inverse=True)
    found = TurnField(
        starts=np.searchsorted(pairs.root, np.arange(len(triangle))),
        places=own,
        weights=weights,
        inverse=np.asarray(np.linalg.inv(tangents(corners[used])), dtype=np.float64),
        upright=upright_frames(along, facing),
    )
    return found, used


def _at_corners(triangle: Indices, barycentric: Array, joined: Indices, areas: Array) -> _Pairs:
    """The triangles at the corners of each root's own; each corner's share out by their areas.

    The shares of a root add up to the area around it.
    """
    owner = np.repeat(np.arange(len(joined)), 3)
    order = np.argsort(joined.ravel(), kind="stable")
    vertex, owner = joined.ravel()[order], owner[order]
    count = int(joined.max()) + 1
    first = np.searchsorted(vertex, np.arange(count + 1))
    around = np.bincount(vertex, weights=areas[owner], minlength=count)
    corner = joined[triangle].ravel()
    sizes = (first[1:] - first[:-1])[corner]
    root = np.repeat(np.repeat(np.arange(len(triangle)), 3), sizes)
    step = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    near = owner[np.repeat(first[corner], sizes) + step]
    total = dots(barycentric, around[corner].reshape(-1, 3))
    part = np.repeat(barycentric.ravel() / around[corner], sizes)
    return _Pairs(root, near, total[root] * part * areas[near])


def _within(
    places: Array, facing: Array, radius: Array, centres: Array, normals: Array, areas: Array
) -> _Pairs:
    """The triangles within each root's radius, by area, distance and how they face."""
    if not radius.any():
        nothing = np.zeros(0, dtype=np.int64)
        return _Pairs(nothing, nothing, np.zeros(0))
    hits = search_tree(centres).query_ball_point(places, radius)
    root = np.repeat(np.arange(len(places)), [len(hit) for hit in hits])
    near = np.concatenate([np.array(hit, dtype=np.int64) for hit in hits])
    squared = ((centres[near] - places[root]) ** 2).sum(axis=1)
    falling = np.maximum(1.0 - squared / np.maximum(radius[root] ** 2, 1e-300), 0.0) ** 2
    same_way = np.maximum(dots(facing[root], normals[near]), 0.0)
    return _Pairs(root, near, areas[near] * falling * same_way)


def _hanging(around: _Pairs, start: _Pairs, joined: Indices) -> Flags:
    """(N,) whether triangles around a root hang together with those at its corners."""

    hanging = np.zeros(len(around.root), dtype=np.bool_)
    begin, other = ((each.root, joined[each.triangle]) for each in (start, around))
    find_hanging(*begin, *other, np.full(joined.max() + 1, -1), hanging)
    return hanging


def _merged(first: _Pairs, second: _Pairs, kept: Flags, triangles: int) -> _Pairs:
    """Both together, of the second those kept, one pair of each root and triangle, by root."""
    root = np.concatenate([first.root, second.root[kept]])
    triangle = np.concatenate([first.triangle, second.triangle[kept]])
    weight = np.concatenate([first.weight, second.weight[kept]])
    key, place = np.unique(root * triangles + triangle, return_inverse=True)
    summed = np.bincount(place.ravel(), weights=weight).astype(np.float64)
    return _Pairs(key // triangles, key % triangles, summed)


def _centred(pairs: _Pairs, offsets: Array, facing: Array, count: int) -> Array:
    """(N,) weights that add up to 1 for each root, their centre at it where that is near.

    offsets: (N, 3) m, from roots to triangles; what lies in the plane square to facing counts.
    """
    root = pairs.root
    height = dots(offsets, facing[root])
    flat = offsets - height[:, None] * facing[root]
    weight = pairs.weight / np.bincount(root, pairs.weight, count)[root]
    part = pairs._replace(weight=weight)
    mean = _sums(part, flat, count)
    square = _sums(part, flat[:, :, None] * flat[:, None, :], count)
    spread = np.trace(square, axis1=1, axis2=2)[:, None, None]
    # the normal's direction, in which nothing lies, must not make it singular
    thick = facing[:, :, None] * facing[:, None, :] + _STIFFNESS * np.eye(3)
    square = square - mean[:, :, None] * mean[:, None, :] + spread * thick
    tilt = -np.linalg.solve(square, mean[:, :, None])[:, :, 0]
    change = dots(tilt[root], flat - mean[root])
    starts = np.searchsorted(root, np.arange(count))
    most = np.maximum.reduceat(np.abs(change), starts)
    return np.asarray(weight * (1.0 + change / np.maximum(1.0, most / _MAX_CHANGE)[root]))


def _sums(pairs: _Pairs, values: Array, count: int) -> Array:
    """(F, ...) weighted sums of values (N, ...) of the pairs, which stand by root."""
    weights = pairs.weight.reshape(-1, *([1] * (values.ndim - 1)))
    starts = np.searchsorted(pairs.root, np.arange(count))
    return np.asarray(np.add.reduceat(weights * values, starts, axis=0))


def search_tree(points: Array) -> Any:
    """k-d tree (scipy) of points (N, 3)."""
    from scipy.spatial import cKDTree

    return cKDTree(points, balanced_tree=False)


class SizeClass(NamedTuple):
    """Triangles of about one size. members: (M,) numbers. tree: of their centres. radii: (M,)."""

    members: Indices
    tree: Any
    radii: Array


def size_classes(corners: Array) -> list[SizeClass]:
    """Triangles (T, 3, 3) by powers of two of their radius: large ones widen no other search."""
    centres = corners.mean(axis=1)
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    sizes = np.floor(np.log2(np.maximum(radii, 1e-300)))
    members = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    return [SizeClass(each, search_tree(centres[each]), radii[each]) for each in members]
