"""Feathers in a line that lie on each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from places import SAMPLES

from featherfx.feather.crossings import find_intersections, make_patches
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import RACHIS_PART
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Motion, Shot


def in_line(count: int, step: np.ndarray, frames: int, **quality: object) -> Shot:
    """Like feathers, each a step (m) behind the last, whose roots swing together in still air."""
    shot = read_shot(SAMPLES / "feather_pull" / "shot.toml")
    one = shot.groom.feathers[0]
    feathers = tuple(
        replace(one, id=f"f{k}", region="coat", position=k * step, rank=count - k)
        for k in range(count)
    )
    swing = {
        "amplitude": 0.03,
        "frequency": 3.0,
        "direction": (0.0, 0.0, 1.0),
        "ramp_periods": 0.25,
    }
    return replace(
        shot,
        groom=replace(shot.groom, feathers=feathers),
        first_frame=0,
        last_frame=frames,
        grips=(),
        motion=Motion("shake", swing),
        wind=replace(shot.wind, speed=0.0, gust=0.0),
        quality=replace(
            shot.quality.pushing, columns=3, coefficients=1, simulated_rows=0, **quality
        ),
    )


def least_gap(upper: np.ndarray, lower: np.ndarray) -> float:
    """m, of the nodes of one vane over the other, along z, by triangles of its grid."""
    m = (lower.shape[1] - 3) // 2
    columns = [*range(2 + 2 * m, 2 + m, -1), 0, *range(3, 3 + m)]
    low, high = lower[:, columns], upper[:, columns].reshape(-1, 3)
    corners = np.concatenate(
        [
            np.stack([low[:-1, :-1], low[1:, :-1], low[:-1, 1:]], axis=2).reshape(-1, 3, 3),
            np.stack([low[1:, :-1], low[1:, 1:], low[:-1, 1:]], axis=2).reshape(-1, 3, 3),
        ]
    )
    a, b, c = (corners[:, k] for k in range(3))
    gaps = []
    for x in high:
        u, v, w = (b - a)[:, :2], (c - a)[:, :2], (x - a)[:, :2]
        det = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        sound = np.abs(det) > 1e-12
        det = np.where(sound, det, 1.0)
        p = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / det
        q = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / det
        over = sound & (p >= 0) & (q >= 0) & (p + q <= 1)
        z = a[:, 2] + p * (b - a)[:, 2] + q * (c - a)[:, 2]
        gaps += (x[2] - z[over]).tolist()
    return min(gaps, default=np.inf)


def crossings(shot: Shot, frame) -> int:
    """Triangles of vanes that pass through each other."""
    rows, columns = shot.quality.rows, shot.quality.columns
    feathers = build_feathers(shot.groom.feathers, rows, columns)
    meshes, offset = [], []
    for k, (feather, pose) in enumerate(zip(feathers, frame.poses, strict=True)):
        surface = feather.surface
        vanes = surface.triangles[surface.part != RACHIS_PART]
        offset.append(surface.points(pose.points))
        meshes.append((offset[-1], vanes, np.zeros(len(vanes), dtype=bool), k))
    return int(find_intersections(np.concatenate(offset), make_patches(meshes)).vanes.sum())
