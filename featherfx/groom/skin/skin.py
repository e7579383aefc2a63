"""Roots on a skin: closest points of a triangle mesh, and frames that follow the skin around them.

A root keeps its triangle, the barycentric coordinates of the closest point and its offset from
that point. It turns with the skin around it: see field.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import cross_columns, dots, triangle_edges
from featherfx.files.disk_cache import kept
from featherfx.groom.skin.field import (
    TurnField,
    fill_sound,
    has_flat,
    search_tree,
    size_classes,
    turn_field,
)

# a triangle whose height is below this share of its longest side has no tangent plane
_THINNEST = 1e-5
# the same, below which it may have lost the most of its area
_THIN = 0.02
_ROOTS_AT_ONCE = 500
_ALIKE = 1e-7  # by which distances differ that count as equal: float32 of texture coordinates
# of a triangle's area at rest, below which it turns roots less and less
_CRUSHED_RATIO = 0.05
# of the weight around a root, with which it has a turn
_MIN_WEIGHT = 0.02
_OUTWARDS = 65  # places that are asked on a way out of a body


@dataclass(frozen=True)
class Body:
    """Body that feathers lie on. corners: (T, 3, 3) m, triangles that look outwards. axes: (3, 3)
    forward, left and up. middle: (3,) m, a point of the plane of symmetry."""

    corners: Array
    axes: Array
    middle: Array

    @cached_property
    def _centres(self) -> Array:
        return self.corners.mean(axis=1)

    @cached_property
    def _tree(self) -> Any:
        return search_tree(self._centres)

    @cached_property
    def _products(self) -> Array:
        return np.cross(
            self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        )

    def gaps(self, points: Array) -> Array:
        """(N,) m, of points (N, 3) over the body, negative within."""
        distance, near = self._tree.query(points)
        size = np.linalg.norm(self._products[near], axis=1)
        above = np.einsum("nc,nc->n", points - self._centres[near], self._products[near]) / size
        beside = np.sqrt(np.maximum(distance**2 - above**2, 0.0))
        # past an edge of the body, where a plane says nothing
        return np.where(beside > 2.0 * np.sqrt(size), distance, above)

    def way_out(self, start: Array, way: Array, most: float) -> float:
        """m, from a point (3,) along a unit way (3,) to where the body ends, up to most m."""
        ways = np.linspace(0.0, most, _OUTWARDS)
        inside = self.gaps(start + ways[:, None] * way) < 0.0
        return float(ways[min(int(inside.nonzero()[0].max(initial=-1)) + 1, len(ways) - 1)])


@dataclass(frozen=True)
class Binding:
    """F roots on T triangles.

    triangle: (F,) number of the triangle. barycentric: (F, 3) coordinates of the closest point.
    distance: (F,) m, from root to closest point. offset: (F, 3) m, from the closest point to the
    root at rest. field: how they turn. used: (U,) numbers of the triangles that move the roots,
    ascending; own: (F,) where each root's triangle stands among them.
    """

    triangle: Indices
    barycentric: Array
    distance: Array
    offset: Array
    field: TurnField
    used: Indices
    own: Indices

    @classmethod
    def of(cls, arrays: Mapping[str, Any]) -> Binding:
        """From arrays by the names of its fields and of the field's."""
        inner = {each.name for each in fields(TurnField)}
        field = TurnField(**{name: arrays[name] for name in inner})
        return cls(field=field, **{k: each for k, each in arrays.items() if k not in inner})

    def arrays(self) -> dict[str, Any]:
        """As `of` takes them."""
        found = vars(self.field) | vars(self)
        del found["field"]
        return found

    def some(self, kept: Flags) -> Binding:
        """The roots that are kept, (F,)."""
        field, own = self.field.some(kept), self.own[kept]
        needed, number = np.unique(np.append(field.places, own), return_inverse=True)
        places, own = np.split(number.ravel(), [len(field.places)])
        return Binding(
            triangle=self.triangle[kept],
            barycentric=self.barycentric[kept],
            distance=self.distance[kept],
            offset=self.offset[kept],
            field=replace(field, places=places, inverse=field.inverse[needed]),
            used=self.used[needed],
            own=own,
        )


