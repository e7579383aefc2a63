"""The ribbon's energy, its derivatives and its limits."""

from dataclasses import replace

import numpy as np
import pytest

from featherfx.errors import InputError
from featherfx.lab.ribbons.curve import centreline, link_masses, work_of_loads
from featherfx.lab.ribbons.energy import Ribbon, closeness, elastic, width_factor

RIBBON = Ribbon(0.5, 0.01, 2e-4, 0.1, 60.0, elements=7, tip_width=0.006, grading=1.7)
SIZE = RIBBON.elements + 1


def random_unknowns(seed, size=SIZE):
    random = np.random.default_rng(seed)
    return np.concatenate([random.normal(30.0, 20.0, size), random.normal(0.0, 0.8, size)])


def frame(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn * np.linalg.det(turn)


NARROW = replace(RIBBON, tip_width=None, grading=1.0, finite_width=False)
CUBIC = replace(RIBBON, elements=2, degree=3)
SQUARE = replace(RIBBON, elements=3, degree=2)


@pytest.mark.parametrize("ribbon", [RIBBON, NARROW, SQUARE, CUBIC])
@pytest.mark.parametrize("seed", [0, 1])
def test_derivatives_by_central_differences(ribbon, seed):
    force = np.random.default_rng(seed).normal(size=(8 * ribbon.elements + 1, 3))
    clamp = frame(seed)
    unknowns = random_unknowns(seed, ribbon.nodes)
    direction = np.random.default_rng(seed + 10).normal(size=2 * ribbon.nodes)
    for energy in (lambda u: elastic(ribbon, u), lambda u: work_of_loads(ribbon, u, clamp, force)):
        step = 1e-5
        above, below = energy(unknowns + step * direction), energy(unknowns - step * direction)
        _, gradient, matrix = energy(unknowns)
        slope = (above[0] - below[0]) / (2.0 * step)
        assert slope == pytest.approx(
            gradient @ direction, rel=1e-7, abs=1e-8 * np.abs(gradient).max()
        )
        bend = (above[1] - below[1]) / (2.0 * step)
        assert bend == pytest.approx(
            matrix @ direction, abs=1e-7 * np.abs(matrix @ direction).max()
        )
        assert matrix == pytest.approx(matrix.T, abs=1e-12 * np.abs(matrix).max())


def test_width_factor_is_smooth_where_series_and_closed_form_meet():
    """artanh(x) / x, and its derivatives by differences, on both sides of 0.1."""
    x = np.array([-0.9, -0.1001, -0.0999, 1e-9, 0.0999, 0.1001, 0.5, 0.99])
    value, first, second = width_factor(x)
    assert value == pytest.approx(np.arctanh(x) / x, rel=1e-13)
    step = 1e-6
    assert first == pytest.approx(
        (width_factor(x + step)[0] - width_factor(x - step)[0]) / (2 * step), rel=1e-6, abs=1e-9
    )
    assert second == pytest.approx(
        (width_factor(x + step)[1] - width_factor(x - step)[1]) / (2 * step), rel=1e-6
    )


def test_rest_shape_costs_nothing():
    energy, gradient, _ = elastic(RIBBON, RIBBON.rest)
    assert energy == pytest.approx(0.0, abs=1e-18)
    assert gradient == pytest.approx(0.0, abs=1e-18)


@pytest.mark.verification
def test_strip_wound_on_a_cylinder_at_an_angle():
    """A flat strip wound on a cylinder of radius R at pitch angle a: its only principal curvature
    is 1 / R, so E = 1/2 D w L / R^2; c = cos^2 a / R, torsion sin a cos a / R, so t = tan a."""
    radius, pitch = 0.02, 0.6
    ribbon = Ribbon(0.3, 0.01, 2e-4, 0.1, elements=5)
    curvature, ruling = np.cos(pitch) ** 2 / radius, np.tan(pitch)
    unknowns = np.repeat([curvature, ruling], 6)
    expected = 0.5 * ribbon.rigidity * ribbon.width * ribbon.length / radius**2
    assert elastic(ribbon, unknowns)[0] == pytest.approx(expected, rel=1e-12)
    # its centreline is a helix: the tip of a helix, from its own formula
    curve = centreline(ribbon, unknowns, np.eye(3), links=64)
    rise = np.linalg.norm(curve.points[-1])
    angle = ribbon.length * np.cos(pitch) / radius
    helix = np.hypot(2.0 * radius * np.sin(0.5 * angle), ribbon.length * np.sin(pitch))
    assert rise == pytest.approx(helix, rel=1e-4)


@pytest.mark.verification
def test_centreline_of_constant_curvature_is_second_order():
    ribbon = Ribbon(0.3, 0.01, 2e-4, 0.1, elements=3)
    unknowns = np.concatenate([np.full(4, 10.0), np.zeros(4)])
    expected = np.array([0.0, np.cos(3.0) - 1.0, np.sin(3.0)]) / 10.0
    errors = [
        np.abs(centreline(ribbon, unknowns, np.eye(3), links).points[-1] - expected).max()
        for links in (8, 16, 32)
    ]
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx(2.0, abs=0.05)


def test_energy_is_infinite_where_rulings_meet():
    unknowns = RIBBON.rest
    unknowns[SIZE] = 60.0
    assert np.abs(closeness(RIBBON, unknowns)).max() > 1.0
    assert elastic(RIBBON, unknowns)[0] == np.inf


def test_masses_are_those_of_the_strip():
    mean = 0.5 * (RIBBON.width + RIBBON.tip_width)
    total = RIBBON.surface_density * RIBBON.length * mean
    assert link_masses(RIBBON).sum() == pytest.approx(total, rel=1e-12)


def test_every_wrong_value_is_told():
    with pytest.raises(InputError) as caught:
        Ribbon(-1.0, 0.0, np.nan, -0.1, np.inf, poisson=0.6, elements=0, grading=9.0)
    keys = {problem.key for problem in caught.value.problems}
    assert keys == {
        *("length", "width", "rigidity", "surface_density"),
        *("rest_curvature", "poisson", "elements", "grading"),
    }
