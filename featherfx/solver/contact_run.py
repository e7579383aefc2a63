"""The batches within one interval of contact: feathers are solved several times over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Contacts, Loads
from featherfx.solver.root_path import RootPath
from featherfx.solver.state import State
from featherfx.solver.step import Solver, StepReport

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Run:
    """Where the batches started, and where the last iterate stands.

    solvers: of the batches. first: (G + 1,) first body of each. duration: s.
    """

    def __init__(
        self,
        solvers: Sequence[Solver],
        first: Indices,
        states: Sequence[State],
        loads: Sequence[Loads],
        paths: Sequence[RootPath],
        duration: float,
    ) -> None:
        self.solvers, self.first, self.duration = solvers, first, duration
        self.loads, self.paths = loads, paths
        self.old = [state.copy() for state in states]
        for state in self.old:
            state.proposal[:] = 0.0
        self.new = [state.copy() for state in self.old]
        self.start = np.concatenate([state.points for state in self.old])
        velocity = np.concatenate([state.velocity for state in self.old])
        self.now = self.start + duration * velocity
        self.solves = 0
        self._counts: list[list[StepReport]] = [[] for _ in states]
        self._seen = np.zeros(int(self.first[-1]), dtype=np.bool_)

    def solve(self, mine: NDArray[np.bool_], contacts: Sequence[Contacts]) -> None:
        """Solve the bodies mine anew from the interval's start."""
        for g, solver in enumerate(self.solvers):
            low, high = self.first[g], self.first[g + 1]
            feathers = np.flatnonzero(mine[low:high])
            if len(feathers) == 0:
                continue
            loads = self.loads[g]._replace(contacts=contacts[g])
            new, report = solver.step(
                self.old[g], loads, self.paths[g], self.duration, feathers.tolist()
            )
            for current, solved in zip(self.new[g], new, strict=True):
                current[feathers] = solved[feathers]
            self.now[low + feathers] = new.points[feathers]
            self.solves += len(feathers)
            # the next try starts from this pose: rates that lead there
            self.old[g].spin[feathers] = new.spin[feathers]
            self.old[g].coefficient_rate[feathers] = new.coefficient_rate[feathers]
            self._counts[g].append(_only(report, feathers))

    def failed(self) -> bool:
        return any((report.status != 0.0).any() for parts in self._counts for report in parts)

    def reports(self) -> list[StepReport]:
        """Per batch, all solves of the interval as one report: counts add, the last error holds."""
        return [
            _joined(parts, solver.model.feathers)
            for parts, solver in zip(self._counts, self.solvers, strict=True)
        ]


def _only(report: StepReport, feathers: Indices) -> StepReport:
    kept = {}
    for name, value in vars(report).items():
        part = np.zeros_like(value)
        part[feathers] = value[feathers]
        kept[name] = part
    return StepReport(**kept)


def _joined(parts: Sequence[StepReport], count: int) -> StepReport:
    zero = np.zeros(count)
    total = {name: zero.copy() for name in StepReport.__dataclass_fields__}
    for part in parts:
        solved = (part.steps > 0.0) | (part.status != 0.0)
        for name in ("iterations", "matrices", "rejected", "failed", "fallbacks"):
            total[name] = total[name] + getattr(part, name)
        for name in ("steps", "forced", "error", "move"):
            total[name] = np.where(solved, getattr(part, name), total[name])
        total["status"] = np.maximum(total["status"], part.status)
    return replace(StepReport(**total))
