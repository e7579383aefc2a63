"""Plumage as a layout moves it, and the skin beneath it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.raster import nodes_within
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots, face_products, unit
from featherfx.feather.build import distinct_shapes
from featherfx.feather.crossings import BODY, TrianglePatches, find_intersections, make_patches
from featherfx.feather.layout.move_kernels import all_gaps, count_cover
from featherfx.feather.layout.overlap import Strips
from featherfx.feather.shapes import build_shapes
from featherfx.feather.types import RACHIS_PART, Feather
from featherfx.groom.skin.field import search_tree
from featherfx.groom.types import Placement

# the rest shape is built with so many rows and columns, of which every second row gives samples,
# and mapped onto so many nodes
_ROWS, _COLUMNS, _SAMPLED = 21, 6, 2
_NODES = (56, 28)
# points of meshes that are turned at once
_AT_ONCE = 100_000


class HeightMaps(NamedTuple):
    """S shapes, in feather lengths.

    samples: (S, Q, 3) points of the vanes, those within before those on the edge; inner: (S,) how
    many lie within, and used: (S,) how many each shape has in all. heights: (S, H, W) above the
    x-y plane, NaN beside the vane. window: (S, 4) x and y of the first node, and the steps between
    nodes.
    """

    samples: Array
    inner: Indices
    used: Indices
    heights: Array
    window: Array


class Arrangement(NamedTuple):
    """F feathers as a layout moves them.

    maps: of their shapes; shape: (F,) which. root: (F, 3) m and frame: (F, 3, 3) as placed. moves:
    (F, 3) raise (rad), roll (rad), lift (m); place: (F, 3) and rotation: (F, 3, 3), root and frame
    as moved. placed_size, size: (F,) m, lengths as placed and now. grown: (F,) whether a feather
    may be shortened and dropped. kept: (F,) False once dropped. relation: (3, 4) and
    nearest: (2, 2) are scratch.
    """

    maps: HeightMaps
    shape: Indices
    root: Array
    frame: Array
    moves: Array
    place: Array
    rotation: Array
    placed_size: Array
    size: Array
    grown: Flags
    kept: Flags
    relation: Array
    nearest: Array

    def world(self) -> Array:
        """(F, Q, 3) m, the samples."""
        samples = self.maps.samples[self.shape] * self.size[:, None, None]
        return self.place[:, None] + np.einsum("fij,fqj->fqi", self.rotation, samples)

    def with_scratch(self) -> Arrangement:
        """The same feathers, with scratch of its own."""
        return self._replace(relation=np.zeros((3, 4)), nearest=np.zeros((2, 2)))

    def put_back(self) -> None:
        """As placed, though as short as they are now."""
        self.moves[:] = 0.0
        self.place[:], self.rotation[:] = self.root, self.frame

    def moved(self, strips: Strips) -> Strips:
        """Strips of the feathers as placed, moved and shortened as they are."""
        change = self.rotation @ self.frame.transpose(0, 2, 1)
        kept = self.size / self.placed_size
        return replace(
            strips,
            root=self.place,
            shaft=kept[:, None] * np.einsum("fij,fj->fi", change, strips.shaft),
            dorsal=self.rotation[:, :, 2],
            reach=kept * strips.reach,
        )

    def heights(self, skin: SkinPlanes | None) -> Array:
        """(F,) m, least height over the skin; NaN without one."""
        if skin is None:
            return np.full(len(self.size), np.nan)
        heights = skin.gaps(self.world())
        unused = np.arange(heights.shape[1]) >= self.maps.used[self.shape][:, None]
        return np.asarray(np.where(unused, np.inf, heights).min(axis=1))

    def gaps(self, pairs: Indices) -> tuple[Array, Array]:
        """Gaps (K,) m of pairs, NaN where they are not over each other, and where they are least.

        The places (K, 2, 2) m are x and y in the frame of the upper, then of the lower feather.
        """
        gaps, places = np.full(len(pairs), np.nan), np.zeros((len(pairs), 2, 2))
        all_gaps(self, pairs, gaps, places)
        return gaps, places

    def cover(self, pairs: Indices) -> float:
        """Mean number of feathers over a point of a vane, itself included."""
        counts = np.zeros((len(self.size), self.maps.samples.shape[1]), dtype=np.int64)
        count_cover(self, pairs, counts)
        inner = self.maps.inner[self.shape]
        within = np.arange(counts.shape[1]) < inner[:, None]
        return 1.0 + float(counts[within].sum() / inner.sum())


class LayoutMeshes:
    """The vanes of F feathers as meshes of V points, and a skin of S beneath. points:
    (V, 3) in feather lengths. owner: (V,) whose each is, in order. skin: (S, 3) m, the last points
    of the patches, of BODY. Only what has moved since the last look is compared again."""

    def __init__(
        self, points: Array, owner: Indices, skin: Array, patches: TrianglePatches
    ) -> None:
        self._points, self._owner, self._patches = points, owner, patches
        self._first = np.flatnonzero(np.diff(owner, prepend=-1))
        self._world = np.concatenate([np.full_like(points, np.nan), skin])
        self._found = np.zeros((0, 2), dtype=np.int64)

    def crossed(self, feathers: Arrangement) -> Indices:
        """(K, 2) kept feathers that pass through each other where they are, or through the skin,
        the lower number first, BODY for the skin."""
        world, count = self._world.copy(), len(self._points)
        for begin in range(0, count, _AT_ONCE):
            some = slice(begin, min(begin + _AT_ONCE, count))
            own = self._owner[some]
            turned = np.einsum("vij,vj->vi", feathers.rotation[own], self._points[some])
            world[some] = feathers.place[own] + feathers.size[own, None] * turned
        changed = (world[:count] != self._world[:count]).any(axis=1)
        # the skin is the last
        moved = np.append(np.logical_or.reduceat(changed, self._first), False)
        kept = np.append(feathers.kept, True)
        jobs = os.cpu_count() or 1
        again = find_intersections(world, self._patches, jobs, moved & kept).owners
        known = self._found[~moved[self._found].any(axis=1)]
        self._world, self._found = world, np.unique(np.concatenate([known, again]), axis=0)
        return self._found[kept[self._found].all(axis=1)]


def _vanes(feather: Feather, length: float) -> tuple[Array, Indices]:
    """(V, 3) points of the vanes, in lengths, and (T, 3) their triangles."""
    surface = feather.surface
    used, corners = np.unique(surface.triangles[surface.part != RACHIS_PART], return_inverse=True)
    return surface.points(feather.rest)[used] / length, corners.reshape(-1, 3)


def _built_on(feathers: Sequence[Placement]) -> tuple[list[tuple[Feather, float]], Indices]:
    """The shapes of feathers, each with its length (m), and (F,) which is whose."""
    first, shape = distinct_shapes(feathers)
    kinds = tuple((feathers[k].prototype or feathers[k].kind, feathers[k].mirrored) for k in first)
    shapes = build_shapes(kinds, _ROWS, _COLUMNS)
    built = [(each, kind.length) for each, (kind, _) in zip(shapes, kinds, strict=True)]
    return built, np.array(shape)


def arrangement_of(feathers: Sequence[Placement]) -> Arrangement:
    """Feathers as they are placed. Raises InputError for shapes that cannot be built."""
    built, shape = _built_on(feathers)
    frame = np.array([feather.rotation for feather in feathers])
    root = np.array([feather.position for feather in feathers])
    size = np.array([feather.kind.length for feather in feathers])
    return Arrangement(
        maps=height_maps(built),
        shape=shape,
        root=root,
        frame=frame,
        moves=np.zeros((len(feathers), 3)),
        place=root.copy(),
        rotation=frame.copy(),
        placed_size=size,
        size=size.copy(),
        grown=np.array([feather.grown for feather in feathers]),
        kept=np.ones(len(feathers), dtype=np.bool_),
        relation=np.zeros((3, 4)),
        nearest=np.zeros((2, 2)),
    )


def meshes_of(feathers: Sequence[Placement], skin: Array | None) -> LayoutMeshes:
    """The vanes of feathers over a skin's corners (T, 3, 3) m."""
    below = np.zeros((0, 3)) if skin is None else skin.reshape(-1, 3)
    faces = np.arange(len(below)).reshape(-1, 3)
    built, shape = _built_on(feathers)
    vanes = [_vanes(*each) for each in built]
    chosen = [vanes[k] for k in shape]
    parts = [(p, t, np.zeros(len(t), bool), f) for f, (p, t) in enumerate(chosen)]
    patches = make_patches([*parts, (below, faces, np.zeros(len(faces), bool), BODY)])
    owner = np.repeat(np.arange(len(chosen)), [len(points) for points, _ in chosen])
    return LayoutMeshes(np.concatenate([points for points, _ in chosen]), owner, below, patches)


