"""The solver of the nodal kinematics: the reference that the default one is measured against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.lab.nodal.model import NodalModel
from featherfx.lab.nodal.newton_kernels import Minimiser
from featherfx.lab.nodal.settle import nodal_settle, nodal_start, nodal_system
from featherfx.lab.nodal.state import NodalState, NodalWork, make_nodal_work
from featherfx.lab.nodal.step_kernels import NodalFrame, nodal_advance
from featherfx.mechanics.model import Loads, Model, wind_of_each
from featherfx.solver.solver import HARD, RootPath, Settings, StepReport, step_settings
from featherfx.solver.state import no_steps

Array = NDArray[np.float64]
Method = Literal["improved", "textbook"]

# Newton iterations of a step at most; the improved method gives up early and halves the step
LIMITS = {"improved": 30, "textbook": 50}
SETTLE_LIMITS = {"improved": 60, "textbook": 200}


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
        if method not in LIMITS:
            message = f"'{method}' is not one of {', '.join(LIMITS)}"
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
        new, loads = state.copy(), wind_of_each(loads, self.model.feathers)
        report, limit = no_steps(self.model.feathers), LIMITS[self.method]
        hard = limit if self._textbook else HARD
        for f in range(self.model.feathers):
            if new.step[f] == 0.0:
                nodal_start(self.model, self.nodal, loads, f, duration, new, self._work)
            settings = step_settings(self.settings, duration, self.model.length[f])
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
        new, loads = state.copy(), wind_of_each(loads, self.model.feathers)
        status = np.zeros(self.model.feathers)
        iterations = np.zeros(self.model.feathers)
        method = Minimiser(self.settings.newton, SETTLE_LIMITS[self.method], self._textbook)
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


def root_path(start: Array, end: Array, base: Array) -> RootPath:
    """A straight path of all roots, without rotation, from start to end (F, 3) m; base: (F, 4)."""
    samples = np.zeros((len(start), 2, 6))
    samples[:, 0, :3], samples[:, 1, :3] = start, end
    return RootPath(samples, base)
