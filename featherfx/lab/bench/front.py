"""Error against work, by what is resolved: rows, columns, coefficients and steps.

On every scene settings that vary all of them are compared with one that is finer in all. What they
miss is fitted with powers of the numbers, of the tolerance of steps, and of the deflections that
loads were estimated to cause; featherfx/shot/options/error_model chooses what is simulated of a
feather from these.

Powers through what the scenes of the front have missed (featherfx/shot/options/error_model.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from featherfx.algebra.types import Array
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import stacked
from featherfx.lab.bench.promise import FineRun, errors, fixed_quality, run
from featherfx.lab.bench.report import Row
from featherfx.lab.bench.scenes import REFERENCE_ROWS, scene
from featherfx.lab.bench.shake import Shake, barb_curvature, swan_primary
from featherfx.shot.loop.error_estimate import barb_bends
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options.error_model import (
    CALM_AIR,
    Deflection,
    ErrorModel,
    GridError,
    GridErrors,
    StepCost,
    StepError,
)
from featherfx.shot.options.load_estimate import estimate_deflections, estimate_loads
from featherfx.shot.types import Shot

# (columns, coefficients)
_ENDS = ((2, 1), (3, 1), (4, 1), (6, 1), (2, 2), (4, 2))
# (tolerance over the feather's length, rows)
_STEPS = (
    (6e-3, (6, 8, 11)),
    (2e-3, (6, 8, 11, 15, 21)),
    (6e-4, (6, 8, 11, 15, 21)),
    (2e-4, (6, 8, 11, 15, 21, 29)),
    (6e-5, (11, 15, 21, 29)),
)
# rows and columns of a reference
_MAX_ROWS, _MAX_COLUMNS = 57, 12


@dataclass(frozen=True)
class Setting:
    """Resolution of every feather. tolerance: over the feather's length."""

    rows: int = 11
    columns: int = 4
    coefficients: int = 2
    tolerance: float = 1e-4
    radius: float = 0.5


_FINEST = Setting(rows=_MAX_ROWS, columns=_MAX_COLUMNS, coefficients=3, tolerance=1e-5)


def settings(touching: bool) -> Iterator[Setting]:
    """Yield the settings to measure. touching: feathers push each other, which takes long."""
    for tolerance, rows in _STEPS[1:3] if touching else _STEPS:
        for n, (m, c) in product(rows, _ENDS[::2][:2] if touching else _ENDS):
            yield Setting(n, m, c, tolerance)


def at(shot: Shot, setting: Setting) -> Shot:
    """A shot of which all feathers are simulated alike; where they push each other, tolerances are
    of the median length."""
    lengths = [p.kind.length for p in shot.groom.feathers]
    length = float(np.median(lengths) if shot.contact is not None else np.max(lengths))
    rest = replace(shot.quality, max_substeps=4096, spectral_radius=setting.radius)
    grid = setting.rows, setting.columns, setting.coefficients
    quality = fixed_quality(grid, setting.tolerance, rest, length)
    return replace(shot, quality=quality)


def estimated_deflections(shot: Shot) -> list[Deflection]:
    """Estimate per feather how far loads bend rachis and barbs, in feather lengths."""
    loads = estimate_loads(shot, root_motion(shot))
    found = estimate_deflections(shot, build_feathers(shot.groom.feathers, 21, 6), loads)
    lengths = [p.kind.length for p in shot.groom.feathers]
    return [
        each._replace(rachis=each.rachis / size, barb=each.barb / size)
        for each, size in zip(found, lengths, strict=True)
    ]


def bent(ran: FineRun) -> list[float]:
    """Per feather, how far barbs did bend, of the feather's length."""
    found = []
    for f, feather in ran.feathers.items():
        rest = stacked([feather.rest] * len(ran.points[f]))
        barb = float(barb_bends(rest, stacked(ran.points[f])).max())
        found.append(barb / feather.station[-1])
    return found


def iteration_times() -> dict[tuple[int, int, int], float]:
    """s, of a Newton iteration of a feather in a batch, by rows, columns and coefficients."""
    kind, found = swan_primary(), dict[tuple[int, int, int], float]()
    for (n, (m, c)), _ in product(product((6, 8, 11, 15, 21, 29), _ENDS), range(2)):
        shake = Shake(n, m, c, 0.0, 3.5e-4, 0.5, 3.5e-5, 1.0 / 12.0, count=8, max_substeps=4096)
        ran = barb_curvature(kind, shake)
        time = ran.seconds / (shake.count * ran.iterations)
        found[n, m, c] = min(time, found.get((n, m, c), time))
    return found


