"""Criterion of rounds of contact, and springs that get stiffer from round to round."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from contact_cases import THICKNESS, free_feathers, solver_of

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact import list_kernels
from featherfx.solver.contact import run as run_module
from featherfx.solver.contact.interval import ContactSolver
from featherfx.solver.contact.list_kernels import _gone, _note_clear, _stiffen, is_clear, residual
from featherfx.solver.contact.search import new_touch
from featherfx.solver.contact.types import ByBody, ContactSettings
from featherfx.solver.state import hold_roots

MASS, STIFFNESS, FRAME, TOLERANCE = 2e-6, 0.3, 1.0 / 24.0, 1e-5
stiffen, misfit = _stiffen.py_func, residual.py_func


@pytest.fixture
def plain(monkeypatch):
    """Kernels that call each other as Python."""
    for each in (is_clear, _gone):
        monkeypatch.setattr(list_kernels, each.name.rpartition(".")[2], each.py_func)


def contact_of(**values):
    contact = new_touch(1).view(np.recarray)[0]
    for name, value in values.items():
        setattr(contact, name, value)
    return contact


@pytest.mark.parametrize("duration", [FRAME / 16.0, FRAME, 2.0 * FRAME, 1.0])
@pytest.mark.parametrize("stiffness", [0.0, STIFFNESS])
def test_what_rounds_leave_moves_a_mass_on_a_spring_as_far_whatever_the_step(duration, stiffness):
    """Implicit steps of two frames, or of one that is longer, by the force that is left."""
    rounds = SimpleNamespace(settings=ContactSettings(tolerance=TOLERANCE, frame=FRAME))
    inertial = MASS / duration**2
    left = ContactSolver._leeway(rounds, np.array([inertial]), np.array([stiffness]), duration)
    moved = left[0] / (MASS / max(duration, 2.0 * FRAME) ** 2 + stiffness)
    assert moved == pytest.approx(0.4 * TOLERANCE, rel=1e-12)


def test_a_body_is_as_far_open_as_its_worst_contact_over_what_rounds_may_leave(plain):
    touch = new_touch(4).view(np.recarray)
    touch.guest, touch.host, touch.stiffness = 0, [1, 1, 2, 1], 2.0
    # balanced, a misfit of 1 m, a gap of -3 m, and one held shut by force
    touch.guest_force, touch.host_force = [5.0, 4.0, 0.0, 8.0], [5.0, 6.0, 0.0, 8.0]
    touch.gap, touch.spared = [0.0, 0.0, -3.0, 0.5], [0.0, 0.0, 0.0, 0.25]
    touch.leeway = [0.1, 4.0, 6.0, 0.25]
    way = np.zeros(3)
    listed = ByBody(np.array([0, 4]), np.arange(4))
    assert misfit(0, touch, listed, way) == (3.0, 2.0, 3.0)
    touch.leeway[1] = 0.125
    assert misfit(0, touch, listed, way) == (3.0, 8.0, 3.0)


@pytest.mark.parametrize("force", [0.0, 1.0])
def test_a_contact_is_not_looked_at_until_bodies_may_have_closed_it(plain, force):
    """A gap of 3 m, of which rounds may leave 1 m, between bodies that went 5 m and 7 m before."""
    contact, way = contact_of(guest=0, host=1, gap=3.0, leeway=1.0, host_force=force), [5.0, 7.0]
    _note_clear.py_func(contact, way)
    assert is_clear.py_func(contact, way) == (force == 0.0)
    assert is_clear.py_func(contact, [5.9, 8.0]) == (force == 0.0)
    assert not is_clear.py_func(contact, [6.0, 8.1])


@pytest.mark.parametrize(
    ("before", "gap", "factor"),
    [(0.0, 1.0, 1.0), (1.0, 0.9, 1.5), (-1.0, -0.9, 1.5), (1.0, 0.7, 1.0), (1.0, -0.9, 1.0),
     (0.2, 0.1999, 1.0)],
)  # fmt: skip
def test_springs_get_stiffer_whose_gaps_hardly_close(before, gap, factor):
    contact = contact_of(stiffness=2.0, stiffest=3.5, leeway=0.2, before=before, gap=gap)
    stiffen(contact)
    assert (contact.stiffness, contact.before) == (2.0 * factor, gap)
    contact.before = gap
    if factor > 1.0:
        stiffen(contact)
        assert contact.stiffness == contact.stiffest


def rounds_of_two_bodies(stiffest, load=1.0, stiffness=1.0):
    """Rounds until two springs, of which a load presses one against the other, are where one twice
    as stiff would be; the contact's spring begins at a hundredth of theirs."""
    contact = contact_of(stiffness=0.01 * stiffness, stiffest=stiffest, leeway=1e-4)
    guest, host = 0.0, 0.0
    for rounds in range(1, 1000):
        r, force = contact.stiffness, contact.host_force
        guest = max((force + r * host - load) / (stiffness + r), -load / stiffness)
        contact.gap = guest - host
        contact.guest_force = max(0.0, force - r * contact.gap)
        stiffen(contact)
        r, force = contact.stiffness, contact.guest_force
        host = (r * guest - force) / (stiffness + r)
        contact.gap = guest - host
        contact.host_force = max(0.0, force - r * contact.gap)
        stiffen(contact)
        if abs(guest + 0.5 * load / stiffness) < 1e-3 > abs(host + 0.5 * load / stiffness):
            return rounds
    return rounds


