"""What is simulated of a feather for an error that is asked for, and what error that then has.

`front.json` is what `featherfx bench --front` measured on six kinds of scene: how much so many
rows, columns and coefficients miss of the finest, by how far loads were estimated to bend shaft and
barbs, what steps of a tolerance miss of the shortest, each not more in HELD of the feathers; and
what each costs. Too few rows, columns or coefficients bend a feather alike and in the same places,
so what they miss adds up (docs/detail.md); steps err at other times, so their square is added. Of
all settings whose sum stays below the error asked for, the one that costs least is chosen.
Afterwards the sum is taken again (estimate.py), with how far the feather did bend and the largest
error of a step.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.shot.types import Shot

FRONT = Path(__file__).with_name("front.json")
# of an error that is asked for, what is planned with: samples then keep to it (docs/detail.md)
MARGIN = 0.5
# steps of tolerances, so that feathers of about one length stay together
TOLERANCES_AN_OCTAVE = 2


class Chosen(NamedTuple):
    """Rows, columns a side, coefficients per barb and direction, and the tolerance of steps, share
    of the length."""

    rows: int
    columns: int
    coefficients: int
    tolerance: float


class Resolved(NamedTuple):
    """What a number of rows, columns or coefficients costs and misses. cost: by number, of a step,
    over the least. factor, exponent: f by number and q of an error f d^q where d is how far loads
    are estimated to bend shaft or barbs; afterwards the same of how far they did; of the length."""

    cost: dict[int, float]
    factor: dict[int, float]
    exponent: float
    after: tuple[dict[int, float], float]

    def expected(self, number: int, bend: float) -> float:
        return float(self.factor[number] * bend**self.exponent)

    def estimated(self, number: int, bend: Array) -> Array:
        """Also of a number between those that were measured."""
        factors, exponent = self.after
        known = sorted(factors)
        logs = np.interp(np.log(number), np.log(known), np.log([factors[n] for n in known]))
        return np.asarray(np.exp(logs) * bend**exponent)


class Front(NamedTuple):
    """What was measured. steps: factor and exponent of the trajectory's error by the tolerance of
    steps; tolerances: the finest and the coarsest that was measured; all of the length."""

    rows: Resolved
    columns: Resolved
    coefficients: Resolved
    steps: tuple[float, float]
    tolerances: tuple[float, float]

    def of_steps(self, tolerance: Array | float) -> Array:
        """Error of the trajectory by the tolerance, or the largest error, of a step."""
        factor, exponent = self.steps
        return np.asarray(factor * np.asarray(tolerance) ** exponent)

    def tolerance_for(self, error: float) -> float:
        """Tolerance of steps that leads to an error of the trajectory."""
        factor, exponent = self.steps
        return float(np.clip((error / factor) ** (1.0 / exponent), *self.tolerances))


@lru_cache
def front() -> Front:
    """What was measured on the scenes."""
    found = json.loads(FRONT.read_text(encoding="utf-8"))["missed"]
    steps = found["steps"]
    return Front(
        rows=_resolved(found["rows"]),
        columns=_resolved(found["columns"]),
        coefficients=_resolved(found["coefficients"]),
        steps=(steps["factor"], steps["exponent"]),
        tolerances=(steps["finest"], steps["coarsest"]),
    )


def _resolved(found: Mapping[str, Any]) -> Resolved:
    tables = found["cost"], found["before"]["factor"], found["after"]["factor"]
    cost, before, after = (
        _filled({int(number): value for number, value in table.items()}) for table in tables
    )
    return Resolved(cost, before, found["before"]["exponent"], (after, found["after"]["exponent"]))


def _filled(table: Mapping[int, float]) -> dict[int, float]:
    """With numbers between those that were measured."""
    known = sorted(table)
    between = [round(math.sqrt(a * b)) for a, b in pairwise(known)]
    numbers = sorted({*known, *between})
    logs = np.interp(np.log(numbers), np.log(known), np.log([table[n] for n in known]))
    return dict(zip(numbers, np.exp(logs).tolist(), strict=True))


@lru_cache(maxsize=4096)
def chosen_for(error: float, shaft: float, barb: float) -> Chosen:
    """The cheapest setting that keeps to an error where loads bend shaft and barbs so far; all are
    shares of the length. The finest where none does."""
    known, best, least = front(), None, math.inf
    finest = known.tolerances[0]
    grids = product(known.rows.cost, known.columns.cost, known.coefficients.cost)
    for n, m, c in grids:
        parts = (
            known.rows.expected(n, shaft),
            known.columns.expected(m, barb),
            known.coefficients.expected(c, barb),
        )
        left = (MARGIN * error) ** 2 - sum(parts) ** 2
        if left <= float(known.of_steps(finest)) ** 2:
            continue
        tolerance = known.tolerance_for(math.sqrt(left))
        work = known.rows.cost[n] * known.columns.cost[m] * known.coefficients.cost[c]
        # steps are of third order in their error
        cost = work * tolerance ** (-1.0 / 3.0)
        if cost < least:
            best, least = Chosen(n, m, c, tolerance), cost
    if best is None:
        grid = max(known.rows.cost), max(known.columns.cost), max(known.coefficients.cost)
        best = Chosen(*grid, known.tolerance_for(MARGIN * error))
    return best


def rounded_up(fraction: float) -> float:
    """A deflection as what is chosen for is: alike within a tenth, never less."""
    return 1.1 ** math.ceil(math.log(max(fraction, 1e-6), 1.1))


def stepped_down(tolerance: float) -> float:
    """The next lower of the tolerances (m) that there are."""
    octaves = math.floor(TOLERANCES_AN_OCTAVE * math.log2(tolerance)) / TOLERANCES_AN_OCTAVE
    return float(2.0**octaves)


def common_tolerance(shot: Shot) -> float:
    """m, of what concerns all feathers of a shot: contact, sleep and cycles. Without a tolerance,
    what half the error asked for leaves a feather of the median length."""
    quality = shot.quality
    if quality.tolerance is not None:
        return quality.tolerance
    error = quality.promised
    assert error is not None
    length = float(np.median([each.kind.length for each in shot.groom.feathers] or [1.0]))
    return length * front().tolerance_for(0.5 * error)
