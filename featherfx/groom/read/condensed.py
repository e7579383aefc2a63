"""Condensed feathers: a shaft whose every point carries its two barbs, turned into vanes.

Each barb becomes the arc that turns as the barb does on average (angle at the root, curl within the
vane, camber out of it), its end a point of the vane's outline on the flattened feather.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import unit

_MAX_GUIDES = 12
_MAX_OUTLINE_POINTS = 60
_BARE = 0.002  # barbs shorter than this share of the shaft are none
_AS_DRAWN = {"rounded_base": 0.0, "rounded_tip": 0.0}
_SHORT = 0.1  # barbs shorter than this share of the longest say nothing about direction


@dataclass(frozen=True)
class DrawnBarbs:
    """left, right: (k, m, 3) m, points of the barbs at the k points of a shaft, root to end.

    Left as seen from dorsal with the tip ahead. The first points may stand on the shaft or not.
    """

    left: Array
    right: Array


@dataclass(frozen=True)
class DrawnVanes:
    """up: (3,) dorsal at the root. change: keys of a feather preset (calamus and vanes)."""

    up: Array
    change: dict[str, Any]


def vanes_of(shaft: Array, barbs: DrawnBarbs, left_leads_right: bool) -> DrawnVanes:
    """Vanes of a condensed feather. shaft: (k, 3) m, k >= 2, as the barbs.

    left_leads_right: whether it is a left wing's feather, whose leading vane is the right one.
    """
    sizes = np.linalg.norm(np.diff(shaft, axis=0), axis=1)
    station = np.concatenate([[0.0], np.cumsum(sizes)])
    sides = [_with_root(shaft, barbs.left), _with_root(shaft, barbs.right)]
    frames = _frames(shaft, *sides)
    lengths = [np.linalg.norm(np.diff(side, axis=1), axis=2).sum(axis=1) for side in sides]
    barbed = np.maximum(*lengths) > _BARE * station[-1]
    bare = station[int(np.argmax(barbed))] if barbed.any() else 0.0
    shapes = [
        _vane(station, bare, side, length, frames, sign)
        for side, length, sign in zip(sides, lengths, (1.0, -1.0), strict=True)
    ]
    leading, trailing = reversed(shapes) if left_leads_right else shapes
    change = {
        "calamus": min(float(bare / station[-1]), 0.8),
        "leading": leading,
        "trailing": trailing,
    }
    return DrawnVanes(frames[0, :, 2], change)


def _with_root(shaft: Array, barbs: Array) -> Array:
    return np.concatenate([shaft[:, None], barbs], axis=1)


def _frames(shaft: Array, left: Array, right: Array) -> Array:
    """(k, 3, 3) columns: tangent, to the left barbs, dorsal, at the shaft's points."""
    tangent = unit(np.gradient(shaft, axis=0))
    apart = left[:, -1] - right[:, -1]
    apart = apart - tangent * (apart * tangent).sum(axis=1, keepdims=True)
    size = np.linalg.norm(apart, axis=1)
    # where there are no barbs, as at both ends, the nearest that are there say where left is
    good = np.flatnonzero(size > _SHORT * size.max(initial=0.0))
    if len(good):
        near = good[np.abs(np.arange(len(shaft))[:, None] - good).argmin(axis=1)]
        apart = apart[near] - tangent * (apart[near] * tangent).sum(axis=1, keepdims=True)
    apart = unit(apart)
    return np.stack([tangent, apart, np.cross(tangent, apart)], axis=2)


def _vane(
    station: Array, bare: float, barbs: Array, length: Array, frames: Array, sign: float
) -> dict[str, Any]:
    """outline and guides of one vane; both empty where it has no barbs."""
    rows = np.flatnonzero((length > _BARE * station[-1]) & (station >= bare))
    if len(rows) < 2:
        return {"outline": [], "guides": [], **_AS_DRAWN}
    vane_length = station[-1] - bare
    angle, curl, camber, ends = _arcs(barbs[rows], frames[rows], sign)
    position = (station[rows] - bare) / vane_length
    outline = np.column_stack([position + ends[:, 0] / vane_length, ends[:, 1] / station[-1]])
    outline = outline[_spread(len(outline), _MAX_OUTLINE_POINTS)]
    corners = [[0.0, 0.0], *outline.tolist(), [1.0, 0.0]]
    ends_at_tip = bool(np.linalg.norm(outline[-1] - [1.0, 0.0]) < 1e-6)
    telling = np.flatnonzero(length[rows] > _SHORT * length.max())
    chosen = telling[_spread(len(telling), _MAX_GUIDES)]
    guides = [
        {
            "position": float(min(max(position[k], 0.0), 1.0)),
            "angle": float(angle[k]),
            "curl": float(curl[k]),
            "camber": float(camber[k]),
        }
        for k in chosen
    ]
    return {"outline": corners[:-1] if ends_at_tip else corners, "guides": guides, **_AS_DRAWN}


def _spread(count: int, most: int) -> Indices:
    """Indices of at most `most` of `count` items, evenly spread, first and last included."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


def _arcs(barbs: Array, frames: Array, sign: float) -> tuple[Array, Array, Array, Array]:
    """Angle, curl and camber (r,) deg of barbs (r, m, 3), and their ends (r, 2) m when flattened.

    sign: +1 for the side of the frames' second axis.
    """
    steps = np.einsum("rmc,rck->rmk", np.diff(barbs, axis=1), frames) * (1.0, sign, 1.0)
    size = np.linalg.norm(steps, axis=2)
    along = (np.cumsum(size, axis=1) - 0.5 * size) / size.sum(axis=1, keepdims=True)
    flat = np.hypot(steps[..., 0], steps[..., 1])
    heading = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1)
    down = np.arctan2(-steps[..., 2], flat)
    start, rise = _lines(along, heading, size)
    _, fall = _lines(along, down, size)
    fitted = start[:, None] + rise[:, None] * along
    ends = np.stack([(size * np.cos(fitted)).sum(axis=1), (size * np.sin(fitted)).sum(axis=1)], 1)
    return np.degrees(start), -np.degrees(rise), np.degrees(fall), ends


def _lines(x: Array, y: Array, weights: Array) -> tuple[Array, Array]:
    """Values at 0 and rises to 1 (r,) of the lines that fit rows (r, m) best."""
    total = weights.sum(axis=1)
    mean_x, mean_y = (weights * x).sum(axis=1) / total, (weights * y).sum(axis=1) / total
    away = x - mean_x[:, None]
    spread = (weights * away**2).sum(axis=1)
    rise = (weights * away * (y - mean_y[:, None])).sum(axis=1) / np.where(spread > 0, spread, 1.0)
    return mean_y - rise * mean_x, rise
