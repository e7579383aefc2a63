"""Statics: one feather brought to rest under its loads by ever longer implicit Euler steps.

Each step starts at rest (no velocity is carried over), so the elastic and potential energy can
only fall; as the step grows, what is left is the equilibrium. Short steps at first keep large
deformations on a path that Newton can follow.

The pressure of wind follows the vane: it has no energy to be minimised. With the areas and normals
of the vane held as a, the pose at rest is a minimum and gives areas g(a). At rest g(a) = a, found
by Anderson's mixing of the last DEPTH pairs (a, r = g(a) - a):

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

from featherfx.algebra.types import Array
from featherfx.feather.types import both
from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.node_kernels import blow
from featherfx.mechanics.vane_hook_kernels import copy_gaps
from featherfx.solver.state import State
from featherfx.solver.status import CONVERGED, NO_REST, NOT_CONVERGED
from featherfx.solver.step.gap_kernels import give_way, slip_of_step
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.step.newton_kernels import UNKNOWN, Goal, minimise
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.work import Work, no_strains

FIRST, LAST, SHORTEST, GROWTH = 1e-2, 1e4, 1e-7, 8.0  # step lengths, s
ITERATIONS, STEPS = 100, 80
STATIC = 1e4  # s, a step after which hardly any inertia is left
DEPTH, MIXED, RIDGE = 6, 0.3, 1e-10
# part of all areas that counts as no change; mixing steps; as many as may pass without progress
SETTLED, MIXINGS, PATIENCE = 1e-5, 60, 12
# in wind: of Newton, a step; number of short steps
WIND_ITERATIONS, WIND_STEPS = 25, 30


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
    status = _settle_in_wind(rest) if in_wind else _settle_still(rest)
    return status, rest.iterations


class Rest:
    """One feather on its way to rest: takes steps from rest and keeps what they lead to.

    Arguments as those of settle. iterations: Newton's, so far.
    """

    def __init__(
        self,
        model: Model,
        loads: Loads,
        f: int,
        fraction: float,
        state: State,
        tolerance: float,
        work: Work,
    ) -> None:
        self.model, self.loads, self.f, self.fraction = model, loads, f, fraction
        self.state, self.tolerance, self.work = state, tolerance, work
        self.iterations = 0
        _stop(f, state)
        self.load()
        work.around.reference.assign(no_strains(model))
        if model.hooked:
            copy_gaps(state.gaps_of(f), work.around.gaps)

    def load(self) -> None:
        """Take the pose that was kept last."""
        load_pose(self.model, self.f, self.state, self.work.now)
        self.work.now.points.assign(self.state.points.at(self.f))

    def keep(self) -> None:
        """The pose now becomes the state's."""
        state, f, now = self.state, self.f, self.work.now
        state.rotation[f], state.centre[f] = now.rotation, now.centre
        state.coefficient[f] = now.coefficient
        state.points.at(f).assign(now.points)
        for step in range(2):
            state.strains.at(f, step).assign(now.strains)
        if self.model.hooked:
            self._let_slip()

    def _let_slip(self) -> None:
        """Gaps slip and open as they do after a step."""
        before, after = self.work.around.gaps, self.work.gaps
        slip_of_step(self.model, self.f, self.work.now.strains.cell, before, after)
        give_way(self.model, self.f, self.work.now.strains.cell, before, after)
        copy_gaps(after, before)
        copy_gaps(after, self.state.gaps_of(self.f))

    def feel_wind(self) -> None:
        """Wind, areas and speeds at the pose now."""
        still, time = self.state.velocity.nodes[self.f], self.state.time[self.f]
        around, stiffness = self.work.around, self.model.cell_stiffness[self.f]
        blow(self.work.now.points.nodes, time, self.loads, self.f, still, stiffness, around)

    def step(self, h: float, limit: int) -> int:
        """One step of h (s) from rest, in the air around as it is; returns Newton's status."""
        now, around = self.work.now, self.work.around
        for held in (around.target, around.past):
            held.assign(now.points)
        factors = Factors(1.0 / (h * h), 1.0 / h, 0.0)
        solved = minimise(
            self.model,
            self.loads,
            self.f,
            self.fraction,
            factors,
            Goal(self.tolerance, limit, UNKNOWN, True),
            self.work,
        )
        self.iterations += solved.iterations
        return int(solved.status)


def _stop(f: int, state: State) -> None:
    for rate in (*state.rates(), state.step):
        rate[f] = 0.0


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


def _settle_in_wind(rest: Rest) -> int:
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
        if rest.step(STATIC, WIND_ITERATIONS) != CONVERGED:
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
    """Short steps towards rest; returns Newton's status, CONVERGED if any step could be solved."""
    h, before, best = FIRST, None, NOT_CONVERGED
    for _ in range(WIND_STEPS):
        start = both(np.copy, rest.work.now.points)
        rest.feel_wind()
        status = rest.step(h, WIND_ITERATIONS)
        best = CONVERGED if CONVERGED in (best, status) else status
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                break
            rest.load()
            continue
        rest.keep()
        way = both(np.subtract, rest.work.now.points, start)
        if before is not None:
            h *= 2.0 if sum(map(np.vdot, way, before)) > 0.0 else 0.5
        h = min(max(h, 1e3 * SHORTEST), STATIC)
        before = way
    rest.load()
    return best
