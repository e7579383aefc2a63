"""Shafts drawn as curves: points of splines, lengths, and the feather shape that fits them best.

A rachis at rest is an arc whose frame turns steadily (camber and sweep), with a course where that
is not enough. A drawn curve is replaced by the arc that turns as the curve does on average, in the
least-squares sense over its length: heading angles about two axes that are carried along the curve
are fitted by straight lines. Where this arc is off by more than 1 % of the length, they are fitted
by broken lines instead, of the fewest pieces that come near enough.

Barbs of a rachis that bends too tightly in the vane's plane fold over each other. A barb b of
length L at the angle a to the shaft turns with it; the strip of vane between it and the next one
has the area (L sin a / 2 - k L^2 / 3) ds where the shaft turns by k ds to the barb's side, if the
barb is straight. It is none left at k = 3 sin a / (2 L).

Condensed feathers have a shaft whose every point carries its two barbs. These become vanes: each
barb is the arc that turns as it does on average (angle at the root, curl within the vane, camber
out of it), its end a point of the vane's outline on the flattened feather.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_from, unit
from featherfx.groom.course import chord_angle, shaft, turn
from featherfx.groom.types import FeatherKind, RachisShape, VaneShape

_STEPS = 8  # points per cubic segment
_MIN_BEND = 1.0  # deg; a curve of less is straight
MAX_LINE_DEVIATION = 0.01  # share of the length; a curve that an arc misses by more has a course
_NEAR = 0.005  # share of the length that a course is made to keep to
_PIECES = (8, 16, 32, 64, 128, 192)  # of a course, which has 200 points at most
_SAMPLES = 768  # of the headings that a course is fitted to
# rows: power of t; columns: control points (Foley et al., Computer Graphics, chapter 11)
_BASES = {
    "bezier": (np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]), 1.0, 3),
    "bspline": (np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]), 6.0, 1),
    "catmullRom": (np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]), 2.0, 1),
}
CURVE_BASES = tuple(_BASES)


@dataclass(frozen=True)
class FittedCurve:
    """The arc, with its course where it has one, that stands for a drawn shaft.

    length: m, of the drawn curve. direction: (3,) unit, of the arc at the root. camber, sweep: deg,
    in the frame of the arc's root whose z axis leans to the given up vector, positive to -z and to
    -y. course: as of a RachisShape, without twist. deviation: m, largest distance of a drawn point
    from the shaft at the same length.
    """

    length: float
    direction: Array
    camber: float
    sweep: float
    course: tuple[tuple[float, float, float, float], ...] = ()
    deviation: float = 0.0


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


def hermite_points(points: Array, tangents: Array) -> Array:
    """(P, 3) points along a curve through points (k, 3) with their tangents (k, 3)."""
    t = np.linspace(0.0, 1.0, _STEPS + 1)[:-1, None, None]
    start, end, leave, arrive = points[:-1], points[1:], tangents[:-1], tangents[1:]
    inner = (2 * t**3 - 3 * t**2 + 1) * start + (t**3 - 2 * t**2 + t) * leave
    inner = inner + (3 * t**2 - 2 * t**3) * end + (t**3 - t**2) * arrive
    return np.vstack([inner.swapaxes(0, 1).reshape(-1, 3), points[-1:]])


def nurbs_points(control: Array, order: int, knots: Array, weights: Array) -> Array:
    """(P, 3) points along a rational B-spline, its first and last included.

    control: (k, 3). knots: (k + order,), not decreasing. weights: (k,). The basis is by the
    recursion of Cox and de Boor.
    """
    spans = np.unique(knots[order - 1 : len(control) + 1])
    steps = np.linspace(0.0, 1.0, _STEPS + 1)[:-1]
    u = np.append((spans[:-1, None] + np.diff(spans)[:, None] * steps).ravel(), spans[-1])[:, None]
    # the last point belongs to the last span that has a length
    last = np.flatnonzero(np.diff(knots) > 0.0)[-1]
    basis = ((knots[:-1] <= u) & (u < knots[1:])).astype(float)
    basis[-1] = np.arange(len(knots) - 1) == last
    for degree in range(1, order):
        rise, fall = knots[degree:-1] - knots[: -degree - 1], knots[degree + 1 :] - knots[1:-degree]
        up = (u - knots[: -degree - 1]) / np.where(rise > 0.0, rise, 1.0)
        down = (knots[degree + 1 :] - u) / np.where(fall > 0.0, fall, 1.0)
        basis = (rise > 0.0) * up * basis[:, :-1] + (fall > 0.0) * down * basis[:, 1:]
    shares = basis * weights
    return np.asarray(shares @ control / shares.sum(axis=1, keepdims=True))


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
    if cosine > np.cos(np.radians(_MIN_BEND)):
        return None
    chord = points[-1] - points[0]
    norm = np.linalg.norm(chord)
    if norm == 0.0:
        return None
    inner = last / np.linalg.norm(last) - first / np.linalg.norm(first)
    outer = -(inner - chord * (inner @ chord) / norm**2)
    size = np.linalg.norm(outer)
    return np.asarray(outer / size) if size > 1e-6 else None


def fit_arc(points: Array, up: Array) -> FittedCurve:
    """Fit an arc to a polyline (k, 3) m of different points; up: (3,), not along its start."""
    start, sizes, headings = _carried(points, up)
    length = float(sizes.sum())
    middle = (np.cumsum(sizes) - 0.5 * sizes) / length
    lines = np.array([_line(middle, each, sizes) for each in headings.T])
    camber, sweep = np.degrees(lines[:, 1]).tolist()
    arc = FittedCurve(length, _tilted(start, lines[:, 0]), camber, sweep)
    return replace(arc, deviation=_deviation(points, sizes, up, arc))


def fit_course(arc: FittedCurve, points: Array, up: Array, tightest: Array) -> FittedCurve:
    """The arc of a polyline, with a course where the arc is off by more than MAX_DEVIATION.

    tightest: (n,) rad per length, the most that the shaft may turn within the vane's plane at even
    shares of its length; no course turns more.
    """
    start, sizes, headings = _carried(points, up)
    best, ends = arc, np.cumsum(sizes) / arc.length
    for pieces in _PIECES:
        if best.deviation <= (_NEAR if best.course else MAX_LINE_DEVIATION) * arc.length:
            break
        turnings = _broken_line(pieces) @ headings[_sampled(ends)]
        found = _with_course(arc, start, up, turnings)
        found = replace(found, deviation=_deviation(points, sizes, up, found))
        turning = turning_within(found, len(tightest))
        if found.deviation < best.deviation and (turning <= tightest).all():
            best = found
    return best


def _carried(points: Array, up: Array) -> tuple[Array, Array, Array]:
    """Frame (3, 3) of the first leg of a polyline, and lengths (k,) m and headings (k, 2) rad of
    all in the frame that is carried along."""
    steps = np.diff(points, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    tangents = steps / sizes[:, None]
    start = frames_from(tangents[0], up)
    return start, sizes, np.stack(_headings(tangents, start), axis=1)


def turning_within(fit: FittedCurve, count: int) -> Array:
    """(count,) rad per length that a shaft turns within the vane's plane, at even shares of it."""
    if not fit.course:
        return np.full(count, abs(np.radians(fit.sweep)))
    places, _, sweep, _ = np.array(fit.course).T
    turning = np.diff(sweep) / np.diff(places) + fit.sweep
    at = np.linspace(0.0, 1.0, count)
    piece = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(turning) - 1)
    return np.abs(np.radians(turning[piece]))


