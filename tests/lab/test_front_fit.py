"""Powers through what the scenes of the front have missed: known ones are found again."""

from itertools import product

import numpy as np
import pytest

from featherfx.lab.bench.front import missed
from featherfx.shot.options.error_model import GridError, GridErrors, StepCost, StepError

KNOWN = GridErrors(
    GridError(0.6, 2.0, 0.6, 0.05), GridError(0.1, 2.0, 0.8), GridError(0.004, 3.0, 0.2)
)
STEPS, WORK, WRUNG = (
    StepError(0.7, 0.7, 1.5),
    StepCost(8.0, 0.2, 0.3, 0.28),
    GridError(0.5, 1.3, 0.0),
)
SETTINGS = tuple(product((6, 8, 11, 15, 21, 29), (2, 3, 4, 6), (1, 2), (6e-3, 1e-3, 2e-4, 5e-5)))


def rows_of(name, shaft, barb, air, wrung=False):
    for n, m, c, tolerance in SETTINGS:
        space = KNOWN.by((n, m, c), barb)
        error = np.hypot(space, STEPS.by(tolerance, air))
        yield {
            "scene": "made",
            "feather": name,
            "touching": False,
            "rows": n,
            "columns": m,
            "coefficients": c,
            "tolerance": tolerance,
            "shaft": shaft,
            "barb": barb,
            "barb bent": 0.5 * barb,
            "air": air,
            "wrung": wrung,
            "error": float(WRUNG.by(n, 0.3) if wrung else error),
        }


def test_known_powers_are_found_again():
    feathers = ((0.02, 0.002, 0.0), (0.1, 0.05, 0.3), (0.3, 0.15, 0.6), (0.8, 0.02, 0.9))
    rows = [row for k, each in enumerate(feathers) for row in rows_of(f"f{k}", *each)]
    rows += rows_of("pulled", 0.3, 0.01, 0.0, wrung=True)
    times = {grid[:3]: 1e-6 * WORK.by(grid[:3]) for grid in SETTINGS}
    found = missed(rows, times)
    assert found["before"]["rows"]["factor"] == pytest.approx(0.6, rel=0.1)
    assert found["before"]["rows"]["exponent"] == pytest.approx(0.6, abs=0.1)
    assert found["before"]["columns"]["exponent"] == pytest.approx(0.8, abs=0.1)
    assert found["steps"]["exponent"] == pytest.approx(0.7, abs=0.05)
    assert found["steps"]["air"] == pytest.approx(1.5, abs=0.2)
    assert found["wrung"] == pytest.approx(WRUNG._asdict())
    assert found["work"] == pytest.approx(WORK._asdict())
    grid, steps = GridErrors(*(GridError(**each) for each in found["after"].values())), STEPS
    kept = [
        r["error"]
        <= 1.02
        * np.hypot(
            grid.by((r["rows"], r["columns"], r["coefficients"]), r["barb bent"]),
            steps.by(r["tolerance"], r["air"]),
        )
        for r in rows
        if not r["wrung"]
    ]
    assert np.mean(kept) > 0.85


def test_feathers_that_push_each_other_are_left_out():
    feathers = ((0.02, 0.002, 0.0), (0.1, 0.05, 0.3), (0.3, 0.15, 0.6), (0.8, 0.02, 0.9))
    rows = [row for k, each in enumerate(feathers) for row in rows_of(f"f{k}", *each)]
    rows += rows_of("pulled", 0.3, 0.01, 0.0, wrung=True)
    touching = [{**r, "touching": True, "error": 9.0 * r["error"]} for r in rows]
    times = {grid[:3]: 1e-6 * WORK.by(grid[:3]) for grid in SETTINGS}
    assert missed(rows + touching, times) == missed(rows, times)
