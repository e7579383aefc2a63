"""Steps and statics of the nodal kinematics, against the barb-curvature kinematics."""

from dataclasses import replace

import numpy as np
import pytest
from nodal_cases import LENGTH, VANE, at_rest, curved_kind, feather_models, flat_kind

from featherfx.lab.nodal.solver import NodalSolver, barb_strain
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import RootPath, Settings, Solver
from featherfx.solver.state import rest_state

GRIDS = ((11, 4, 2), (21, 8, 4))


def distance(first, second):
    """Largest distance of any point, rachis or barb, as a share of the feather's length."""
    return np.linalg.norm(first - second, axis=-1).max() / LENGTH


def shake(frame, rate):
    """Root moving by 5 cm at 3 Hz along z."""
    samples = np.zeros((1, 5, 6))
    time = (frame + np.linspace(0.0, 1.0, 5)) / rate
    samples[0, :, 2] = 0.05 * np.sin(2.0 * np.pi * 3.0 * time)
    return RootPath(samples, np.array([[1.0, 0.0, 0.0, 0.0]]))


def run(solver, state, frames, rate=96.0):
    """(points of all frames, iterations, last state)."""
    loads = no_loads(1, (0.0, 0.0, -9.81))
    trace, iterations = [], 0
    for frame in range(frames):
        state, report = solver.step(state, loads, shake(frame, rate), 1.0 / rate)
        assert report.status[0] == 0
        iterations += report.iterations[0]
        trace.append(state.points.nodes[0])
    return np.array(trace), iterations, state


def fixed_step(newton=1e-7):
    return Settings(tolerance=1e9, newton=newton, max_substeps=1)


@pytest.mark.slow
@pytest.mark.verification
def test_both_kinematics_converge_to_one_static_shape():
    """The nodal one's error on few columns: curved barbs have none where they bend little."""
    loads = no_loads(1, (0.0, 0.0, -20.0 * 9.81))
    errors = []
    for rows, columns, coefficients in GRIDS:
        model, nodal = feather_models(flat_kind(), rows, columns, coefficients)
        straight = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        smooth, status, _ = Solver(model, Settings(newton=1e-9)).equilibrium(straight, loads)
        solver = NodalSolver(model, nodal, Settings(newton=1e-9))
        points, nodal_status, _ = solver.equilibrium(at_rest(model, nodal), loads)
        assert status[0] == nodal_status[0] == 0
        assert distance(points.points.nodes, straight.points.nodes) > 0.05
        errors.append(distance(points.points.nodes, smooth.points.nodes))
    assert errors[0] < 5e-3
    assert errors[1] < 6e-4
    assert errors[1] < errors[0] / 4.0


@pytest.mark.slow
@pytest.mark.verification
def test_unequal_barbs_converge_where_sections_are_carried_in_both():
    """Barbs ten times stiffer within the vane than out of it."""
    loads = no_loads(1, (0.0, 0.0, -20.0 * 9.81))
    kind = replace(flat_kind(), vane_material=VANE)
    errors = []
    for rows, columns, coefficients in GRIDS:
        model, nodal = feather_models(kind, rows, columns, coefficients, section="carried")
        straight = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        smooth, status, _ = Solver(model, Settings(newton=1e-9)).equilibrium(straight, loads)
        solver = NodalSolver(model, nodal, Settings(newton=1e-9))
        points, nodal_status, _ = solver.equilibrium(at_rest(model, nodal), loads)
        assert status[0] == nodal_status[0] == 0
        errors.append(distance(points.points.nodes, smooth.points.nodes))
    assert errors[1] < 1e-3
    assert errors[1] < errors[0] / 2.5


@pytest.mark.slow
@pytest.mark.verification
def test_both_kinematics_converge_to_one_motion():
    errors = []
    for rows, columns, coefficients in GRIDS:
        model, nodal = feather_models(flat_kind(), rows, columns, coefficients)
        straight = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
        smooth, _, _ = run(Solver(model, fixed_step()), straight, 16)
        points, _, _ = run(NodalSolver(model, nodal, fixed_step()), at_rest(model, nodal), 16)
        errors.append(distance(points, smooth))
    assert errors[0] < 4.5e-3
    assert errors[1] < errors[0] / 3.0


@pytest.mark.slow
def test_improved_newton_needs_few_iterations_and_textbook_many_for_one_answer():
    model, nodal = feather_models(curved_kind(), 11, 4)
    improved = NodalSolver(model, nodal, fixed_step())
    textbook = NodalSolver(model, nodal, fixed_step(), "textbook")
    points, few, _ = run(improved, at_rest(model, nodal), 6, rate=480.0)
    same, many, _ = run(textbook, at_rest(model, nodal), 6, rate=480.0)
    assert few <= 8 * 6
    assert many > 1.3 * few
    assert distance(points, same) < 1e-5


@pytest.mark.slow
def test_inextensible_is_the_limit_of_stiff_barbs():
    model, nodal = feather_models(curved_kind(), 11, 4, stretch="inextensible")
    points, _, state = run(NodalSolver(model, nodal, fixed_step()), at_rest(model, nodal), 6)
    assert barb_strain(model, state)[0] < 1e-9
    gaps = []
    for stiffer in (1.0, 10.0):
        stiff = nodal._replace(
            stretch_stiffness=nodal.stretch_stiffness * stiffer, inextensible=False
        )
        other, _, _ = run(NodalSolver(model, stiff, fixed_step(1e-9)), at_rest(model, nodal), 6)
        gaps.append(distance(points, other))
    assert gaps[0] < 1e-4
    assert gaps[1] < 0.3 * gaps[0]


def arrays_of(state):
    """All arrays of a state."""
    return [a for each in state for a in (each if isinstance(each, tuple) else (each,))]


@pytest.mark.slow
def test_a_step_leaves_its_inputs_alone_and_repeats_exactly():
    model, nodal = feather_models(curved_kind(), 11, 4)
    solver, state = NodalSolver(model, nodal, Settings()), at_rest(model, nodal)
    before = state.copy()
    loads = no_loads(1, (0.0, 0.0, -9.81))
    first, _ = solver.step(state, loads, shake(0, 24.0), 1.0 / 24.0)
    second, _ = solver.step(state, loads, shake(0, 24.0), 1.0 / 24.0)
    assert all(map(np.array_equal, arrays_of(state), arrays_of(before)))
    assert all(map(np.array_equal, arrays_of(first), arrays_of(second)))
    assert first.time[0] == pytest.approx(1.0 / 24.0)
