"""What the first frame finds: feathers in balance, and fluttering ones in motion."""

from __future__ import annotations

import warnings
from functools import partial

import numpy as np
import pytest
from trial_batches import at_origin, preset_batch

from featherfx.errors import SimulationError
from featherfx.mechanics.model import Loads, no_loads
from featherfx.shot.loop.free_group import _in_motion, settled, standing
from featherfx.solver.solver import (
    MAX_FRAME_ITERATIONS,
    Settings,
    Solver,
    hold_roots,
    limit_iterations,
)
from featherfx.solver.types import NO_REST

AIR = np.array([1.2, 1.2, 0.02, 1.1])
# across the vane; a swan primary finds no rest in the second
BREEZE, STORM = (0.0, 0.0, 3.0), (0.0, 0.0, 20.0)


def in_wind(*speed: float) -> Loads:
    return no_loads(2, (0.0, 0.0, -9.81))._replace(air=AIR, wind_mean=np.array(speed))


@pytest.fixture
def solver():
    _, model = preset_batch("swan_primary", count=2)
    with Solver(model, Settings(tolerance=1e-3, spectral_radius=0.5)) as solver:
        yield solver


def tips(solver, state, loads, frames):
    found = []
    for _ in range(frames):
        state, report = solver.step(state, loads, hold_roots(state), 1.0 / 24.0)
        assert not report.status.any()
        found.append(state.points.nodes[0, -1, 0].copy())
    return np.array(found)


def test_in_a_breeze_feathers_start_at_rest(solver):
    state, _, fluttering = settled(solver, at_origin(solver.model), in_wind(*BREEZE), ["a", "b"])
    assert not any(rate.any() for rate in state.rates())
    assert not state.time.any()
    assert not len(fluttering)


@pytest.mark.slow
def test_where_there_is_no_rest_feathers_start_in_motion_and_without_a_warning(solver):
    loads, start = in_wind(*STORM), at_origin(solver.model)
    start.time[:] = 7.0
    _, status, _ = solver.equilibrium(start, loads)
    assert (status == NO_REST).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state, _, fluttering = settled(solver, start, loads, ["a", "b"])
    assert fluttering.tolist() == [0, 1]
    assert (state.time == 7.0).all()
    assert np.abs(state.velocity.nodes[:, :, 1:]).max() > 1e-2
    assert not any(rate.any() for rate in start.rates())
    # the motion goes on as it is: no first frame is thrown out of what follows
    after = tips(solver, state, loads, 24)
    middle = 0.5 * (after.max(axis=0) + after.min(axis=0))
    reach = np.linalg.norm(after - middle, axis=1).max()
    assert np.linalg.norm(state.points.nodes[0, -1, 0] - middle) < 2.0 * reach


def test_a_small_feather_flutters_through_its_own_time(monkeypatch):
    """Of 18 mm in 80 m/s: 100 L/U are about 20 ms; half a second is halved until it is less."""
    _, model = preset_batch("down", count=2)
    lengths, stepped = model.length.sum(axis=1), []

    def step(solver, state, loads, path, duration, members):
        stepped.append(duration)
        return Solver.step(solver, state, loads, path, duration / 100.0, members)

    with Solver(model, Settings(tolerance=1e-3, spectral_radius=0.5)) as solver:
        state = at_origin(model)
        monkeypatch.setattr(solver, "step", partial(step, solver))
        _in_motion(solver, state, in_wind(0.0, 0.0, 80.0), ["a", "b"], np.arange(2))
    assert 0.5 < sum(stepped) / (100.0 * lengths[0] / 80.0) <= 1.0


def test_a_bake_bounds_the_work_of_a_frame_by_what_an_iteration_costs():
    few, more, most = (limit_iterations(unknowns) for unknowns in (1, 120, 2000))
    assert few == MAX_FRAME_ITERATIONS
    assert few > more > most


def test_gusts_that_stand_are_those_of_their_time_at_any_other():
    def gust(loads, time):
        angle = place @ loads.wind_wave - loads.wind_rate * time + loads.wind_phase
        return loads.wind_amplitude @ np.cos(angle)

    random, place, time = np.random.default_rng(2), np.array([0.3, -0.1, 0.2]), 1.7
    loads = in_wind(*BREEZE)._replace(
        wind_wave=random.normal(size=(3, 4)),
        wind_rate=random.normal(size=4),
        wind_phase=random.normal(size=4),
        wind_amplitude=random.normal(size=(3, 4)),
    )
    still = standing(loads, time)
    assert not np.allclose(gust(loads, 0.0), gust(loads, time))
    for other in (0.0, time, 5.0):
        assert gust(still, other) == pytest.approx(gust(loads, time), abs=1e-12)


def test_only_chosen_feathers_are_touched(solver):
    start = at_origin(solver.model)
    state = settled(solver, start, in_wind(*STORM), ["a", "b"], [1]).state
    np.testing.assert_array_equal(state.points.nodes[0], start.points.nodes[0])
    assert np.abs(state.points.nodes[1] - start.points.nodes[1]).max() > 1e-3


def test_one_that_cannot_be_solved_is_named(solver):
    loads, start = in_wind(*STORM), at_origin(solver.model)
    hurried = Solver(solver.model, Settings(tolerance=1e-3, spectral_radius=0.5, max_iterations=2))
    with pytest.raises(SimulationError, match=r"'?a'?.*Newton iterations"):
        settled(hurried, start, loads, ["a", "b"])
