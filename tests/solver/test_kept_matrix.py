"""Newton with a matrix that is kept: its correction, and how far a step is from the solution."""

from __future__ import annotations

import numpy as np
import pytest
from trial_batches import at_origin, preset_batch

from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import RootPath, Settings, Solver, hold_roots
from featherfx.solver.step.banded_kernels import (
    begin_pair,
    end_pair,
    factorise,
    solve_corrected,
    store_step,
)
from featherfx.solver.types import MAX_SECANT_PAIRS, panel_shape

UNLIMITED = 1e30


def spd(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + size * np.eye(size)


def full_band(matrix):
    """band[j, d] = A[j + d, j], as wide as the matrix."""
    size = len(matrix)
    band = np.zeros((size, size))
    for j in range(size):
        band[j, : size - j] = matrix[j:, j]
    return band


@pytest.mark.parametrize("count", [0, 1, 3])
def test_the_corrected_solution_is_that_of_bfgs(count):
    """H+ = (1 - r s y^T) H (1 - r y s^T) + r s s^T, r = 1 / s.y, pair by pair from A^-1."""
    rng, size = np.random.default_rng(count), 9
    before, true = spd(rng, size), spd(rng, size)
    secants, inverse = np.zeros((MAX_SECANT_PAIRS, 3, size)), np.linalg.inv(before)
    for pair in range(count):
        step, right = rng.normal(size=(2, size))
        change = true @ step
        begin_pair(pair, right, secants)
        store_step(pair, step, secants)
        assert end_pair(pair, right - change, secants)
        share = 1.0 / (step @ change)
        left = np.eye(size) - share * np.outer(step, change)
        inverse = left @ inverse @ left.T + share * np.outer(step, step)
    band = full_band(before)
    assert factorise(band, np.zeros(panel_shape(size)))
    right = rng.normal(size=size)
    x = right.copy()
    solve_corrected(band, count, secants, x)
    assert x == pytest.approx(inverse @ right, rel=1e-10)
    if count:
        solve_corrected(band, count, secants, change)
        assert change == pytest.approx(step, rel=1e-10)


def test_a_step_along_which_the_energy_bends_down_is_refused():
    secants, step, right = np.zeros((MAX_SECANT_PAIRS, 3, 4)), np.ones(4), np.ones(4)
    begin_pair(0, right, secants)
    store_step(0, step, secants)
    assert not end_pair(0, 2.0 * right, secants)


def swung(state, start, step):
    """Roots on a swing of 5 cm at 3 Hz that starts smoothly."""
    samples = np.zeros((len(state.rotation), 5, 6))
    times = np.linspace(start, start + step, 5)
    samples[:, :, 2] = 0.05 * (1.0 - np.cos(6.0 * np.pi * times))
    return RootPath(samples, hold_roots(state).base)


@pytest.mark.parametrize("rate", [48, 192])
def test_a_step_ends_within_the_tolerance_of_its_solution_with_fewer_matrices(rate):
    """Every step is solved from the same state to 1e-6 m and to 1e-10 m."""
    _, model = preset_batch("swan_primary", rows=11, columns=4, coefficients=2)
    state, loads = at_origin(model), no_loads(1, (0.0, 0.0, -9.81))
    loose = Solver(model, Settings(UNLIMITED, newton=1e-6, max_substeps=1))
    tight = Solver(model, Settings(UNLIMITED, newton=1e-10, max_substeps=1))
    iterations = matrices = 0
    for index in range(rate // 4):
        path = swung(state, index / rate, 1.0 / rate)
        near, report = loose.step(state, loads, path, 1.0 / rate)
        state, exact = tight.step(state, loads, path, 1.0 / rate)
        assert (report.status[0], exact.status[0]) == (0, 0)
        assert np.abs(near.points.nodes - state.points.nodes).max() < 1e-6
        assert report.move[0] < 1e-6
        iterations, matrices = iterations + report.iterations[0], matrices + report.matrices[0]
    assert matrices < 0.7 * iterations


def test_loose_steps_err_no_more_and_are_mostly_solved_once():
    """Steps that Newton leaves at a tenth of their tolerance, by how the step before converged,
    beside steps that are solved to the end, and both beside much shorter ones."""
    _, model = preset_batch("swan_primary", rows=11, columns=4, coefficients=2)
    start, loads, frame = at_origin(model), no_loads(1, (0.0, 0.0, -9.81)), 1.0 / 24.0
    found, spent = {}, {}
    for name, tolerance, newton in (
        ("loose", 1e-4, 1e-5),
        ("tight", 1e-4, 1e-9),
        ("short", 1e-6, 1e-8),
    ):
        solver = Solver(model, Settings(tolerance, newton=newton, spectral_radius=0.5))
        state, sums = start, np.zeros(4)
        for index in range(6):
            path = swung(state, index * frame, frame)
            state, report = solver.step(state, loads, path, frame)
            assert report.status[0] == 0
            assert report.error[0] <= tolerance
            counts = report.steps, report.iterations, report.matrices, report.rejected
            sums += [each[0] for each in counts]
        found[name], spent[name] = state.points.nodes, sums
    left, missed = (
        np.abs(found[one] - found[other]).max()
        for one, other in (("loose", "tight"), ("tight", "short"))
    )
    assert left < 0.5 * missed
    steps, iterations, matrices, rejected = spent["loose"]
    assert iterations < 0.75 * spent["tight"][1]
    assert rejected < 0.12 * steps
    assert matrices < 0.7 * (steps + rejected)


def test_a_matrix_serves_on_while_a_feather_turns():
    """A root that turns ever faster, by 0.9 rad in the last frame: matrices turn with the rows."""
    _, model = preset_batch("swan_primary", rows=11, columns=4, coefficients=2)
    loads, frame = no_loads(1), 1.0 / 24.0
    solver = Solver(model, Settings(1e-4, newton=1e-5, spectral_radius=0.5))
    state, sums = at_origin(model), np.zeros(3)
    for index in range(5):
        samples = np.zeros((1, 9, 6))
        samples[0, :, 5] = 0.1 * (np.linspace(index, index + 1.0, 9) ** 2 - index**2)
        path = RootPath(samples, state.rotation[:, 0].copy())
        state, report = solver.step(state, loads, path, frame)
        assert report.status[0] == 0
        if index >= 2:
            counts = report.steps, report.matrices, report.rejected
            sums += [each[0] for each in counts]
    steps, matrices, rejected = sums
    assert matrices < 0.5 * (steps + rejected)
