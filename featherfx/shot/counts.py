"""What the steps of a shot took: counts over feathers and frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.solver import StepReport


@dataclass
class Counts:
    """Sums over a shot so far.

    reports: one per batch and frame. slept, coasted, repeated: feather frames that were not
    stepped; rigid, guided: those of feathers that follow their roots or guides only.
    """

    reports: list[StepReport] = field(default_factory=list)
    slept: int = 0
    coasted: int = 0
    repeated: int = 0
    rigid: int = 0
    guided: int = 0

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
            "worst_residual": max((float(r.move.max()) for r in reports), default=0.0),
            "worst_step_error": max((float(r.error.max()) for r in reports), default=0.0),
            "skipped": {
                "sleeping feather frames": self.slept,
                "coasting feather frames": self.coasted,
                "repeated feather frames": self.repeated,
                "rigid feather frames": self.rigid,
                "guided feather frames": self.guided,
            },
        }


def _mean_and_max(counts: list[NDArray[np.float64]]) -> dict[str, float]:
    if not counts:
        return {"mean": 0.0, "max": 0.0}
    joined = np.concatenate(counts)
    return {"mean": float(joined.mean()), "max": float(joined.max())}
