"""Counts of a simulation, for reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.solver.solver import StepReport
from featherfx.solver.state import LONG_STEP_COUNTS

# feathers that a report names one by one
_MAX_NAMED = 10


class Bounds(NamedTuple):
    """Bounds of steps. tolerance: m, local error of one. limits: values of the keys by which none
    may be shorter."""

    tolerance: float
    limits: Mapping[str, int]


class TooLong(NamedTuple):
    """Frame of a feather in which its steps were longest for what they should keep to.

    error, tolerance: m, the largest local error, and what it should be. forced, passed, slipped:
    steps as in StepReport.
    """

    frame: float
    error: float
    tolerance: float
    forced: int
    passed: int
    slipped: int

    def rank(self) -> tuple[bool, float]:
        """Larger where it is worse: any error above the tolerance before none."""
        return self.forced > 0, self.error / self.tolerance

    def told(self, feather: str) -> dict[str, Any]:
        """As a bake's report has it."""
        return {
            "feather": feather,
            "frame": self.frame,
            "error": self.error,
            "tolerance": self.tolerance,
            "substeps": self.forced,
            "substeps_with_barbs_passing": self.passed,
            "substeps_with_hooks_slipping": self.slipped,
        }


class Unsolved(NamedTuple):
    """Frame in which a feather's steps ended farthest from their solutions. distance: m."""

    frame: float
    distance: float


@dataclass
class Counts:
    """Sums over a shot so far.

    reports: one per batch and frame. too_long: by feather, its worst frame. limits: what bounds the
    steps of these, by keys. unsolved: by feather, its worst frame, where a step is farther from its
    solution than its error may be, as where a frame had to end (step_control_kernels). slept:
    feather frames that were not stepped; rigid, guided: those of feathers that follow their roots
    or guides only.
    """

    reports: list[StepReport] = field(default_factory=list)
    too_long: dict[str, TooLong] = field(default_factory=dict)
    limits: dict[str, int] = field(default_factory=dict)
    unsolved: dict[str, Unsolved] = field(default_factory=dict)
    slept: int = 0
    rigid: int = 0
    guided: int = 0

    def add(self, report: StepReport, names: Sequence[str], frame: float, bounds: Bounds) -> None:
        """Count what a batch, whose feathers have these names, did on the way to a frame."""
        self.reports.append(report)
        for f in np.flatnonzero(report.too_long()).tolist():
            counts = (int(getattr(report, name)[f]) for name in LONG_STEP_COUNTS)
            found = TooLong(frame, float(report.error[f]), bounds.tolerance, *counts)
            known = self.too_long.get(names[f])
            if known is None or found.rank() > known.rank():
                self.too_long[names[f]] = found
            self.limits |= bounds.limits
        for f in np.flatnonzero(report.move > bounds.tolerance).tolist():
            far = Unsolved(frame, float(report.move[f]))
            before = self.unsolved.get(names[f], far)
            self.unsolved[names[f]] = max(before, far, key=lambda each: each.distance)

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
            "substeps_with_barbs_passing": int(sum(r.passed.sum() for r in reports)),
            "substeps_with_hooks_slipping": int(sum(r.slipped.sum() for r in reports)),
            "feathers_over_tolerance": len(self.too_long),
            "substep_limits": self.limits,
            "worst_substeps": self._worst(),
            "feathers_unsolved": len(self.unsolved),
            "worst_unsolved": self._unsolved(),
            "worst_residual": max((float(r.move.max()) for r in reports), default=0.0),
            "worst_step_error": max((float(r.error.max()) for r in reports), default=0.0),
            "skipped": {
                "sleeping feather frames": self.slept,
                "rigid feather frames": self.rigid,
                "guided feather frames": self.guided,
            },
        }

    def _worst(self) -> list[dict[str, Any]]:
        """Feathers whose steps were longest for what they should keep to, one frame each."""
        by_name = sorted(self.too_long.items())
        worst = sorted(by_name, key=lambda each: each[1].rank(), reverse=True)
        return [found.told(name) for name, found in worst[:_MAX_NAMED]]

    def _unsolved(self) -> list[dict[str, Any]]:
        """Feathers whose steps ended farthest from their solutions, one frame each."""
        by_name = sorted(self.unsolved.items())
        worst = sorted(by_name, key=lambda each: each[1].distance, reverse=True)
        return [{"feather": name, **each._asdict()} for name, each in worst[:_MAX_NAMED]]


def _mean_and_max(counts: list[Array]) -> dict[str, float]:
    if not counts:
        return {"mean": 0.0, "max": 0.0}
    joined = np.concatenate(counts)
    return {"mean": float(joined.mean()), "max": float(joined.max())}
