"""The law of a hooked triangle: energy, stress, tangent, slip."""

from __future__ import annotations

import numpy as np
import pytest
from derivatives import derivative_fault, unnoticed_signs
from scipy.optimize import minimize

from featherfx.mechanics.vane_hook_kernels import (
    hooked_energy,
    hooked_response,
    open_energy,
    open_response,
    slip_after,
)

STIFFNESS, LIMIT = (3.0, 1.2), (0.5, 0.3)
# strains (e_ww, 2 e_vw) that slip in both ways, in one, under pressure, and not at all
STRAINS = [(0.4, 0.5), (0.4, 0.0), (0.1, -0.6), (-0.3, 0.7), (0.05, 0.1)]
STATES = [((0.0, 0.0), 1.0, 0.0), ((0.02, -0.1), 1.3, 0.4)]


def arguments(state):
    slip, level, growth = state
    return slip, LIMIT, level, growth


@pytest.mark.parametrize("strains", STRAINS)
@pytest.mark.parametrize("state", STATES)
def test_energy_is_the_least_over_all_slips(strains, state):
    (before, level, growth) = state
    k, y, x = np.array(STIFFNESS), np.array(LIMIT), np.array(strains)

    def total(p):
        # plastic work at level 1 of a move dp is sqrt(sum (y dp)^2); opening only
        step = y * (p - np.array(before))
        work = np.sqrt(np.sum(step**2) + 1e-24)
        barred = 1e3 * abs(min(step[0], 0.0))
        return 0.5 * np.sum(k * (x - p) ** 2) + level * work + 0.5 * growth * work**2 + barred

    starts = [np.array(before), 0.5 * (x + np.array(before)), x]
    least = min(minimize(total, s, method="Nelder-Mead", tol=1e-14).fun for s in starts)
    energy = hooked_energy(STIFFNESS, strains, *arguments(state))
    assert energy == pytest.approx(least, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("strains", STRAINS)
@pytest.mark.parametrize("state", STATES)
def test_stress_is_the_slope_of_the_energy(strains, state):
    def value(d):
        return hooked_energy(STIFFNESS, (strains[0] + d[0], strains[1] + d[1]), *arguments(state))

    stress = np.array(hooked_response(STIFFNESS, strains, *arguments(state))[0])

    def fault(gradient):
        return derivative_fault(
            value, gradient, np.random.default_rng(2), 0.05, curved=False, noise=1e-15
        )

    assert fault(stress) == ""
    assert unnoticed_signs(fault, stress) == []


@pytest.mark.parametrize("strains", STRAINS)
@pytest.mark.parametrize("state", STATES)
def test_tangent_is_the_slope_of_the_stress(strains, state):
    _, (ww, wv, vv) = hooked_response(STIFFNESS, strains, *arguments(state))
    rows = np.array([[ww, wv], [wv, vv]])
    for k in range(2):

        def value(d, k=k):
            moved = strains[0] + d[0], strains[1] + d[1]
            return hooked_response(STIFFNESS, moved, *arguments(state))[0][k]

        def fault(gradient, value=value):
            rng = np.random.default_rng(5)
            return derivative_fault(value, gradient, rng, 0.05, curved=False, noise=2e-12)

        assert fault(rows[k]) == ""
        if np.abs(rows[k]).max() > 1e-9:
            assert unnoticed_signs(fault, rows[k]) == []


def test_stress_after_slip_is_on_the_yield_surface_and_the_slip_stays():
    slip, level = (0.0, 0.0), 1.0
    for strains in [(0.4, 0.5), (0.5, 0.2), (0.1, 0.0)]:
        moved, work = slip_after(STIFFNESS, strains, slip, LIMIT, level, 0.4)
        stress, _ = hooked_response(STIFFNESS, strains, slip, LIMIT, level, 0.4)
        expected = np.array(STIFFNESS) * (np.array(strains) - np.array(moved))
        assert stress == pytest.approx(expected, rel=1e-9)
        level += 0.4 * work
        f = np.hypot(max(stress[0], 0.0) / LIMIT[0], stress[1] / LIMIT[1])
        assert f <= level * (1.0 + 1e-9)
        assert work == 0.0 or f == pytest.approx(level, rel=1e-9)
        slip = moved
    assert slip[0] > 0.2
    # back where it came from, the barbs are pressed together: figure 3.9 of Jouve 2024
    stress, _ = hooked_response(STIFFNESS, (0.0, 0.0), slip, LIMIT, level, 0.4)
    assert stress[0] == pytest.approx(-STIFFNESS[0] * slip[0])


def test_work_of_a_cycle_is_what_slip_spends():
    """Closed in strain: the work done is the dissipation plus what the slip keeps stored."""
    slip, level, growth = (0.0, 0.0), 1.0, 0.4
    path = np.concatenate([np.linspace(0.0, 0.5, 4001), np.linspace(0.5, 0.0, 4001)])
    work, spent, before = 0.0, 0.0, 0.0
    for x, last in zip(path[1:], path[:-1], strict=True):
        stress, _ = hooked_response(STIFFNESS, (x, 0.0), slip, LIMIT, level, growth)
        slip, slipped = slip_after(STIFFNESS, (x, 0.0), slip, LIMIT, level, growth)
        work += 0.5 * (stress[0] + before) * (x - last)
        spent += level * slipped + 0.5 * growth * slipped**2
        level, before = level + growth * slipped, stress[0]
    stored = 0.5 * STIFFNESS[0] * slip[0] ** 2
    assert work == pytest.approx(spent + stored, rel=1e-5)
    assert spent > 0.1 * work


def test_an_open_triangle_resists_nearness_alone():
    """c = (slide, distance): e_ww = (|c|^2 - 1) / 2, 2 e_vw = slide."""
    for slide in (0.0, 0.7, 3.0):
        apart, near = (0.5 * (slide**2 + 1.1**2 - 1.0), slide), (0.5 * (slide**2 - 0.51), slide)
        assert open_energy(STIFFNESS, apart, 1.0) == 0.0
        assert open_response(STIFFNESS, apart, 1.0) == ((0.0, 0.0), (0.0, 0.0, 0.0))
        assert open_energy(STIFFNESS, near, 1.0) == pytest.approx(
            0.5 * 3.0 * 0.3**2, rel=4e-3
        )  # J is rounded by 1e-3
        # barbs that were as near as that when they parted do not mind
        assert open_energy(STIFFNESS, near, 0.69) == 0.0


@pytest.mark.parametrize("nearest", [1.0, 0.9])
@pytest.mark.parametrize("strains", [(-0.3, 0.0), (-0.2, 0.5), (0.3, -1.0)])
def test_stress_and_tangent_of_an_open_triangle_are_slopes(strains, nearest):
    stress, (ww, wv, vv) = open_response(STIFFNESS, strains, nearest)
    rng = np.random.default_rng(8)

    def moved(d):
        return strains[0] + d[0], strains[1] + d[1]

    slopes = [
        (lambda d: open_energy(STIFFNESS, moved(d), nearest), np.array(stress)),
        (lambda d: open_response(STIFFNESS, moved(d), nearest)[0][0], np.array([ww, wv])),
        (lambda d: open_response(STIFFNESS, moved(d), nearest)[0][1], np.array([wv, vv])),
    ]
    for value, gradient in slopes:

        def fault(found, value=value):
            return derivative_fault(value, found, rng, 0.05, curved=False)

        assert fault(gradient) == ""
        assert unnoticed_signs(fault, gradient) == []
