"""The compression guard: its derivatives, what it leaves alone, and what it holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from derivatives import derivative_fault, unnoticed_signs, with_a_wrong_sign
from nodal_cases import VANE, at_rest, end_row_loads, strip_models
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from trial_batches import assembled, at_origin, preset_kind, random_pose

from featherfx.feather.build import build_feather
from featherfx.lab.nodal.solver import NodalSolver
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.guard_kernels import GUARD_ROUNDING, area_ratio, guard_energy, guard_slopes
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_strain
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import add_increment, load_pose
from featherfx.solver.types import IntegratorFactors

REST = np.array([1.3, 0.4, 0.8])
STILL = IntegratorFactors(0.0, 0.0, 0.0)


def flat_triangle(across: float, along: float) -> np.ndarray:
    """(3, 3) nodes of a triangle with REST whose barb keeps its length; (across, along): c."""
    a = np.array([1.0, 0.0, 0.0])
    c = np.array([along, across, 0.0])
    return np.stack([np.zeros(3), a / REST[0], REST[1] * a + c / REST[2]])


def compressed(rng: np.random.Generator) -> np.ndarray:
    """A random triangle somewhere in space with J between 0.3 and 0.8."""
    nodes = flat_triangle(rng.uniform(0.3, 0.8), rng.normal(0.0, 0.3))
    return nodes @ Rotation.random(random_state=rng).as_matrix().T + rng.normal(size=3)


def energy(nodes: np.ndarray) -> float:
    return guard_energy((2.3, 1.0), *membrane_strain(*nodes, REST))


def gradient(nodes: np.ndarray) -> np.ndarray:
    slope, _, by_across, by_shear = guard_slopes((2.3, 1.0), *membrane_strain(*nodes, REST))
    lines = np.zeros((2, 3, 3))
    membrane_gradient(*nodes, REST, lines)
    return slope * (by_across * lines[0] + by_shear * lines[1]).ravel()


@pytest.mark.parametrize("seed", range(5))
def test_gradient_is_the_derivative_and_a_wrong_sign_is_seen(seed: int) -> None:
    nodes = compressed(np.random.default_rng(seed))

    def check(slopes: np.ndarray) -> str:
        def value(x: np.ndarray) -> float:
            return energy(nodes + x.reshape(3, 3))

        return derivative_fault(value, slopes, np.random.default_rng(seed), 0.05)

    assert check(gradient(nodes)) == ""
    assert unnoticed_signs(check, gradient(nodes)) == []


def test_area_ratio_is_that_of_the_areas() -> None:
    for across, along in ((0.9, 0.0), (0.5, 0.4), (1.4, -0.7)):
        nodes = flat_triangle(across, along)
        ratio = area_ratio(*membrane_strain(*nodes, REST))
        expected = np.sqrt((across**2 + GUARD_ROUNDING) / (1.0 + GUARD_ROUNDING))
        assert ratio == pytest.approx(expected, rel=1e-12)


def test_nothing_at_rest_and_under_tension() -> None:
    assert guard_energy((1.0, 1.0), 0.0, 0.0) == 0.0
    assert guard_slopes((1.0, 1.0), 0.0, 0.0)[:2] == (0.0, 0.0)
    assert guard_energy((1.0, 1.0), 0.3, 0.2) == 0.0
    # a complete fold has a finite energy, no slope but a finite curvature
    assert 0.85 < guard_energy((1.0, 1.0), -0.5, 0.0) < 1.0


def guarded_batch(modulus: float):
    """A coarse swan feather with a guard, barb-curvature kinematics."""
    kind = preset_kind("swan_primary")
    vane = replace(kind.vane_material, compression_guard=modulus)
    kind = replace(kind, vane_material=vane)
    feather = build_feather(kind, 7, 3)
    return make_model([feather], [kind], 2)._replace(held=np.array([False]))


def test_the_assembled_gradient_holds_the_guard() -> None:
    """In a random pose; the guard is strong enough for its errors to show."""
    rng = np.random.default_rng(3)
    model = guarded_batch(1e10)
    free = model._replace(cell_guard=np.zeros((1, 0, 0, 0, 0, 0)))
    state, loads, work = random_pose(model, rng), no_loads(1), make_scratch(model)
    load_pose(model, 0, state, work.now)
    without = evaluate(free, loads, 0, 0.0, STILL, work.now, work.around)
    total = evaluate(model, loads, 0, 0.0, STILL, work.now, work.around)
    assert total > 1.01 * without

    def value(x: np.ndarray) -> float:
        add_increment(model.length[0], work.now, x, 1.0, work.trial, work.beam.gradient)
        return evaluate(model, loads, 0, 0.0, STILL, work.trial, work.around)

    slopes = assembled(model, loads, 0.0, STILL, work)
    row = np.full(6 + 4 * model.coefficients, 0.01)
    row[:3] *= model.length[0].mean()
    scale = np.tile(row, model.rows)
    assert derivative_fault(value, slopes, np.random.default_rng(4), scale) == ""
    place = int(np.argmax(np.abs(slopes * scale)))
    wrong = with_a_wrong_sign(slopes, place)
    assert derivative_fault(value, wrong, np.random.default_rng(4), scale) != ""


def test_no_guard_leaves_every_bit_as_it_was() -> None:
    """A guard of modulus zero is not there at all; a triangle at rest does not feel any."""
    assert guarded_batch(0.0).cell_guard.size == 0
    model = guarded_batch(1e9)
    state, work = at_origin(model), make_scratch(model)
    load_pose(model, 0, state, work.now)
    assert abs(evaluate(model, no_loads(1), 0, 0.0, STILL, work.now, work.around)) < 1e-18
    force = assembled(model, no_loads(1), 0.0, STILL, work)
    assert np.abs(force).max() < 1e-9


@pytest.mark.slow
@pytest.mark.verification
def test_a_strip_pressed_across_its_barbs() -> None:
    """Beyond the largest force that the membrane alone can bear, 1 / sqrt(27) of its modulus:

    force / (width b) = across x (x^2 - 1) / 2 - k / 864 (1 - J)^2 dJ/dx,    x the stretch.
    """
    guard = 1e3 * VANE.modulus_across_barbs
    # so stiff against shear and bending that the strip stays straight
    vane = replace(VANE, compression_guard=guard, shear_modulus=2e5, bending_across=1e-4)
    pinned = np.zeros((6, 7), dtype=bool)
    pinned[0] = True
    length, width = 0.005, 0.02
    model, nodal = strip_models(length, width, 6, 3, vane, pinned)
    pressure = 1.5 * vane.modulus_across_barbs / np.sqrt(27.0)

    def excess(x: float) -> float:
        ratio = np.sqrt((x * x + GUARD_ROUNDING) / (1.0 + GUARD_ROUNDING))
        slope = x / (ratio * (1.0 + GUARD_ROUNDING))
        membrane = 0.5 * vane.modulus_across_barbs * x * (x * x - 1.0)
        return membrane - guard / 864.0 * (1.0 - ratio) ** 2 * slope + pressure

    stretch = brentq(excess, 0.3, 1.0, xtol=1e-14)
    solver = NodalSolver(model, nodal, Settings(newton=1e-10))
    force = -pressure * width * vane.thickness
    loads = end_row_loads(no_loads(1), model, (1.0, 0.0, 0.0), force)
    state, status, _ = solver.equilibrium(at_rest(model, nodal), loads)
    assert status[0] == 0
    assert state.points.nodes[0, -1, :, 0] == pytest.approx(length * stretch, rel=1e-7)


def test_a_guarded_feather_settles_and_its_vane_loses_less_area() -> None:
    """Pushed towards its root by its tip: least area with the guard and without it."""
    least = []
    for modulus in (0.0, 1e9):
        model = guarded_batch(modulus)._replace(held=np.array([True]))
        start = at_origin(model)
        rest = start.points.nodes[0, -1, 0]
        loads = no_loads(1)._replace(
            grip_node=np.array([[[model.rows - 1, 0]]]),
            grip_start=np.array([[rest]]),
            grip_end=np.array([[rest + np.array([0.0, 0.08, 0.0])]]),
            grip_stiffness=np.array([[500.0]]),
        )
        with Solver(model, Settings(newton=1e-8)) as solver:
            state, status, _ = solver.equilibrium(start, loads, 1.0)
        assert status[0] == 0
        strains = state.strains.cell[0, 0][model.cell_stiffness[0, ..., 0] > 0.0]
        least.append(min(area_ratio(*each) for each in strains))
    assert least[0] < 0.9
    assert least[1] > least[0] + 0.02
