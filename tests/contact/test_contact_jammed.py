"""What is done where feathers find no balance: pairs that pass, and settling with shorter steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contact_cases import free_feathers, solver_of
from test_contact_shots import SAMPLE, baked, half_wing

from featherfx.errors import InputWarning
from featherfx.mechanics.model import no_loads
from featherfx.shot.read.read import read_shot
from featherfx.shot.types import Motion
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.types import PLAIN_INTERVAL, IntervalOptions
from featherfx.solver.state import hold_roots

GRID = {"rows": 11, "columns": 4}
PAIR, ORDERED = [(0, 1), (1, 0)], [-1, 1]
DEEPEST = 5e-3  # m


@pytest.mark.parametrize(
    ("depth", "jammed", "passes"),
    [(3e-3, True, True), (3e-3, False, False), (5e-4, True, False), (7e-3, False, True)],
)
def test_a_jammed_pair_passes_from_a_fifth_of_the_depth_of_others_on(depth, jammed, passes):
    """The second feather belongs over the first, and begins under it by a depth (m)."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], [0.02, 0.01, -depth]], **GRID)
    contact = solver_of(model, PAIR, ORDERED, deepest=DEEPEST, margin=DEEPEST)
    contact.interval([state], [no_loads(2)], [hold_roots(state)], 1e-4)
    assert contact.depths()[2].max() == pytest.approx(depth, abs=1e-3)
    contact.accept(jammed=np.full(2, jammed))
    assert bool(contact.passed) == passes
    contact.interval([state], [no_loads(2)], [hold_roots(state)], 1e-4)
    assert (len(contact.depths()[2]) == 0) == passes


def test_a_step_in_which_one_feather_fails_ends_with_its_first_search(monkeypatch):
    """Where feathers settle; in motion contacts are searched again where others went."""
    places = [[0, 0, 0], [0.02, 0.01, 2e-3], [0, 1, 0], [0.02, 1.01, 2e-3]]
    model, state = free_feathers("swan_primary", places, **GRID)
    state.velocity.nodes[0] = np.nan
    pairs, loads, searches = [(0, 1), (1, 0), (2, 3), (3, 2)], [no_loads(4, (0, 0, -9000))], []
    for settling in (True, False):
        contact, found = solver_of(model, pairs, [*ORDERED, *ORDERED]), []
        find = contact._find

        def count(*given, find=find, found=found):
            found.append(find(*given))

        monkeypatch.setattr(contact, "_find", count)
        manner = IntervalOptions(settling=settling)
        _, (report,), _ = contact.interval([state], loads, [hold_roots(state)], 1e-3, manner=manner)
        assert report.status[0] != 0
        assert report.status[2] == 0
        searches.append(len(found))
    assert searches[0] == 1 < searches[1]


@pytest.mark.parametrize("fails", [False, True])
def test_a_feather_that_no_step_brings_into_balance_keeps_its_pose(monkeypatch, fails):
    """The first forty steps leave one a metre away, with contacts off, or unsolved."""
    shot = half_wing(read_shot(SAMPLE))
    quality = replace(shot.quality, rows=7, columns=2, coefficients=1)
    shot = replace(shot, quality=quality, motion=Motion("hold", {}))
    hard, interval, tries = 4, ContactSolver.interval, []

    def hindered(self, states, loads, paths, duration, walls=(), manner=PLAIN_INTERVAL):
        done, reports, contact = interval(self, states, loads, paths, duration, walls, manner)
        if not manner.settling and self.free[hard] and len(tries) < 40:
            tries.append(duration)
            done[0].points.nodes[hard] += 1.0
            reports[0].status[hard] = 1.0 if fails else 0.0
            off = np.where(np.arange(len(contact.off)) == hard, 1.0, contact.off)
            contact = replace(contact, off=contact.off if fails else off)
        return done, reports, contact

    monkeypatch.setattr(ContactSolver, "interval", hindered)
    with pytest.warns(InputWarning, match=f"'{shot.groom.feathers[hard].id}' found no balance"):
        simulation, (first, *others) = baked(shot, 3)
    for frame in others:
        for now, then in zip(frame.rows, first.rows, strict=True):
            assert np.abs(now - then).max() < 1e-3
    assert simulation.report["contact"]["feathers_whose_contacts_yielded"] == 1
