"""Feathers against feathers: momentum, energy, order, speed."""

from __future__ import annotations

import numpy as np
import pytest
from contact_cases import crossings, free_feathers, momentum, run, solver_of

from featherfx.solver.integrator_kernels import integrator_coefficients

GRID = {"rows": 11, "columns": 4}
PAIR = [(0, 1), (1, 0)]
ORDERED, UNORDERED = [-1, 1], [0, 0]


def closing(speed, height=0.012):
    """Two feathers, the second above the first and coming down at a speed (m/s)."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], [0.02, 0.01, height]], **GRID)
    state.velocity[1, :, [0, *range(3, state.points.shape[2])], 2] -= speed
    return model, state


def surfaces(model, state):
    """(points, triangles) of the vanes, from the model's cells."""
    m, found = model.columns, []
    for f in range(model.feathers):
        points = state.points[f]
        triangles = []
        for side, i, j, half in np.argwhere(model.cell_stiffness[f, ..., 0] != 0.0):
            near = 0 if j == 0 else 2 + side * m + j
            far = 3 + side * m + j
            corners = [(i, near), (i, far), (i + 1, near)]
            if half == 1:
                corners = [(i, far), (i + 1, far), (i + 1, near)]
            triangles.append([row * points.shape[1] + p for row, p in corners])
        found.append((points.reshape(-1, 3), np.array(triangles)))
    return found


def kinetic(model, state):
    return 0.5 * np.einsum("fnp,fnpk,fnpk->", model.mass, state.velocity, state.velocity)


@pytest.mark.verification
@pytest.mark.parametrize("order", [ORDERED, UNORDERED])
def test_a_collision_in_flight_keeps_momentum_and_makes_no_energy(order):
    model, state = closing(5.0)
    contact = solver_of(model, PAIR, order, rounds=60, tolerance=1e-7, friction=0.3)
    before, energy = momentum(model, state), kinetic(model, state)
    most = 0
    for _state, report in run(contact, state, 2e-4, 25):
        most = max(most, report.contacts)
        assert kinetic(model, _state) <= energy * (1.0 + 1e-6)
    assert most > 5
    change = np.linalg.norm(momentum(model, _state) - before)
    assert change < 1e-4 * np.linalg.norm(before)
    # the struck feather has taken on a part of it
    assert momentum(model, _state)[2] < 0.0
    assert _state.velocity[0, :, 0, 2].mean() < -0.2


@pytest.mark.parametrize("order", [ORDERED, UNORDERED])
@pytest.mark.parametrize("step", [1e-4, 5e-4])
def test_nothing_passes_at_fifty_metres_a_second(order, step):
    """The feathers close by up to 25 mm, 200 thicknesses, in a step, and do not pass."""
    model, state = closing(50.0)
    contact = solver_of(model, PAIR, order, rounds=30)
    first, second = surfaces(model, state)
    assert crossings(first, second) + crossings(second, first) == 0
    for _state, _report in run(contact, state, step, int(1.5e-3 / step)):
        centre = _state.points[:, :, 0, 2].mean(axis=1)
        assert centre[1] > centre[0]
        first, second = surfaces(model, _state)
        assert crossings(first, second) + crossings(second, first) == 0
    # without contact the second would be 60 mm below the first
    assert _state.velocity[0, :, 0, 2].mean() < -5.0


def test_both_sides_of_every_contact_feel_the_same_force():
    model, state = closing(2.0, height=0.009)
    contact = solver_of(model, PAIR, ORDERED, rounds=60, tolerance=1e-7)
    compared = 0
    for _ in run(contact, state, 3e-4, 10):
        value = contact._touch.value[: contact._count]
        guest, host = value[:, 4], value[:, 5]
        closed = np.maximum(guest, host) > 0.0
        compared += int(closed.sum())
        stiffness = np.maximum(value[:, 6], value[:, 7])
        assert np.all(np.abs(guest - host) <= 1e-7 * stiffness)
        # and where there is a force there is no gap
        assert np.all(np.abs(value[closed, 1]) <= 2e-7 + np.abs(guest - host)[closed])
    assert compared > 20


def test_feathers_apart_are_stepped_as_if_there_were_no_contact():
    """Bit by bit, and with one solve each."""
    model, state = closing(1.0, height=0.2)
    alone = solver_of(model)
    touching = solver_of(model, PAIR, ORDERED)
    for (a, first), (b, second) in zip(
        run(alone, state, 1e-3, 5), run(touching, state, 1e-3, 5), strict=True
    ):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        assert first.solves == second.solves == 2
        assert second.contacts == 0


def test_a_feather_that_slipped_through_comes_back_at_the_recovery_speed():
    """Starts 3 mm on the wrong side; the order brings it back, without a kick."""
    model, state = free_feathers("swan_primary", [[0, 0, 0], [0.0, 0.0, -0.003]], **GRID)
    contact = solver_of(model, PAIR, ORDERED, rounds=30, recovery=0.1)
    heights, step = [], 2e-3
    for new, report in run(contact, state, step, 25):
        heights.append(float((new.points[1, :, 0, 2] - new.points[0, :, 0, 2]).mean()))
        assert np.abs(new.velocity[:, :, 0]).max() < 1.0
    rates = np.diff(heights[:8]) / step
    assert rates == pytest.approx(np.full(7, 0.1), rel=0.5)
    assert heights[-1] > 0.0


def test_the_steps_estimate_of_inertia_is_the_integrators():
    """The rounds' stiffness relies on inertia = 2 / h^2 at radius 0."""
    assert integrator_coefficients(0.0, 0.1)[0] == pytest.approx(2.0 / 0.1**2)
