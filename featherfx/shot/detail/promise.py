"""What is simulated of a feather for an error that is asked for, and what error that then has.

`front.json` is what `featherfx bench --front` measured on six kinds of scene, as powers: what a
number of rows, columns or coefficients misses of the finest is

    factor number^-order bend^exponent

of the length, where bend is how far loads would bend barbs if they bent in proportion: a load over
a stiffness, which goes on growing where barbs are bent as far as they are long. Of rows the number
of spaces between them counts; pieces of lines, as of shafts and barbs, are of second order. What
steps of a tolerance miss is factor tolerance^exponent e^(-air share), where share is the air's part
of what bends the shaft: air takes from a vibration what a step erred, and without air errors add
up. Too few rows, columns or coefficients bend a feather alike and in the same places, so what they
miss adds up (docs/detail.md); steps err at other times, so their square is added. Of all settings
whose sum stays below the error asked for, the one that costs least is chosen. Afterwards the sum is
taken again (estimate.py), with how far the feather did bend and the largest error of a step.

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
from featherfx.groom.keys.preset import Quality
from featherfx.shot.types import Shot

FRONT = Path(__file__).with_name("front.json")
# of an error that is asked for, what is planned with: few feathers err by more than twice what the
# powers say (docs/detail.md). Of less than FINE, less, as what feathers err by falls slower than
# what is planned; less of vanes that are pulled within their plane, whose power is that of the
# middle one
MARGIN, WRUNG_MARGIN, FINE = 0.45, 0.2, 0.015
# the same of calm feathers, which err by a third of it at most (docs/detail.md), and least share of
# the air for them
CALM_MARGIN, CALM_AIR = 0.8, 0.5
# steps of tolerances, so that feathers of about one length stay together
TOLERANCES_AN_OCTAVE = 2
# what is chosen from, the finest last: few enough that feathers of one kind stay together
ROWS = (6, 8, 11, 15, 21, 29, 41, 57)
COLUMNS = (2, 3, 4, 6, 8, 12)
COEFFICIENTS = (1, 2, 3)


class Bends(NamedTuple):
    """How far loads bend a feather's shaft and would bend its barbs in proportion, and the air's
    share of what bends the shaft, 0 to 1. wrung: whether a grip or a force pulls within the plane
    of the vane, which may buckle then."""

    shaft: float
    barb: float
    air: float
    wrung: bool = False


class Chosen(NamedTuple):
    """Rows, columns a side, coefficients per barb and direction, and the tolerance of steps, share
    of the length."""

    rows: int
    columns: int
    coefficients: int
    tolerance: float


class Missed(NamedTuple):
    """What a number of rows, columns or coefficients misses, of the length. least: what bends
    less misses as much as what bends so far."""

    factor: float
    order: float
    exponent: float
    least: float = 0.0

    def by(self, number: Array | float, bend: Array | float) -> Array:
        """bend: of the length."""
        return np.asarray(
            self.factor
            * np.asarray(number, float) ** -self.order
            * np.maximum(bend, self.least) ** self.exponent
        )

    def times(self, share: float) -> Missed:
        """So much of it."""
        return self._replace(factor=share * self.factor)


class MissedBySteps(NamedTuple):
    """What steps of a tolerance miss, both of the length."""

    factor: float
    exponent: float
    air: float

    def by(self, tolerance: Array | float, share: Array | float) -> Array:
        """tolerance: or the largest error of a step. share: the air's."""
        damped = np.exp(-self.air * np.asarray(share))
        return np.asarray(self.factor * np.asarray(tolerance) ** self.exponent * damped)

    def tolerance_for(self, error: float, share: float) -> float:
        """Tolerance of steps that leads to an error of the trajectory."""
        return float((error * math.exp(self.air * share) / self.factor) ** (1.0 / self.exponent))


class Grid(NamedTuple):
    """What rows, columns and coefficients miss."""

    rows: Missed
    columns: Missed
    coefficients: Missed

    def by(self, grid: tuple[int, int, int], barb: Array | float) -> Array:
        """grid: rows, columns, coefficients. barb: how far barbs bend, of the length."""
        rows, columns, coefficients = grid
        ends = self.columns.by(columns, barb) + self.coefficients.by(coefficients, barb)
        return self.rows.by(rows - 1, barb) + ends


class Work(NamedTuple):
    """Time of an iteration: each + rows (1 + column columns + coefficient coefficients), in that of
    a row; and the power of the number of steps by one over the tolerance."""

    each: float
    column: float
    coefficient: float
    steps: float

    def by(self, grid: tuple[int, int, int]) -> float:
        rows, columns, coefficients = grid
        return self.each + rows * (1.0 + self.column * columns + self.coefficient * coefficients)