def is_flat(points: Array, triangles: Indices) -> Flags:
    """(T,) whether triangles have no area to speak of. points: (V, 3), triangles: (T, 3)."""
    first, second = triangle_edges(points, triangles)
    doubled = _square(cross_columns(first, second))
    longest = np.maximum(_square(first), _square(second))
    second -= first
    longest = np.maximum(longest, _square(second))
    flat = np.sqrt(doubled) <= _THINNEST * longest
    return np.asarray(flat | (longest == 0.0))


def _square(columns: Array) -> Array:
    return np.asarray(np.einsum("ct,ct->t", columns, columns))


def bind(
    roots: Array,
    points: Array,
    triangles: Indices,
    search: tuple[Array, Array] | None = None,
    radius: Array | None = None,
    along: Array | None = None,
) -> Binding:
    """Bind roots (F, 3) m to the triangles (T, 3), not flat, of a skin with points (V, 3) m.

    search: places (F, 3) and corners (T, 3, 3) to find the closest triangle in, such as texture
    space with a third coordinate 0; by default the roots among the triangles themselves. Of several
    places there the one nearest to the root counts. The roots stay where they are in either case:
    the offset holds the rest. radius: (F,) m, of the part of
    the skin that turns each root; default 0, the triangles at its own. along: (F, 3) directions
    that a mirrored skin takes with it, default a side of the triangle.
    """
    corners = points[triangles]
    if search is None:
        triangle, barycentric = closest(roots, corners)
    else:
        triangle, barycentric = closest(*search, (roots, corners))
    own = corners[triangle]
    if along is None:
        along = own[:, 1] - own[:, 0]
    offset = roots - np.einsum("fk,fkc->fc", barycentric, own)
    wide = np.zeros(len(roots)) if radius is None else radius
    field, used = turn_field(triangle, barycentric, points, triangles, wide, along)
    return Binding(
        triangle=triangle,
        barycentric=barycentric,
        distance=np.linalg.norm(offset, axis=1),
        offset=offset,
        field=field,
        used=used,
        own=np.searchsorted(used, triangle),
    )


def bound_before(*how: Any) -> Binding:
    """As bind; what was bound before is taken from the store."""
    return Binding.of(kept("binding", how, lambda: bind(*how).arrays()))


def find_sound(corners: Array, rest: Array) -> Array | None:
    """(U,) 1 of triangles with an area, falling smoothly to 0 as it vanishes; None where no
    triangle is thin, or all have their area. corners, rest: (U, 3, 3) m."""
    sound = np.empty(len(corners))
    if not has_flat(corners, _THIN):
        return None
    return None if fill_sound(corners, rest, _THINNEST, _CRUSHED_RATIO, sound) else sound


def borrow_turns(binding: Binding, sound: Array) -> tuple[Binding, Flags]:
    """The binding with the turns of roots on collapsed triangles left to those around, and (F,)
    which roots still have a turn. sound: (U,) as find_sound gives it."""
    field = binding.field
    weights = np.maximum(field.weights, 0.0) * sound[field.places]
    total = np.add.reduceat(weights, field.starts)
    has_turn = total > _MIN_WEIGHT
    sizes = np.diff(field.starts, append=len(field.places))
    weights = weights / np.repeat(np.where(has_turn, total, 1.0), sizes)
    return replace(binding, field=replace(field, weights=weights)), has_turn


def follow(binding: Binding, corners: Array, mirrored: bool = False) -> tuple[Array, Array]:
    """Root positions (F, 3) m and rotations since rest (F, 3, 3) on deformed triangles.

    corners: (U, 3, 3) m, of the triangles that the binding uses. mirrored: the skin has been
    mirrored since rest. There is no rotation that does the same then; the rotation is the one that
    takes the direction along and the skin's normal with it.
    """
    rotations = binding.field.turns(corners, mirrored)
    surface = np.einsum("fk,fkc->fc", binding.barycentric, corners[binding.own])
    return surface + np.einsum("fij,fj->fi", rotations, binding.offset), rotations


