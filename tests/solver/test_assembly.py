"""Assembled gradient of a step's energy, and what a rigid motion does to strains and forces."""

from __future__ import annotations

import numpy as np
import pytest
from derivatives import derivative_fault, with_a_wrong_sign
from drawn_cases import crumple
from trial_batches import (
    FEATHER_PRESETS,
    assembled,
    at_origin,
    preset_batch,
    random_pose,
    random_quat,
    rod,
    turned,
)

from featherfx.algebra.vectors import quats_to_frames, rotation_vectors
from featherfx.feather.types import RowPoints
from featherfx.mechanics.model import no_loads
from featherfx.solver.scratch import make_scratch, make_strains
from featherfx.solver.step.newton_kernels import copy_pose, evaluate
from featherfx.solver.step.pose_kernels import add_increment, load_pose
from featherfx.solver.types import IntegratorFactors, Strains

FACTORS = IntegratorFactors(500.0, 30.0, 0.4, 0.8)
STILL = IntegratorFactors(0.0, 0.0, 0.0)
SHARE = 0.5


class Trial:
    """The energy of one feather's step as a function of an increment of its coordinates."""

    def __init__(self, model, state, loads, factors, around=None):
        self.model, self.loads, self.factors = model, loads, factors
        self.work = make_scratch(model)
        if around is not None:
            for name, array in around.items():
                if name in ("reference", "target", "past"):
                    getattr(self.work.around, name).assign(array)
                else:
                    getattr(self.work.around, name)[...] = array
        now = self.work.now
        load_pose(model, 0, state, now)
        self.value = evaluate(model, loads, 0, SHARE, factors, now, self.work.around)

    def energy(self, x):
        work = self.work
        add_increment(self.model.length[0], work.now, x, 1.0, work.trial, work.beam.gradient)
        return evaluate(self.model, self.loads, 0, SHARE, self.factors, work.trial, work.around)

    def assembled(self, signed=False):
        """Gradient (N,); the Hessian is left in the work's band."""
        return assembled(self.model, self.loads, SHARE, self.factors, self.work, signed)


def loaded(name, seed, crumpled=0.0, **sizes):
    """A preset's feather, flying free, far from rest, with damping, drag, gravity and grips;
    crumpled (rad): with rows that are turned against each other by up to as much."""
    rng = np.random.default_rng(seed)
    _, model = preset_batch(name, **sizes)
    model = model._replace(held=np.array([False]))
    state = random_pose(model, rng)
    if crumpled > 0.0:
        crumple(model, state, rng, crumpled)
        # the same frames, but come to the other way about
        state.rotation[0, 3:] *= -1.0
    size = (model.rows, model.mass.shape[2])
    last = 1 + model.columns
    loads = no_loads(1, (1.0, 2.0, -9.8))._replace(
        air=np.array([1.2, 1.5, 0.1, 1.0]),
        added_mass=np.ones(1),
        grip_node=np.array([[[model.rows - 1, 0], [2, last], [-1, 0]]]),
        grip_start=rng.normal(size=(1, 3, 3)),
        grip_end=rng.normal(size=(1, 3, 3)),
        grip_stiffness=np.array([[50.0, 20.0, 1e9]]),
        grip_slack=np.array([[0.3, 0.0, 0.0]]),
    )
    around = {
        "target": RowPoints(rng.normal(size=(*size, 3)), rng.normal(size=(model.rows, 2, 3))),
        "past": RowPoints(0.1 * rng.normal(size=(*size, 3)), np.zeros((model.rows, 2, 3))),
        "reference": Strains(*(0.1 * rng.normal(size=a.shape) for a in make_strains(model))),
        "wind": rng.normal(size=(*size, 3)),
        "area": 1e-2 * rng.normal(size=(*size, 3)),
        "speed": np.abs(rng.normal(size=size)),
        "carried": 1e-3 * np.abs(rng.normal(size=size)),
        "slip": rng.normal(size=size),
    }
    return Trial(model, state, loads, FACTORS, around)


def scales(model):
    """Sizes of increments that move the coordinates about as far as each other."""
    row = np.full(6 + 4 * model.coefficients, 0.1)
    row[:3] = 0.1 * model.length[0].mean()
    return 0.3 * np.tile(row, model.rows)


# loops along barbs fill their last turn (2, 6, 10) or do not
GRIDS = [(3, 0), (3, 1), (3, 3), (2, 1), (6, 1), (10, 2)]


