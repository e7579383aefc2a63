"""The edge of a vane on the flattened feather, and where barbs meet it.

The control points are joined in their order by a monotone cubic (PCHIP) of the chord length in
each coordinate: it passes through every point, has no corner and never swings beyond its
neighbours, so an outline drawn at y >= 0 stays there. An outline that starts or ends away from
the rachis is closed by a straight edge at right angles to it; a rounded tip is led to the rachis
instead, its distance from there falling off as a quarter of an ellipse. The vane lies to the right
of the curve, between it and the rachis.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from featherfx.algebra.interpolation import monotone
from featherfx.algebra.vectors import arc_lengths
from featherfx.feather.types import Array

Outline = tuple[tuple[float, float], ...]

_SAMPLES_PER_SPAN = 24
_END_SAMPLES = 49
_PARALLEL = 1e-14
_END_SLACK = 1e-9


def describe_outline_fault(control: Outline) -> str:
    """Describe what is wrong with the control points themselves; empty if nothing is."""
    points = np.asarray(control, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        return "an outline needs at least two points (x, y)"
    if not np.isfinite(points).all():
        return "the outline holds a number that is not finite"
    if points[:, 1].min() < 0.0:
        return f"the outline has y = {points[:, 1].min():g}. Give y >= 0"
    repeated = np.flatnonzero(np.all(np.diff(points, axis=0) == 0.0, axis=1))
    if len(repeated):
        x, y = control[int(repeated[0])]
        return f"the outline repeats the point ({x:g}, {y:g})"
    crossing = _self_crossing(outline_curve(control))
    if crossing is not None:
        return f"the outline crosses itself near ({crossing[0]:g}, {crossing[1]:g})"
    return ""


@lru_cache(maxsize=1024)
def outline_curve(control: Outline, rounded_tip: float = 0.0) -> Array:
    """(K, 2) the outline as a fine polyline, base to tip, closed to the rachis; read-only.

    Same coordinates as the control points: x in lengths of the vane, y in lengths of the
    feather. rounded_tip: share of the vane's length over which an open tip is closed.
    """
    points = np.asarray(control, dtype=np.float64)
    chord = arc_lengths(points)
    fine = np.linspace(chord[:-1], chord[1:], _SAMPLES_PER_SPAN, endpoint=False, axis=1).ravel()
    blunt = points[-1, 1] > 0.0
    if blunt and rounded_tip > 0.0:
        near = chord[-1] - min(rounded_tip, chord[-1]) * np.linspace(1.0, 0.0, _END_SAMPLES) ** 2
        fine = np.unique(np.concatenate((fine, near[:-1])))
    curve = np.concatenate((monotone(chord, points, fine), points[-1:]))
    if blunt and rounded_tip > 0.0:
        curve[:, 1] *= opening((curve[-1, 0] - curve[:, 0]) / rounded_tip)
    base = [[points[0, 0], 0.0]] if points[0, 1] > 0.0 else np.empty((0, 2))
    tip = [[points[-1, 0], 0.0]] if curve[-1, 1] > 0.0 else np.empty((0, 2))
    curve = np.concatenate((base, curve, tip))
    curve.flags.writeable = False
    return curve


def opening(way: Array) -> Array:
    """Return how far a vane has opened, 0 to 1, after fractions of a rounded end: a quarter of an
    ellipse."""
    within = np.clip(way, 0.0, 1.0)
    return np.sqrt(within * (2.0 - within))


def _self_crossing(curve: Array) -> Array | None:
    """(2,) a point near which the polyline properly crosses itself, None if it does not."""
    start, step = curve[:-1], np.diff(curve, axis=0)
    offset = start[None] - start[:, None]
    den = _cross(step[:, None], step[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        along = _cross(offset, step[None]) / den
        other = _cross(offset, step[:, None]) / den
    hit = (along > 0.0) & (along < 1.0) & (other > 0.0) & (other < 1.0) & (den != 0.0)
    first, second = np.nonzero(hit)
    apart = second > first + 1
    return start[first[apart][0]] if apart.any() else None


def ray_lengths(curve: Array, root: Array, angle: Array, smallest: float) -> Array:
    """(n,) m, how far rays from the rachis stay within the vane.

    curve: (K, 2) m, from `outline_curve`. root: (n,) m, x of the rays' starts (y = 0).
    angle: (n,) rad, from the rachis, in (0, pi). smallest: m, crossings nearer to the root than
    this do not count. A ray that starts outside the vane, or leaves it at once, has length zero.
    """
    step = np.diff(curve, axis=0)
    ray = np.stack((np.cos(angle), np.sin(angle)), axis=-1)[:, None]
    offset = np.stack((curve[:-1, 0] - root[:, None], curve[:-1, 1] + 0.0 * root[:, None]), -1)
    den = _cross(ray, step)
    parallel = np.abs(den) <= _PARALLEL * np.linalg.norm(step, axis=1)
    den = np.where(parallel, 1.0, den)
    distance = _cross(offset, step) / den
    along = _cross(offset, ray) / den
    met = ~parallel & (distance > smallest)
    met &= (along >= -_END_SLACK) & (along <= 1.0 + _END_SLACK)
    distance = np.where(met, distance, np.inf)
    nearest = np.argmin(distance, axis=1)
    rows = np.arange(len(root))
    # The vane is on the right of the curve: a ray that crosses it from left to right comes in.
    leaves = met[rows, nearest] & (den[rows, nearest] < 0.0)
    return np.where(leaves, np.where(leaves, distance[rows, nearest], 0.0), 0.0)


def distance_outside(curve: Array, points: Array) -> Array:
    """(N,) m, how far points (N, 2) lie outside the vane; zero for those within.

    curve: (K, 2) m, from `outline_curve`.
    """
    start, end = curve[:-1], curve[1:]
    x, y = points[:, :1], points[:, 1:]
    straddles = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(straddles, end[:, 1] - start[:, 1], 1.0)
    crossing = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    inside = np.count_nonzero(straddles & (x < crossing), axis=1) % 2 == 1
    distance = np.zeros(len(points))
    strays = points[~inside]
    if len(strays):
        step = end - start
        offset = strays[:, None] - start
        along = np.sum(offset * step, axis=-1) / np.sum(step * step, axis=-1)
        gap = offset - np.clip(along, 0.0, 1.0)[..., None] * step
        nearest = np.sqrt(np.sum(gap * gap, axis=-1).min(axis=1))
        # The rachis closes the vane.
        low, high = curve[[0, -1], 0]
        rachis = np.hypot(strays[:, 0] - np.clip(strays[:, 0], low, high), strays[:, 1])
        distance[~inside] = np.minimum(nearest, rachis)
    return distance


def _cross(first: Array, second: Array) -> Array:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