def closest(
    roots: Array, corners: Array, among: tuple[Array, Array] | None = None
) -> tuple[Indices, Array]:
    """Closest triangle (F,) and barycentric coordinates (F, 3) of the closest point on it.

    roots: (F, 3), corners: (T, 3, 3), T > 0. among: other roots and corners, by which one of
    equally close triangles is chosen; of those equally close in both the first is taken.
    """
    search = _Search(corners)
    triangle = np.zeros(len(roots), dtype=np.int64)
    barycentric = np.zeros((len(roots), 3))
    # blocks bound the memory: a root far from the skin has many triangles about equally close
    for start in range(0, len(roots), _ROOTS_AT_ONCE):
        block = slice(start, start + _ROOTS_AT_ONCE)
        other = None if among is None else (among[0][block], among[1])
        triangle[block], barycentric[block] = search.closest(roots[block], other)
    return triangle, barycentric


class _Search:
    """Search trees of triangle centres, all in one and by classes of size."""

    def __init__(self, corners: Array) -> None:
        self._corners = corners
        self._all = search_tree(corners.mean(axis=1))
        self._classes = size_classes(corners)

    def closest(self, roots: Array, among: tuple[Array, Array] | None) -> tuple[Indices, Array]:
        row, candidate = self._candidates(roots)
        places, corners = roots.take(row, axis=0), self._corners.take(candidate, axis=0)
        weights = _closest_weights(places, corners)
        squared = _squared_distance(places, weights, corners)
        if among is not None:
            least = np.full(len(roots), np.inf)
            np.minimum.at(least, row, squared)
            alike = np.sqrt(squared) <= np.sqrt(least[row]) + _ALIKE
            row, candidate, weights = row[alike], candidate[alike], weights[alike]
            places, corners = among
            squared = _squared_distance(places[row], weights, corners[candidate])
        order = np.lexsort((candidate, squared, row))
        first = order[np.unique(row[order], return_index=True)[1]]
        return candidate[first], weights[first]

    def _candidates(self, roots: Array) -> tuple[Indices, Indices]:
        """Pairs (root, triangle); every root's closest triangle is among them.

        A triangle at a distance has its centre within that distance and its radius.
        """
        _, near = self._all.query(roots)
        weights = _closest_weights(roots, self._corners[near])
        reach = np.sqrt(_squared_distance(roots, weights, self._corners[near]))
        reach = reach * (1.0 + 1e-9) + _ALIKE
        rows, triangles = [np.arange(len(roots))], [near]
        for members, tree, radii in self._classes:
            hits = tree.query_ball_point(roots, reach + radii.max(), return_sorted=False)
            counts = np.fromiter(map(len, hits), np.int64, len(hits))
            row = np.repeat(np.arange(len(roots)), counts)
            hit = np.fromiter(chain.from_iterable(hits), np.int64, len(row))
            away = tree.data.take(hit, axis=0) - roots.take(row, axis=0)
            near_enough = dots(away, away) <= (reach[row] + radii[hit]) ** 2
            rows.append(row[near_enough])
            triangles.append(members[hit[near_enough]])
        return np.concatenate(rows), np.concatenate(triangles)


def _squared_distance(points: Array, weights: Array, corners: Array) -> Array:
    gap = np.einsum("pk,pkc->pc", weights, corners) - points
    return dots(gap, gap)


def _closest_weights(points: Array, corners: Array) -> Array:
    """(P, 3) barycentric coordinates of the closest points of triangles (P, 3, 3) to points."""
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    away = points - corners[:, 0]
    aa, ab, bb = dots(first, first), dots(first, second), dots(second, second)
    pa, pb = dots(away, first), dots(away, second)
    determinant = aa * bb - ab * ab
    safe = np.where(determinant > 0.0, determinant, 1.0)
    v, w = (bb * pa - ab * pb) / safe, (aa * pb - ab * pa) / safe
    inside = np.stack([1.0 - v - w, v, w], axis=1)
    weights, squared = inside, np.full(len(points), np.inf)
    is_inside = (determinant > 0.0) & (inside >= 0.0).all(axis=1)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        side = corners[:, end] - corners[:, start]
        length = dots(side, side)
        along = dots(points - corners[:, start], side) / np.where(length > 0.0, length, 1.0)
        along = np.clip(along, 0.0, 1.0)
        gap = corners[:, start] + along[:, None] * side - points
        distance = dots(gap, gap)
        on_edge = np.zeros_like(inside)
        on_edge[:, start], on_edge[:, end] = 1.0 - along, along
        better = ~is_inside & (distance < squared)
        weights = np.where(better[:, None], on_edge, weights)
        squared = np.where(better, distance, squared)
    return weights
