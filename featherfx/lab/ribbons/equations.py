"""Equilibrium of a ribbon as differential equations: what the shapes of rest.py are held against.

No line is shared with them: moments and forces instead of an energy, collocation instead of links.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_bvp
from scipy.interpolate import PchipInterpolator

from featherfx.algebra.types import Array
from featherfx.errors import SimulationError
from featherfx.lab.ribbons.energy import Ribbon
from featherfx.lab.ribbons.rest import RibbonRest


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
