"""The grid and tolerance that keep a feather to an error, and the error that it then has.

`featherfx lab measure errors` measured on six kinds of scene what is in `error_model.json`: as
powers, what a number of rows, columns or coefficients misses of the finest is

    factor number^-order bend^exponent

of the length, where bend is how far loads would bend barbs if they bent in proportion: a load over
a stiffness, which goes on growing where barbs are bent as far as they are long. Of rows the number
of spaces between them counts; pieces of lines, as of shafts and barbs, are of second order. What
steps of a tolerance miss is factor tolerance^exponent e^(-air share), where share is the air's part
of what bends the shaft: air takes from a vibration what a step erred, and without air errors add
up. Too few rows, columns or coefficients bend a feather alike and in the same places, so what they
miss adds up (docs/detail.md); steps err at other times, so their square is added. Of all settings
whose sum stays below the error asked for, the one that costs least is chosen. Afterwards the sum is
taken again (error_estimate.py), with how far the feather did bend and the largest error of a step.

Vanes that are pulled within their plane may buckle, and what rows miss of that is far more, and
falls slower; it has a power of its own.

Feathers that air damps and that bend less than any of the scenes in air are calm: neither buckling
nor flutter scatters what they err by, and what rows and coefficients miss is in proportion to how
far they bend, as in linear bending.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array

_FILE = Path(__file__).with_name("error_model.json")
# of an error that is asked for, what is planned with: few feathers err by more than twice what the
# powers say (docs/detail.md). Below _FINE_ERROR, less, as what feathers err by falls slower than
# what is planned; less of vanes that are pulled within their plane, whose power is that of the
# middle one
_MARGIN, _WRUNG_MARGIN, _FINE_ERROR = 0.45, 0.2, 0.015
# the same of calm feathers, which err by a third of it at most (docs/detail.md), and the least air
# fraction of these
_CALM_MARGIN, CALM_AIR = 0.8, 0.5
# steps of tolerances, so that feathers of about one length stay together
_TOLERANCES_PER_OCTAVE = 2
# what is chosen from, the finest last: few enough that feathers of one kind stay together
ROWS = (6, 8, 11, 15, 21, 29, 41, 57)
COLUMNS = (2, 3, 4, 6, 8, 12)
COEFFICIENTS = (1, 2, 3)


class Deflection(NamedTuple):
    """Deflection of a rachis by its loads, and of the barbs if they bent in proportion.

    air: the air's fraction of what bends the rachis, 0 to 1. wrung: whether a grip or a force pulls
    within the plane of the vane, which may buckle then.
    """

    rachis: float
    barb: float
    air: float
    wrung: bool = False


class GridError(NamedTuple):
    """The error of a number of rows, columns or coefficients, over the length. least: what bends
    less errs by as much as what bends so far."""

    factor: float
    order: float
    exponent: float
    least: float = 0.0

    def by(self, number: Array | float, bend: Array | float) -> Array:
        """Return the error of a number at a bend, over the length."""
        return np.asarray(
            self.factor
            * np.asarray(number, float) ** -self.order
            * np.maximum(bend, self.least) ** self.exponent
        )

    def times(self, fraction: float) -> GridError:
        """Return a fraction of it."""
        return self._replace(factor=fraction * self.factor)


class StepError(NamedTuple):
    """The error of steps of a tolerance, both over the length."""

    factor: float
    exponent: float
    air: float

    def by(self, tolerance: Array | float, air: Array | float) -> Array:
        """Return the error of steps of a tolerance, or of a largest error. air: its fraction."""
        damped = np.exp(-self.air * np.asarray(air))
        return np.asarray(self.factor * np.asarray(tolerance) ** self.exponent * damped)

    def tolerance_for(self, error: float, air: float) -> float:
        """Return the tolerance of steps that leads to an error of the trajectory."""
        return float((error * math.exp(self.air * air) / self.factor) ** (1.0 / self.exponent))


class GridErrors(NamedTuple):
    """The errors of rows, columns and coefficients."""

    rows: GridError
    columns: GridError
    coefficients: GridError

    def by(self, grid: tuple[int, int, int], barb: Array | float) -> Array:
        """Return the error of rows, columns and coefficients. barb: how far barbs bend."""
        rows, columns, coefficients = grid
        ends = self.columns.by(columns, barb) + self.coefficients.by(coefficients, barb)
        return self.rows.by(rows - 1, barb) + ends


class StepCost(NamedTuple):
    """Time of an iteration: each + rows (1 + column columns + coefficient coefficients), in that of
    a row; steps: power of the number of steps by one over the tolerance."""

    each: float
    column: float
    coefficient: float
    steps: float

    def by(self, grid: tuple[int, int, int]) -> float:
        """Return the time of rows, columns and coefficients."""
        rows, columns, coefficients = grid
        return self.each + rows * (1.0 + self.column * columns + self.coefficient * coefficients)


class ErrorModel(NamedTuple):
    """Errors that were measured on the scenes (lab/bench/front.py).

    before: by how far loads are estimated to bend feathers; after: by how far they did. wrung: of
    rows, of vanes that are pulled within their plane. work: time of an iteration. tolerances: the
    finest and the coarsest that are trusted, over the length. calm: least deflections of rachis and
    barbs of the scenes in air, over the length.
    """

    before: GridErrors
    after: GridErrors
    wrung: GridError
    steps: StepError
    work: StepCost
    tolerances: tuple[float, float]
    calm: tuple[float, float]

    def calms(self, deflection: Deflection) -> bool:
        """Return whether a feather is calm."""
        less = deflection.rachis < self.calm[0] and deflection.barb < self.calm[1]
        return less and deflection.air >= CALM_AIR and not deflection.wrung

    def expected(self, deflection: Deflection) -> GridErrors:
        """Return the errors of rows, columns and coefficients of a feather."""
        rows, columns, coefficients = self.before
        if deflection.wrung:
            rows = self.wrung
        elif self.calms(deflection):
            rows = rows.times(deflection.rachis / self.calm[0])
            coefficients = coefficients.times(deflection.barb / self.calm[1])
        return GridErrors(rows, columns, coefficients)


@lru_cache
def error_model() -> ErrorModel:
    """Return what was measured on the scenes."""
    found = json.loads(_FILE.read_text(encoding="utf-8"))["missed"]
    before, after = (
        GridErrors(*(GridError(**found[when][name]) for name in GridErrors._fields))
        for when in ("before", "after")
    )
    steps, work = StepError(**found["steps"]), StepCost(**found["work"])
    wrung, (finest, coarsest) = GridError(**found["wrung"]), found["tolerances"]
    return ErrorModel(before, after, wrung, steps, work, (finest, coarsest), tuple(found["calm"]))


@lru_cache(maxsize=4096)
def choose_for_error(error: float, deflection: Deflection) -> tuple[int, int, int, float]:
    """Return the rows, columns, coefficients and tolerance of the cheapest simulation that keeps to
    an error; the finest where none does. Error, deflection and tolerance are over the length."""
    known, best, least = error_model(), None, math.inf
    (finest, coarsest), grid_errors = known.tolerances, known.expected(deflection)
    is_calm = known.calms(deflection)
    planned = _CALM_MARGIN * error if is_calm else planned_error(error, deflection.wrung)
    for grid in product(ROWS, COLUMNS, COEFFICIENTS):
        left = planned**2 - float(grid_errors.by(grid, deflection.barb)) ** 2
        if left <= float(known.steps.by(finest, deflection.air)) ** 2:
            continue
        tolerance = min(known.steps.tolerance_for(math.sqrt(left), deflection.air), coarsest)
        cost = known.work.by(grid) * tolerance**-known.work.steps
        if cost < least:
            best, least = (*grid, tolerance), cost
    if best is not None:
        return best
    tolerance = known.steps.tolerance_for(planned, deflection.air)
    return ROWS[-1], COLUMNS[-1], COEFFICIENTS[-1], min(max(tolerance, finest), coarsest)


def planned_error(error: float, wrung: bool = False) -> float:
    """Return the error that is planned with, for one that is asked for."""
    margin = _WRUNG_MARGIN if wrung else _MARGIN
    return margin * error * math.sqrt(min(error / _FINE_ERROR, 1.0))


def rounded_up(fraction: float) -> float:
    """Round a deflection up to a power of 1.25: those within a quarter are treated alike."""
    return 1.25 ** math.ceil(math.log(max(fraction, 1e-6), 1.25))


def rounded_down(fraction: float) -> float:
    """Round a fraction of the air down to fifths: those within a fifth are treated alike."""
    return math.floor(5.0 * fraction) / 5.0


def stepped_down(tolerance: float) -> float:
    """Return the next lower of the tolerances (m) that there are."""
    octaves = math.floor(_TOLERANCES_PER_OCTAVE * math.log2(tolerance)) / _TOLERANCES_PER_OCTAVE
    return float(2.0**octaves)
