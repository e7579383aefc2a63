"""A feather that is left alone: what counts as that, and that its energy does not grow."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from drawn_cases import crumple
from test_integrator import Oscillator
from trial_batches import at_origin, preset_batch, rod

from featherfx.feather.types import RowPoints, both
from featherfx.lab.ribbons.rod import total_energy
from featherfx.mechanics.model import expand_wind, no_loads
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.state import hold_roots, rest_state
from featherfx.solver.step.energy_kernels import (
    EnergyBound,
    is_isolated,
    slow_down,
    solved_energy,
    stored_sums,
)

STILL = (0.0, 0.0, 0.0)


@pytest.mark.verification
@pytest.mark.parametrize("radius", [0.0, 0.3, 0.5, 0.8, 0.9])
@pytest.mark.parametrize("phase", [0.05, 0.3, 1.0, 3.0, 30.0])
def test_energy_with_the_held_part_never_grows_and_bounds_the_plain_one(radius, phase):
    """T + U + 1/2 s^2 h^2 a^2 + 1/4 (a - w)^2 / frequency^2, s = (1 - r) / (2 (1 + r)), of a linear
    oscillator of unit mass; what T + U regains in a step is within held_energy."""
    frequency = 3.0
    trial = Oscillator(frequency, radius)
    h = phase / frequency
    s = 0.5 * (1 - radius) / (1 + radius)
    mass = np.ones((1, 1))

    def whole():
        a, w = trial.motion.smoothed[0, 0, 0], trial.motion.acceleration[0, 0, 0]
        return trial.energy + 0.5 * (s * h * a) ** 2 + 0.25 * ((a - w) / frequency) ** 2

    first = whole()
    for _ in range(60):
        before, plain = whole(), trial.energy
        square, lag = stored_sums(mass, STILL, trial.motion)
        held = 0.125 * h * h * square + 0.25 * h * abs(lag)
        trial.step(h)
        assert whole() <= before + 1e-12 * first
        assert trial.energy <= plain + held + 1e-12 * first


def path_of(state, places=None, turn=0.0):
    samples = hold_roots(state).samples if places is None else np.zeros((1, len(places), 6))
    if places is not None:
        samples[0, :, :3] = places
    samples[0, -1, 3] += turn
    return samples[0]


def alone(path, **changes):
    model = rod(4)
    loads = expand_wind(no_loads(1)._replace(**changes), 1)
    return is_isolated(model, loads, 0, path, 0.5)


def test_what_counts_as_left_alone():
    state = at_origin(rod(4))
    still = path_of(state)
    air = np.array([1.2, 1.2, 0.02, 1.1])
    grip = {"grip_node": np.array([[[3, 0]]]), "grip_stiffness": np.ones((1, 1))}
    start, end = np.zeros((1, 1, 3)), np.ones((1, 1, 3))
    even = path_of(state, np.outer([0.0, 0.5, 1.0], [2.0, 0.0, 1.0]))
    assert alone(still) == (True, STILL)
    assert alone(still, air=air)[0]
    assert not alone(still, air=air, wind_mean=np.array([1.0, 0.0, 0.0]))[0]
    assert alone(still, grip_start=start, grip_end=start, **grip)[0]
    assert not alone(still, grip_start=start, grip_end=end, **grip)[0]
    assert not alone(path_of(state, turn=0.1))[0]
    assert alone(even) == (True, (4.0, 0.0, 2.0))
    assert not alone(even, air=air)[0]
    assert not alone(even, grip_start=start, grip_end=start, **grip)[0]
    assert not alone(path_of(state, np.outer([0.0, 0.4, 1.0], [2.0, 0.0, 1.0])))[0]
    assert not is_isolated(
        rod(4)._replace(held=np.zeros(1, dtype=np.bool_)),
        expand_wind(no_loads(1), 1),
        0,
        still,
        0.5,
    )[0]


def test_velocities_are_cut_to_the_energy_there_was_or_the_step_fails():
    model, work = rod(4), make_scratch(rod(4))
    state, loads = at_origin(model), expand_wind(no_loads(1), 1)
    work.now.points.assign(state.points.at(0))
    work.around.past.assign(state.points.at(0))
    work.around.past.nodes[1:, 0, 2] -= 0.1
    kinetic = 0.5 * 100.0 * 0.01 * model.mass[0, 1:, 0].sum()

    def kept(energy):
        promise = EnergyBound(True, STILL, 0.0, energy, np.inf)
        return solved_energy(model, loads, 0, promise, 0.0, 10.0, work)

    assert kept(kinetic) == pytest.approx((1.0, kinetic))
    assert kept(0.25 * kinetic) == pytest.approx((0.5, 0.25 * kinetic), rel=1e-6)
    assert kept(-1e-3 * kinetic)[0] == -1.0


def test_velocities_are_slowed_in_the_frame_of_the_root():
    velocity = RowPoints(np.full((2, 3, 3), 3.0), np.full((2, 2, 3), 3.0))
    slow_down(0.5, (1.0, 0.0, 0.0), velocity)
    assert (velocity.nodes[:, :, 0] == 2.0).all()
    assert (velocity.directors[:, :, 0] == 1.5).all()


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("drift", [0.0, 20.0])
def test_a_crumpled_feather_unfolds_without_gaining_energy(seed, drift):
    """Steps far longer than its vibrations; its root stands still, or moves evenly with it."""
    _, model = preset_batch("swan_primary")
    state = at_origin(model)
    crumple(model, state, np.random.default_rng(seed), 0.3)
    state.velocity.nodes[0, :, :, 0] = drift
    loads, frame = no_loads(1, (0.0, 0.0, -9.81)), 1e-3
    energies = []

    def energy():
        own = state.copy()
        own.velocity.nodes[0, :, :, 0] -= drift
        return total_energy(model, loads, own)

    with Solver(model, Settings(tolerance=1e-5, max_substeps=1)) as solver:
        for _ in range(12):
            energies.append(energy())
            path = hold_roots(state)
            path.samples[0, -1, 0] += drift * frame
            state, report = solver.step(state, loads, path, frame)
            assert report.status[0] == 0
    assert energies[-1] < 0.9 * energies[0]
    assert np.diff(energies).max() <= 1e-7 * energies[0]


def test_a_pose_out_of_balance_is_not_thrown_at_its_first_step():
    """With damping of seconds a bent rod creeps back. The first acceleration has to know that: else
    the first step would turn into motion what only heats the material."""
    model = rod(9)._replace(retardation=np.array([[10.0, 0.0]]))
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    crumple(model, state, np.random.default_rng(1), 0.1)
    before = total_energy(model, no_loads(1), state)
    new, report = Solver(model, Settings()).step(state, no_loads(1), hold_roots(state), 1e-3)
    assert report.steps[0] == 1
    kinetic = 0.5 * np.einsum("np,npk->", model.mass[0], new.velocity.nodes[0] ** 2)
    turning = np.einsum("np,npk->", model.rotary_inertia[0], new.velocity.directors[0] ** 2)
    kinetic += 0.5 * turning
    assert kinetic < 1e-3 * before
    assert total_energy(model, no_loads(1), new) < before


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_a_feather_taken_up_in_even_flight_with_its_root_stays_as_it_is(speed):
    """Its first acceleration is none: the root is where its path leads, not held back."""
    _, model = preset_batch("swan_primary")
    state, rest = at_origin(model), at_origin(model).points.at(0)
    state.velocity.nodes[0, :, :, 0] = speed
    with Solver(model, Settings(spectral_radius=0.5)) as solver:
        for _ in range(3):
            path = hold_roots(state)
            path.samples[0, -1, 0] += speed / 24.0
            state, report = solver.step(state, no_loads(1), path, 1.0 / 24.0)
            assert (report.steps[0], report.failed[0]) == (1, 0)
    moved = rest.shifted(np.array([3.0 * speed / 24.0, 0.0, 0.0]))
    both(partial(np.testing.assert_allclose, atol=1e-12 * speed), state.points.at(0), moved)
