"""Solutions of rods by other means than the solver: none of it calls into featherfx."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh
from scipy.optimize import brentq, root
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from featherfx.algebra.types import Array
from featherfx.errors import SimulationError

# roots of cosh x cos x = -1: wave numbers times length of a clamped-free beam
WAVE_NUMBERS = np.array([1.8751040687, 4.6940911330, 7.8547574382, 10.9955407349])


def elastica_tip(load: float) -> tuple[float, float]:
    """(x, deflection) / L of a cantilever under a dead transverse tip force, load = F L^2 / EI.

    Bisshopp and Drucker 1945: with modulus k = sqrt((1 + sin t) / 2), t the tip's slope, and
    amplitude a with sin a = 1 / (k sqrt 2), sqrt(load) = K(k) - F(a, k), deflection / L =
    1 - 2 (E(k) - E(a, k)) / sqrt(load), x / L = sqrt(2 sin t / load).
    """

    def excess(slope: float) -> float:
        m = 0.5 * (1.0 + np.sin(slope))
        amplitude = np.arcsin(1.0 / np.sqrt(2.0 * m))
        return float(ellipk(m) - ellipkinc(amplitude, m) - np.sqrt(load))

    slope = brentq(excess, 1e-9, 0.5 * np.pi - 1e-9, xtol=1e-14)
    m = 0.5 * (1.0 + np.sin(slope))
    amplitude = np.arcsin(1.0 / np.sqrt(2.0 * m))
    drop = 1.0 - 2.0 * (ellipe(m) - ellipeinc(amplitude, m)) / np.sqrt(load)
    return float(np.sqrt(2.0 * np.sin(slope) / load)), float(drop)


def _cross_matrix(vector: Array) -> Array:
    """(3, 3) matrix that multiplies as the cross product with a vector (3,) does."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def kirchhoff_tip(
    length: float,
    stiffness: Sequence[float] | Array,
    tip_force: Sequence[float],
    weight: float = 0.0,
    taper: float = 0.0,
    curvature: float = 0.0,
) -> Array:
    """(3,) tip of an inextensible clamped rod, by shooting from the free end.

    stiffness: (GJ, EI about d2, EI about d3) at the clamp, times c^4; weight: N/m along -z at the
    clamp, times c^2; c = 1 - taper s / length. curvature: at rest, about d3. Equations: r' = d1,
    m' = n x d1, n = tip_force + weight beyond s, m.d_i = B_i (k_i - k0_i), d_i' = k x d_i.
    Unknown: the tip's rotation, found by continuation in the load so that the clamp's is none.
    """
    stiffness, force = np.asarray(stiffness, float), np.asarray(tip_force, float)

    def beyond(s: float) -> float:
        if taper == 0.0:
            return weight * (length - s)
        cube = [(1.0 - taper * x / length) ** 3 for x in (s, length)]
        return weight * length / (3.0 * taper) * (cube[0] - cube[1])

    def back(rotation: Rotation, factor: float, accuracy: float) -> Array:
        def slope(s: float, y: Array) -> Array:
            frame = y[6:].reshape(3, 3)
            n = factor * (force - [0.0, 0.0, beyond(s)])
            bend = stiffness * (1.0 - taper * s / length) ** 4
            bent = frame @ (frame.T @ y[3:6] / bend + [0.0, 0.0, curvature])
            turned = _cross_matrix(bent) @ frame
            return np.concatenate([frame[:, 0], _cross_matrix(n) @ frame[:, 0], turned.ravel()])

        start = np.concatenate([np.zeros(6), rotation.as_matrix().ravel()])
        span = (length, 0.0)
        run = solve_ivp(slope, span, start, "DOP853", rtol=accuracy, atol=0.1 * accuracy)
        return np.asarray(run.y[:, -1])

    tip = Rotation.from_rotvec([0.0, 0.0, curvature * length])
    load = (np.linalg.norm(tip_force) + weight * length) * length**2 / stiffness.min()
    factors = np.linspace(0.0, 1.0, 4 + int(4 * np.log2(1 + load)))[1:] ** 2
    change = np.zeros(3)
    for factor, accuracy in [*((each, 1e-5) for each in factors), (1.0, 1e-10)]:

        def miss(
            vector: Array, factor: float = factor, accuracy: float = accuracy, tip: Rotation = tip
        ) -> Array:
            end = back(Rotation.from_rotvec(vector) * tip, factor, accuracy)
            # the nearest rotation: integration keeps the frame orthonormal to its accuracy only
            return np.asarray(Rotation.from_matrix(end[6:].reshape(3, 3)).as_rotvec())

        found = root(miss, change, method="hybr", tol=10.0 * accuracy)
        if np.linalg.norm(found.fun) >= 1e3 * accuracy:
            raise SimulationError("reference rod", 0.0, "shooting found no solution")
        change = 0.5 * found.x
        tip = Rotation.from_rotvec(found.x) * tip
    return -back(tip, 1.0, 1e-10)[:3]


