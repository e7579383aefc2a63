"""Rods at rest against closed forms, shooting and published values."""

import numpy as np
import pytest

from featherfx.errors import InputWarning
from featherfx.lab.ribbons.oracles import elastica_tip, kirchhoff_tip
from featherfx.lab.ribbons.rod import Rod, bend, clamped, rod_loads, rod_model
from featherfx.solver.solver import Settings, Solver

pytestmark = pytest.mark.verification

ARC = 100.0 * np.pi / 4.0


def distance(first, second):
    return float(np.linalg.norm(np.asarray(first) - np.asarray(second)))


@pytest.mark.parametrize("load", [pytest.param(1.0, marks=pytest.mark.slow), 5.0])
def test_tapered_elastica_in_both_planes(load):
    """Unequal stiffnesses: the force across the planes bends and twists the rod."""
    stiffness = (0.6, 2.0, 1.0)
    force = (0.0, 0.6 * load, -0.8 * load)
    expected = kirchhoff_tip(1.0, stiffness, force, taper=0.5)
    rod = Rod(1.0, ei=1.0, ei2=2.0, gj=0.6, taper=0.5)
    assert distance(bend(rod, force).tip, expected) < 1e-3


def test_elastica_across_both_planes():
    """Lengths and stiffness far from one; the studies of rods have published loads."""
    length, ei, load, direction = 0.3, 2e-3, 5.0, np.array([0.0, 0.8, 0.6])
    x, drop = elastica_tip(load)
    tip = bend(Rod(length, ei), tuple(load * ei / length**2 * direction)).tip
    assert distance(tip, length * np.array([x, *(drop * direction[1:])])) < 1e-4 * length


def test_45_degree_bend_with_shear_and_stretch():
    """The published section's EA and GA change the tip by no more than its slenderness allows."""
    rigid = bend(Rod(ARC, 1e7 / 12.0, rest_curvature=0.01), (0.0, 0.0, 600.0)).tip
    flexible = Rod(ARC, 1e7 / 12.0, ea=1e7, ga=0.5e7, rest_curvature=0.01)
    assert 1e-6 * ARC < distance(bend(flexible, (0.0, 0.0, 600.0)).tip, rigid) < 2e-4 * ARC


def wound(rod, moment, axis, parts):
    """A rod under a tip moment (N m) about a body axis, applied in parts as a couple of dead forces
    on the directors that turns with the tip until it fits."""
    model = rod_model(rod)
    solver = Solver(model, Settings(newton=1e-9 * rod.length))
    couple = np.zeros((1, model.rows, 2, 3))
    loads = rod_loads(rod)._replace(couple=couple)
    state = clamped(model)
    for part in [*np.linspace(0.0, 1.0, parts + 1)[1:].repeat(2), *[1.0] * 8]:
        second, third = state.points.directors[0, -1]
        spin = np.stack([np.cross(second, third), second, third])[axis]
        couple[0, -1, 0] = 0.5 * part * moment * np.cross(spin, second)
        couple[0, -1, 1] = 0.5 * part * moment * np.cross(spin, third)
        if axis == 2:
            couple[0, -1, 0] *= 2.0
        state, status, _ = solver.equilibrium(state, loads)
        assert status[0] == 0
    return state


def test_pure_bending_into_a_full_circle():
    length, ei = 2.0, 0.7
    rod = Rod(length, ei)
    state = wound(rod, 2.0 * np.pi * ei / length, 2, 48)
    points = state.centre[0]
    assert distance(points[-1], points[0]) < 1e-6 * length
    # a regular polygon with 40 sides of length / 40
    radius = length / 40.0 / (2.0 * np.sin(np.pi / 40.0))
    from_centre = np.linalg.norm(points - points[:-1].mean(0), axis=1)
    assert from_centre == pytest.approx(radius, rel=1e-6)
    assert radius == pytest.approx(length / (2.0 * np.pi), rel=2e-3)


def test_torsion_of_a_straight_shaft():
    """Tip turned by T L / GJ, and by T / GJ integral ds / c^4 with taper."""
    length, gj, torque, taper = 0.5, 0.03, 0.09, 0.4
    for shape, longer in ((0.0, 1.0), (taper, ((1 - taper) ** -3 - 1) / (3 * taper))):
        state = wound(Rod(length, 1.0, gj=gj, taper=shape), torque, 0, 48)
        second = state.points.directors[0, -1, 0]
        turned = np.arctan2(second[2], second[1])
        expected = torque * length / gj * longer
        assert np.exp(1j * turned) == pytest.approx(np.exp(1j * expected), abs=1e-6)
        assert state.centre[0, -1] == pytest.approx([length, 0.0, 0.0], abs=1e-9)


def test_stretch_of_a_hanging_rod():
    """Tip force and own weight along the rod: F L / EA + W L^2 / 2 EA."""
    rod = Rod(1.0, 1e-2, ea=50.0)
    result = bend(rod, (3.0, 0.0, 0.0), points=[(0.5, (1.0, 0.0, 0.0))])
    assert result.tip == pytest.approx([1.0 + 3.0 / 50.0 + 0.5 / 50.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("force", "taper"),
    [pytest.param((0.0, 0.0, -5.0), 0.0, marks=pytest.mark.slow), ((0.0, 2.0, 0.0), 0.7)],
)
def test_second_order_in_the_number_of_rows(force, taper):
    expected = kirchhoff_tip(1.0, (1.0, 1.0, 1.0), force, taper=taper)
    errors = np.array(
        [
            distance(bend(Rod(1.0, 1.0, segments=n, taper=taper), force).tip, expected)
            for n in (10, 20, 40, 80)
        ]
    )
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 1.9).all(), f"errors {errors}, orders {orders}"


def test_a_rod_without_loads_keeps_its_rest_shape():
    """An arc's rows lie on its circle exactly."""
    points = bend(Rod(1.0, 1.0, rest_curvature=2.0, segments=7)).points
    s = np.linspace(0.0, 1.0, 8)
    expected = np.stack([np.sin(2 * s) / 2, (1 - np.cos(2 * s)) / 2, 0 * s], axis=1)
    assert points == pytest.approx(expected, abs=1e-12)


def test_a_load_beyond_all_bending_stretches_nothing_and_is_warned_of():
    # sqrt(EI / F) = 1 mm, elements of 25 mm
    with pytest.warns(InputWarning, match="3000 segments resolve"):
        bent = bend(Rod(1.0, 1.0, segments=40), (0.0, 0.0, -1e6))
    assert np.linalg.norm(np.diff(bent.points, axis=0), axis=1).max() < 0.025 * (1.0 + 2e-5)
