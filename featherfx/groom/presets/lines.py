"""Shafts and barbs that a preset draws as lines through points, as turnings."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.algebra.interpolation import monotone
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import arc_lengths, parallel
from featherfx.groom.course import crossing_segments
from featherfx.groom.keys.problems import Place
from featherfx.groom.read.rachis_curve import (
    MAX_LINE_DEVIATION,
    FittedCurve,
    fit_arc,
    fit_course,
    tightest,
    turning_within,
)
from featherfx.groom.types import BARB_ANGLE, BarbGuide, FeatherKind

# points of a line for each that is given, as of an outline
_SAMPLES_PER_SPAN = 24
# deg, of a guide whose own cannot be told
_ANY_ANGLE = 60.0
_DORSAL = np.array([0.0, 0.0, 1.0])

Line = tuple[tuple[float, ...], ...]


def follow_rachis_line(kind: FeatherKind, line: Line, place: Place) -> FeatherKind:
    """Return the kind with its rachis along a line; twist stays. place: of the line, for faults."""
    if not _sound(line, place):
        return kind
    points = _curve(line)
    if parallel(points[1] - points[0], _DORSAL):
        place.fail("leaves the follicle square to the vane. Give any way but along z")
        return kind
    arc, most = fit_arc(points, _DORSAL), tightest(kind)
    fit = fit_course(arc, points, _DORSAL, most)
    if fit.deviation > MAX_LINE_DEVIATION:
        place.fail(_too_sharp(arc, points, most, fit))
        return kind
    shape = replace(kind.rachis, camber=fit.camber, sweep=fit.sweep, course=fit.course)
    return replace(kind, rachis=shape)


def follow_barb_line(own: dict[str, Any], line: Line, at: Place) -> BarbGuide:
    """Return a guide whose barb follows a line. own: its other keys. at: place of the line."""
    fit = _fitted_barb(line) if _sound(line, at) else None
    if fit is None:
        return BarbGuide(**{**own, "angle": _ANY_ANGLE})
    angle = float(np.degrees(np.arctan2(fit.direction[1], fit.direction[0])))
    if not BARB_ANGLE.low <= angle <= BARB_ANGLE.high:
        at.fail(f"leaves the shaft at {angle:.0f} deg. Give {BARB_ANGLE.allowed()}")
    if fit.deviation > MAX_LINE_DEVIATION:
        off = f"the barb would be off by {fit.deviation:.1%} of its length, more than 1 %"
        at.fail(f"turns more often or more sharply than a course of 200 points: {off}")
    course = tuple((share, sweep, 0.0) for share, _, sweep, _ in fit.course)
    return BarbGuide(**{**own, "angle": angle, "curl": fit.sweep, "course": course})


def _fitted_barb(line: Line) -> FittedCurve:
    points = _curve(line)
    return fit_course(fit_arc(points, _DORSAL), points, _DORSAL, np.full(2, np.inf))


def _sound(line: Line, place: Place) -> bool:
    """Return True if a curve goes through the points; add a problem otherwise."""
    if len(line) < 2:
        place.fail(f"has {len(line)} point. Give 2 to 200 (or none)")
        return False
    for index, (before, point) in enumerate(pairwise(_lifted(line).tolist()), start=1):
        if before == point:
            place.item(index).fail("is the point before it once more. Give points that differ")
            return False
    points = _lifted(line)
    if not points[:, 2].any() and (crossings := crossing_segments(points[:, :2])):
        first, second = crossings[0]
        place.item(second).fail(f"the line crosses itself: segments {first} and {second} meet")
        return False
    return True


def _lifted(line: Line) -> Array:
    """(k, 3) the points, those of two numbers within the vane's plane."""
    return np.array([(*point, 0.0)[:3] for point in line])


def _curve(line: Line) -> Array:
    """(K, 3) a smooth curve through the points, as of an outline a monotone cubic of the chord, in
    lengths of it."""
    points = _lifted(line)
    chord = arc_lengths(points)
    at = np.linspace(chord[:-1], chord[1:], _SAMPLES_PER_SPAN, endpoint=False, axis=1).ravel()
    curve = np.concatenate([monotone(chord, points, at), points[-1:]])
    return np.asarray(curve / np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def _too_sharp(arc: FittedCurve, points: Array, most: Array, fit: FittedCurve) -> str:
    """Say why the rachis cannot follow a line."""
    told = f"the shaft would be off by {fit.deviation:.1%} of its length, more than 1 %"
    free = fit_course(arc, points, _DORSAL, np.full(len(most), np.inf))
    over = turning_within(free, len(most)) / most
    if free.deviation > MAX_LINE_DEVIATION or over.max() <= 1.0:
        return f"turns more often or more sharply than a course of 200 points: {told}"
    where = int(np.argmax(over))
    return (
        f"bends {over[where]:.2f} times as sharply within the vane, at "
        f"{where / (len(most) - 1):.2g} of its length, as lets barbs lie side by side there, and "
        f"{told}. Shorter barbs or a wider bend help"
    )