def taper_frequencies(length: float, ei: float, mass: float, taper: float, count: int) -> Array:
    """(count,) Hz of a clamped rod bending in one plane, by Rayleigh and Ritz.

    Trial functions s^2 times Legendre polynomials; the integrals are exact.
    """
    size = 14
    nodes, weights = np.polynomial.legendre.leggauss(40)
    s, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    shapes, curved = [], []
    for k in range(size):
        polynomial = np.polynomial.Legendre.basis(k, domain=[0.0, 1.0]).convert(
            kind=np.polynomial.Polynomial, domain=[-1, 1], window=[-1, 1]
        )
        full = polynomial * np.polynomial.Polynomial([0.0, 0.0, 1.0])
        shapes.append(full(s))
        curved.append(full.deriv(2)(s))
    c = 1.0 - taper * s
    stiff = np.einsum("as,bs,s->ab", curved, curved, weights * c**4)
    heavy = np.einsum("as,bs,s->ab", shapes, shapes, weights * c**2)
    values = eigh(stiff, heavy, eigvals_only=True)[:count]
    return np.asarray(np.sqrt(values * ei / mass) / length**2 / (2.0 * np.pi))


def link_chain(
    links: int, length: float, ei: float, mass: float, weight: float, times: Array
) -> Array:
    """(T, 2) tip (x, z) of a rod let go from the horizontal, as a chain of rigid links.

    Point masses at the joints and the tip, springs EI / l between links and 2 EI / l at the clamp;
    unknowns are the links' slopes below the horizontal, integrated by an implicit Runge-Kutta
    method.
    """
    step = length / links
    lumped = np.full(links, mass * step)
    lumped[-1] *= 0.5
    # mass carried by both links a and b: all joints beyond the outer one
    carried = np.cumsum(lumped[::-1])[::-1]
    both = carried[np.maximum.outer(np.arange(links), np.arange(links))] * step**2
    spring = np.full(links, ei / step)
    spring[0] *= 2.0

    def slope(_: float, y: Array) -> Array:
        angle, rate = y[:links], y[links:]
        apart = angle[:, None] - angle[None, :]
        bend = spring * np.diff(angle, prepend=0.0)
        moment = np.append(bend[1:], 0.0) - bend
        push = weight / mass * carried * step * np.cos(angle)
        whirl = (both * np.sin(apart)) @ rate**2
        return np.concatenate([rate, np.linalg.solve(both * np.cos(apart), moment + push - whirl)])

    run = solve_ivp(
        slope, (0.0, times[-1]), np.zeros(2 * links), "Radau", times, rtol=1e-6, atol=1e-8
    )
    angle = run.y[:links]
    return np.stack([step * np.cos(angle).sum(0), -step * np.sin(angle).sum(0)], axis=1)


def heavy_elastica(load: float) -> tuple[float, float]:
    """(x, drop) / L of the tip of a planar cantilever under its weight, load = w L^3 / EI.

    With p the angle from the vertical, s from clamp to tip: p'' = load (1 - s) sin p, p(0) = pi/2,
    p'(1) = 0, by shooting with the logarithm of p at the tip, which is as small as
    exp(-2/3 sqrt(load)). Then x = integral of sin p, drop = integral of cos p.
    """

    def shoot(logarithm: float) -> Array:
        def slope(s: float, y: Array) -> Array:
            angle, rate = y[0], y[1]
            return np.array([-rate, -load * s * np.sin(angle), np.sin(angle), np.cos(angle)])

        def upright(_: float, y: Array) -> float:
            return float(y[0] - np.pi)

        upright.terminal = True  # type: ignore[attr-defined]
        first = np.exp(logarithm)
        # s from the tip here; rates are by s from the clamp
        start = np.array([first, 0.0, 0.0, 0.0])
        run = solve_ivp(
            slope, (0.0, 1.0), start, "LSODA", events=upright, rtol=1e-10, atol=1e-12 * first
        )
        return np.asarray(run.y[:, -1])

    low = -2.0 - np.sqrt(load)
    found = brentq(lambda x: shoot(x)[0] - 0.5 * np.pi, low, np.log(0.5 * np.pi), xtol=1e-12)
    end = shoot(found)
    return float(end[2]), float(end[3])
