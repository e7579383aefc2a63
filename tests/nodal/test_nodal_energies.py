"""Forces of the nodal kinematics: derivatives, rigid motion, exact tractions."""

from dataclasses import replace

import numpy as np
import pytest
from nodal_cases import (
    VANE,
    at_rest,
    curved_kind,
    end_row_loads,
    feather_models,
    shifted,
    strip_models,
)
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from featherfx.errors import InputError
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver, nodal_state
from featherfx.mechanics.model import no_loads
from featherfx.solver.solver import Settings

STEPS = np.array([4e-5, 2e-5, 1e-5])
KINDS = {
    "barbs": {"bending": "barbs"},
    "hinges": {"bending": "hinges"},
    "plate": {"bending": "plate"},
    "carried": {"section": "carried"},
}


def comparable(model, nodal):
    """The models with stretch of barbs and shaft as soft as the rest, so that no energy hides
    another one's error."""
    stretch, shaft = 1e-4 * nodal.stretch_stiffness, 1e-4 * model.rachis_stiffness
    return model._replace(rachis_stiffness=shaft), nodal._replace(stretch_stiffness=stretch)


def random_pose(model, nodal, seed, size=2e-3):
    random = np.random.default_rng(seed)
    step = size * random.standard_normal(int(nodal.size[0]))
    direction = 5e-2 * random.standard_normal(int(nodal.size[0]))
    return shifted(at_rest(model, nodal), nodal, step), direction


def sweep_order(solver, nodal, state, direction, gradient):
    """Order at which central differences of the energy approach the gradient."""
    loads = no_loads(1, (1.0, 2.0, -9.81))
    errors = []
    for h in STEPS:
        ahead, behind = (
            solver.system(shifted(state, nodal, sign * h * direction), loads, 0).energy
            for sign in (1.0, -1.0)
        )
        errors.append(abs((ahead - behind) / (2.0 * h) - gradient @ direction))
    return np.polyfit(np.log(STEPS), np.log(errors), 1)[0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_gradient_is_the_derivative_of_the_energy(kind, seed):
    model, nodal = comparable(*feather_models(curved_kind(), 7, 3, **KINDS[kind]))
    solver = NodalSolver(model, nodal, Settings())
    state, direction = random_pose(model, nodal, seed)
    gradient = solver.system(state, no_loads(1, (1.0, 2.0, -9.81)), 0).gradient
    assert sweep_order(solver, nodal, state, direction, gradient) == pytest.approx(2.0, abs=0.1)
    frames = nodal.frame_slot[0, 1:]
    for wrong_part in (frames, nodal.slot[0, 3, 1:2]):
        only = np.zeros_like(direction)
        for at in wrong_part:
            only[at : at + 3] = direction[at : at + 3]
        assert sweep_order(solver, nodal, state, only, -gradient) < 0.5


@pytest.mark.parametrize("kind", KINDS)
def test_stiffness_at_rest_is_the_derivative_of_the_gradient(kind):
    model, nodal = feather_models(curved_kind(), 6, 3, **KINDS[kind])
    solver, loads = NodalSolver(model, nodal, Settings()), no_loads(1)
    rest = at_rest(model, nodal)
    band = solver.system(rest, loads, 0).band
    size = len(band)
    matrix = np.zeros((size, size))
    for d in range(band.shape[1]):
        index = np.arange(size - d)
        matrix[index + d, index] = matrix[index, index + d] = band[index, d]
    direction = np.random.default_rng(3).standard_normal(size)
    h = 1e-7
    ahead, behind = (
        solver.system(shifted(rest, nodal, s * h * direction), loads, 0).gradient for s in (1, -1)
    )
    expected = (ahead - behind) / (2.0 * h)
    assert matrix @ direction == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())
    assert np.linalg.eigvalsh(matrix)[0] > 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motion_gives_no_force(kind):
    model, nodal = feather_models(curved_kind(), 7, 3, **KINDS[kind])
    solver, loads = NodalSolver(model, nodal, Settings()), no_loads(1)
    rotation = Rotation.from_rotvec([0.7, -2.0, 1.1]).as_matrix()
    moved = at_rest(model, nodal, rotation, (3.0, -1.0, 2.0))
    bent, _ = random_pose(model, nodal, 4, size=1e-4)
    scale = np.abs(solver.system(bent, loads, 0).gradient).max()
    result = solver.system(moved, loads, 0)
    assert np.abs(result.gradient).max() < 1e-9 * scale
    assert result.energy < 1e-18


