"""Triangles of a cache or a pose, with the attributes that colours and shading need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Floats, Indices
from featherfx.algebra.vectors import vertex_normals
from featherfx.errors import Problem, require
from featherfx.feather.types import LEADING, RACHIS_PART, TRAILING
from featherfx.groom.keys.problems import nearest
from featherfx.phases import StageRead, note_read
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import CachedFeather

# barbs where there are none: no place is between them
_WHOLE = np.array([0.5, 0.0, 0.0, 1.0, 0.0], dtype=np.float32)


@dataclass(frozen=True)
class Geometry:
    """V vertices and T triangles; metres, z up.

    points: (V, 3). triangles: (T, 3). material: (T,) VANE, RACHIS_MATERIAL, SKIN_MATERIAL or
    EYE of light_kernels.
    normals, tangents: (V, 3), zero where there is none. colours: (V, 3), as a kernel takes them.
    barbs: (V, 5) of vanes: number of the barb and place on it, how round it is shaded, the part of
    it over which its end is free (barb_kernels.py), and nm of a film that shines by interference.
    """

    points: Floats
    triangles: NDArray[np.int32]
    material: NDArray[np.uint8]
    normals: Floats
    tangents: Floats
    colours: Floats
    barbs: Floats


def geometry_of(
    points: Array | Floats,
    triangles: Indices,
    material: Array | int,
    normals: Array | Floats,
    colours: Array | Floats,
) -> Geometry:
    """Make geometry of triangles without barbs. material: one, or (T,). colours: (V, 3) or (3,)."""
    flat = np.zeros_like(points, dtype=np.float32)
    return Geometry(
        points=points.astype(np.float32),
        triangles=triangles.astype(np.int32),
        material=np.broadcast_to(material, len(triangles)).astype(np.uint8),
        normals=normals.astype(np.float32),
        tangents=flat,
        colours=np.broadcast_to(colours, points.shape).astype(np.float32),
        barbs=np.broadcast_to(_WHOLE, (len(points), 5)),
    )


def joined(parts: Sequence[Geometry]) -> Geometry:
    """Several as one."""
    starts = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    values = {
        each.name: np.concatenate([getattr(part, each.name) for part in parts])
        for each in fields(Geometry)
    }
    values["triangles"] = np.concatenate(
        [part.triangles + np.int32(start) for part, start in zip(parts, starts, strict=True)]
    )
    return Geometry(**values)


def apart(points: Array, triangles: Indices, normals: Array, colours: Array) -> Geometry:
    """Triangles that share no vertices, of colours (T, 3)."""
    corners = triangles.ravel()
    own = np.arange(len(corners)).reshape(-1, 3)
    return geometry_of(points[corners], own, 0, normals[corners], np.repeat(colours, 3, axis=0))


class DrawnGrid(NamedTuple):
    """A vane's vertices from the shaft outwards. rows: (R, C). edges: (R - 1, C), upper edges of
    the strips between them; None where these are the rows. heights: (R,). places: (C,), on the
    barb."""

    rows: Indices
    edges: Indices | None
    heights: Array
    places: Array


@dataclass(frozen=True)
class Topology:
    """Vertices of a mesh as rows of barbs and rings of the rachis.

    vanes: of each side. shaft: (R, M) vertices around the shaft and heights (R,); None where it has
    none.
    """

    vanes: tuple[DrawnGrid, ...]
    shaft: tuple[Indices, Array] | None


def topology_of(feather: CachedFeather) -> Topology | None:
    """None where the mesh is no feather with rows of barbs, such as one of another program."""
    if feather.st is None:
        return None
    vanes = []
    for side in (LEADING, TRAILING):
        if (feather.side == side).any():
            triangles = feather.triangles[feather.side == side]
            grid = _vane_grid(feather.st, triangles) or _parting_grid(feather.st, triangles)
            if grid is None:
                return None
            vanes.append(grid)
    shaft = None
    if (feather.side == RACHIS_PART).any():
        shaft = _shaft_rings(feather.st, feather.triangles[feather.side == RACHIS_PART])
        if shaft is None:
            return None
    return Topology(tuple(vanes), shaft) if vanes and shaft else None


def _vane_grid(st: Floats, triangles: Indices) -> DrawnGrid | None:
    """None where rows are no barbs of one number of vertices, one for each place."""
    rows = _rows(st, np.unique(triangles))
    grid = _ordered(st, rows)
    if grid is None:
        return None
    widest = int(np.argmax([len(row) for row in rows]))
    places = np.abs(st[grid[widest], 0] - 0.5).astype(float)
    places = (places - places[0]) / max(places[-1] - places[0], 1e-12)
    heights = st[grid[:, 0], 1].astype(float)
    return DrawnGrid(grid, None, heights, places) if (np.diff(places) > 0).all() else None


def _parting_grid(st: Floats, triangles: Indices) -> DrawnGrid | None:
    """As _vane_grid, of a vane that may part: each strip has edges of its own."""
    heights = st[triangles, 1]
    low, high = heights.min(axis=1), heights.max(axis=1)
    lower, upper = [], []
    for height in np.unique(low):
        strip = low == height
        vertices = np.unique(triangles[strip])
        own = st[vertices, 1]
        if len(np.unique(high[strip])) != 1 or len(np.unique(own)) != 2:
            return None
        lower.append(vertices[own == height])
        upper.append(vertices[own != height])
    rows = _ordered(st, [*lower, upper[-1]])
    edges = _ordered(st, upper)
    if rows is None or edges is None or rows.shape[1] != edges.shape[1]:
        return None
    whole = _vane_grid(st, rows)
    return None if whole is None else whole._replace(edges=edges)


def _ordered(st: Floats, rows: Sequence[Indices]) -> Indices | None:
    """(R, C) vertices of rows from the shaft outwards, or None."""
    count = max((len(row) for row in rows), default=0)
    if count < 2 or len(rows) < 2:
        return None
    ordered = []
    for row in rows:
        if len(row) == 1:
            # base or tip, where barbs have no length
            row = np.repeat(row, count)
        if len(row) != count:
            return None
        ordered.append(row[np.argsort(np.abs(st[row, 0] - 0.5), kind="stable")])
    return np.array(ordered)


def _shaft_rings(st: Floats, triangles: Indices) -> tuple[Indices, Array] | None:
    rows = _rows(st, np.unique(triangles))
    sizes = [len(row) for row in rows]
    count = max(set(sizes), key=sizes.count)
    # a cap's middle stands behind the ring that it closes
    rings = [row[:count] for row in rows if len(row) in (count, count + 1)]
    if count < 3 or len(rings) != len(rows) or len(rings) < 2:
        return None
    grid = np.array(rings)
    return grid, st[grid[:, 0], 1].astype(float)


def _rows(st: Floats, vertices: Indices) -> list[Indices]:
    """Vertices of one height each, from the base on, in their own order."""
    _, inverse = np.unique(st[vertices, 1], return_inverse=True)
    return [vertices[inverse == k] for k in range(int(inverse.max()) + 1)]


@dataclass(frozen=True)
class DrawnPose:
    """One time; metres, z up. points, normals: (V, 3). barbs: (T, 3) barb directions, zero where
    unknown. hooked: (T,) 1 where hooks hold to 0 where they are open."""

    points: Array
    normals: Array
    barbs: Array
    hooked: Array


@dataclass(frozen=True)
class DrawnScene:
    """The constant part of the meshes that are drawn.

    cache: where it stands. chosen: (N,) feathers of it. feathers: those. starts: (N + 1,) first
    point of each, and V. triangles: (T, 3). rachis: (T,) bool. owner: (T,) feather, of N. regions:
    per feather.
    along_feather: (T,) fraction of the feather's length, from st. to_world: (3, 3), row vectors,
    stage to metres and z up.
    """

    cache: Cache
    chosen: Indices
    feathers: tuple[CachedFeather, ...]
    starts: Indices
    triangles: Indices
    rachis: Flags
    owner: Indices
    regions: tuple[str, ...]
    along_feather: Array
    to_world: Array

    @cached_property
    def rest(self) -> DrawnPose:
        """The rest pose, which only colours of values ask for."""
        rest = load_pose(self.cache, self, None)
        if any(f.rest is None for f in self.feathers):
            return rest
        authored = np.concatenate([np.asarray(f.rest, dtype=float) for f in self.feathers])
        return replace(rest, points=authored @ self.to_world)


def chosen_feathers(
    cache: Cache, source: str, feathers: Sequence[str], regions: Sequence[str]
) -> Indices:
    """(N,) those of the ids or regions, patterns with * and ? too; all where neither is given.

    Raises InputError where a pattern fits none, with names that are like it.
    """
    known = {
        "feather": [each.id for each in cache.feathers],
        "region": [each.region for each in cache.feathers],
    }
    problems, chosen = [], np.zeros(len(cache.feathers), dtype=bool)
    for key, patterns in (("feather", feathers), ("region", regions)):
        for pattern in patterns:
            fits = np.array([fnmatchcase(name, pattern) for name in known[key]], dtype=bool)
            if not fits.any():
                near = nearest(pattern, set(known[key]) - {""})
                problems.append(Problem(source, key, f"no {key} fits '{pattern}', {near}"))
            chosen |= fits
    require(*problems)
    return np.flatnonzero(chosen if feathers or regions else ~chosen)


def load_scene(cache: Cache, chosen: Indices | None = None) -> DrawnScene:
    """The scene of a cache, or of some of its feathers."""
    chosen = np.arange(len(cache.feathers)) if chosen is None else chosen
    feathers = tuple(cache.feathers[k] for k in chosen)
    note_read(StageRead(str(cache.path), "/", "drawn surface", len(chosen), cache.left))
    counts = [len(points) for points in cache.points_of(chosen.tolist())]
    starts = np.cumsum([0, *counts])
    triangles = np.concatenate(
        [f.triangles + offset for f, offset in zip(feathers, starts[:-1], strict=True)]
    )
    heights = [
        np.zeros(n) if f.st is None else f.st[:, 1] for f, n in zip(feathers, counts, strict=True)
    ]
    return DrawnScene(
        cache=cache,
        chosen=chosen,
        feathers=feathers,
        starts=starts,
        triangles=triangles,
        rachis=np.concatenate([f.side == RACHIS_PART for f in feathers]),
        owner=np.repeat(np.arange(len(counts)), [len(f.triangles) for f in feathers]),
        regions=tuple(f.region for f in feathers),
        along_feather=np.concatenate(heights).astype(float)[triangles].mean(axis=1),
        to_world=cache.to_world,
    )


def load_pose(cache: Cache, scene: DrawnScene, time: float | None) -> DrawnPose:
    """The feathers of a scene at a time code; None is the rest pose (first sample where none is
    authored)."""
    return _pose(cache, scene.chosen, scene.triangles, scene.to_world, time)


def load_points(
    cache: Cache, scene: DrawnScene, time: float | None, among: Indices | None = None
) -> Array:
    """(V, 3) points alone, much faster than load_pose. among: ascending numbers of some of them,
    which alone are read."""
    chosen = scene.chosen.tolist()
    if among is None:
        points = np.concatenate(cache.points_of(chosen, time), dtype=float)
    else:
        points = cache.some_points_of(chosen, time, among)
    return points if (scene.to_world == np.eye(3)).all() else points @ scene.to_world


def _pose(
    cache: Cache, chosen: Indices, triangles: Indices, to_world: Array, time: float | None
) -> DrawnPose:
    poses = [cache.pose(k, time) for k in chosen]
    points = np.concatenate([p.points for p in poses]).astype(float) @ to_world
    turn = to_world / np.linalg.norm(to_world[0])
    barbs = [
        np.zeros((len(cache.feathers[k].triangles), 3))
        if p.barb_direction is None
        else p.barb_direction
        for p, k in zip(poses, chosen, strict=True)
    ]
    if all(p.normals is not None for p in poses):
        normals = np.concatenate([np.asarray(p.normals, dtype=float) for p in poses]) @ turn
    else:
        normals = vertex_normals(points, triangles)
    hooked = [
        np.ones(len(cache.feathers[k].triangles)) if p.hooked is None else p.hooked
        for p, k in zip(poses, chosen, strict=True)
    ]
    along = np.concatenate(barbs).astype(float) @ turn
    return DrawnPose(points, normals, along, np.concatenate(hooked).astype(float))
