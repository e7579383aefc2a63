"""Powers through what the scenes of the front have missed (featherfx/shot/detail/promise.py)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from featherfx.algebra.types import Array
from featherfx.lab.bench.report import Row
from featherfx.shot.detail.promise import CALM_AIR, Front, Grid, Missed, MissedBySteps, Work

HOW = (
    "Written by featherfx bench --front. On every scene of featherfx/lab/bench/scenes.py rows,"
    " columns, coefficients and the tolerance of steps are varied and compared with a setting that"
    " is finer in all; error: largest distance of any simulated point at any frame, of the length."
    " What a number misses is factor number^-order d^exponent, d the deflection of barbs, rows by"
    " the number of spaces between them, before: as estimated from the loads if barbs bent in"
    " proportion, after: as simulated; what is missed counts three times as much where a power says"
    " less, and after is not less in nine of ten; steps miss factor tolerance^exponent"
    " e^(-air share). work: time of an iteration, each + rows (1 + column columns + coefficient"
    " coefficients). wrung: of rows, of vanes that are pulled within their plane. calm: least"
    " deflections of shaft and barbs in air. Feathers that push each other are left out."
)
# of feathers and scenes, in how many what is estimated afterwards is not less than what they miss
_HELD = 0.9
LEAST_ERROR = 1e-5
# of the finest tolerance that was measured, to what the power of steps is trusted
_TRUSTED = 0.1
# of rows and columns: the polylines of shafts and barbs are of second order
_LINES = 2.0
# bounds of (log factor, exponent) of rows and columns, and of (log factor, exponent, air) of steps:
# what bends more does not err less, nor more than in proportion
_GRID = (-12.0, 5.0), (0.0, 1.0)
# of rows, how far barbs are estimated to bend, and do, below which what is missed falls no more: in
# the shake, where barbs bend by 0.001 to 0.009, rows miss as much as where they bend by so much
_LEAST, _LEAST_BENT = 0.05, 0.015
_STEPS = (-6.0, 3.0), (0.3, 1.1), (0.0, 5.0)
# a feather that errs by more than a power says weighs so much more than one that errs by less, so
# that the power is one that some nine of ten keep to
_UNDER = 3.0
# what a second coefficient takes away shows where grid and steps miss little; least of it; and what
# further ones take away: 1, 2 and 3 missed 0.48, 0.07 and 0.016 % where all else was the finest
_SHOWN_ROWS, _SHOWN_TOLERANCE, _SHOWN, _ORDER = 11, 1e-3, 1e-4, 3.0
# errors that are farther than this factor's log from the powers count in proportion only, as of
# vanes that snap over
_FAR = 0.2
# of the number of steps by one over the tolerance, the middle of what the scenes took
_STEPS_POWER = 0.28


class _Measured(NamedTuple):
    """(R,) of every row; weight: alike for every feather of every scene. feather: its number."""

    rows: Array
    columns: Array
    coefficients: Array
    tolerance: Array
    shaft: Array
    barb: Array
    air: Array
    error: Array
    weight: Array
    feather: Array

    def missed(self, grid: Grid, steps: MissedBySteps) -> Array:
        """(R,) what powers say that the settings miss."""
        space = (
            grid.rows.by(self.rows - 1.0, self.barb)
            + grid.columns.by(self.columns, self.barb)
            + grid.coefficients.by(self.coefficients, self.barb)
        )
        return np.hypot(space, steps.by(self.tolerance, self.air))


def missed(rows: Sequence[Row], times: Mapping[tuple[int, int, int], float]) -> dict[str, Any]:
    """Fit the error model to rows of `measure` and to `iteration_times`. Of
    feathers that push each other nothing is promised, so theirs are left out."""
    rows = [r for r in rows if not r["touching"]]
    wrung = [r for r in rows if r["wrung"]]
    rows = [r for r in rows if not r["wrung"]]
    before, after = _measured(rows, ""), _measured(rows, " bent")
    grid, steps = _fitted(before, _LEAST)
    held, _ = _fitted(after, _LEAST_BENT)
    off = np.quantile(np.log(after.error / after.missed(held, steps)), _HELD)
    held = Grid(*(each._replace(factor=each.factor * float(np.exp(off))) for each in held))
    tolerances = _TRUSTED * float(before.tolerance.min()), float(before.tolerance.max())
    blown = before.air >= CALM_AIR
    calm = float(before.shaft[blown].min()), float(before.barb[blown].min())
    found = Front(grid, held, _wrung(wrung), steps, _work(times), tolerances, calm)
    return {
        "before": {name: each._asdict() for name, each in found.before._asdict().items()},
        "after": {name: each._asdict() for name, each in found.after._asdict().items()},
        "wrung": found.wrung._asdict(),
        "steps": found.steps._asdict(),
        "work": found.work._asdict(),
        "tolerances": list(found.tolerances),
        "calm": list(found.calm),
    }


def _measured(rows: Sequence[Row], when: str) -> _Measured:
    names = ("rows", "columns", "coefficients", "tolerance", "shaft", f"barb{when}", "air")
    values: list[Array] = [np.array([float(r[name]) for r in rows]) for name in names]
    values[4:6] = [np.maximum(each, LEAST_ERROR) for each in values[4:6]]
    values.append(np.maximum([r["error"] for r in rows], LEAST_ERROR))
    feathers = [f"{r['scene']}/{r['feather']}" for r in rows]
    _, number, count = np.unique(feathers, return_inverse=True, return_counts=True)
    return _Measured._make([*values, count[number] ** -0.5, number])


def _fitted(measured: _Measured, least: float) -> tuple[Grid, MissedBySteps]:
    """The powers that are nearest to what was measured, rather above than below. least: of rows."""
    coefficients = _coefficients(measured)

    def powers(parameters: Array) -> tuple[Grid, MissedBySteps]:
        a, rows, b, columns, c, *steps = map(float, parameters)
        lines = Missed(np.exp(a), _LINES, rows, least), Missed(np.exp(b), _LINES, columns)
        return Grid(*lines, coefficients), MissedBySteps(np.exp(c), *steps)

    def off(parameters: Array) -> Array:
        over = np.log(measured.missed(*powers(parameters)) / measured.error)
        return np.asarray(measured.weight * np.where(over < 0.0, _UNDER, 1.0) * over / _FAR)

    low, high = np.transpose([*_GRID, *_GRID, *_STEPS])
    found = least_squares(off, 0.5 * (low + high), bounds=(low, high), loss="soft_l1").x
    return powers(found)


def _coefficients(measured: _Measured) -> Missed:
    """By the most that a second coefficient takes away of any feather, not less in _HELD."""
    fine = (measured.rows >= _SHOWN_ROWS) & (measured.tolerance <= _SHOWN_TOLERANCE)
    kept = measured._replace(**{k: v[fine] for k, v in measured._asdict().items()})
    settings = zip(kept.feather, kept.rows, kept.columns, kept.tolerance, strict=True)
    errors: dict[Any, dict[int, float]] = {}
    for setting, count, error in zip(settings, kept.coefficients, kept.error, strict=True):
        errors.setdefault(setting, {})[int(count)] = float(error)
    most: dict[int, float] = {}
    for (feather, *_), own in errors.items():
        if own.keys() >= {1, 2}:
            most[feather] = max(own[1] - own[2], most.get(feather, _SHOWN))
    barbs = dict(zip(kept.feather, kept.barb, strict=True))
    bend, gain = np.log([barbs[f] for f in most]), np.log(list(most.values()))
    slope = float(np.clip(np.polyfit(bend, gain, 1)[0], 0.0, 1.0))
    factor = float(np.exp(np.quantile(gain - slope * bend, _HELD)))
    return Missed(factor / (1.0 - 2.0**-_ORDER), _ORDER, slope)


def _wrung(rows: Sequence[Row]) -> Missed:
    """Fit the error of rows for the middle feather, whatever the other settings and loads."""
    number = np.log([r["rows"] for r in rows])
    slope, level = np.polyfit(number, np.log([r["error"] for r in rows]), 1)
    return Missed(float(np.exp(level)), -float(slope), 0.0)


def _work(times: Mapping[tuple[int, int, int], float]) -> Work:
    """Through the times of iterations by rows, columns and coefficients, all in proportion."""
    time = np.array(list(times.values()))
    terms = np.array([(1.0, n, n * m, n * c) for n, m, c in times]) / time[:, None]
    each, row, column, coefficient = np.linalg.lstsq(terms, np.ones(len(time)), rcond=None)[0]
    return Work(float(each / row), float(column / row), float(coefficient / row), _STEPS_POWER)
