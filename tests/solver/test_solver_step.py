"""Steps of whole batches: rest, violence, failure, determinism."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from trial_batches import FEATHER_PRESETS, at_origin, preset_batch, preset_kind, random_pose

from featherfx.errors import SimulationError
from featherfx.feather.types import barb_slice
from featherfx.mechanics.model import no_loads
from featherfx.solver.damping import with_damping
from featherfx.solver.solver import (
    FEATHERS_PER_PIECE,
    RootPath,
    Settings,
    Solver,
    divide_feathers,
    hold_roots,
    raise_if_failed,
)
from featherfx.solver.types import CONVERGED, NOT_CONVERGED, NOT_DEFINITE, NOT_FINITE

FRAME = 1.0 / 24.0
EARTH = (0.0, 0.0, -9.81)
SMALL = {"rows": 9, "columns": 4, "coefficients": 2}
SETTINGS = Settings(tolerance=1e-3, newton=1e-6)


def swung(state, start, amplitude=0.1, frequency=3.0, axis=2, smooth=False):
    """The path of roots that swing, from a jolt or smoothly, for a frame from a given time on."""
    path = hold_roots(state)
    times = np.linspace(start, start + FRAME, 5)
    samples = np.zeros((len(state.rotation), 5, 6))
    phase = 2.0 * np.pi * frequency * times
    samples[:, :, axis] = amplitude * (1.0 - np.cos(phase) if smooth else np.sin(phase))
    return RootPath(samples, path.base)


def barb_stretch(model, points):
    """Largest relative change of length of any barb segment; points: (F, n, 1 + 2 m, 3)."""
    worst = 0.0
    for side in range(2):
        barb = points[:, :, barb_slice(side, model.columns)]
        nodes = np.concatenate([points[:, :, :1], barb], axis=2)
        length = np.linalg.norm(np.diff(nodes, axis=2), axis=3)
        rest = model.segment[:, side, :, None]
        present = np.broadcast_to(rest > 0.0, length.shape)
        change = np.abs(length - rest)[present] / np.broadcast_to(rest, length.shape)[present]
        worst = max(worst, float(change.max(initial=0.0)))
        assert np.abs(length[~present]).max(initial=0.0) < 1e-12
    return worst


def three():
    _, model = preset_batch("swan_primary", count=3, **SMALL)
    return model, at_origin(model)


@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_a_feather_without_loads_stays_at_rest(name):
    _, model = preset_batch(name, **SMALL)
    start = at_origin(model)
    state = start
    with Solver(model, SETTINGS) as solver:
        for _ in range(24):
            state, report = solver.step(state, no_loads(1), hold_roots(state), FRAME)
            assert not report.status.any()
    drift = np.linalg.norm(state.points.nodes - start.points.nodes, axis=-1).max()
    assert drift < 1e-9
    assert state.time[0] == pytest.approx(1.0)


def test_violent_motion_keeps_every_barb_segment_and_follows_the_root():
    _, model = preset_batch("swan_primary", **SMALL)
    state, moved = at_origin(model), 0.0
    with Solver(model, SETTINGS) as solver:
        for frame in range(12):
            before = state
            path = swung(state, frame * FRAME, amplitude=0.25)
            state, report = solver.step(state, no_loads(1, EARTH), path, FRAME)
            assert not report.status.any()
            assert np.isfinite(state.points.nodes).all()
            assert barb_stretch(model, state.points.nodes) < 1e-12
            assert state.centre[0, 0] == pytest.approx(path.samples[0, -1, :3], abs=1e-12)
            moved = max(moved, np.abs(state.points.nodes - before.points.nodes).max())
    assert moved > 0.1


def test_a_root_that_starts_at_full_speed_has_short_steps_for_a_moment():
    _, model = preset_batch("swan_primary", **SMALL)
    state = at_origin(model)
    samples = np.zeros((1, 5, 6))
    samples[0, :, 2] = np.linspace(0.0, FRAME, 5)
    path = hold_roots(state)._replace(samples=samples)
    with Solver(model, Settings(tolerance=1e-5, newton=1e-8)) as solver:
        _, free = solver.step(state, no_loads(1), path, FRAME)
    assert free.forced[0] == 0
    with Solver(model, Settings(tolerance=1e-5, newton=1e-8, max_substeps=16)) as solver:
        _, bounded = solver.step(state, no_loads(1), path, FRAME)
    assert bounded.status[0] == free.status[0] == 0
    # beyond the bound only steps whose error is above a part of the feather's length
    assert bounded.steps[0] < free.steps[0]
    assert bounded.forced[0] > 0


def test_the_input_state_is_never_modified():
    model, state = three()
    state = random_pose(model, np.random.default_rng(0), 0.02, 0.05)
    copies = {name: array.copy() for name, array in state.arrays().items()}
    path, loads = swung(state, 0.0), no_loads(3, EARTH)
    with Solver(model, SETTINGS) as solver:
        after, _ = solver.step(state, loads, path, FRAME)
        settled, _, _ = solver.equilibrium(state, loads)
    for name, array in state.arrays().items():
        assert array.tobytes() == copies[name].tobytes(), name
        for other in (after, settled):
            assert not np.shares_memory(other.arrays()[name], array), name


def test_jobs_do_not_change_a_byte():
    model, _ = three()
    results = []
    for jobs in (1, 2, 2):
        state = at_origin(model)
        with Solver(model, SETTINGS, jobs) as solver:
            for frame in range(3):
                path = swung(state, frame * FRAME)
                state, report = solver.step(state, no_loads(3, EARTH), path, FRAME)
        results.append(b"".join(a.tobytes() for a in (*state.arrays().values(), *report)))
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize(("count", "jobs"), [(1, 1), (3, 2), (1000, 1), (1000, 7)])
def test_threads_take_every_feather_once_and_several_at_a_time(count, jobs):
    found = divide_feathers(np.arange(count), jobs)
    assert np.concatenate(found).tolist() == list(range(count))
    assert len(found) >= min(count, jobs)
    assert max(map(len, found)) <= FEATHERS_PER_PIECE
    assert count < 1000 or len(found) < count / 10


def test_threads_are_no_more_than_feathers():
    _, model = preset_batch("covert", **(SMALL | {"count": 3}))
    before = threading.active_count()
    state = at_origin(model)
    with Solver(model, SETTINGS, jobs=100_000) as solver:
        solver.step(state, no_loads(3, EARTH), hold_roots(state), FRAME)
        assert threading.active_count() - before <= 3


def test_a_feather_does_not_depend_on_the_others_of_its_batch():
    model, _ = three()
    _, single = preset_batch("swan_primary", **SMALL)
    states = []
    for each in (model, single):
        state = at_origin(each)
        with Solver(each, SETTINGS) as solver:
            state, _ = solver.step(state, no_loads(each.feathers, EARTH), swung(state, 0.0), FRAME)
        states.append(state)
    assert states[0].points.nodes[2].tobytes() == states[1].points.nodes[0].tobytes()


def test_chosen_feathers_move_and_the_others_do_not():
    model, state = three()
    with Solver(model, SETTINGS) as solver:
        after, report = solver.step(
            state, no_loads(3, EARTH), hold_roots(state), FRAME, feathers=[2]
        )
    assert after.points.nodes[:2].tobytes() == state.points.nodes[:2].tobytes()
    assert not np.array_equal(after.points.nodes[2], state.points.nodes[2])
    assert report.steps.tolist()[:2] == [0.0, 0.0]
    assert report.steps[2] > 0
    assert after.time == pytest.approx([0.0, 0.0, FRAME])


def broken_loads():
    """Gravity on three feathers; the grip of the second one is nowhere."""
    nowhere = np.full((3, 1, 3), 0.1)
    nowhere[1] = np.nan
    node = np.full((3, 1, 2), -1)
    node[1, 0] = 4, 0
    return no_loads(3, EARTH)._replace(
        grip_node=node, grip_start=nowhere, grip_end=nowhere, grip_stiffness=np.full((3, 1), 10.0)
    )


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_feather_that_cannot_be_solved_does_not_stop_the_others(jobs):
    model, start = three()
    with Solver(model, SETTINGS, jobs) as solver:
        state, _ = solver.step(start, no_loads(3, EARTH), hold_roots(start), FRAME)
        after, report = solver.step(state, broken_loads(), hold_roots(state), FRAME)
        whole, _ = solver.step(state, no_loads(3, EARTH), hold_roots(state), FRAME)
    assert report.status.tolist() == [CONVERGED, NOT_FINITE, CONVERGED]
    for name, array in after.arrays().items():
        assert np.isfinite(array).all(), name
        assert array[1].tobytes() == state.arrays()[name][1].tobytes(), name
        for other in (0, 2):
            assert array[other].tobytes() == whole.arrays()[name][other].tobytes(), name


def test_a_failed_settling_is_told():
    model, state = three()
    with Solver(model, SETTINGS) as solver:
        settled, status, _ = solver.equilibrium(state, broken_loads())
    assert status[0] == status[2] == CONVERGED
    assert status[1] == NOT_FINITE
    for name, array in settled.arrays().items():
        assert np.isfinite(array).all(), name


@pytest.mark.parametrize(
    ("status", "reason"),
    [
        (NOT_FINITE, "a value is not finite"),
        (NOT_DEFINITE, "the linear system is not positive definite"),
        (NOT_CONVERGED, "Newton did not converge at the shortest step"),
    ],
)
def test_failures_name_feather_time_and_reason(status, reason):
    names = ["first", "second", "third"]
    with pytest.raises(SimulationError) as caught:
        raise_if_failed(np.array([0.0, status, 0.0]), np.array([0.1, 0.25, 0.3]), names)
    assert str(caught.value) == f"feather second at t = 0.25 s: {reason}"
    with pytest.raises(SimulationError, match=r"second.*\(and 1 more feathers\)"):
        raise_if_failed(np.array([0.0, status, status]), np.zeros(3), names)
    raise_if_failed(np.zeros(3), np.zeros(3), names)


def test_a_root_that_spins_at_300_rad_per_second_stays_finite():
    _, model = preset_batch("swan_primary", **SMALL)
    state = at_origin(model)
    samples = np.zeros((1, 5, 6))
    samples[0, :, 5] = np.linspace(0.0, 300.0 * FRAME, 5)
    with Solver(model, SETTINGS) as solver:
        after, report = solver.step(
            state, no_loads(1), RootPath(samples, hold_roots(state).base), FRAME
        )
    for name, array in after.arrays().items():
        assert np.isfinite(array).all(), name
    assert barb_stretch(model, after.points.nodes) < 1e-12
    assert report.status[0] == CONVERGED
    assert np.abs(after.centre[0]).max() < 1.01 * model.length[0].sum()


def test_error_control_keeps_to_the_tolerance():
    """Tighter tolerances take more steps, report smaller errors and come closer together."""
    ends, steps = [], []
    _, model = preset_batch("swan_primary", **SMALL)
    model = with_damping(model, [preset_kind("swan_primary")])
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7):
        state, count = at_origin(model), 0.0
        settings = Settings(tolerance=tolerance, newton=1e-8)
        with Solver(model, settings) as solver:
            for frame in range(3):
                path = swung(state, frame * FRAME, amplitude=0.03, smooth=True)
                state, report = solver.step(state, no_loads(1), path, FRAME)
                assert report.error[0] <= tolerance
                assert report.move[0] <= 1e-8
                count += report.steps[0]
        ends.append(state.points.nodes[0])
        steps.append(count)
    assert steps == sorted(steps)
    assert steps[-1] > 4 * steps[0]
    gaps = [np.linalg.norm(end - ends[-1], axis=-1).max() for end in ends[:-1]]
    assert gaps[2] < 0.4 * gaps[1] < 0.4 * gaps[0]


@pytest.mark.parametrize("name", ["swan_primary", "tail_feather"])
def test_a_mirrored_feather_moves_as_the_mirror_image(name):
    ends = []
    for mirrored in (False, True):
        _, model = preset_batch(name, mirrored=mirrored, **SMALL)
        sign = -1.0 if mirrored else 1.0
        state, loads = at_origin(model), no_loads(1, (0.0, 3.0 * sign, -9.81))
        with Solver(model, Settings(tolerance=1e-3, newton=1e-9)) as solver:
            for frame in range(3):
                path = swung(state, frame * FRAME, amplitude=0.05 * sign, axis=1, smooth=True)
                state, _ = solver.step(state, loads, path, FRAME)
        ends.append(state.points.nodes[0])
    assert np.abs(ends[0][:, :, 1]).max() > 0.01
    assert np.abs(ends[0] * (1.0, -1.0, 1.0) - ends[1]).max() < 1e-6
