"""Obstacles give way to nothing: springs near roots, and what pinches."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import THICKNESS, free_feathers, solver_of

from featherfx.mechanics.model import no_loads
from featherfx.solver.contact.surfaces import NEAR_ROOT, elastic_stiffness
from featherfx.solver.contact.types import IntervalOptions, LedMotion
from featherfx.solver.state import hold_roots

STEP, TOLERANCE = 1.0 / 48.0, 0.1 * THICKNESS
# guest and host: what is between with those that are led
PAIRS = [(1, 0), (1, 2)]


def pressed(rises, fixed=True, steps=1, still=0):
    """A contour feather whose root is held, the shaft's first node off it between the flat tips of
    two that are led, 0.3 mm beneath it and above; these rise by so much (m) in so many steps, and
    stand still in others. fixed: whether they are obstacles. Yields each step's report and
    contacts."""
    model, state = free_feathers("body_contour", np.zeros((3, 3)), rows=11, columns=4)
    model.held[:] = True
    contact = solver_of(model, PAIRS, [1, -1], tolerance=TOLERANCE, friction=0.0)
    start = state.points.nodes.copy()
    level = start[1, 1, 0, 2]
    for body, apart in ((0, -3e-4), (2, 3e-4)):
        start[body, ..., 0] += start[1, 1, 0, 0] - start[body, -2, 0, 0]
        start[body, ..., 2] = level + apart
    way = np.zeros_like(start)
    way[0, ..., 2], way[2, ..., 2] = rises
    free = np.array([False, True, False])
    for k in range(steps + still):
        begin, end = (start + way * min(1.0, at / steps) for at in (k, k + 1))
        led = LedMotion(free, begin, end, ~free if fixed else np.zeros_like(free))
        (state,), _, report = contact.interval(
            [state],
            [no_loads(3)],
            [hold_roots(state)],
            STEP / steps,
            manner=IntervalOptions(led=led),
        )
        yield report, contact.found.contacts
        contact.accept()


@pytest.mark.parametrize(("fixed", "rounds"), [(True, 15), (False, 20)])
def test_a_shaft_is_pressed_off_near_its_root_in_few_rounds(fixed, rounds):
    """By obstacles: with the spring of a node farther out it takes 26 rounds. By what is led for an
    interval: with springs alone it is off by three times the tolerance after as many."""
    ((report, contacts),) = pressed((3e-4, 0.0), fixed)
    forces = contacts["guest_force"]
    assert forces.max() > 0.05
    assert report.residual < TOLERANCE
    assert report.rounds <= rounds


def test_what_pinches_a_feather_shares_the_depth_that_has_no_room():
    """Both rise by 0.25 mm into 0.18 mm of room, so 0.07 mm are left on either side."""
    ((report, contacts),) = pressed((2.5e-4, -2.5e-4))
    depth = contacts["spared"] - contacts["gap"]
    assert report.residual < TOLERANCE
    for host in (0, 2):
        assert 5e-5 < depth[contacts["host"] == host].max() < 9e-5


@pytest.mark.parametrize("steps", [1, 8, 32])
def test_what_pinches_for_a_span_presses_no_harder_from_step_to_step(steps):
    """Any forces that balance each other hold a feather between two that are led: those solved
    together were 34 kN after one step, and depth that each step took back made others grow."""
    found = [*pressed((2.5e-4, -2.5e-4), False, steps, still=8)]
    forces = [contacts["guest_force"].max(initial=0.0) for _, contacts in found]
    assert max(forces) < 0.2
    assert forces[-1] < 1.01 * forces[steps]
    assert found[-1][0].residual < TOLERANCE


def test_only_a_root_that_is_held_makes_a_shaft_stiffer_near_it():
    model, _ = free_feathers("body_contour", np.zeros((2, 3)), rows=11, columns=4)
    model.held[0] = True
    soft, firm = elastic_stiffness(model), elastic_stiffness(model, 0.5 * NEAR_ROOT)
    assert firm[0, 1, 0] == pytest.approx(8.0 * soft[0, 1, 0])
    assert np.array_equal(firm[0, 5:], soft[0, 5:])
    assert np.array_equal(firm[1], soft[1])
