"""Batches of feathers that share a grid: models, maps to the meshes' grids, loads, counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.shapes import PointCarrier, build_unit_maps, scaled_map, with_detail
from featherfx.feather.types import Feather, RowMap
from featherfx.files.disk_cache import kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind, Placement, Splits
from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.resolution import may_slip
from featherfx.shot.frames import FeatherPose
from featherfx.shot.options import FeatherOptions
from featherfx.shot.patterns import Force, Grip
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


# places of a groom whose maps are kept together
_PART = 128


def model_of(
    placements: Sequence[Placement],
    feathers: Sequence[Feather],
    options: FeatherOptions,
    touching: bool,
) -> Model:
    """Constant arrays of a batch: made once for feathers of one shape, or of one shape and size
    where their materials do not follow from the size.

    touching: whether loose barbs do not pass through each other. Of what is not solved, nothing is
    damped.
    """
    units = [_of_unit_size(each, options) for each in placements]
    shapes: list[tuple[Any, ...]] = [
        (id(unit), p.mirrored)
        if unit
        else (id(p.prototype or p.kind), p.kind, p.size, p.mirrored, id(p.leaf))
        for p, unit in zip(placements, units, strict=True)
    ]
    first: dict[tuple[Any, ...], int] = {}
    for k, shape in enumerate(shapes):
        first.setdefault(shape, k)
    number = {shape: n for n, shape in enumerate(first)}
    own = [(placements[k], units[k], feathers[k]) for k in first.values()]
    grid = options.rows, options.columns

    def compute() -> dict[str, Any]:
        from featherfx.feather.build import build_feather
        from featherfx.mechanics.batch import make_model  # only for models that are not cached
        from featherfx.solver.damping import with_damping

        some = [
            build_feather(unit, *grid, placement.mirrored) if unit else feather
            for placement, unit, feather in own
        ]
        kinds = [_as_simulated(unit or placement.kind, options) for placement, unit, _ in own]
        model = make_model(some, kinds, options.coefficients, touching)
        if not options.is_simulated:
            return model.arrays()
        return with_damping(model, kinds).arrays()

    inputs = [_constant(placement, unit) for placement, unit, _ in own]
    how = options.level, *grid, options.coefficients, touching
    found = Model.from_arrays(kept("models", [inputs, *how], compute))
    model = found.some([number[shape] for shape in shapes])
    sizes = [1.0 if unit is None else p.size for p, unit in zip(placements, units, strict=True)]
    if not any(units):
        return model
    from featherfx.mechanics.batch import resized

    return resized(model, np.array(sizes))


def _constant(placement: Placement, unit: FeatherKind | None) -> list[Any]:
    """List what the constants of a feather, or of one of unit size, depend on."""
    if unit is not None:
        return [unit.uncoloured, placement.mirrored]
    kind, prototype = placement.kind, placement.prototype
    shape = prototype and prototype.uncoloured
    return [kind.uncoloured, shape, placement.size, placement.mirrored, placement.leaf]


def _of_unit_size(placement: Placement, options: FeatherOptions) -> FeatherKind | None:
    """The kind that a feather is `size` times as large as, if all of its constants follow."""
    unit = placement.prototype
    if (
        unit is None
        or placement.leaf is not None
        or unit.scaling != "similar"
        or unit.thickness_exponent != 1.0
        or has_open_hooks(unit, options)
    ):
        return None
    return unit if adjusted(unit, Change(scale=placement.size)) == placement.kind else None


def has_open_hooks(kind: FeatherKind, options: FeatherOptions) -> bool:
    """Return whether hooks of a feather may slip; those of vanes with less detail hold."""
    return options.level == "full" and may_slip(kind)


def _as_simulated(kind: FeatherKind, options: FeatherOptions) -> FeatherKind:
    if has_open_hooks(kind, options) or not may_slip(kind):
        return kind
    return replace(
        kind,
        vane_material=replace(kind.vane_material, hooks="closed"),
        leading=replace(kind.leading, splits=Splits()),
        trailing=replace(kind.trailing, splits=Splits()),
    )


def maps_between(
    members: Indices,
    placements: Sequence[Placement],
    simulated: Sequence[Feather],
    drawn: Sequence[Feather],
) -> list[RowMap | None]:
    """From the simulated grids to those drawn; None where they are the same. members: numbers in
    the groom, ascending."""
    if not placements or simulated[0].cell.shape == drawn[0].cell.shape:
        return [None] * len(placements)
    coarse, fine = simulated[0], drawn[0]
    grids = (coarse.rows, coarse.columns), (fine.rows, fine.columns)
    # one map for all feathers that differ in size only; a wind in which some feathers are simulated
    # otherwise leaves most parts of a groom as they were
    known: dict[tuple[int, bool], RowMap] = {}
    for part in np.split(np.arange(len(members)), np.flatnonzero(np.diff(members // _PART)) + 1):
        own = {}
        for placement in (placements[k] for k in part):
            shape = placement.prototype or placement.kind
            if (id(shape), placement.mirrored) not in known:
                own[id(shape), placement.mirrored] = shape, placement.mirrored
        known |= zip(own, build_unit_maps(tuple(own.values()), *grids), strict=True)
    found: list[RowMap | None] = []
    for placement, own_coarse, own_fine in zip(placements, simulated, drawn, strict=True):
        unit = known[id(placement.prototype or placement.kind), placement.mirrored]
        size = placement.size if placement.prototype is not None else 1.0
        own_map = scaled_map(unit, size, coarse.rows)
        is_laid = placement.leaf is not None
        found.append(with_detail(own_map, own_coarse, own_fine) if is_laid else own_map)
    return found
