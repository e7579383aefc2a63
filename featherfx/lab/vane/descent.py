"""Downhill to a stable equilibrium where Newton's iterations alone do not find one.

A membrane has no bending stiffness, so where barbs are compressed it may buckle within its plane,
and its stiffness is then indefinite. The stiffness of a step is taken with the stresses

    (1 - t) S + t S+,      S+ the part of S without its negative principal stresses,

with the least t found at which it is definite, and a line search on the energy follows. Near a
minimum t is zero and the convergence quadratic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.lab.vane.system import MembraneSystem

Array = NDArray[np.float64]

LIMIT = 150
# the last step: below this share of the size
CLOSE = 1e-8
# how t grows until the stiffness is definite, and how it falls from one iteration to the next
FIRST, MORE, LESS = 0.1, 0.15, 0.3
SHORTEST = 1e-6
ARMIJO = 1e-4


class NoEquilibrium(Exception):
    """No equilibrium was found; holds the reason."""


def tensile(stresses: Array) -> Array:
    """Stresses (..., 3) of (vv, ww, vw) without their negative principal parts."""
    mean = 0.5 * (stresses[..., 0] + stresses[..., 1])
    half = 0.5 * (stresses[..., 0] - stresses[..., 1])
    radius = np.hypot(half, stresses[..., 2])
    large, small = np.maximum(mean + radius, 0.0), np.maximum(mean - radius, 0.0)
    ratio = np.divide(0.5 * (large - small), radius, out=np.zeros_like(radius), where=radius > 0)
    centre = 0.5 * (large + small)
    return np.stack(
        [centre + ratio * half, centre - ratio * half, ratio * stresses[..., 2]], axis=-1
    )


def descend(
    system: MembraneSystem, positions: Array, shift: Array, accuracy: float
) -> tuple[Array, int] | None:
    """Positions (N, 2) of a minimum and the iterations taken, or None. Raises NoEquilibrium.

    positions: where it begins. shift: (N, 2) m, of the held nodes; zero elsewhere. accuracy: share
    of the energy that a step must win to be followed by another.
    """
    weight = 0.0
    for iteration in range(LIMIT):
        stresses = system.stresses(positions)
        step, gain, weight = _direction(system, positions, stresses, weight, shift)
        length = 1.0 if iteration == 0 else _length(system, positions, step, gain)
        positions = positions + length * step
        shift = np.zeros_like(shift)
        close = np.abs(step).max() < CLOSE * system.size
        if iteration and (close or gain < accuracy * system.energy(positions)):
            return positions, iteration + 1
    return None


def _direction(
    system: MembraneSystem, positions: Array, stresses: Array, weight: float, shift: Array
) -> tuple[Array, float, float]:
    """Newton's step, what it would win (J, twice), and the weight t that it took."""
    convex = tensile(stresses)
    weight = max(0.0, weight - LESS)
    while True:
        found = system.solve(positions, stresses + weight * (convex - stresses), shift)
        if found is not None or weight >= 1.0:
            break
        weight = min(1.0, weight + MORE) if weight > 0.0 else FIRST
    if found is None:
        raise NoEquilibrium("the stiffness is singular")
    step, forces = found
    return step, -float((forces * step).sum()), weight


def _length(system: MembraneSystem, positions: Array, step: Array, gain: float) -> float:
    energy, length = system.energy(positions), 1.0
    if gain < 1e-13 * abs(energy):
        return length
    while length > SHORTEST:
        trial = positions + length * step
        if system.upright(trial) and system.energy(trial) <= energy - ARMIJO * length * gain:
            break
        length *= 0.5
    return length
