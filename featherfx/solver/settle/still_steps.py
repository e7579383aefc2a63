"""A feather on its way to rest: implicit Euler steps that start without velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.state import State
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.step.newton_kernels import minimise
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.step.strain_kernels import no_strains
from featherfx.solver.work import Work

Array = NDArray[np.float64]


class Rest:
    """One feather on its way to rest: takes steps from rest and keeps what they lead to.

    Arguments as those of settle (featherfx/solver/settle/settle.py). iterations: Newton's, so far.
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

    def load(self) -> None:
        """Take the pose that was kept last."""
        load_pose(self.model, self.f, self.state, self.work.now)
        self.work.now.points[:] = self.state.points[self.f]

    def keep(self) -> None:
        """The pose now becomes the state's."""
        state, f, now = self.state, self.f, self.work.now
        state.rotation[f], state.centre[f] = now.rotation, now.centre
        state.coefficient[f], state.points[f] = now.coefficient, now.points
        for step in range(2):
            state.strains.at(f, step).assign(now.strains)

    def feel_wind(self) -> None:
        """Wind, areas and speeds at the pose now."""
        still, time = self.state.velocity[self.f], self.state.time[self.f]
        around, stiffness = self.work.around, self.model.cell_stiffness[self.f]
        blow(self.work.now.points, time, self.loads, self.f, still, stiffness, around)

    def step(self, h: float, limit: int) -> int:
        """One step of h (s) from rest, in the air around as it is; returns Newton's status."""
        now, around = self.work.now, self.work.around
        around.target[:] = now.points
        around.past[:] = now.points
        factors = Factors(1.0 / (h * h), 1.0 / h, 0.0)
        solved = minimise(
            self.model,
            self.loads,
            self.f,
            self.fraction,
            factors,
            self.tolerance,
            limit,
            self.work,
        )
        self.iterations += solved.iterations
        return int(solved.status)


def _stop(f: int, state: State) -> None:
    for rate in (
        state.velocity,
        state.acceleration,
        state.smoothed,
        state.spin,
        state.coefficient_rate,
        state.step,
    ):
        rate[f] = 0.0