class SkinPlanes:
    """Tangent planes of a skin: those of the nearest triangle's middle."""

    def __init__(self, corners: Array) -> None:
        normals = unit(face_products(corners))
        centres = corners.mean(axis=1)
        offsets = dots(centres, normals)
        self._planes = np.concatenate([normals, offsets[:, None]], axis=1)
        self._tree = search_tree(centres)
        self._points, self._found = np.zeros((0, 0, 3)), np.zeros((0, 0, 4))

    def planes(self, points: Array) -> Array:
        """(F, Q, 4) unit normal and offset, m, near points (F, Q, 3) of feathers; those that have
        not moved since the last look keep theirs."""
        if self._points.shape != points.shape:
            self._points = np.full_like(points, np.nan)
            self._found = np.zeros((*points.shape[:2], 4))
        moved = (points != self._points).any(axis=(1, 2))
        _, near = self._tree.query(points[moved].reshape(-1, 3), workers=-1)
        self._found[moved] = self._planes[near].reshape(-1, points.shape[1], 4)
        self._points = points
        return self._found

    def gaps(self, points: Array) -> Array:
        """(F, Q) m, heights of points (F, Q, 3) over the skin; negative inside."""
        planes = self.planes(points)
        return np.asarray(np.einsum("fqc,fqc->fq", points, planes[..., :3]) - planes[..., 3])


