"""What Newton does where its step is too long, and what a try counts for."""

from __future__ import annotations

from functools import partial
from math import inf, nan, pi

import numpy as np
import pytest
from trial_batches import at_origin, preset_batch

from featherfx.mechanics.model import expand_wind, no_loads
from featherfx.solver.scratch import make_scratch
from featherfx.solver.step.energy_kernels import EnergyBound
from featherfx.solver.step.newton_kernels import (
    MAX_SHIFT,
    STABILISED,
    STABILISED_ONLY,
    UNKNOWN_CONVERGENCE,
    NewtonResult,
    _nearer,
    _search,
    _stiffer,
    accept_nearly_solved,
)
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.step.step_control_kernels import (
    MIN_ATTEMPTS_LEFT,
    MIN_STEP_RATIO,
    TAKEN,
    Attempt,
    Outcome,
    attempt_work,
    judge_attempt,
    min_step_length,
    next_step,
)
from featherfx.solver.types import CONVERGED, NOT_CONVERGED, IntegratorFactors, StepSettings

nearer, stiffer = _nearer.py_func, _stiffer.py_func


def test_after_a_step_that_leads_upwards_the_minimum_of_the_parabola_is_tried():
    """E = -2 x + c x^2 has its minimum at 1 / c; half to a tenth of x = 1 is tried."""
    for bend, expected in ((4.0, 0.25), (2.5, 0.4), (100.0, 0.1), (1.2, 0.5)):
        assert nearer(1.0, -2.0 + bend, -2.0) == pytest.approx(expected)
    # from half of the way the same minimum
    assert nearer(0.5, -2.0 * 0.5 + 6.0 * 0.25, -2.0) == pytest.approx(1.0 / 6.0)


def test_what_is_not_finite_and_a_slope_that_is_not_known_halve():
    assert nearer(1.0, nan, -2.0) == nearer(1.0, inf, -2.0) == nearer(1.0, 3.0, 0.0) == 0.5


def test_no_increment_turns_a_barbs_joint_by_more_than_half_a_turn():
    """Along increments that cost no energy, since nothing has mass or stiffness."""
    _, model = preset_batch("swan_primary", rows=5, columns=3)
    model = model._replace(
        **{name: 0.0 * array for name, array in model._asdict().items() if "stiffness" in name},
        mass=0.0 * model.mass,
        rotary_inertia=0.0 * model.rotary_inertia,
    )
    work, loads = make_scratch(model), expand_wind(no_loads(1), 1)
    load_pose(model, 0, at_origin(model), work.now)
    work.around.target.assign(work.now.points)
    step, count = work.system.right, model.coefficients
    step[:] = 0.0
    barbs = step.reshape(model.rows, -1)[:, 6:].reshape(model.rows, 4, count)
    barbs[2, 3] = 40.0

    def taken(scale):
        barbs[2, 3] *= scale
        level, factors = (0.0, 0.0), IntegratorFactors(0.0, 0.0, 0.0)
        return _search(model, loads, 0, 0.0, factors, level, 0.0, work)[2]

    part = taken(1.0)
    turns = part * model.shapes.T @ barbs[2, 3]
    assert 0.5 * pi < np.abs(turns).max() <= pi
    assert np.abs(work.trial.coefficient[1, 2, count:]).max() == pytest.approx(part * 40.0)
    assert taken(0.5 * part) == 1.0


def test_what_is_asked_for_gets_stiffer_until_it_is_given_up():
    assert stiffer(0.0, True) == STABILISED_ONLY
    shift, asked = stiffer(0.0, False), 0
    assert shift == stiffer(STABILISED, True) > 0.0
    while shift <= MAX_SHIFT:
        shift, asked = stiffer(shift, False), asked + 1
    assert asked < 5


def test_a_try_without_a_full_step_is_not_near_its_solution():
    near = accept_nearly_solved.py_func

    def after(move):
        return near(NewtonResult(NOT_CONVERGED, 32, 20, move, UNKNOWN_CONVERGENCE), 1e-3, 0.0)

    assert after(inf) == NOT_CONVERGED
    assert after(2e-5) == NOT_CONVERGED
    assert after(0.9e-5) == CONVERGED


def outcome(iterations, matrices):
    others = dict.fromkeys(Outcome._fields[3:], 0.0)
    return Outcome(CONVERGED, iterations, matrices, **others)


def test_an_iteration_with_a_matrix_at_hand_counts_as_a_quarter():
    assert attempt_work.py_func(outcome(32, 32)) == 32
    assert attempt_work.py_func(outcome(32, 8)) == 14
    assert attempt_work.py_func(outcome(1, 0)) == 1


def test_steps_that_are_dear_get_fewer():
    """Easy ones may be as short as their errors ask until three quarters of the work are spent."""
    settings = StepSettings(1.0, 1.0 / 4096.0, 0.0, 1e-4, 1e-2, 1e-6, 32, 12, 20_000, 0.0)
    shortest = partial(min_step_length.py_func, settings, 0.5)
    free = MIN_STEP_RATIO * settings.shortest
    assert shortest(400, 10_000, 7.0) == free
    assert shortest(400, 9_999, 7.0) == pytest.approx(0.5 * 2.0 * 10_001 / 400 / 9_999)
    assert shortest(2000, 5_000, 6.0) == free
    assert shortest(2000, 4_999, 6.0) == pytest.approx(0.5 * 2.0 * 15_001 / 2000 / 4_999)
    assert shortest(2047, 8_000, 6.0) == free
    assert shortest(2048, 8_000, 6.0) == pytest.approx(0.5 * 12.0 / 8_000)
    # of little work more is left for the end
    hurried = partial(min_step_length.py_func, settings._replace(most_iterations=1_200), 0.5)
    kept = MIN_ATTEMPTS_LEFT * settings.iterations
    assert hurried(10, kept, 6.0) == free
    assert hurried(10, kept - 1, 6.0) > free


def test_a_step_as_short_as_it_may_be_is_not_rejected_for_its_error():
    """Steps that are evenly divided are a little longer than was wanted."""
    settings = StepSettings(1.0, 1.0 / 4096.0, 0.0, 1e-4, 1e-2, 1e-6, 32, 12, 20_000, 1.0)
    floor = min_step_length.py_func(settings, 0.0, 0, 20_000, 0.0)
    step, fraction = next_step.py_func(floor, 0.0, 1.0)
    assert floor < step
    promise = EnergyBound(False, (0.0, 0.0, 0.0), 0.0, 0.0, inf)
    tried = Attempt(step, floor, fraction, 2, 0.0, 32, promise, UNKNOWN_CONVERGENCE, 0.0, 0.0, 0)
    erring = outcome(2, 2)._replace(error=5e-4, excess=5e-4)
    verdict, _, _ = judge_attempt.py_func(floor, 0, tried, erring, settings)
    assert verdict == TAKEN
