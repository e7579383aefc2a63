"""States of an interval made ready, and put back, in parts that threads take."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import THICKNESS, free_feathers
from numpy.typing import NDArray

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact import run
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import Candidates, ContactSettings, IntervalOptions
from featherfx.solver.solver import Settings, Solver, hold_roots

SPEED, STEP, FEATHERS, RESTING = 0.5, 1e-3, 5, 3


def _after_a_step(jobs: int) -> dict[str, NDArray[np.float64]]:
    """Feathers with held roots, each at a speed of its own, but for one that rests unpressed."""
    places = [(0.0, 0.5 * k, 0.0) for k in range(FEATHERS)]
    model, state = free_feathers("covert", places, rows=5, columns=2)
    model.held[:] = True
    state.velocity.nodes[..., 2] = SPEED * np.arange(FEATHERS)[:, None, None]
    pairs = Candidates(np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    halves = [0.5 * THICKNESS] * FEATHERS
    with Solver(model, Settings(max_substeps=1), jobs) as solver:
        contact = ContactSolver([solver], pairs, halves, ContactSettings())
        resting = np.arange(FEATHERS) == RESTING
        (new,), _, _ = contact.interval(
            [state],
            [no_loads(FEATHERS)],
            [hold_roots(state)],
            STEP,
            manner=IntervalOptions(resting=resting),
        )
    found = {name: array.copy() for name, array in new.arrays().items()}
    for name, array in state.arrays().items():
        assert (found[name][RESTING] == array[RESTING]).all()
    assert (found["points.nodes"][1, -1, :, 2] > state.points.nodes[1, -1, :, 2]).all()
    return found


@pytest.mark.parametrize("jobs", [1, 2])
def test_parts_change_no_bytes(jobs, monkeypatch):
    whole = _after_a_step(1)
    monkeypatch.setattr(run, "_WORTH_IT", 0)
    monkeypatch.setattr(run, "_AT_ONCE", 2)
    parts = _after_a_step(jobs)
    assert all(np.array_equal(parts[name], each) for name, each in whole.items())