def _tilted(start: Array, heading: Array) -> Array:
    """(3,) unit, where a curve goes that has turned by heading (2,) rad in its frame (3, 3)."""
    down, back = heading
    tilt = np.array([np.cos(down) * np.cos(back), -np.sin(back), -np.sin(down)])
    return np.asarray(start @ (tilt / np.linalg.norm(tilt)))


def _sampled(ends: Array) -> Array:
    """(_SAMPLES,) numbers of the legs of a polyline, that end at shares (k,), at even places."""
    places = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    return np.minimum(np.searchsorted(ends, places), len(ends) - 1)


@lru_cache(maxsize=len(_PIECES))
def _broken_line(pieces: int) -> Array:
    """(pieces + 1, _SAMPLES): from values at even places to the corners of the broken line of even
    pieces that fits them best."""
    places = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * pieces
    hats = np.maximum(1.0 - np.abs(places[:, None] - np.arange(pieces + 1)), 0.0)
    return np.linalg.solve(hats.T @ hats, hats.T)


def _with_course(arc: FittedCurve, start: Array, up: Array, turnings: Array) -> FittedCurve:
    """An arc with a course, that has turned by (n, 2) rad from a frame (3, 3) at even places."""
    (down, back), places = turnings[0], np.linspace(0.0, 1.0, len(turnings))
    carried, _ = turn(np.array([0.0, down, -back]))
    root = start @ carried
    # the frame of the feather is rolled against the one that is carried along the curve
    _, roll_cosine, roll_sine = root.T @ frames_from(root[:, 0], up)[:, 1]
    rolled = np.array([[roll_cosine, roll_sine], [-roll_sine, roll_cosine]])
    turned = np.degrees((turnings - turnings[0]) * [1.0, -1.0] @ rolled.T) * [1.0, -1.0]
    rest = turned - places[:, None] * [arc.camber, arc.sweep]
    course = np.column_stack([places, rest, np.zeros(len(places))])
    return replace(arc, direction=root[:, 0], course=tuple(map(tuple, course.tolist())))


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


