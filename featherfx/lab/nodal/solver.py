"""The solver of the nodal kinematics: the reference that the default one is measured against.

Statics, the system at a pose, and the first acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem
from featherfx.feather.types import both
from featherfx.lab.nodal.assembly_kernels import nodal_assemble
from featherfx.lab.nodal.model import NodalModel
from featherfx.lab.nodal.newton_kernels import Minimiser, evaluate, move_by, nodal_minimise
from featherfx.lab.nodal.state import NodalState, NodalWork, make_nodal_work
from featherfx.lab.nodal.step_kernels import NodalFrame, keep_state, load_state, nodal_advance
from featherfx.mechanics.air_kernels import blow
from featherfx.mechanics.model import Loads, Model, expand_wind
from featherfx.solver.settle_kernels import (
    FIRST_SETTLE_STEP,
    MAX_SETTLE_STEPS,
    MIN_SETTLE_STEP,
    SETTLE_STEP_GROWTH,
    STATIC_STEP,
)
from featherfx.solver.solver import HARD_STEP_WORK, RootPath, Settings, StepReport, step_settings
from featherfx.solver.state import make_report
from featherfx.solver.status import CONVERGED
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import IntegratorFactors


def nodal_settle(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    fraction: float,
    state: NodalState,
    method: Minimiser,
    work: NodalWork,
) -> tuple[int, int]:
    """Bring feather f of the state to rest, in place, by ever longer implicit Euler steps.

    As settle_feathers of solver/settle_kernels.py, without its first long step. method: of its
    steps. Returns (Newton status, iterations).
    """
    around, now = work.around, work.now
    points = *state.velocity, *state.acceleration, *state.smoothed
    for rate in (*points, state.spin, state.step):
        rate[f] = 0.0
    around.reference[:], around.carried[:] = 0.0, 0.0
    h, iterations, status = FIRST_SETTLE_STEP, 0, CONVERGED
    for _ in range(MAX_SETTLE_STEPS):
        load_state(state, f, work)
        for held in (around.target, around.past):
            held.assign(now.points)
        if loads.air[0] > 0.0:
            time, still = state.time[f], state.velocity.nodes[f]
            blow(now.points.nodes, time, loads, f, still, model, around)
        factors = IntegratorFactors(1.0 / (h * h), 1.0 / h, 0.0)
        solved = nodal_minimise(model, nodal, loads, f, fraction, factors, method, work)
        status, iterations = solved.status, iterations + solved.iterations
        if status != CONVERGED:
            h *= 0.25
            if h < MIN_SETTLE_STEP:
                break
            continue
        keep_state(f, state, work)
        if h >= STATIC_STEP:
            break
        h *= SETTLE_STEP_GROWTH
    state.strains[f, 1] = state.strains[f, 0]
    return int(status), int(iterations)


def nodal_system(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    inertia: float,
    state: NodalState,
    work: NodalWork,
) -> float:
    """Assemble at feather f's pose of the state: work.system holds Hessian and minus gradient.

    inertia: 1/s^2, times the mass about the pose itself; 0 for the stiffness alone. Geometric
    stiffness is that of the pose's own stresses. Returns the energy (J).
    """
    now, around = work.now, work.around
    load_state(state, f, work)
    for held in (around.target, around.past):
        held.assign(now.points)
    around.reference[:] = 0.0
    factors = IntegratorFactors(inertia, 0.0, 0.0)
    energy = evaluate(model, nodal, loads, f, 0.0, factors, now, work)
    work.before[:] = now.strains
    nodal_assemble(model, nodal, loads, f, 0.0, factors, True, work)
    return float(energy)


def nodal_start(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    duration: float,
    state: NodalState,
    work: NodalWork,
) -> None:
    """Set the accelerations of feather f, in place, to those that its loads give at rest.

    As start_acceleration of featherfx/solver/step/start_kernels.py; duration: s.
    """
    square = duration**2
    nodal_system(model, nodal, loads, f, 1.0 / square, state, work)
    system, now, trial = work.system, work.now, work.trial
    if not factorise(system.band, system.panel):
        return
    solve_factored(system.band, system.right)
    move_by(model, nodal, f, 1.0, True, work)
    rates = both(lambda after, before: (after - before) / square, trial.points, now.points)
    for kept in (state.acceleration, state.smoothed):
        kept.at(f).assign(rates)


Method = Literal["improved", "textbook"]

# Newton iterations of a step at most; the improved method gives up early and halves the step
_LIMITS = {"improved": 30, "textbook": 50}
_SETTLE_LIMITS = {"improved": 60, "textbook": 200}


@dataclass(frozen=True)
class NodalSystem:
    """Energy (J) and linear system of one feather at a pose: stiffness band[j, d] of unknowns j
    and j + d, (N, B + 1), and gradient (N,); N, numbered by NodalModel.slot."""

    energy: float
    band: Array
    gradient: Array


class NodalSolver:
    """Steps a batch in the nodal kinematics; shape and settings are those of Solver.

    model, nodal: constant data. method: "improved", or "textbook" for projected Newton with a line
    search on the whole energy, which is kept as a measure. Raises InputError for another method.
    """

    def __init__(
        self, model: Model, nodal: NodalModel, settings: Settings, method: Method = "improved"
    ) -> None:
        if method not in _LIMITS:
            message = f"'{method}' is not one of {', '.join(_LIMITS)}"
            raise InputError(Problem("", "method", message))
        self.model, self.nodal, self.settings, self.method = model, nodal, settings, method
        self._work: NodalWork = make_nodal_work(model, nodal)

    @property
    def _textbook(self) -> bool:
        return self.method == "textbook"

    def step(
        self, state: NodalState, loads: Loads, path: RootPath, duration: float
    ) -> tuple[NodalState, StepReport]:
        """Advance all feathers by a duration in s; the given state is not changed.

        A feather that cannot be solved stays at its last good sub-step and has a status in the
        report: see raise_if_failed of featherfx/solver/solver.py.
        """
        new, loads = state.copy(), expand_wind(loads, self.model.feathers)
        report, limit = make_report(self.model.feathers), _LIMITS[self.method]
        hard = limit if self._textbook else HARD_STEP_WORK
        for f in range(self.model.feathers):
            if new.step[f] == 0.0:
                nodal_start(self.model, self.nodal, loads, f, duration, new, self._work)
            settings = step_settings(self.settings, duration, self.model.length[f].sum())
            settings = settings._replace(iterations=limit, hard=hard)
            frame = NodalFrame(path, settings, self._textbook)
            nodal_advance(self.model, self.nodal, loads, f, frame, new, self._work, report)
        return new, report

    def equilibrium(
        self, state: NodalState, loads: Loads, fraction: float = 0.0
    ) -> tuple[NodalState, Array, Array]:
        """Bring all feathers to rest under their loads; the given state is not changed.

        fraction: 0..1, place within the loads' frame (grips). Returns the state, and per feather
        the status (0: at rest within settings.newton) and the Newton iterations.
        """
        new, loads = state.copy(), expand_wind(loads, self.model.feathers)
        status = np.zeros(self.model.feathers)
        iterations = np.zeros(self.model.feathers)
        method = Minimiser(self.settings.newton, _SETTLE_LIMITS[self.method], self._textbook)
        for f in range(self.model.feathers):
            status[f], iterations[f] = nodal_settle(
                self.model, self.nodal, loads, f, fraction, new, method, self._work
            )
        return new, status, iterations

    def system(
        self, state: NodalState, loads: Loads, feather: int, inertia: float = 0.0
    ) -> NodalSystem:
        """Energy, stiffness and gradient of one feather's pose, at rest.

        inertia: 1/s^2, times the mass that is added to the stiffness.
        """
        energy = nodal_system(self.model, self.nodal, loads, feather, inertia, state, self._work)
        size = int(self.nodal.size[feather])
        system = self._work.system
        return NodalSystem(energy, system.band[:size].copy(), -system.right[:size])


def barb_strain(model: Model, state: NodalState) -> Array:
    """(F,) largest stretch e_vv (Green-Lagrange) of any barb segment after the last step."""
    start = 6 * (model.rows - 1)
    stretch = state.strains[:, 0, start : start + 2 * model.rows * model.columns]
    return np.abs(stretch).max(axis=1, initial=0.0)