def strained(force_per_area, modulus):
    """Stretch of a bar under a dead load whose second Piola-Kirchhoff stress is linear in the
    Green-Lagrange strain: stretch * modulus * (stretch^2 - 1) / 2 = force per rest area."""
    return brentq(
        lambda stretch: 0.5 * stretch * modulus * (stretch**2 - 1.0) - force_per_area,
        0.9,
        2.0,
        xtol=1e-15,
    )


@pytest.mark.slow
@pytest.mark.verification
def test_traction_across_the_barbs_is_exact():
    length, width = 0.02, 0.01
    pinned = np.zeros((6, 5), dtype=bool)
    pinned[0] = True
    model, nodal = strip_models(length, width, 6, 2, VANE, pinned)
    force = 0.3 * VANE.modulus_across_barbs * width * VANE.thickness
    solver = NodalSolver(model, nodal, Settings(newton=1e-12))
    loads = end_row_loads(no_loads(1), model, (1.0, 0.0, 0.0), force)
    state, status, _ = solver.equilibrium(at_rest(model, nodal), loads)
    assert status[0] == 0
    expected = length * strained(0.3 * VANE.modulus_across_barbs, VANE.modulus_across_barbs)
    tip = state.points.nodes[0, -1]
    assert tip[:, 0] == pytest.approx(expected, rel=1e-8)
    assert tip[:, 1] == pytest.approx(nodal.rest_nodes[0, -1, :, 1], abs=1e-10)


@pytest.mark.slow
@pytest.mark.verification
def test_traction_along_the_barbs_is_exact():
    length, width, columns = 0.02, 0.01, 3
    pinned = np.zeros((5, 7), dtype=bool)
    pinned[:, 0] = True
    model, nodal = strip_models(length, width, 5, columns, VANE, pinned)
    pressure = 0.01 * VANE.modulus_along_barbs
    force = np.zeros((1, 5, 7, 3))
    spacing = length / 4
    share = np.array([0.5, 1.0, 1.0, 1.0, 0.5]) * spacing * VANE.thickness * pressure
    force[0, :, columns, 1] = share
    solver = NodalSolver(model, nodal, Settings(newton=1e-12))
    loads = no_loads(1)._replace(force=force)
    state, status, _ = solver.equilibrium(at_rest(model, nodal), loads)
    assert status[0] == 0
    expected = 0.5 * width * strained(pressure, VANE.modulus_along_barbs)
    assert state.points.nodes[0, :, columns, 1] == pytest.approx(expected, rel=1e-8)


def test_points_go_from_one_kinematics_to_the_other():
    model, nodal = feather_models(curved_kind(), 7, 3)
    pose, _ = random_pose(model, nodal, 5)
    directors = np.random.default_rng(5).standard_normal((1, 7, 3))
    rotations = Rotation.from_rotvec(directors[0]).as_matrix()
    pose.points.directors[0] = rotations[:, :, 1:].swapaxes(1, 2)
    state = nodal_state(model, pose.points)
    assert all(map(np.array_equal, state.points, pose.points))
    assert Rotation.from_quat(np.roll(state.rotation[0], -1, axis=1)).as_matrix() == pytest.approx(
        rotations, abs=1e-12
    )


def test_wrong_options_are_all_named():
    model, nodal = feather_models(curved_kind(), 7, 3)
    with pytest.raises(InputError) as caught:
        nodal_model(
            model, [], [], bending="shell", stretch="soft", pinned=np.zeros((2, 2), dtype=bool)
        )
    assert [problem.key for problem in caught.value.problems] == ["bending", "stretch", "pinned"]
    with pytest.raises(InputError, match="improved, textbook"):
        NodalSolver(model, nodal, Settings(), "newest")


@pytest.mark.parametrize("seed", [1, 2])
def test_gradient_with_a_guard_is_the_derivative_of_the_energy(seed):
    """The guard holds most of the energy, and without it the gradient is another one."""
    kind = curved_kind()
    guarded = replace(kind, vane_material=replace(kind.vane_material, compression_guard=1e12))
    model, nodal = comparable(*feather_models(guarded, 7, 3))
    loads = no_loads(1, (1.0, 2.0, -9.81))
    free = model._replace(cell_guard=np.zeros((1, 0, 0, 0, 0, 0)))
    solver, without = (NodalSolver(each, nodal, Settings()) for each in (model, free))
    state, direction = random_pose(model, nodal, seed)
    system = solver.system(state, loads, 0)
    gradient, energy = system.gradient.copy(), system.energy
    bare = without.system(state, loads, 0)
    assert energy > 2.0 * bare.energy
    assert sweep_order(solver, nodal, state, direction, gradient) == pytest.approx(2.0, abs=0.1)
    assert sweep_order(solver, nodal, state, direction, bare.gradient) < 0.5
