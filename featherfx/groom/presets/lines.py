"""Shafts that a preset draws as a line through points: the turnings that stand for them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from featherfx.algebra.monotone import monotone
from featherfx.algebra.rotation import parallel
from featherfx.algebra.types import Array
from featherfx.groom.keys.problems import Place
from featherfx.groom.presets.flat_vane import crossing_segments
from featherfx.groom.read.rachis_curve import (
    MOST_DEVIATION,
    FittedCurve,
    fit_arc,
    fit_course,
    turning_within,
)
from featherfx.groom.read.tightest import tightest
from featherfx.groom.types import FeatherKind

# points of a line for each that is given, as of an outline
_SAMPLES_PER_SPAN = 24
_DORSAL = np.array([0.0, 0.0, 1.0])

Line = tuple[tuple[float, ...], ...]


def along_line(kind: FeatherKind, line: Line, place: Place) -> FeatherKind:
    """The kind with a shaft along a line, which keeps its twist. place: of the line, for faults."""
    if not _sound(line, place):
        return kind
    points = _curve(line)
    points = points / np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    if parallel(points[1] - points[0], _DORSAL):
        place.fail("leaves the follicle square to the vane; allowed: any way but along z")
        return kind
    arc, most = fit_arc(points, _DORSAL), tightest(kind)
    fit = fit_course(arc, points, _DORSAL, most)
    if fit.deviation > MOST_DEVIATION:
        place.fail(_too_sharp(arc, points, most, fit))
        return kind
    shape = replace(kind.rachis, camber=fit.camber, sweep=fit.sweep, course=fit.course)
    return replace(kind, rachis=shape)


def _sound(line: Line, place: Place) -> bool:
    """Whether a curve goes through the points; told where none does."""
    if len(line) < 2:
        place.fail(f"has {len(line)} point, allowed 2 to 200 (or none)")
        return False
    for index, (before, point) in enumerate(pairwise(_lifted(line).tolist()), start=1):
        if before == point:
            place.item(index).fail("is the point before it once more; allowed: points that differ")
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
    """(K, 3) a smooth curve through the points, as of an outline: a monotone cubic of the chord."""
    points = _lifted(line)
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(chord[:-1], chord[1:], _SAMPLES_PER_SPAN, endpoint=False, axis=1).ravel()
    return np.concatenate([monotone(chord, points, at), points[-1:]])


def _too_sharp(arc: FittedCurve, points: Array, most: Array, fit: FittedCurve) -> str:
    """What keeps a line from being followed."""
    told = f"the shaft would be off by {fit.deviation:.1%} of its length; allowed: up to 1 %"
    free = fit_course(arc, points, _DORSAL, np.full(len(most), np.inf))
    over = turning_within(free, len(most)) / most
    if free.deviation > MOST_DEVIATION or over.max() <= 1.0:
        return f"turns more often or more sharply than a course of 200 points: {told}"
    where = int(np.argmax(over))
    return (
        f"bends {over[where]:.2f} times as sharply within the vane, at "
        f"{where / (len(most) - 1):.2g} of its length, as lets barbs lie side by side there, and "
        f"{told}; shorter barbs or a wider bend help"
    )
