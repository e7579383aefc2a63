"""The meshes of a cache as one triangle soup with the attributes that colours need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import Problem, require
from featherfx.feather.types import RACHIS_PART
from featherfx.groom.keys.problems import nearest
from featherfx.provenance import StageRead, note_read
from featherfx.render.geometry import vertex_normals
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import CachedFeather


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