def test_rounds_with_springs_that_are_too_soft_end_as_soon_as_they_get_stiffer():
    """A spring of r takes the part ((K - r) / (K + r))^2 of what is amiss in a round."""
    expected = np.log(2e-3) / np.log(((1.0 - 0.01) / (1.0 + 0.01)) ** 2)
    assert rounds_of_two_bodies(0.01) == pytest.approx(expected, rel=0.1)
    assert rounds_of_two_bodies(1.0) < 0.2 * expected


def test_pairs_that_rest_in_each_other_take_as_many_rounds_as_others():
    """One that a load presses on another, from as far over where they push each other. A pair may
    be as deep in each other as it is drawn."""
    rounds = []
    for depth in (0.0, THICKNESS):
        places = [[0.0, 0.0, 0.0], [0.002, 0.001, 1.2 * THICKNESS - depth]]
        model, state = free_feathers("swan_primary", places, rows=12, columns=4, coefficients=1)
        model.held[:] = True
        contact = solver_of(model, [(0, 1), (1, 0)], [-1, 1], rounds=200, tolerance=1e-6)
        contact.candidates.depth[:] = depth
        force = np.zeros((2, *model.mass.shape[1:], 3))
        force[1, ..., 2] = -50.0 * model.mass[1]
        loads, taken = no_loads(2)._replace(force=force), 0
        for _ in range(2):
            (state,), _, report = contact.interval([state], [loads], [hold_roots(state)], 0.02)
            contact.accept()
            assert report.contacts > 5
            taken += report.rounds
        rounds.append(taken)
    assert rounds[1] == pytest.approx(rounds[0], rel=0.05)


def test_forces_that_are_solved_together_are_those_that_rounds_alone_find(monkeypatch):
    """Two feathers that one another's blow presses, in steps that go on from its forces."""
    found = []
    for room in (0, run_module._MOST_TOGETHER):
        monkeypatch.setattr(run_module, "_MOST_TOGETHER", room)
        places = [[0.004 * f, 0.003 * f, 4e-4 * f] for f in range(2)]
        model, state = free_feathers("body_contour", places, rows=12, columns=4, coefficients=1)
        state.velocity.nodes[-1, ..., 2] = -0.5
        contact = solver_of(model, [(0, 1), (1, 0)], [-1, 1], rounds=200, tolerance=1e-8)
        for _ in range(4):
            (state,), _, _ = contact.interval([state], [no_loads(2)], [hold_roots(state)], 3e-4)
            contact.accept()
        found.append(state.points.nodes)
    assert 0.0 < np.abs(found[1] - found[0]).max() < 1e-7
