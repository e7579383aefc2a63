"""A feather at rest as a height over the plane of its root, and as samples, at unit length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.build import build_feather
from featherfx.feather.types import RACHIS, Feather
from featherfx.groom.types import FeatherKind

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# the rest shape is built with so many rows and columns, and mapped onto so many nodes
_ROWS, _COLUMNS = 11, 4
_NODES = (28, 14)


@dataclass(frozen=True)
class HeightMaps:
    """S shapes, in feather lengths.

    samples: (S, Q, 3) points of the vanes, those within before those on the edge; inner: (S,) how
    many lie within, and used: (S,) how many each shape has in all. heights:
    (S, H, W) above the x-y plane, NaN beside the vane. window: (S, 4) x and y of the first node,
    and the steps between nodes.
    """

    samples: Array
    inner: Indices
    used: Indices
    heights: Array
    window: Array


def height_maps(shapes: list[tuple[FeatherKind, bool]]) -> HeightMaps:
    """Maps of kinds, each mirrored or not. Raises InputError for shapes that cannot be built."""
    built = [
        (build_feather(kind, _ROWS, _COLUMNS, mirrored), kind.length) for kind, mirrored in shapes
    ]
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
    within, edge = [], []
    for side in range(2):
        has = feather.barb_length[side] > 0.0
        first = 2 + side * _COLUMNS
        within.append(feather.points[has, first + middle])
        edge.append(feather.points[has, first + end])
    in_vane = (feather.barb_length > 0.0).any(axis=0)
    shaft = feather.points[in_vane, 0]
    return np.concatenate([shaft[1:], *within]), np.concatenate([shaft[:1], *edge])


def _map(feather: Feather, length: float) -> tuple[Array, Array]:
    """(H, W) heights and (4,) window of one feather, by its vanes' triangles."""
    surface = feather.surface
    triangles = surface.triangles[surface.part != RACHIS]
    points = surface.points(feather.points)[:, :] / length
    used = points[np.unique(triangles)]
    low, high = used[:, :2].min(axis=0), used[:, :2].max(axis=0)
    step = np.maximum((high - low) / (np.array(_NODES) - 1.0), 1e-9)
    axes = [low[k] + step[k] * np.arange(_NODES[k]) for k in range(2)]
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    heights = _heights(nodes, points[triangles]).reshape(_NODES)
    return heights, np.concatenate([low, step])


def _heights(nodes: Array, corners: Array) -> Array:
    """(N,) greatest height of triangles (T, 3, 3) over places (N, 2), NaN where there is none."""
    first = corners[:, 1, :2] - corners[:, 0, :2]
    second = corners[:, 2, :2] - corners[:, 0, :2]
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    flat = np.abs(area) < 1e-14
    inverse = 1.0 / np.where(flat, 1.0, area)
    away = nodes[:, None, :] - corners[None, :, 0, :2]
    u = (away[..., 0] * second[:, 1] - away[..., 1] * second[:, 0]) * inverse
    v = (first[:, 0] * away[..., 1] - first[:, 1] * away[..., 0]) * inverse
    inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9) & ~flat
    z = corners[:, 0, 2] + u * (corners[:, 1, 2] - corners[:, 0, 2])
    z = z + v * (corners[:, 2, 2] - corners[:, 0, 2])
    best = np.where(inside, z, -np.inf).max(axis=1)
    return np.where(np.isfinite(best), best, np.nan)
