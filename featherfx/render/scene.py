"""All meshes of a cache as one triangle soup with the attributes that colours need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import RACHIS
from featherfx.usd.read.read import Cache, CachedPose

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class DrawnPose:
    """One time. points, normals: (V, 3). barbs: (T, 3) barb directions, zero where unknown."""

    points: Array
    normals: Array
    barbs: Array


@dataclass(frozen=True)
class DrawnScene:
    """The constant part of all meshes.

    triangles: (T, 3). rachis: (T,) bool. owner: (T,) feather. regions: per feather. apex: (T,)
    which corner is opposite to the barb edge, -1 where there are no barbs. along_feather: (T,)
    fraction of the feather's length, from st.
    rest: rest pose. Units of the stage.
    """

    triangles: Indices
    rachis: NDArray[np.bool_]
    owner: Indices
    regions: tuple[str, ...]
    apex: Indices
    along_feather: Array
    rest: DrawnPose

    @property
    def extent_of_rest(self) -> float:
        return float(np.ptp(self.rest.points, axis=0).max())


def load_scene(cache: Cache) -> DrawnScene:
    """The scene of a cache."""
    counts = [len(cache.pose(k).points) for k in range(len(cache.feathers))]
    offsets = np.cumsum([0, *counts[:-1]])
    triangles = np.concatenate(
        [f.triangles + offset for f, offset in zip(cache.feathers, offsets, strict=True)]
    )
    rest = load_pose(cache, triangles, None)
    authored = [f.rest is not None for f in cache.feathers]
    if all(authored):
        points = np.concatenate([np.asarray(f.rest, dtype=float) for f in cache.feathers])
        rest = DrawnPose(points, rest.normals, rest.barbs)
    heights = [
        np.zeros(n) if f.st is None else f.st[:, 1]
        for f, n in zip(cache.feathers, counts, strict=True)
    ]
    return DrawnScene(
        triangles=triangles,
        rachis=np.concatenate([f.side == RACHIS for f in cache.feathers]),
        owner=np.repeat(np.arange(len(counts)), [len(f.triangles) for f in cache.feathers]),
        regions=tuple(f.region for f in cache.feathers),
        apex=_apex(rest, triangles),
        along_feather=np.concatenate(heights).astype(float)[triangles].mean(axis=1),
        rest=rest,
    )


def load_pose(cache: Cache, triangles: Indices, time: float | None) -> DrawnPose:
    """All feathers at a time code; None is the rest pose (first sample where none is authored)."""
    poses = [cache.pose(k, time) for k in range(len(cache.feathers))]
    points = np.concatenate([p.points for p in poses]).astype(float)
    barbs = [
        np.zeros((len(f.triangles), 3)) if p.barb_direction is None else p.barb_direction
        for p, f in zip(poses, cache.feathers, strict=True)
    ]
    return DrawnPose(
        points, _normals(poses, points, triangles), np.concatenate(barbs).astype(float)
    )


def _normals(poses: list[CachedPose], points: Array, triangles: Indices) -> Array:
    if all(p.normals is not None for p in poses):
        return np.concatenate([np.asarray(p.normals, dtype=float) for p in poses])
    a, b, c = (points[triangles[:, k]] for k in range(3))
    summed = np.zeros_like(points)
    np.add.at(summed, triangles, np.cross(b - a, c - a)[:, None, :])
    length = np.linalg.norm(summed, axis=1, keepdims=True)
    return summed / np.where(length > 0, length, 1)


def _apex(rest: DrawnPose, triangles: Indices) -> Indices:
    """The corner opposite to the edge that runs along the barb direction."""
    corners = rest.points[triangles]
    # Edge k is opposite to corner k.
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    length = np.maximum(np.linalg.norm(edges, axis=2), 1e-300)
    cosine = np.abs(np.einsum("tkc,tc->tk", edges, rest.barbs)) / length
    return np.where(rest.barbs.any(axis=1), np.argmax(cosine, axis=1), -1)
