"""Ribbons that move: rest shapes by shooting, a beam's frequency, wind, both ends held."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from featherfx.errors import InputError, SimulationError
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import GRAVITY_ALONG_Y, clamp_frame, hang
from featherfx.lab.ribbons.oracles import solved
from featherfx.lab.ribbons.ribbon import Air, FarClamp, FixedSteps, RibbonMotion

# Charrondiere et al. 2019, section 5.2; D in N m, as in their other figures
PEACOCK = Ribbon(0.5, 0.015, 2e-4, 0.015, 30.0, 0.5, elements=40)
LEVEL = clamp_frame("level")
STILL = np.zeros(3)


@pytest.mark.slow
@pytest.mark.verification
def test_a_peacocks_barb_at_rest_is_that_of_shooting():
    """Section 5.2: nearly the same. The largest gap is 0.05 % of the length."""
    rest = hang(PEACOCK).rest
    exact = solved(PEACOCK, rest, LEVEL, GRAVITY_ALONG_Y)
    assert np.abs(exact - rest.curve.points).max() < 1e-3 * PEACOCK.length
    # as an element that moves it stays there
    moving = RibbonMotion(PEACOCK, LEVEL, GRAVITY_ALONG_Y)
    state = moving.at_rest(rest.unknowns)
    before = moving.points(state.unknowns)
    for _ in range(3):
        state = moving.advance(state, FixedSteps(0.01))
    assert moving.points(state.unknowns) == pytest.approx(before, abs=1e-6)


def test_a_straight_strip_swings_at_a_beams_frequency_and_keeps_its_energy():
    """1.8751^2 sqrt(D / (sigma L^4)) / (2 pi) for small turns."""
    ribbon = Ribbon(0.1, 0.005, 2e-4, 0.1, elements=6)
    moving = RibbonMotion(ribbon, LEVEL, STILL)
    # the curvature of the first mode, Euler's and Bernoulli's
    place = 1.8751 * ribbon.stations / ribbon.length
    mode = np.cosh(place) + np.cos(place) - 0.7341 * (np.sinh(place) + np.sin(place))
    state = moving.let_go(np.concatenate([0.3 * mode, np.zeros(7)]))
    frequency = 1.8751**2 * np.sqrt(2e-4 / (0.1 * 0.1**4)) / (2.0 * np.pi)
    step, heights, energy = 1.0 / frequency / 48.0, [], moving.energy(state)
    for _ in range(48):
        state = moving.advance(state, FixedSteps(step, 0.9))
        heights.append(moving.points(state.unknowns)[-3, 1])
        assert moving.energy(state) < energy * (1.0 + 1e-3)
    crossings = np.flatnonzero(np.diff(np.sign(heights)) != 0)
    first, second = (k + heights[k] / (heights[k] - heights[k + 1]) for k in crossings[:2])
    assert 0.5 / ((second - first) * step) == pytest.approx(frequency, rel=0.01)
    assert moving.energy(state) > 0.9 * energy


@pytest.mark.slow
def test_a_limp_strip_in_wind_stands_where_drag_and_weight_balance():
    """At sin a / cos^2 a = rho C U^2 / (2 sigma g) from the plumb line."""
    ribbon = Ribbon(0.2, 0.002, 1e-9, 0.05, elements=4)
    moving, air = RibbonMotion(ribbon, clamp_frame("down"), GRAVITY_ALONG_Y), Air((0.8, 0.0, 0.0))
    state = moving.at_rest()
    for _ in range(30):
        state = moving.advance(state, FixedSteps(0.1, 0.0), air)
    load = air.density * air.drag * 0.8**2 / (2.0 * 0.05 * 9.81)
    angle = brentq(lambda a: np.sin(a) - load * np.cos(a) ** 2, 0.0, 1.5)
    points = moving.points(state.unknowns)[:-2]
    away = points[-1] - points[len(points) // 2]
    assert np.arctan2(away[0], -away[1]) == pytest.approx(angle, rel=0.01)


@pytest.mark.slow
def test_a_strip_held_at_both_ends_is_the_elastica():
    """Clamped at both ends, brought together: ends L (2 E / K - 1) apart, the middle k L / K away,
    pushed by 16 K^2 D w / L^2; K, E elliptic integrals of modulus k."""
    ribbon, modulus = Ribbon(0.1, 0.005, 2e-4, 0.05, elements=16), 0.5
    first, second = ellipk(modulus**2), ellipe(modulus**2)
    end = np.array([ribbon.length * (2.0 * second / first - 1.0), 0.0, 0.0])
    moving = RibbonMotion(ribbon, LEVEL, STILL, FarClamp(end, LEVEL))
    turns = -20.0 * np.cos(2.0 * np.pi * ribbon.stations / ribbon.length)
    state = moving.at_rest(np.concatenate([turns, np.zeros(17)]))
    points = moving.points(state.unknowns)[:-2]
    assert points[-1] == pytest.approx(end, abs=1e-6)
    assert np.abs(points[:, 1]).max() == pytest.approx(modulus * ribbon.length / first, rel=5e-3)
    push = 16.0 * first**2 * ribbon.rigidity * ribbon.width / ribbon.length**2
    assert -state.pull.sum(axis=0)[0] == pytest.approx(push, rel=5e-3)
    moved = moving.advance(state, FixedSteps(0.001))
    assert moving.points(moved.unknowns)[:-2] == pytest.approx(points, abs=1e-5)


def test_what_no_ribbon_can_do_is_said():
    moving = RibbonMotion(Ribbon(0.1, 0.005, 2e-4, 0.05, elements=4), LEVEL, STILL)
    state = moving.at_rest()
    with pytest.raises(InputError, match="step"):
        moving.advance(state, FixedSteps(0.0))
    with pytest.raises(InputError, match="drag"):
        moving.advance(state, FixedSteps(0.01), Air(drag=-1.0))
    far = FarClamp(np.array([0.2, 0.0, 0.0]), LEVEL)
    with pytest.raises(SimulationError, match="clamp"):
        RibbonMotion(moving.ribbon, LEVEL, STILL, far).at_rest()
