"""The batches within one interval of contact: feathers are solved several times over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Contacts, Loads
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.settle.take_up import carry_to
from featherfx.solver.solver import Solver
from featherfx.solver.state import State, StepReport, no_steps
from featherfx.solver.step.root_path import RootPath

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Newton iterations of one solve of a feather; one that needs more gets a shorter interval
MOST_ITERATIONS = 1000
# counts of a report that add up over a feather's solves; of the others the last one's holds
SUMS = ("iterations", "matrices", "rejected", "failed", "fallbacks")


class Run:
    """Where the batches started, and where the last iterate stands.

    solvers: of the batches. grids: theirs. duration: s. substeps: most regular steps of a feather
    within it. start, now: (B, n, P, 3) m, all bodies on the widest grid. report:
    of all solves and bodies.
    """

    def __init__(
        self,
        solvers: Sequence[Solver],
        grids: Grids,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
        substeps: int = 1,
    ) -> None:
        self.solvers, self.grids, self.duration = solvers, grids, duration
        self.loads, self.paths = loads, paths
        self.settings = [
            replace(
                solver.settings,
                max_substeps=substeps,
                max_iterations=min(solver.settings.max_iterations, MOST_ITERATIONS),
            )
            for solver in solvers
        ]
        self.old = [state.copy() for state in states]
        for solver, state, path in zip(solvers, self.old, paths, strict=True):
            carry_to(solver.model, state, path)
        self.new = [state.copy() for state in self.old]
        self.start = grids.together([state.points for state in self.old])
        velocity = grids.together([state.velocity for state in self.old])
        self.now = self.start + duration * velocity
        self.solves = 0
        self.report = no_steps(grids.bodies)

    def solve(self, mine: Flags, contacts: Contacts) -> None:
        """Solve the bodies mine anew from the interval's start. contacts: of all bodies.

        All rounds begin with the step length that the interval before left, so that a feather that
        takes shorter steps of its own takes the same ones in every round.
        """
        for g, solver in enumerate(self.solvers):
            low, high = self.grids.first[g], self.grids.first[g + 1]
            feathers = np.flatnonzero(mine[low:high])
            if len(feathers) == 0:
                continue
            own = contacts._replace(first=contacts.first[low : high + 1])
            loads = self.loads[g]._replace(contacts=own)
            old, new = self.old[g], self.new[g]
            solver.begin(old, loads, self.paths[g], self.duration, feathers.tolist())
            report = solver.advance(
                new,
                loads,
                self.paths[g],
                self.duration,
                feathers.tolist(),
                old,
                self.settings[g],
            )
            self.grids.put(new.points[feathers], g, feathers, self.now)
            self.solves += len(feathers)
            # the next try starts from this pose: rates that lead there
            old.spin[feathers] = new.spin[feathers]
            old.coefficient_rate[feathers] = new.coefficient_rate[feathers]
            self._count(low, feathers, report)

    def _count(self, low: int, feathers: Indices, report: StepReport) -> None:
        for name, total, new in zip(report._fields, self.report, report, strict=True):
            bodies, more = low + feathers, new[feathers]
            if name in SUMS:
                more = more + total[bodies]
            elif name == "status":
                more = np.maximum(more, total[bodies])
            total[bodies] = more

    def failed(self) -> bool:
        return bool(self.report.status.any())

    def reports(self) -> list[StepReport]:
        """Per batch, all solves of the interval as one report: counts add, the last error holds."""
        return [
            StepReport(*(each[low:high] for each in self.report))
            for low, high in pairwise(self.grids.first)
        ]
