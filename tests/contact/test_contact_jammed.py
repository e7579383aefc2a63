"""What is done where feathers find no balance: pairs that pass, and settling with shorter steps."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from contact_cases import free_feathers, solver_of

from featherfx.mechanics.model import no_loads
from featherfx.shot.contact import settle
from featherfx.solver.contact.interval_options import IntervalOptions
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


def test_a_length_that_failed_twice_is_not_tried_again(monkeypatch):
    """Steps of settling of which none longer than most can be solved, and that never come to
    rest."""
    most, asked = 0.02, []

    class Steps:
        stuck = np.zeros(2, dtype=np.bool_)

        def __init__(self, *given):
            pass

        def take(self, states, h, resting, apart):
            asked.append(h)
            length = h
            while length > most:
                length *= settle.CUT
            new = [each.copy() for each in states]
            new[0].points.nodes[...] += 1.0
            report = SimpleNamespace(depth=0.0, start_depth=0.0, deep=np.zeros(2))
            return new, report, np.full(2, length)

    monkeypatch.setattr(settle, "_Steps", Steps)
    _, state = free_feathers("swan_primary", [[0, 0, 0], [0, 1, 0]], **GRID)
    alone = SimpleNamespace(beside=lambda states, time: states)
    solver = SimpleNamespace(settings=SimpleNamespace(tolerance=1e-5))
    settle.settled_together(
        solver, SimpleNamespace(begun=False), [state], [], ["a", "b"], np.zeros(2), alone
    )
    stages = [asked[k * settle.MAX_STEPS : (k + 1) * settle.MAX_STEPS] for k in range(3)]
    assert stages[0] == [0.01] * settle.MAX_STEPS
    for stage in stages[1:]:
        assert sum(each > most for each in stage) == 2
        assert stage[-1] <= most