def height_maps(built: Sequence[tuple[Feather, float]]) -> HeightMaps:
    """Maps of feathers, each with its length (m)."""
    parts = [_samples(feather) for feather, _ in built]
    samples = [
        np.concatenate(part) / length for part, (_, length) in zip(parts, built, strict=True)
    ]
    most = max(len(each) for each in samples)
    padded = np.zeros((len(samples), most, 3))
    for k, each in enumerate(samples):
        padded[k, : len(each)] = each
    maps = [_map(feather, length) for feather, length in built]
    return HeightMaps(
        samples=padded,
        inner=np.array([len(within) for within, _ in parts]),
        used=np.array([len(each) for each in samples]),
        heights=np.stack([heights for heights, _ in maps]),
        window=np.stack([window for _, window in maps]),
    )


def _samples(feather: Feather) -> tuple[Array, Array]:
    """(Q, 3) m within and on the edge: rachis and middles of barbs; ends of barbs and the tip."""
    middle, end = (_COLUMNS + 1) // 2, _COLUMNS
    nodes, within, edge = feather.rest.nodes, [], []
    sampled = np.arange(len(nodes)) % _SAMPLED == 0
    for side in range(2):
        has = (feather.barb_length[side] > 0.0) & sampled
        within.append(nodes[has, side * _COLUMNS + middle])
        edge.append(nodes[has, side * _COLUMNS + end])
    # where a vane begins rounded, it reaches back to a row without barbs
    cell = feather.cell.any(axis=(0, 2, 3))
    in_vane = (np.append(cell, False) | np.append(False, cell)) & sampled
    shaft = nodes[in_vane, 0]
    return np.concatenate([shaft[1:], *within]), np.concatenate([shaft[:1], *edge])


def _map(feather: Feather, length: float) -> tuple[Array, Array]:
    """(H, W) heights and (4,) window of one feather, by its vanes' triangles."""
    points, triangles = _vanes(feather, length)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    step = np.maximum((high - low) / (np.array(_NODES) - 1.0), 1e-9)
    return _heights(low, step, points[triangles]), np.concatenate([low, step])


def _heights(low: Array, step: Array, corners: Array) -> Array:
    """(H, W) greatest height of triangles (T, 3, 3) over nodes from low (2,) on, step (2,) apart,
    NaN where there is none."""
    best = np.full(_NODES, -np.inf)
    for found in nodes_within((corners[:, :, :2] - low) / step, _NODES):
        z = corners[found.triangle, :, 2]
        height = z[:, 0] + found.u * (z[:, 1] - z[:, 0]) + found.v * (z[:, 2] - z[:, 0])
        np.maximum.at(best, (found.i, found.j), height)
    return np.where(np.isfinite(best), best, np.nan)
