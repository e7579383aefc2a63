"""Rods that buckle out of their plane, against the stability of the rod's own equations.

The critical loads come from a Bessel function's root, or from the second variation of the planar
rod's energy, discretised here with linear elements on a fine grid. The solver's are where the
stiffness against a small force across the plane vanishes.
"""

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import jv

from featherfx.lab.ribbons.rod import Rod, clamped, rod_loads, rod_model, tributary_length
from featherfx.solver.solver import Settings, Solver

pytestmark = pytest.mark.verification

SIDEWAYS = 1e-6


def stiffness_across(rod, state, forces, axis):
    """Force over displacement of the tip across the plane, N/m, and the settled state.

    forces: (n, 3) N on the rows. axis: 0..2 of the small force.
    """
    model = rod_model(rod)
    loads = rod_loads(rod)
    loads.force[0, :, 0] = forces
    loads.force[0, -1, 0, axis] += SIDEWAYS * rod.ei / rod.length**2
    solver = Solver(model, Settings(newton=1e-12 * rod.length))
    state, status, _ = solver.equilibrium(clamped(model) if state is None else state, loads)
    assert status[0] == 0
    return SIDEWAYS * rod.ei / rod.length**2 / state.centre[0, -1, axis], state


def critical(stiffness, first, second):
    """Where a stiffness vanishes that is linear in the square of the load near there."""
    a, b = stiffness(first), stiffness(second)
    assert 0.0 < b < 0.5 * a
    return np.sqrt(second**2 + (second**2 - first**2) * b / (a - b))


def first_root(order, low, high):
    return brentq(lambda z: jv(order, z), low, high, xtol=1e-12)


def test_lateral_buckling_under_a_tip_load():
    """Michell 1899, Prandtl 1899: b'' + (P (L - s))^2 b / (EI GJ) = 0, b(0) = b'(L) = 0, solved by
    sqrt(x) J_1/4(P x^2 / 2 sqrt(EI GJ)), x = L - s: the first root of J_-1/4 doubled, 4.0126."""
    weak, torsion, length = 2e-3, 7e-4, 0.4
    unit = np.sqrt(weak * torsion) / length**2
    expected = 2.0 * first_root(-0.25, 1.5, 2.5) * unit
    assert expected / unit == pytest.approx(4.0126, abs=1e-4)
    rod = Rod(length, weak, ei2=2000.0 * weak, gj=torsion)

    def stiffness(load):
        forces = np.zeros((rod.segments + 1, 3))
        forces[-1, 2] = -load
        return stiffness_across(rod, None, forces, 1)[0]

    assert critical(stiffness, 0.95 * expected, 0.99 * expected) == pytest.approx(
        expected, rel=3e-3
    )


def test_lateral_buckling_of_a_ribbon_under_its_weight():
    """The same with w (L - s)^2 / 2 for P (L - s): 6 times the first root of J_-1/6, 12.853."""
    weak, torsion, length = 1e-3, 2e-3, 0.3
    unit = np.sqrt(weak * torsion) / length**3
    expected = 6.0 * first_root(-1.0 / 6.0, 1.7, 2.6) * unit
    assert expected / unit == pytest.approx(12.853, abs=1e-3)
    rod = Rod(length, weak, ei2=5000.0 * weak, gj=torsion)

    def stiffness(weight):
        forces = np.zeros((rod.segments + 1, 3))
        forces[:, 2] = -weight * tributary_length(rod)
        return stiffness_across(rod, None, forces, 1)[0]

    assert critical(stiffness, 0.95 * expected, 0.99 * expected) == pytest.approx(
        expected, rel=3e-3
    )


def planar(curvature, weight):
    """(s, angle from the vertical, curvature) of a hanging rod of unit length and EI.

    k' = w (1 - s) sin(angle), angle' = k, angle(0) = 0, k(1) = rest curvature.
    """
    s = np.linspace(0.0, 1.0, 101)

    guess = np.stack([curvature * s, 0.0 * s + curvature])
    for part in np.linspace(0.0, 1.0, 12)[1:]:

        def slope(x, y, part=part):
            return np.stack([y[1], part * weight * (1.0 - x) * np.sin(y[0])])

        found = solve_bvp(slope, lambda a, b: np.array([a[0], b[1] - curvature]), s, guess)
        assert found.success
        guess = found.sol(s)
    return s, guess[0], guess[1]


def lowest_variation(curvature, weight, torsion):
    """Lowest eigenvalue of the second variation of energy out of the plane.

    The frame is turned by a t + b n (t tangent, n normal in the plane), so that twist and
    curvature about n change by a' - k b and b' + k a, curvature about the binormal by
    -1/2 (a b' - b a' + k (a^2 + b^2)) and the tangent, to second order, by 1/2 (a b n - b^2 t):

    2 W = int GJ (a' - k b)^2 + EI (b' + k a)^2 - m (a b' - b a' + k (a^2 + b^2))
              + N_t b^2 - N_n a b ds,      m = EI (k - k0),  N the weight beyond s
    """
    s, angle, k = planar(curvature, weight)
    h = s[1] - s[0]
    middle = 0.5 * (s[1:] + s[:-1])
    angle, k = 0.5 * (angle[1:] + angle[:-1]), 0.5 * (k[1:] + k[:-1])
    beyond = weight * (1.0 - middle)
    along, across = beyond * np.cos(angle), -beyond * np.sin(angle)
    moment = k - curvature
    count = len(s)
    matrix = np.zeros((2 * count, 2 * count))
    mean, rate = np.array([0.5, 0.5]), np.array([-1.0, 1.0]) / h
    none = np.zeros(2)
    for e in range(count - 1):
        a, b = np.r_[mean, none], np.r_[none, mean]
        da, db = np.r_[rate, none], np.r_[none, rate]
        twist, bend = da - k[e] * b, db + k[e] * a
        part = torsion * np.outer(twist, twist) + np.outer(bend, bend)
        both = np.outer(a, db) - np.outer(b, da)
        part -= moment[e] * (0.5 * (both + both.T) + k[e] * (np.outer(a, a) + np.outer(b, b)))
        part += along[e] * np.outer(b, b)
        part -= 0.5 * across[e] * (np.outer(a, b) + np.outer(b, a))
        places = np.array([e, e + 1, count + e, count + e + 1])
        matrix[np.ix_(places, places)] += h * part
    free = np.r_[1:count, count + 1 : 2 * count]
    return eigh(matrix[np.ix_(free, free)], eigvals_only=True, subset_by_index=[0, 0])[0] / h


def test_out_of_plane_buckling_of_a_curved_hanging_rod():
    """Romero et al. 2021, bend-twist: clamped vertically, curved to nearly a circle at rest. The
    weight unbends it within its plane, until it gives way to the side."""
    curvature, torsion, length, ei = 6.0, 0.7, 0.25, 3e-3
    expected = brentq(lambda w: lowest_variation(curvature, w, torsion), 10.0, 13.5, xtol=1e-3)
    rod = Rod(length, ei, gj=torsion * ei, rest_curvature=curvature / length, segments=80)
    state = None

    def stiffness(weight):
        nonlocal state
        for part in np.linspace(0.3, 1.0, 6) if state is None else (1.0,):
            forces = np.zeros((rod.segments + 1, 3))
            forces[:, 0] = part * weight * ei / length**3 * tributary_length(rod)
            value, state = stiffness_across(rod, state, forces, 2)
        return value

    found = critical(stiffness, 0.97 * expected, 0.99 * expected)
    assert found == pytest.approx(expected, rel=5e-3)
