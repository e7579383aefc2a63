"""Ribbons that move: rest shapes by shooting, a beam's frequency, wind, both ends held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from featherfx.errors import InputError, SimulationError
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.experiments import GRAVITY, clamp_frame, hang
from featherfx.lab.ribbons.motion import Air, FarClamp, Pace, RibbonMotion

# Charrondiere et al. 2019, section 5.2; D in N m, as in their other figures
PEACOCK = Ribbon(0.5, 0.015, 2e-4, 0.015, 30.0, 0.5, elements=40)
LEVEL = clamp_frame("level")
STILL = np.zeros(3)


def ruling_rate(value: np.ndarray) -> np.ndarray:
    """x with H'(x) / H(x)^2 = value, H = artanh(x) / x, by bisection in artanh(x)."""
    low, high = np.zeros_like(value), np.full_like(value, 18.0)
    for _ in range(60):
        y = 0.5 * (low + high)
        x = np.maximum(np.tanh(y), 1e-9)
        factor = np.maximum(y, 1e-9) / x
        slope = np.where(x > 1e-4, (np.cosh(y) ** 2 - factor) / x, 2.0 * x / 3.0)
        above = slope / factor**2 > np.abs(value)
        high, low = np.where(above, y, high), np.where(above, low, y)
    return np.sign(value) * np.tanh(0.5 * (low + high))


def equations(s: np.ndarray, y: np.ndarray, ribbon: Ribbon, weight: np.ndarray) -> np.ndarray:
    """Equilibrium of a ribbon clamped at one end, as differential equations in arc length.

    y: place (3), frame (9, columns across, normal, along), moment in the frame (3), slope t of the
    rulings, p = dE / dt' . With curvatures (c, 0, t c): dE / dc = M_1 + t M_3 and
    dE / dt - p' = c M_3 hold at every place, M' + (c, 0, t c) x M + d_3 x n = 0 and n is the weight
    (3,) per length of what is beyond.
    """
    width, rigidity, nu, k = ribbon.width, ribbon.rigidity, ribbon.poisson, ribbon.rest_curvature
    frame, moment, t, p = y[3:12].reshape(3, 3, -1), y[12:15], y[15], y[16]
    wide = 1.0 + t**2
    bent = (moment[0] + t * moment[2]) / (rigidity * width) + k * (1.0 + nu * t**2)
    x = ruling_rate(4.0 * p * wide**2 / (rigidity * width**2 * bent**2))
    factor = np.where(np.abs(x) > 1e-6, np.arctanh(x) / np.where(x == 0.0, 1.0, x), 1.0)
    c = bent / (factor * wide**2)
    turn = np.stack([c, 0.0 * c, t * c])
    force = np.einsum("i,ijs->js", weight, frame) * (ribbon.length - s)
    across, normal, along = frame[:, 0], frame[:, 1], frame[:, 2]
    by_ruling = 2.0 * rigidity * width * (factor * c**2 * wide * t - nu * k * c * t)
    return np.concatenate(
        [
            along,
            # d_i' = (c d_1 + t c d_3) x d_i
            np.stack([turn[2] * normal, c * along - turn[2] * across, -c * normal], 1).reshape(
                9, -1
            ),
            -np.cross(turn, moment, axis=0) - np.stack([-force[1], force[0], 0.0 * c]),
            [2.0 * x / width, by_ruling - c * moment[2]],
        ]
    )


def shot(ribbon: Ribbon, unknowns: np.ndarray, points: np.ndarray, frames: np.ndarray) -> Any:
    """The solution of these equations near a guess, from solve_bvp of scipy."""
    size = ribbon.elements + 1
    place = np.linspace(0.0, ribbon.length, len(points))
    t = np.interp(place, ribbon.stations, unknowns[size:])
    guess = np.zeros((17, len(points)))
    guess[:3], guess[3:12], guess[15] = points.T, frames.reshape(-1, 9).T, t
    weight = ribbon.surface_density * ribbon.width * GRAVITY

    def ends(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        start = np.concatenate([STILL, LEVEL.ravel()])
        return np.concatenate([first[:12] - start, first[16:], last[12:15], last[16:]])

    return solve_bvp(lambda s, y: equations(s, y, ribbon, weight), ends, place, guess, tol=1e-5,
                     max_nodes=20000)  # fmt: skip


@pytest.mark.slow
@pytest.mark.verification
def test_a_peacocks_barb_at_rest_is_that_of_shooting():
    """Section 5.2: nearly the same. The largest gap is 0.05 % of the length."""
    rest = hang(PEACOCK).rest
    found = shot(PEACOCK, rest.unknowns, rest.curve.points, rest.curve.frames)
    assert found.status == 0
    place = np.linspace(0.0, PEACOCK.length, len(rest.curve.points))
    exact = np.stack([np.interp(place, found.x, found.y[k]) for k in range(3)], axis=1)
    assert np.abs(exact - rest.curve.points).max() < 1e-3 * PEACOCK.length
    # as an element that moves it stays there
    moving = RibbonMotion(PEACOCK, LEVEL, GRAVITY)
    state = moving.at_rest(rest.unknowns)
    before = moving.points(state.unknowns)
    for _ in range(3):
        state = moving.advance(state, Pace(0.01))
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
        state = moving.advance(state, Pace(step, 0.9))
        heights.append(moving.points(state.unknowns)[-3, 1])
        assert moving.energy(state) < energy * (1.0 + 1e-3)
    crossings = np.flatnonzero(np.diff(np.sign(heights)) != 0)
    first, second = (k + heights[k] / (heights[k] - heights[k + 1]) for k in crossings[:2])
    assert 0.5 / ((second - first) * step) == pytest.approx(frequency, rel=0.01)
    assert moving.energy(state) > 0.9 * energy


def test_a_limp_strip_in_wind_stands_where_drag_and_weight_balance():
    """At sin a / cos^2 a = rho C U^2 / (2 sigma g) from the plumb line."""
    ribbon = Ribbon(0.2, 0.002, 1e-9, 0.05, elements=4)
    moving, air = RibbonMotion(ribbon, clamp_frame("down"), GRAVITY), Air((0.8, 0.0, 0.0))
    state = moving.at_rest()
    for _ in range(30):
        state = moving.advance(state, Pace(0.1, 0.0), air)
    load = air.density * air.drag * 0.8**2 / (2.0 * 0.05 * 9.81)
    angle = brentq(lambda a: np.sin(a) - load * np.cos(a) ** 2, 0.0, 1.5)
    points = moving.points(state.unknowns)[:-2]
    away = points[-1] - points[len(points) // 2]
    assert np.arctan2(away[0], -away[1]) == pytest.approx(angle, rel=0.01)


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
    moved = moving.advance(state, Pace(0.001))
    assert moving.points(moved.unknowns)[:-2] == pytest.approx(points, abs=1e-5)


def test_what_no_ribbon_can_do_is_said():
    moving = RibbonMotion(Ribbon(0.1, 0.005, 2e-4, 0.05, elements=4), LEVEL, STILL)
    state = moving.at_rest()
    with pytest.raises(InputError, match="step"):
        moving.advance(state, Pace(0.0))
    with pytest.raises(InputError, match="drag"):
        moving.advance(state, Pace(0.01), Air(drag=-1.0))
    far = FarClamp(np.array([0.2, 0.0, 0.0]), LEVEL)
    with pytest.raises(SimulationError, match="clamp"):
        RibbonMotion(moving.ribbon, LEVEL, STILL, far).at_rest()