def _deviation(points: Array, sizes: Array, up: Array, fit: FittedCurve) -> float:
    share = np.concatenate([[0.0], np.cumsum(sizes)]) / fit.length
    shape = RachisShape(1.0, 1.0, camber=fit.camber, sweep=fit.sweep, course=fit.course)
    _, mean = shaft(shape, np.minimum(share, 1.0))
    drawn = (points - points[0]) @ frames_from(fit.direction, up)
    apart = np.linalg.norm(drawn - fit.length * share[:, None] * mean, axis=1)
    return float(apart.max())


# of the turning that leaves no area: below it no vane folds of waves, screws and corners of shafts
# of six presets (down, whose barbs are long, folds at 0.95, the others at 1.8 to 2.7)
_SAFE = 0.9
_PLACES = 129
_LONGEST, _REACHES = 1.5, 301


def tightest(kind: FeatherKind) -> Array:
    """(129,) rad per length of the shaft, at even shares of it; infinite where there is no vane."""
    along = (np.linspace(0.0, 1.0, _PLACES) - kind.calamus) / (1.0 - kind.calamus)
    bend = np.zeros(_PLACES)
    for vane in (kind.leading, kind.trailing):
        if vane.outline:
            bend = np.maximum(bend, np.where(along >= 0.0, _bend(vane, kind.calamus, along), 0.0))
    return np.asarray(_SAFE * 1.5 / np.where(bend > 0.0, bend, 1e-9))


def _bend(vane: VaneShape, calamus: float, along: Array) -> Array:
    """(K,) length of the barbs at shares of the vane over the sine of their angle."""
    angle = np.radians(
        np.interp(
            along,
            [guide.position for guide in vane.guides],
            [chord_angle(guide) for guide in vane.guides],
        )
    )
    places, widths = np.array(vane.outline).T
    reach = np.linspace(0.0, _LONGEST, _REACHES)
    ends = along[:, None] + reach * np.cos(angle)[:, None] / (1.0 - calamus)
    edge = np.interp(ends, np.maximum.accumulate(places), widths, right=0.0)
    length = reach[np.argmax(reach * np.sin(angle)[:, None] >= edge, axis=1)]
    return np.asarray(length / np.sin(angle))


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