def measure(name: str) -> list[Row]:
    """A row for each feather and setting of a scene."""
    rows: list[Row] = []
    shot = scene(name)
    estimated = estimated_deflections(shot)
    run(at(shot, Setting(tolerance=1e-2)))  # compiles
    finest = run(at(shot, replace(_FINEST, rows=REFERENCE_ROWS[name])))
    real = bent(finest)
    for setting in settings(shot.contact is not None):
        each = run(at(shot, setting))
        found = errors(each, finest)
        parts = zip(shot.groom.feathers, found, each.options, estimated, real, strict=True)
        for p, error, own, loaded, barb in parts:
            rows.append(
                {
                    "scene": name,
                    "feather": p.id,
                    "length": p.kind.length,
                    "touching": shot.contact is not None,
                    **vars(setting),
                    "tolerance": own.tolerance / p.kind.length,
                    **loaded._asdict(),
                    "barb bent": barb,
                    "substeps": each.report["substeps"]["mean"],
                    "error": error,
                    "seconds": each.seconds,
                }
            )
    return rows


_REFERENCE_ERROR = 0.01


def fine(shot: Shot) -> Shot:
    """The shot as it is compared with."""
    length = float(np.median([p.kind.length for p in shot.groom.feathers]))
    quality = replace(
        shot.quality.with_error(_REFERENCE_ERROR),
        rows=_FINEST.rows,
        simulated_rows=_FINEST.rows,
        columns=_FINEST.columns,
        simulated_columns=_FINEST.columns,
        coefficients=_FINEST.coefficients,
        tolerance=_FINEST.tolerance * length,
    )
    return replace(shot, quality=quality)


HOW = (
    "Written by featherfx lab measure errors. On every scene of featherfx/lab/bench/scenes.py rows,"
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
MIN_ERROR = 1e-5
# of the finest tolerance that was measured, to what the power of steps is trusted
_TRUSTED = 0.1
# of rows and columns: the polylines of rachises and barbs are of second order
_LINES = 2.0
# bounds of (log factor, exponent) of rows and columns, and of (log factor, exponent, air) of steps:
# what bends more does not err less, nor more than in proportion
_GRID = (-12.0, 5.0), (0.0, 1.0)
# of rows, how far barbs are estimated to bend, and do, below which what is missed falls no more: in
# the shake, where barbs bend by 0.001 to 0.009, rows miss as much as where they bend by so much
_LEAST, _MIN_BENT = 0.05, 0.015
_FITTED_STEPS = (-6.0, 3.0), (0.3, 1.1), (0.0, 5.0)
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

    def missed(self, grid: GridErrors, steps: StepError) -> Array:
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
    held, _ = _fitted(after, _MIN_BENT)
    off = np.quantile(np.log(after.error / after.missed(held, steps)), _HELD)
    held = GridErrors(*(each._replace(factor=each.factor * float(np.exp(off))) for each in held))
    tolerances = _TRUSTED * float(before.tolerance.min()), float(before.tolerance.max())
    blown = before.air >= CALM_AIR
    calm = float(before.shaft[blown].min()), float(before.barb[blown].min())
    found = ErrorModel(grid, held, _wrung(wrung), steps, _work(times), tolerances, calm)
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
    values[4:6] = [np.maximum(each, MIN_ERROR) for each in values[4:6]]
    values.append(np.maximum([r["error"] for r in rows], MIN_ERROR))
    feathers = [f"{r['scene']}/{r['feather']}" for r in rows]
    _, number, count = np.unique(feathers, return_inverse=True, return_counts=True)
    return _Measured._make([*values, count[number] ** -0.5, number])


def _fitted(measured: _Measured, least: float) -> tuple[GridErrors, StepError]:
    """The powers that are nearest to what was measured, rather above than below. least: of rows."""
    coefficients = _coefficients(measured)

    def powers(parameters: Array) -> tuple[GridErrors, StepError]:
        a, rows, b, columns, c, *steps = map(float, parameters)
        lines = GridError(np.exp(a), _LINES, rows, least), GridError(np.exp(b), _LINES, columns)
        return GridErrors(*lines, coefficients), StepError(np.exp(c), *steps)

    def off(parameters: Array) -> Array:
        over = np.log(measured.missed(*powers(parameters)) / measured.error)
        return np.asarray(measured.weight * np.where(over < 0.0, _UNDER, 1.0) * over / _FAR)

    low, high = np.transpose([*_GRID, *_GRID, *_FITTED_STEPS])
    found = least_squares(off, 0.5 * (low + high), bounds=(low, high), loss="soft_l1").x
    return powers(found)


def _coefficients(measured: _Measured) -> GridError:
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
    return GridError(factor / (1.0 - 2.0**-_ORDER), _ORDER, slope)


def _wrung(rows: Sequence[Row]) -> GridError:
    """Fit the error of rows for the middle feather, whatever the other settings and loads."""
    number = np.log([r["rows"] for r in rows])
    slope, level = np.polyfit(number, np.log([r["error"] for r in rows]), 1)
    return GridError(float(np.exp(level)), -float(slope), 0.0)


def _work(times: Mapping[tuple[int, int, int], float]) -> StepCost:
    """Through the times of iterations by rows, columns and coefficients, all in proportion."""
    time = np.array(list(times.values()))
    terms = np.array([(1.0, n, n * m, n * c) for n, m, c in times]) / time[:, None]
    each, row, column, coefficient = np.linalg.lstsq(terms, np.ones(len(time)), rcond=None)[0]
    return StepCost(float(each / row), float(column / row), float(coefficient / row), _STEPS_POWER)
