"""What is done where feathers find no balance: pairs that pass, and settling with shorter steps."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import free_feathers, solver_of

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact.types import IntervalOptions
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
