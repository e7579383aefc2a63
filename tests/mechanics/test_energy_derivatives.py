"""Gradients of every strain and energy kernel against central differences, in random poses.

Each case is also tried with the sign of every single entry turned: the check must see it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from derivatives import derivative_fault, unnoticed_signs
from trial_batches import barb_slopes, random_quat, rod, rotation_of, turned

from featherfx.feather.types import RowPoints
from featherfx.mechanics.barb_kernels import (
    barb_points,
    couple_energy,
    director_energy,
    subtract_couple_moments,
    subtract_director_moments,
)
from featherfx.mechanics.model import no_loads
from featherfx.mechanics.node_kernels import node_energy, node_forces
from featherfx.mechanics.rachis_kernels import rachis_gradient, rachis_strain
from featherfx.mechanics.vane_bending_kernels import (
    cell_twist,
    hinge_angle,
    hinge_gradient,
    twist_slopes,
)
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_strain
from featherfx.mechanics.vane_rest import curvature_shapes
from featherfx.solver.scratch import make_scratch
from featherfx.solver.types import IntegratorFactors

SEEDS = range(5)


class Case(NamedTuple):
    """An energy as a function of an increment (N,), its gradient (N,) at zero, step sizes."""

    value: Callable[[np.ndarray], float]
    gradient: np.ndarray
    scale: float | np.ndarray = 1.0


def rachis(rng):
    """Energy of one element; the rows are turned against each other by up to 2.5 rad."""
    first = random_quat(rng)
    axis = rng.normal(size=3)
    second = turned(first, axis / np.linalg.norm(axis) * rng.uniform(0.0, 2.5))
    points, length = rng.normal(size=(2, 3)), 0.7
    rest, stiffness = rng.normal(size=6), rng.uniform(0.5, 2.0, 6)
    halfway, strain = np.zeros((3, 3)), np.zeros(6)

    def strains(x):
        rachis_strain(
            turned(first, x[3:6]),
            turned(second, x[9:12]),
            points[0] + x[0:3],
            points[1] + x[6:9],
            length,
            halfway,
            strain,
        )
        return strain - rest

    stress = stiffness * strains(np.zeros(12))
    slopes = np.zeros((6, 12))
    rachis_gradient(points[0], points[1], length, halfway, strain, slopes)
    return Case(lambda x: 0.5 * stiffness @ strains(x) ** 2, stress @ slopes, 0.3)


def rachis_at_rest_angle(rng):
    """The same with hardly any turn between the rows, where angle and axis lose their meaning."""
    turn, points = random_quat(rng), rng.normal(size=(2, 3))
    halfway, strain, weight = np.zeros((3, 3)), np.zeros(6), rng.normal(size=6)

    def value(x):
        first, second = turned(turn, x[3:6]), turned(turn, x[9:12])
        rachis_strain(first, second, points[0] + x[:3], points[1] + x[6:9], 0.7, halfway, strain)
        return weight @ strain

    value(np.zeros(12))
    slopes = np.zeros((6, 12))
    rachis_gradient(points[0], points[1], 0.7, halfway, strain, slopes)
    return Case(value, weight @ slopes)


def membrane(rng):
    """Energy of one triangle."""
    nodes, rest = rng.normal(size=(3, 3)), np.array([1.3, 0.4, 0.8])
    stiffness = rng.uniform(0.5, 2.0, 2)

    def strains(x):
        moved = nodes + x.reshape(3, 3)
        return np.array(membrane_strain(moved[0], moved[1], moved[2], rest))

    slopes = np.zeros((2, 3, 3))
    membrane_gradient(*nodes, rest, slopes)
    stress = stiffness * strains(np.zeros(9))
    return Case(lambda x: 0.5 * stiffness @ strains(x) ** 2, stress @ slopes.reshape(2, 9))


def hinge(rng):
    """Energy of one dihedral angle."""
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0.3, 1, 0], [0.6, -1, 0]])
    nodes += 0.3 * rng.normal(size=(4, 3))
    rest = rng.normal()
    slopes = np.zeros((4, 3))
    hinge_gradient(*nodes, slopes)

    def value(x):
        return 0.5 * (hinge_angle(*(nodes + x.reshape(4, 3))) - rest) ** 2

    return Case(value, (hinge_angle(*nodes) - rest) * slopes.ravel(), 0.3)


def twist(rng):
    """Energy of one cell's twist."""
    nodes, rest = rng.normal(size=(4, 3)), rng.normal()
    slopes = np.array(twist_slopes(*(nodes[1:] - nodes[0])))

    def value(x):
        return 0.5 * (cell_twist(*(nodes + x.reshape(4, 3))) - rest) ** 2

    return Case(value, (cell_twist(*nodes) - rest) * slopes.ravel(), 0.1)


