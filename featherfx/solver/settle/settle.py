"""Statics: one feather brought to rest under its loads by ever longer implicit Euler steps.

Each step starts at rest (no velocity is carried over), so the elastic and potential energy can
only fall; as the step grows, what is left is the equilibrium. Short steps at first keep large
deformations on a path that Newton can follow. Wind has no energy: see wind.py.
"""

from __future__ import annotations

from featherfx.mechanics.model import Loads, Model
from featherfx.solver.settle.still_steps import Rest
from featherfx.solver.settle.wind import settle_in_wind
from featherfx.solver.state import State
from featherfx.solver.status import CONVERGED, NOT_CONVERGED
from featherfx.solver.work import Work

FIRST, LAST, SHORTEST, GROWTH = 1e-2, 1e4, 1e-7, 8.0  # step lengths, s
ITERATIONS, STEPS = 100, 80


def settle(
    model: Model, loads: Loads, f: int, fraction: float, state: State, tolerance: float, work: Work
) -> tuple[int, int]:
    """Bring feather f of the state to rest, in place; its velocities become zero.

    fraction: 0..1, place within the loads' frame. tolerance: m, distance of a step from its
    solution. Returns (Newton status or NO_REST, iterations).
    """
    rest = Rest(model, loads, f, fraction, state, tolerance, work)
    blowing = bool(loads.wind_mean[f].any() or loads.wind_amplitude.any())
    in_wind = loads.air[0] > 0.0 and blowing
    status = settle_in_wind(rest) if in_wind else _settle_still(rest)
    return status, rest.iterations


def _settle_still(rest: Rest) -> int:
    """Ever longer steps; returns Newton's status."""
    h, status = FIRST, CONVERGED
    if rest.loads.air[0] > 0.0:
        rest.feel_wind()
    for _ in range(STEPS):
        status = rest.step(h, ITERATIONS)
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                return status
            rest.load()
            continue
        rest.keep()
        if h >= LAST:
            return CONVERGED
        h *= GROWTH
    return NOT_CONVERGED if status == CONVERGED else status