class Front(NamedTuple):
    """What was measured. before: by how far loads are estimated to bend feathers; after: by how
    far they did, not less in HELD of them (lab/bench/front_fit.py). wrung: of rows, of
    vanes that are pulled within their plane. tolerances: the finest and the coarsest that are
    trusted, of the length. calm: least deflections of shaft and barbs of the scenes in air, of the
    length."""

    before: Grid
    after: Grid
    wrung: Missed
    steps: MissedBySteps
    work: Work
    tolerances: tuple[float, float]
    calm: tuple[float, float]

    def calms(self, bends: Bends) -> bool:
        """Whether a feather is calm."""
        less = bends.shaft < self.calm[0] and bends.barb < self.calm[1]
        return less and bends.air >= CALM_AIR and not bends.wrung

    def expected(self, bends: Bends) -> Grid:
        """What rows, columns and coefficients miss of a feather."""
        rows, columns, coefficients = self.before
        if bends.wrung:
            rows = self.wrung
        elif self.calms(bends):
            rows = rows.times(bends.shaft / self.calm[0])
            coefficients = coefficients.times(bends.barb / self.calm[1])
        return Grid(rows, columns, coefficients)


@lru_cache
def front() -> Front:
    """What was measured on the scenes."""
    found = json.loads(FRONT.read_text(encoding="utf-8"))["missed"]
    before, after = (
        Grid(*(Missed(**found[when][name]) for name in Grid._fields))
        for when in ("before", "after")
    )
    steps, work = MissedBySteps(**found["steps"]), Work(**found["work"])
    wrung, (finest, coarsest) = Missed(**found["wrung"]), found["tolerances"]
    return Front(before, after, wrung, steps, work, (finest, coarsest), tuple(found["calm"]))


@lru_cache(maxsize=4096)
def chosen_for(error: float, bends: Bends) -> Chosen:
    """The cheapest setting that keeps to an error; errors and bends are shares of the length. The
    finest where none does."""
    known, best, least = front(), None, math.inf
    (finest, coarsest), missed = known.tolerances, known.expected(bends)
    planned = CALM_MARGIN * error if known.calms(bends) else planned_with(error, bends.wrung)
    for grid in product(ROWS, COLUMNS, COEFFICIENTS):
        left = planned**2 - float(missed.by(grid, bends.barb)) ** 2
        if left <= float(known.steps.by(finest, bends.air)) ** 2:
            continue
        tolerance = min(known.steps.tolerance_for(math.sqrt(left), bends.air), coarsest)
        cost = known.work.by(grid) * tolerance**-known.work.steps
        if cost < least:
            best, least = Chosen(*grid, tolerance), cost
    if best is not None:
        return best
    tolerance = known.steps.tolerance_for(planned, bends.air)
    kept = min(max(tolerance, finest), coarsest)
    return Chosen(ROWS[-1], COLUMNS[-1], COEFFICIENTS[-1], kept)


def planned_with(error: float, wrung: bool = False) -> float:
    """What settings are chosen by, for an error that is asked for."""
    margin = WRUNG_MARGIN if wrung else MARGIN
    return margin * error * math.sqrt(min(error / FINE, 1.0))


def rounded_up(fraction: float) -> float:
    """A deflection as what is chosen for is: alike within a quarter, never less."""
    return 1.25 ** math.ceil(math.log(max(fraction, 1e-6), 1.25))


def rounded_down(share: float) -> float:
    """A share of the air as what is chosen for is: alike within a fifth, never more."""
    return math.floor(5.0 * share) / 5.0


def stepped_down(tolerance: float) -> float:
    """The next lower of the tolerances (m) that there are."""
    octaves = math.floor(TOLERANCES_AN_OCTAVE * math.log2(tolerance)) / TOLERANCES_AN_OCTAVE
    return float(2.0**octaves)


def quality_of(shot: Shot) -> Quality:
    """The quality that a shot's feathers are simulated by: where they push each other, its numbers
    if it has any for that."""
    return shot.quality if shot.contact is None else shot.quality.pushing


def common_tolerance(shot: Shot) -> float:
    """m, of what concerns all feathers of a shot: contact, and whether roots begin at rest. Without
    a tolerance, what half the error asked for leaves a feather of the median length."""
    quality = shot.quality.pushing
    if quality.tolerance is not None:
        return quality.tolerance
    error = quality.promised
    assert error is not None
    length = float(np.median([each.kind.length for each in shot.groom.feathers] or [1.0]))
    known = front()
    tolerance = known.steps.tolerance_for(0.5 * error, 0.0)
    return length * float(np.clip(tolerance, *known.tolerances))
