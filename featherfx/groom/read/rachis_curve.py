"""Shafts drawn as curves: points of splines, lengths, and the feather shape that fits them best.

A rachis at rest is an arc whose frame turns steadily (camber and sweep). A drawn curve is replaced
by the arc that turns as the curve does on average, in the least-squares sense over its length:
heading angles about two axes that are carried along the curve are fitted by straight lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from featherfx.algebra.rotation import frames_from
from featherfx.algebra.types import Array

_STEPS = 8  # points per cubic segment
_LEAST_BEND = 1.0  # deg; a curve of less is straight
# rows: power of t; columns: control points (Foley et al., Computer Graphics, chapter 11)
_BASES = {
    "bezier": (np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]), 1.0, 3),
    "bspline": (np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]), 6.0, 1),
    "catmullRom": (np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]), 2.0, 1),
}
BASES = tuple(_BASES)


@dataclass(frozen=True)
class FittedCurve:
    """The arc that stands for a drawn shaft.

    length: m, of the drawn curve. direction: (3,) unit, of the arc at the root. camber, sweep: deg,
    in the frame of the arc's root whose z axis leans to the given up vector, positive to -z and to
    -y. deviation: m, largest distance of a drawn point from the arc at the same length.
    """

    length: float
    direction: Array
    camber: float
    sweep: float
    deviation: float


def spline_points(control: Array, basis: str, pinned: bool) -> Array:
    """(P, 3) points along a cubic curve, its first and last included.

    control: (k, 3), at least 4 (2 when pinned). basis: one of BASES. pinned: whether the curve is
    made to reach its first and last control points, as USD does by points mirrored at the ends.
    """
    matrix, divisor, step = _BASES[basis]
    if pinned and basis != "bezier":
        control = np.vstack(
            [2 * control[:1] - control[1:2], control, 2 * control[-1:] - control[-2:-1]]
        )
    starts = np.arange(0, len(control) - 3, step)
    parameter = np.linspace(0.0, 1.0, _STEPS + 1)[:-1]
    weights = parameter[:, None] ** np.arange(4) @ matrix / divisor
    quads = control[starts[:, None] + np.arange(4)]
    points = np.einsum("pk,skc->spc", weights, quads).reshape(-1, 3)
    return np.vstack([points, matrix.sum(axis=0) / divisor @ quads[-1]])


def without_repeats(points: Array) -> Array:
    """A polyline (k, 3) without points that repeat the one before them."""
    scale = np.abs(points - points[:1]).max(initial=0.0)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return points[np.concatenate([[True], steps > 1e-9 * scale])]


def curved_up(points: Array) -> Array | None:
    """(3,) unit: the outer side of a shaft's bend, square to its chord; None where it is straight.

    Feathers bend towards ventral, so that the outer side is dorsal.
    """
    steps = np.diff(points, axis=0)
    first, last = steps[0], steps[-1]
    cosine = first @ last / (np.linalg.norm(first) * np.linalg.norm(last))
    if cosine > np.cos(np.radians(_LEAST_BEND)):
        return None
    chord = points[-1] - points[0]
    norm = np.linalg.norm(chord)
    if norm == 0.0:
        return None
    inner = last / np.linalg.norm(last) - first / np.linalg.norm(first)
    outer = -(inner - chord * (inner @ chord) / norm**2)
    size = np.linalg.norm(outer)
    return np.asarray(outer / size) if size > 1e-6 else None


def fit_curve(points: Array, up: Array) -> FittedCurve:
    """Fit an arc to a polyline (k, 3) m of different points; up: (3,), not along its start."""
    steps = np.diff(points, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    length = float(sizes.sum())
    tangents = steps / sizes[:, None]
    start = frames_from(tangents[0], up)
    middle = (np.cumsum(sizes) - 0.5 * sizes) / length
    down, back = _headings(tangents, start)
    camber, sweep = _line(middle, down, sizes), _line(middle, back, sizes)
    tilt = np.array([np.cos(camber[0]) * np.cos(sweep[0]), -np.sin(sweep[0]), -np.sin(camber[0])])
    direction = start @ (tilt / np.linalg.norm(tilt))
    arc = (length, direction, float(np.degrees(camber[1])), float(np.degrees(sweep[1])))
    return FittedCurve(*arc, _deviation(points, sizes, up, arc))


def _headings(tangents: Array, start: Array) -> tuple[Array, Array]:
    """Angles (k,) rad by which tangents (k, 3) have turned to -z and to -y of a carried frame.

    The frame is carried by the smallest rotation from one tangent to the next, written out for
    single numbers: thousands of short curves spend their time here.
    """
    x, y, z = (tuple(column) for column in start.T.tolist())
    down, back = [0.0], [0.0]
    for before, after in pairwise(tangents.tolist()):
        ahead, left, up = _dot(x, after), _dot(y, after), _dot(z, after)
        sine = math.hypot(left, up)
        turning = math.atan2(sine, ahead) / sine if sine > 1e-12 else 1.0
        down.append(down[-1] - turning * up)
        back.append(back[-1] - turning * left)
        opening = 1.0 + _dot(before, after)
        if opening > 1e-12:  # else the curve turns back on itself, and y and z stay
            middle = (before[0] + after[0], before[1] + after[1], before[2] + after[2])
            y = _less(y, left / opening, middle)
            z = _less(z, up / opening, middle)
        x = tuple(after)
    return np.array(down), np.array(back)


def _dot(first: Sequence[float], second: Sequence[float]) -> float:
    return first[0] * second[0] + first[1] * second[1] + first[2] * second[2]


def _less(vector: Sequence[float], factor: float, other: Sequence[float]) -> tuple[float, ...]:
    return (
        vector[0] - factor * other[0],
        vector[1] - factor * other[1],
        vector[2] - factor * other[2],
    )


def _line(x: Array, y: Array, weights: Array) -> tuple[float, float]:
    """Value at 0 and rise to 1 of the line that fits best."""
    if len(x) < 2:
        return float(y[0]), 0.0
    mean_x, mean_y = np.average(x, weights=weights), np.average(y, weights=weights)
    rise = (weights * (x - mean_x)) @ (y - mean_y) / (weights @ (x - mean_x) ** 2)
    return float(mean_y - rise * mean_x), float(rise)


def _deviation(
    points: Array, sizes: Array, up: Array, arc: tuple[float, Array, float, float]
) -> float:
    length, direction, camber, sweep = arc
    fraction = np.concatenate([[0.0], np.cumsum(sizes)]) / length
    axis = np.radians([0.0, camber, -sweep])
    drawn = (points - points[0]) @ frames_from(direction, up)
    return float(np.linalg.norm(drawn - length * arc_points(fraction, axis), axis=1).max())


def arc_points(fraction: Array, turning: Array) -> Array:
    """(k, 3) points of a unit arc along x that turns by `turning` (rad), at fractions (k,)."""
    angle = float(np.linalg.norm(turning))
    if angle < 1e-9:
        return fraction[:, None] * np.array([1.0, 0.0, 0.0])
    axis = turning / angle
    along = axis * axis[0]
    across = np.array([1.0, 0.0, 0.0]) - along
    sine, cosine = np.sin(fraction * angle) / angle, (1.0 - np.cos(fraction * angle)) / angle
    return np.asarray(
        fraction[:, None] * along
        + sine[:, None] * across
        + cosine[:, None] * np.cross(axis, [1.0, 0.0, 0.0])
    )
