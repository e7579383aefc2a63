"""Solutions of rods and ribbons by other means: none of it calls the solver or ribbon.py.

A ribbon's equilibrium is differential equations of moments and forces instead of an energy, with
collocation instead of links.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.linalg import eigh
from scipy.optimize import brentq, root
from scipy.spatial.transform import Rotation
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from featherfx.algebra.types import Array
from featherfx.errors import SimulationError
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.ribbon import RibbonRest


def ruling_rate(value: Array) -> Array:
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


def equations(s: Array, y: Array, ribbon: Ribbon, weight: Array) -> Array:
    """Equilibrium of a ribbon clamped at one end, as differential equations in arc length.

    y: place (3), frame (9, columns across, normal, along), moment in the frame (3), slope t of the
    rulings, p = dE / dt' . With curvatures (c, 0, t c): dE / dc = M_1 + t M_3 and
    dE / dt - p' = c M_3 hold at every place, M' + (c, 0, t c) x M + d_3 x n = 0 and n is the weight
    (3,) per length of what is beyond.
    """
    width, rigidity, nu, k = ribbon.width, ribbon.rigidity, ribbon.poisson, ribbon.rest[0]
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


def solved(ribbon: Ribbon, rest: RibbonRest, frame: Array, gravity: Array) -> Array:
    """(N + 1, 3) m, the points of a rest shape by these equations, near it, from scipy's solve_bvp.

    frame: at the clamp. Raises SimulationError where it finds no solution.
    """
    unknowns, points, frames = rest.unknowns, rest.curve.points, rest.curve.frames
    place = np.linspace(0.0, ribbon.length, len(points))
    t = np.interp(place, ribbon.node_stations, unknowns[ribbon.nodes :])
    guess = np.zeros((17, len(points)))
    guess[:3], guess[3:12], guess[15] = points.T, frames.reshape(-1, 9).T, t
    weight = ribbon.surface_density * ribbon.width * gravity

    def ends(first: Array, last: Array) -> Array:
        start = np.concatenate([np.zeros(3), frame.ravel()])
        return np.concatenate([first[:12] - start, first[16:], last[12:15], last[16:]])

    found = solve_bvp(
        lambda s, y: equations(s, y, ribbon, weight), ends, place, guess, tol=1e-5, max_nodes=20000
    )
    if found.status != 0:
        raise SimulationError("ribbon", 0.0, f"no solution of its equations: {found.message}")
    return np.stack([np.interp(place, found.x, found.y[k]) for k in range(3)], axis=1)


def shell_moment(curvature: Array, width: float, thickness: float, poisson: float) -> Array:
    """Moment over D w (1/m) of a strip of thin shell bent along itself to curvatures above 0.

    Its section curls: the height z over its middle costs D / 2 (k^2 + z''^2 + 2 nu k z'') of
    bending and Y h / 2 (k z)^2 of stretching, Y h = 12 (1 - nu^2) D / h^2, the edges free. With
    t = w (3 (1 - nu^2) k^2 / h^2)^(1/4) the least of it is D w k^2 / 2 (1 - nu^2 F),
    F = 2 g / t, g = (cosh t - cos t) / (sinh t + sin t): a beam where the strip is thick, a plate
    where it is thin (Lamb 1891). The moment is its derivative by k.
    """
    t = width * (3.0 * (1.0 - poisson**2)) ** 0.25 * np.sqrt(curvature / thickness)
    # both over the exponential, which overflows
    small, e = np.exp(-t), np.exp(-2.0 * t)
    below = 0.5 * (1.0 - e) + small * np.sin(t)
    g = (0.5 * (1.0 + e) - small * np.cos(t)) / below
    slope = 1.0 - g * (0.5 * (1.0 + e) + small * np.cos(t)) / below
    return np.asarray(curvature * (1.0 - poisson**2 * (1.5 * g / t + 0.5 * slope)))


def shell_tip(load: float, width: float, thickness: float, poisson: float) -> Array:
    """(2,) reach and drop, over its length, of such a strip clamped level under its weight.

    load: weight per length times length^3 over D w. width, thickness: over the length.
    """
    curvature = np.geomspace(1e-6, 10.0 * load, 4000)
    moment = shell_moment(curvature, width, thickness, poisson)
    bent = PchipInterpolator(np.append(0.0, moment), np.append(0.0, curvature))

    def slope(s: Array, y: Array) -> Array:
        return np.stack([bent(y[1]), -load * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    place = np.linspace(0.0, 1.0, 101)
    fall = 0.5 * np.pi * (1.0 - (1.0 - place) ** 8)
    guess = np.stack([fall, 4.0 * np.pi * (1.0 - place) ** 7, 0.2 * place, 0.8 * place])
    found = solve_bvp(
        slope, lambda a, b: np.append(a[[0, 2, 3]], b[1]), place, guess, tol=1e-6, max_nodes=20000
    )
    if found.status != 0:
        raise SimulationError("shell", 0.0, f"no solution of its equations: {found.message}")
    return np.asarray(found.y[2:, -1])


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
