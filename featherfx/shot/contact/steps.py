"""How long the common steps of feathers that touch are, within a frame.

A step after which a feather is not solved, or contacts are far off, is tried again, shorter. Below
the shortest that is allowed, the contacts of the feathers that fail yield for one step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.contact.interval import ContactReport
from featherfx.solver.solver import StepReport, raise_if_failed
from featherfx.solver.status import TOO_MUCH_WORK

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# a step that cannot be solved is cut to this part of it, at the least to that of the shortest
# regular one
CUT, SMALLEST = 0.25, 1.0 / 16.0
# misfit of a step's contacts, over the thickness, beyond which it is cut to the shortest regular
# one, and beyond which it is cut further
WRONG, BAD = 0.5, 2.0
# part of the feathers that should need no more than one step of their own in a common one
FEW_STEPS = 0.8
# Newton iterations of a feather in a frame, over Settings.max_iterations: it is solved in rounds
MORE_ITERATIONS = 8


@dataclass(frozen=True)
class StepRules:
    """What does not change over a shot.

    steps: common steps of a frame, 0: as many as are needed. substeps: most regular steps of a
    feather in a frame. tolerance: m, local error of a step. thickness: m, the least of any vane.
    rounds: of a step that was easy, at most. iterations: Settings.max_iterations. names: ids.
    """

    steps: int
    substeps: int
    tolerance: float
    thickness: float
    rounds: int
    iterations: int
    names: list[str]

    def wrong(self, contact: ContactReport) -> bool:
        """Whether contacts are off by more than they should be."""
        return contact.residual > WRONG * self.thickness


class FrameSteps:
    """The steps from start to end (s). proposal: s, length that the frame before left; 0: none.

    time: s, where the feathers are. length, stop: s, of the step to try and where it ends;
    substeps: that a feather may divide it into. yielding: feathers whose contacts yield in it.
    repeated: steps that were tried again.
    """

    def __init__(self, rules: StepRules, start: float, end: float, proposal: float) -> None:
        self.rules, self.time, self.end = rules, start, end
        duration = end - start
        self.shortest = duration / (rules.steps or rules.substeps)
        self.proposal = self.shortest if rules.steps else min(proposal or duration, duration)
        self.yielding: Flags | None = None
        self.repeated = 0
        self._done = 1e-9 * duration
        self._spent = np.zeros(len(rules.names))

    def left(self) -> bool:
        """Whether the end is not reached; chooses the next step."""
        left, h = self.end - self.time, self.proposal
        if left <= self._done:
            return False
        self.length = left if h > 0.999 * left else (0.5 * left if h > 0.6 * left else h)
        self.stop = self.end if self.length == left else self.time + self.length
        own = max(1, round(self.length / self.shortest))
        self.substeps = 1 if self.rules.steps else own
        return True

    def again(self, reports: Sequence[StepReport], contact: ContactReport) -> bool:
        """Whether the step is to be tried again, shorter or yielding; SimulationError where no try
        is left."""
        status = np.concatenate([report.status for report in reports])
        self._spend(reports)
        failed = bool(status.any())
        if not failed and not self._too_wrong(contact):
            return False
        self.repeated += 1
        self.proposal = (CUT if failed else 0.5) * self.length
        if self.proposal < SMALLEST * self.shortest:
            if self.yielding is not None:
                now = np.full(len(status), self.time)
                raise_if_failed(status, now, self.rules.names)
            self.yielding, self.proposal = status != 0.0, self.length
        return True

    def accepted(self, reports: Sequence[StepReport], contact: ContactReport) -> None:
        """Go on to the step's end, and propose the next one's length."""
        easy = contact.rounds <= self.rules.rounds
        self.proposal = min(self.shortest, (2.0 if easy else 1.0) * self.length)
        if not self.rules.steps:
            self.proposal = max(self.proposal, self.length * self._change(reports))
        self.time, self.yielding = self.stop, None

    def _too_wrong(self, contact: ContactReport) -> bool:
        bad = contact.residual > BAD * self.rules.thickness
        least = (2.0 * SMALLEST if bad else 1.001) * self.shortest
        return self.rules.wrong(contact) and self.length > least

    def _spend(self, reports: Sequence[StepReport]) -> None:
        """SimulationError for a feather that took too many Newton iterations in the frame."""
        self._spent += np.concatenate([report.iterations for report in reports])
        most = MORE_ITERATIONS * self.rules.iterations
        status = np.where(self._spent > most, TOO_MUCH_WORK, 0)
        raise_if_failed(status, np.full(len(status), self.time), self.rules.names, most)

    def _change(self, reports: Sequence[StepReport]) -> float:
        """Factor from this common step to the next: most feathers should need one of their own."""
        steps = np.concatenate([report.steps for report in reports])
        error = np.concatenate([report.error for report in reports])
        awake = steps > 0.0
        if not awake.any():
            return 2.0
        need = float(np.quantile(steps[awake], FEW_STEPS))
        if need > 1.0:
            return max(0.25, 1.0 / need)
        off = max(float(np.quantile(error[awake], FEW_STEPS)), 1e-30)
        change = 0.9 * (self.rules.tolerance / off) ** (1.0 / 3.0)
        return float(min(2.0, max(0.5, change)))