def barb(rng):
    """Springs from a barb's nodes to random points, by root, row frame and coefficients."""
    joints = np.stack([[1.0, 0, 0, 0], *(random_quat(rng) for _ in range(4))])
    turn, clamp, root = random_quat(rng), random_quat(rng), rng.normal(size=3)
    shapes = curvature_shapes(3, 5, 1.0)
    coefficients, goal = rng.normal(size=6), rng.normal(size=(5, 3))
    points = np.zeros((5, 3))

    def offsets(x):
        barb_points(
            turned(turn, x[3:6]), root + x[:3], clamp, joints, 0.4, shapes, coefficients + x[6:],
            np.zeros((5, 4)), points,
        )  # fmt: skip
        return points - goal

    force = offsets(np.zeros(12)).copy()
    slopes = barb_slopes(turn, clamp, joints, 0.4, shapes, coefficients)
    gradient = np.einsum("akj,jk->a", slopes, force)
    return Case(lambda x: 0.5 * np.sum(offsets(x) ** 2), gradient)


class Nodes:
    """Inertia, added mass, gravity and drag of 2 rows of 2 columns in a random wind."""

    def __init__(self, rng):
        shape = (2, 5)
        self.points = rng.normal(size=(*shape, 3))
        self.model = rod(2)._replace(
            mass=rng.uniform(0.5, 1.5, (1, *shape)),
            rachis_area=rng.uniform(1, 2, (1, 2)),
            attached=np.array([[0.9, 3.0]]),
        )
        air, gravity = np.array([1.2, 1.5, 0.1, 1.1]), rng.normal(size=3)
        self.loads = no_loads(1)._replace(air=air, gravity=gravity, added_mass=np.ones(1))
        target, past, wind, area = rng.normal(size=(4, *shape, 3))
        still = np.zeros((2, 2, 3))
        speed = rng.uniform(0.5, 2.0, shape)
        self.around = make_scratch(self.model).around._replace(
            target=RowPoints(target, still),
            past=RowPoints(past, still),
            wind=wind,
            area=area,
            speed=speed,
            carried=rng.uniform(0.5, 1.5, shape),
            slip=rng.normal(size=shape),
            stream=rng.uniform(0.5, 2.0, (*shape, 3)),
        )
        self.factors = IntegratorFactors(3.0, 2.0, 0.0)
        self.force, self.stiff = np.zeros((*shape, 3)), np.zeros((*shape, 6))
        self.size = self.points.size

    def energy(self, x):
        moved = self.points + x.reshape(self.points.shape)
        return node_energy(self.model, self.loads, 0, self.factors, moved, self.around)

    def forces(self, x):
        moved = self.points + x.reshape(self.points.shape)
        each = self.model, self.loads, 0, self.factors, moved, self.around
        node_forces(*each, self.force, self.stiff)
        return self.force.copy()


def directors(rng):
    """Rotary inertia of 2 rows whose directors turn with them, and dead loads on these."""
    rest, target, couple = rng.normal(size=(3, 2, 2, 3))
    inertia, turned_rows = rng.uniform(0.5, 1.5, (2, 2)), np.zeros(6)

    def energy(x):
        moved = np.stack(
            [each @ rotation_of(u).T for each, u in zip(rest, x.reshape(2, 3), strict=True)]
        )
        return director_energy(inertia, 3.0, moved, target) + couple_energy(couple, moved)

    for i in range(2):
        subtract_director_moments(i, inertia, 3.0, rest, target, turned_rows[3 * i :])
        subtract_couple_moments(i, couple, rest, turned_rows[3 * i :])
    return Case(energy, -turned_rows, 0.3)


def nodes(rng):
    trial = Nodes(rng)
    return Case(trial.energy, trial.forces(np.zeros(trial.size)).ravel(), 0.3)


def node_stiffness(rng):
    """A random combination of the node forces: its gradient is the Hessian's product."""
    trial, weight = Nodes(rng), rng.normal(size=(2, 5, 3))
    trial.forces(np.zeros(trial.size))
    order = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]
    gradient = np.einsum("ipkl,ipl->ipk", trial.stiff[..., order], weight)
    return Case(lambda x: np.sum(weight * trial.forces(x)), gradient.ravel())


CASES = [rachis, rachis_at_rest_angle, membrane, hinge, twist, barb, directors, nodes]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("make", CASES)
def test_gradients_are_derivatives_of_second_order(make, seed):
    case = make(np.random.default_rng(seed))
    rng = np.random.default_rng(100 + seed)
    assert derivative_fault(case.value, case.gradient, rng, case.scale) == ""


@pytest.mark.parametrize("make", CASES)
def test_the_check_sees_one_wrong_sign(make):
    case = make(np.random.default_rng(7))

    def check(gradient):
        return derivative_fault(case.value, gradient, np.random.default_rng(8), case.scale)

    assert unnoticed_signs(check, case.gradient) == []


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_of_nodes_is_the_slope_of_their_forces(seed):
    case = node_stiffness(np.random.default_rng(seed))
    rng = np.random.default_rng(200 + seed)
    # drag is quadratic in the velocity: central differences are exact, there is no order to see
    assert derivative_fault(case.value, case.gradient, rng, 0.1, curved=False) == ""
    wrong = case.gradient.copy()
    wrong[0] *= 1.001
    assert derivative_fault(case.value, wrong, rng, 0.1, curved=False) != ""