@pytest.mark.parametrize(("columns", "coefficients"), GRIDS)
@pytest.mark.parametrize("name", ["swan_primary", "ornamental_plume"])
def test_the_assembled_gradient_is_the_derivative_along_the_retraction(name, columns, coefficients):
    trial = loaded(name, 3, rows=7, columns=columns, coefficients=coefficients)
    gradient = trial.assembled()
    rng, scale = np.random.default_rng(4), scales(trial.model)
    assert derivative_fault(trial.energy, gradient, rng, scale, directions=8) == ""
    for place in np.argsort(-np.abs(gradient * scale))[:: len(gradient) // 12]:
        wrong = with_a_wrong_sign(gradient, int(place))
        if abs(gradient[place] * scale[place]) > 1e-6 * np.abs(gradient * scale).max():
            assert derivative_fault(trial.energy, wrong, np.random.default_rng(4), scale) != ""


@pytest.mark.parametrize("seed", [8, 10])
def test_so_it_is_where_hinges_fold_over_and_rows_turn_round(seed):
    trial = loaded("swan_primary", seed, crumpled=4.0, rows=7, columns=3, coefficients=1)
    strains = trial.work.now.strains
    turns = strains.rachis[:, 3:] + trial.model.rachis_rest[0, :, 3:6]
    assert np.linalg.norm(turns, axis=1).max() > 4.0
    assert np.sum(np.abs(strains.hinge) > 2.0) > 2
    gradient, scale = trial.assembled(), scales(trial.model)
    assert derivative_fault(trial.energy, gradient, np.random.default_rng(4), scale) == ""


def test_the_gradient_does_not_depend_on_how_the_hessian_is_made():
    trial = loaded("swan_primary", 5)
    first = trial.assembled(signed=False)
    assert trial.assembled(signed=True).tobytes() == first.tobytes()


@pytest.mark.parametrize(("columns", "coefficients"), GRIDS)
def test_at_rest_the_matrix_is_the_derivative_of_the_gradient(columns, coefficients):
    """Without forces no term of second order is left out: H_ab = d gradient_a / d x_b."""
    _, model = preset_batch("swan_primary", rows=6, columns=columns, coefficients=coefficients)
    model = model._replace(held=np.array([False]))
    state = at_origin(model)
    trial = Trial(model, state, no_loads(1), FACTORS, {"target": state.points.at(0)})
    scale = scales(model)
    force = np.abs(trial.assembled(signed=True) * scale).max()
    matrix = dense(trial.work.system.band)
    assert force < 1e-7 * (np.diag(matrix) * scale**2).min()
    columns_of = [slopes_of_the_gradient(trial, state, x) for x in np.diag(1e-3 * scale)]
    right = np.array(columns_of).T / (1e-3 * scale)
    weight = 1.0 / np.sqrt(np.diag(matrix))
    assert np.abs((matrix - right) * np.outer(weight, weight)).max() < 1e-7


def slopes_of_the_gradient(trial, state, x):
    """Half the difference of the gradients after increments x and -x from a state."""
    work, model = trial.work, trial.model
    gradients = []
    for sign in (1.0, -1.0):
        load_pose(model, 0, state, work.now)
        trial.energy(sign * x)
        copy_pose(work.trial, work.now)
        gradients.append(trial.assembled())
    return 0.5 * (gradients[0] - gradients[1])


def dense(band):
    """(N, N) of a symmetric band."""
    size, width = band.shape
    matrix = np.zeros((size, size))
    for d in range(width):
        inside = np.arange(max(size - d, 0))
        matrix[inside + d, inside] = matrix[inside, inside + d] = band[inside, d]
    return matrix


@pytest.mark.parametrize("signed", [False, True])
def test_the_matrix_knows_how_damping_holds_crushed_hinges(signed):
    """They may turn while their triangles open, so that openness times fold stays."""
    trial = loaded("swan_primary", 10, crumpled=4.0, rows=7, columns=3, coefficients=1)
    trial.factors, model = IntegratorFactors(0.0, 0.0, 2e13, 2e13), trial.model
    others = ("rachis_stiffness", "barb_stiffness", "cell_stiffness", "twist_stiffness")
    trial.model = model._replace(**{name: 0.0 * getattr(model, name) for name in others})
    strains, scale = trial.work.now.strains, 1e-4 * scales(trial.model)
    trial.work.around.reference.assign(strains)
    assert 0.0 < strains.openness[:, 1:-1].min() < 0.3
    trial.assembled(signed)
    matrix, middle = dense(trial.work.system.band), trial.energy(0.0 * scale)
    for direction in scale * np.random.default_rng(4).normal(size=(8, len(scale))):
        bend = trial.energy(direction) + trial.energy(-direction) - 2.0 * middle
        assert direction @ matrix @ direction == pytest.approx(bend, rel=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_the_gauss_newton_hessian_is_positive_definite_far_from_rest(seed):
    trial = loaded("swan_primary", seed, rows=7, columns=3)
    trial.assembled(signed=False)
    matrix = dense(trial.work.system.band)
    values = np.linalg.eigvalsh(matrix)
    assert values.min() > -1e-9 * values.max()
    scale = np.sqrt(np.diag(matrix))
    assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > 0.0


def moved_rigidly(state, rng):
    """The same pose at another place and orientation."""
    vector, shift = rotation_vectors(quats_to_frames(random_quat(rng))), rng.normal(size=3)
    moved = state.copy()
    rotation = quats_to_frames(turned(np.array([1.0, 0, 0, 0]), vector))
    for i in range(state.rotation.shape[1]):
        moved.rotation[0, i] = turned(state.rotation[0, i], vector)
    moved.centre[0] = state.centre[0] @ rotation.T + shift
    return moved, rotation


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_a_rigid_motion_changes_no_strain_and_no_energy(name, seed):
    rng = np.random.default_rng(seed)
    _, model = preset_batch(name)
    model = model._replace(held=np.array([False]))
    state = random_pose(model, rng)
    moved, _ = moved_rigidly(state, rng)
    before, after = (Trial(model, each, no_loads(1), STILL) for each in (state, moved))
    strains = zip(before.work.now.strains, after.work.now.strains, strict=True)
    assert max(np.abs(each).max() for each in before.work.now.strains) > 0.1
    assert max(np.abs(a - b).max() for a, b in strains) < 1e-10
    assert after.value == pytest.approx(before.value, rel=1e-10)


@pytest.mark.parametrize("name", FEATHER_PRESETS)
def test_a_rest_shape_anywhere_has_no_energy_and_no_force(name):
    rng = np.random.default_rng(11)
    _, model = preset_batch(name)
    model = model._replace(held=np.array([False]))
    moved, _ = moved_rigidly(at_origin(model), rng)
    trial = Trial(model, moved, no_loads(1), STILL)
    force = trial.assembled() * scales(model)
    stiffness = trial.work.system.band[:, 0] * scales(model) ** 2
    assert np.abs(force).max() < 1e-10 * stiffness.max()
    assert 0.0 <= trial.value < 1e-18 * stiffness.max()


@pytest.mark.parametrize("name", ["swan_primary", "covert"])
def test_inner_forces_have_no_resultant_and_no_moment(name):
    """A rigid motion of a strained pose does no work: the gradient is normal to it."""
    rng = np.random.default_rng(12)
    _, model = preset_batch(name)
    model = model._replace(held=np.array([False]))
    trial = Trial(model, random_pose(model, rng), no_loads(1), STILL)
    gradient = trial.assembled().reshape(model.rows, -1)
    force, moment = gradient[:, :3], gradient[:, 3:6]
    centre = trial.work.now.centre
    largest = np.abs(force).max()
    assert largest > 1e-3
    assert np.abs(force.sum(axis=0)).max() < 1e-9 * largest
    total = moment.sum(axis=0) + np.cross(centre, force).sum(axis=0)
    assert np.abs(total).max() < 1e-9 * max(largest, np.abs(moment).max())


def test_a_rod_without_barbs_has_the_same_properties():
    rng = np.random.default_rng(13)
    model = rod(6, stretching=50.0)._replace(held=np.array([False]))
    trial = Trial(model, random_pose(model, rng), no_loads(1, (0.0, 0.0, -9.8)), STILL)
    gradient = trial.assembled()
    scale = np.full(len(gradient), 0.3)
    assert derivative_fault(trial.energy, gradient, rng, scale) == ""


def test_a_held_root_has_no_equation():
    trial = loaded("swan_primary", 6)
    held = trial.model._replace(held=np.array([True]))
    trial.model = held
    gradient = trial.assembled()
    band = trial.work.system.band
    assert not gradient[:6].any()
    assert (band[:6, 0] == 1.0).all()
    assert not band[:6, 1:].any()


def test_the_whole_hessian_is_the_derivative_of_the_gradient_at_rest():
    rng = np.random.default_rng(22)
    _, model = preset_batch("swan_primary", rows=7, columns=3)
    model = model._replace(held=np.array([False]))
    trial = Trial(model, at_origin(model), no_loads(1), STILL)
    trial.assembled(signed=True)
    band = trial.work.system.band.copy()
    size, width = band.shape
    matrix = np.zeros((size, size))
    for d in range(width):
        inside = np.arange(max(size - d, 0))
        matrix[inside + d, inside] = matrix[inside, inside + d] = band[inside, d]
    for _ in range(5):
        x = 1e-4 * scales(model) * rng.normal(size=size)
        assert trial.energy(x) == pytest.approx(0.5 * x @ matrix @ x, rel=1e-2)
