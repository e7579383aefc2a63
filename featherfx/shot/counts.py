"""What a simulation did, counted for reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.solver.solver import StepReport

# feathers that a report names one by one
_MOST_NAMED = 10


class Advanced(NamedTuple):
    """What a sample took of batches that are stepped together.

    reports: of the batches, none where nothing was solved. resting, coasting: feathers that nothing
    stirs, where they are and with their roots. repeated: those that were replayed. twins: those
    that became images of others.
    """

    reports: Sequence[StepReport]
    resting: int = 0
    coasting: int = 0
    repeated: int = 0
    twins: int = 0


@dataclass
class Counts:
    """Sums over a shot so far.

    reports: one per batch and frame. forced: by feather, its frame with the greatest error of a
    sub-step above the tolerance, that error (m) and the number of such sub-steps. slept, coasted,
    repeated, twins: feather frames that were not stepped; rigid, guided: those of feathers that
    follow their roots or guides only.
    """

    reports: list[StepReport] = field(default_factory=list)
    forced: dict[str, tuple[float, float, int]] = field(default_factory=dict)
    slept: int = 0
    coasted: int = 0
    repeated: int = 0
    twins: int = 0
    rigid: int = 0
    guided: int = 0

    def add(self, report: StepReport, names: Sequence[str], frame: float) -> None:
        """Count what a batch, whose feathers have these names, did on the way to a frame."""
        self.reports.append(report)
        for f in np.flatnonzero(report.forced).tolist():
            error, (_, worst, _) = float(report.error[f]), self.forced.get(names[f], (0, -1.0, 0))
            if error > worst:
                self.forced[names[f]] = frame, error, int(report.forced[f])

    def skip(self, done: Advanced) -> None:
        """Count what was not solved of a sample."""
        self.slept += done.resting
        self.coasted += done.coasting
        self.repeated += done.repeated
        self.twins += done.twins

    def frame(self, rigid: int, guided: int) -> None:
        """Count a frame that is handed out."""
        self.rigid += rigid
        self.guided += guided

    def summary(self) -> dict[str, Any]:
        """The figures of a bake's report: counts, and lengths in m."""
        reports = self.reports
        return {
            "newton_iterations": _mean_and_max([r.iterations for r in reports]),
            "substeps": _mean_and_max([r.steps for r in reports]),
            "rejected_substeps": int(sum(r.rejected.sum() for r in reports)),
            "substeps_over_tolerance": int(sum(r.forced.sum() for r in reports)),
            "worst_substeps": self._worst(),
            "worst_residual": max((float(r.move.max()) for r in reports), default=0.0),
            "worst_step_error": max((float(r.error.max()) for r in reports), default=0.0),
            "skipped": {
                "sleeping feather frames": self.slept,
                "coasting feather frames": self.coasted,
                "repeated feather frames": self.repeated,
                "twin feather frames": self.twins,
                "rigid feather frames": self.rigid,
                "guided feather frames": self.guided,
            },
        }

    def _worst(self) -> list[dict[str, Any]]:
        """Feathers with the greatest errors above the tolerance, one frame each."""
        worst = sorted(self.forced.items(), key=lambda each: (-each[1][1], each[0]))
        return [
            {"feather": name, "frame": frame, "error": error, "substeps": count}
            for name, (frame, error, count) in worst[:_MOST_NAMED]
        ]


def _mean_and_max(counts: list[Array]) -> dict[str, float]:
    if not counts:
        return {"mean": 0.0, "max": 0.0}
    joined = np.concatenate(counts)
    return {"mean": float(joined.mean()), "max": float(joined.max())}
