"""Batches of feathers that share a grid, what acts on them, and counts of their steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.density import PointCarrier
from featherfx.feather.types import Feather, RowMap
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.frames import FeatherPose
from featherfx.shot.options import FeatherOptions
from featherfx.shot.types import Force, Grip
from featherfx.solver.solver import Solver, StepReport
from featherfx.solver.state import LONG_STEP_COUNTS, State

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


# strain of the rachis to which a grip draws it by default: half of what keratin breaks at
MAX_GRIP_STRAIN = 0.05
# contact group of a feather that pushes nothing
ALONE = -1


class GroupLoad:
    """A load on a batch of feathers; it may change their model over time."""

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Take the values of a step from start to end (s); whether the model is another one."""
        return False

    def model(self, model: Model) -> Model:
        """Constant data with the present values, from those without this load."""
        return model

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with those of a step from start to end (s)."""
        return loads


@dataclass
class FeatherGroup:
    """Feathers that share a grid: their places in the groom, solver, state and loads.

    options: how they are simulated. island: contact group, or ALONE. feathers: as simulated. maps:
    to the meshes' grid, where that is another one. own: model without what loads change. start:
    nodes at the first frame. acting: loads beside grips and forces.
    loads: of the step before. stirred: (F,) feathers that something else than a step has changed
    since the sample before. several: places of those with several rest poses; fluttering: of those
    that found none. report: of the last step, None where none was taken.
    """

    options: FeatherOptions
    island: int
    members: Indices
    feathers: list[Feather]
    maps: list[RowMap | None]
    names: list[str]
    grips: list[tuple[int, Grip]]
    forces: list[tuple[int, Force, Array]]
    solver: Solver
    own: Model
    state: State
    start: Array
    stirred: Flags
    acting: list[GroupLoad] = field(default_factory=list)
    loads: Loads | None = None
    several: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    fluttering: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    report: StepReport | None = None

    @property
    def level(self) -> str:
        """Level of detail."""
        return self.options.level

    @cached_property
    def carrier(self) -> PointCarrier | None:
        """Map to the meshes' grid, where that is another one."""
        maps = [each for each in self.maps if each is not None]
        return PointCarrier(maps) if maps else None

    @property
    def is_flying(self) -> bool:
        """Return whether the feathers have left their roots."""
        return not self.solver.model.held.any()

    def renew(self, start: float, end: float) -> bool:
        """Give the solver the model of a step from start to end (s); whether it is a new one."""
        new = [load.renew(self, start, end) for load in self.acting]
        if any(new):
            model = self.own
            for load in self.acting:
                model = load.model(model)
            self.solver.model = model
        return any(new)

    def restart_steps(self, step: float) -> None:
        """Have the next step, of `step` s, find accelerations first: the loads have changed."""
        self.state = self.state.copy()
        self.state.step[:], self.state.proposal[:] = 0.0, step


def grips_of(names: Sequence[str], grips: Sequence[Grip], model: Model) -> list[tuple[int, Grip]]:
    """List the grips on a batch of feathers with these ids, each with its place in the batch and
    its largest force."""
    place = {name: k for k, name in enumerate(names)}
    found = [(place[each.feather], each) for each in grips if each.feather in place]
    return [(f, replace(each, max_force=_max_force(model, f, each))) for f, each in found]


def _max_force(model: Model, feather: int, grip: Grip) -> float:
    """Return the largest force of a grip (N), by default what the rachis bears up to its row."""
    if grip.max_force is not None:
        return grip.max_force
    elements = max(1, round(grip.row * (model.rows - 1)))
    tension = model.rachis_stiffness[feather, :elements, 0] / model.length[feather, :elements]
    return MAX_GRIP_STRAIN * float(tension.min())


def poses_of(group: FeatherGroup) -> dict[int, FeatherPose]:
    """Return points and rates of a group's feathers, by their numbers, on the grid of the
    meshes."""
    state, hooked = group.state, group.solver.model.hooked
    numbers = group.members.tolist()
    if (carrier := group.carrier) is not None:
        every = np.arange(len(numbers))
        moving = carrier(every, state.points, state.velocity, state.acceleration)
        return dict(zip(numbers, FeatherPose.each(moving), strict=True))
    found = {}
    for k, f in enumerate(numbers):
        gaps = state.gaps_of(k) if hooked else None
        points, rate, second = state.points.at(k), state.velocity.at(k), state.acceleration.at(k)
        found[f] = FeatherPose(points, rate, second, gaps)
    return found
