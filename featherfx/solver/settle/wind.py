"""Statics in wind, whose pressure follows the vane: it has no energy to be minimised.

With the areas and normals of the vane held as a, the pose at rest is a minimum and gives areas
g(a). At rest g(a) = a, found by Anderson's mixing of the last DEPTH pairs (a, r = g(a) - a):

    a+ = a - dA c + s (r - dR c),        c = argmin |r - dR c|

dA, dR their differences from the last one, s MIXED. Taking g(a) itself oscillates from some 3 m/s
on, because the vane swings through the wind. Source: Anderson 1965; Walker and Ni 2011.

Where that fails the feather is carried along by short steps that start at rest, in air that is
felt anew before each; they grow while the feather goes on in one way and shrink where it turns
back. Then mixing is tried once more. A feather that flutters has no rest in wind: it is left in
the pose that those steps led to.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.settle.still_steps import Rest
from featherfx.solver.status import CONVERGED, NO_REST

Array = NDArray[np.float64]

STATIC = 1e4  # s, a step after which hardly any inertia is left
DEPTH, MIXED, RIDGE = 6, 0.3, 1e-10
# part of all areas that counts as no change; mixing steps; as many as may pass without progress
SETTLED, MIXINGS, PATIENCE = 1e-5, 60, 12
ITERATIONS = 25  # of Newton, a step
# short steps: the first and the shortest (s), their number
FIRST, SHORTEST, STEPS = 1e-2, 1e-7, 30


def settle_in_wind(rest: Rest) -> int:
    """Bring a feather to rest; returns CONVERGED, Newton's status or NO_REST."""
    if _mix(rest):
        return CONVERGED
    rest.load()
    status = _drift(rest)
    if status != CONVERGED or _mix(rest):
        return status
    return NO_REST


def _mix(rest: Rest) -> bool:
    """Find areas that the pose in them gives back; whether they were found."""
    around = rest.work.around
    rest.feel_wind()
    areas, least, waited = around.area.copy(), np.inf, 0
    pairs: deque[tuple[Array, Array]] = deque(maxlen=DEPTH)
    for _ in range(MIXINGS):
        around.area[:] = areas
        if rest.step(STATIC, ITERATIONS) != CONVERGED:
            return False
        rest.feel_wind()
        change = around.area - areas
        left = float(np.linalg.norm(change))
        if left <= SETTLED * float(np.linalg.norm(around.area)):
            rest.keep()
            return True
        waited = 0 if left < 0.9 * least else waited + 1
        least = min(least, left)
        if waited > PATIENCE:
            return False
        pairs.append((areas.ravel(), change.ravel()))
        areas = mixed(pairs).reshape(areas.shape)
    return False


def mixed(pairs: deque[tuple[Array, Array]]) -> Array:
    """The next guess from pairs of guesses and changes, both (K,), the last one at the end."""
    guess, change = pairs[-1]
    if len(pairs) == 1:
        return guess + MIXED * change
    guesses = np.stack([guess - other for other, _ in list(pairs)[:-1]], axis=1)
    changes = np.stack([change - other for _, other in list(pairs)[:-1]], axis=1)
    normal = changes.T @ changes
    normal += RIDGE * np.trace(normal) * np.eye(len(normal))
    weights = np.linalg.solve(normal, changes.T @ change)
    result: Array = guess - guesses @ weights + MIXED * (change - changes @ weights)
    return result


def _drift(rest: Rest) -> int:
    """Short steps towards rest; returns Newton's status."""
    h, before, status = FIRST, None, CONVERGED
    for _ in range(STEPS):
        start = rest.work.now.points.copy()
        rest.feel_wind()
        status = rest.step(h, ITERATIONS)
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                return status
            rest.load()
            continue
        rest.keep()
        way = rest.work.now.points - start
        if before is not None:
            h *= 2.0 if np.vdot(way, before) > 0.0 else 0.5
        h = min(max(h, 1e3 * SHORTEST), STATIC)
        before = way
    return status
