"""A shot while it is simulated: what its stages share, and what a stage is."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Indices
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather
from featherfx.files.disk_cache import kept, settings_digest
from featherfx.mechanics.model import Loads
from featherfx.mechanics.resolution import barb_course, has_elastic_clamp
from featherfx.packages import brought
from featherfx.phases import counted
from featherfx.shot.frames import FeatherPose, sample_number
from featherfx.shot.loads import force_weights, frame_loads
from featherfx.shot.loop.groups import (
    ALONE,
    Bounds,
    FeatherGroup,
    GroupLoad,
    grips_of,
    has_open_hooks,
    maps_between,
    model_of,
)
from featherfx.shot.motion.motion import prepare_cuts, root_motion
from featherfx.shot.options import FeatherOptions, ShotOptions, common_tolerance, resolve_options
from featherfx.shot.roots import Roots, RunUpRoots, run_up_of
from featherfx.shot.types import Shot
from featherfx.solver.solver import Solver, limit_iterations
from featherfx.solver.state import rest_state

Arrays = dict[str, NDArray[Any]]


class StepGroup(Protocol):
    """Batches of feathers that are settled and stepped together: a free or a contact group."""

    groups: Sequence[FeatherGroup]

    @property
    def bounds(self) -> Bounds:
        """Tolerance and limits of the steps."""

    def settle(self) -> None:
        """Bring the feathers to rest where the shot begins."""

    def advance(self, index: int) -> int:
        """Bring the feathers from the sample before to a sample; return how many nothing stirred.

        Raises SimulationError.
        """


class Guidance(NamedTuple):
    """Guided feathers. members: (F,) their numbers. guides: (G,) those that they follow. weights:
    sparse (F, G)."""

    members: Indices
    guides: Indices
    weights: Any

    def without(self, others: Indices) -> Guidance | None:
        """Return what is left without some feathers, by number; None where nothing is."""
        left = ~np.isin(self.members, others)
        weights = self.weights[left]
        used = np.unique(weights.indices)
        return (
            Guidance(self.members[left], self.guides[used], weights[:, used]) if used.size else None
        )


class ShotRun:
    """A shot while it is simulated.

    shot: with its colliders brought up from rest. first: number of the first sample, below 0 where
    the motion does not begin at rest, or `begin`. motion: of the roots, brought up from rest, with
    cuts. drawn: all feathers on the meshes' grid. wanted: numbers of those in the frames; solved:
    of those that are stepped if they are simulated. islands: (F,) contact group of each, or ALONE.
    posed: of those whose poses are asked for, in the frames or by what these depend on. rigid,
    guided: number of wanted feathers that are not simulated. guidance: of all that are guided.
    lifted: numbers of those that a coat draws by its fields alone. rates: how many of
    the two rates of points are drawn of feathers that are drawn anew; the others mean nothing.
    groups: batches; step_groups: the same, as they are stepped together.
    """

    def __init__(
        self,
        shot: Shot,
        subframes: int,
        jobs: int,
        wanted: Sequence[int] | None,
        begin: int | None = None,
        motion: Roots | None = None,
    ) -> None:
        self.subframes, self.jobs = subframes, jobs
        self._settings = ""
        if begin is None and motion is None and "settings" in vars(shot):
            self._settings = settings_digest(shot.settings)
        shot = prepare_cuts(shot)
        self.shot, self.motion, self.first = shot, motion or root_motion(shot), begin or 0
        if begin is None:
            self.shot, self.motion, self.first = _from_preroll(shot, self.motion, subframes)
        self.drawn = drawn_feathers(shot)
        every: Indices = np.arange(len(self.drawn))
        self.wanted: Indices = every if wanted is None else np.array(wanted, dtype=np.int64)
        self.solved = self.posed = self.wanted
        self.islands = np.full(len(self.drawn), ALONE)
        self.rigid = self.guided = 0
        self.guidance: Guidance | None = None
        self.lifted: Indices = np.zeros(0, dtype=np.int64)
        self.rates = 2
        self.groups: list[FeatherGroup] = []
        self.step_groups: list[StepGroup] = []

    @cached_property
    def options(self) -> ShotOptions:
        """Simulation options of all feathers."""
        return resolve_options(self.shot, self.drawn, self.motion, keep=self.kept)

    def kept(self, what: str, inputs: Sequence[Any], compute: Callable[[], Arrays]) -> Arrays:
        """Arrays that follow from the whole shot, as featherfx.files.disk_cache.kept gives them;
        computed where nobody has told the settings of the shot yet."""
        if not self._settings:
            return compute()
        return kept(what, [self._settings, *inputs], compute)

    def pose_also(self, feathers: Indices) -> None:
        """Pose some feathers, by number, whether they are wanted or not: what is simulated of them
        is solved, and the guides of what is guided."""
        self.posed = np.union1d(self.posed, feathers)
        self.solved = np.union1d(self.solved, feathers)
        if self.guidance is not None:
            led = self.guidance.without(np.setdiff1d(self.guidance.members, feathers))
            if led is not None:
                self.solved = np.union1d(self.solved, led.guides)

    def time(self, index: int) -> float:
        """Time of a sample, s since the first frame."""
        return index / (self.shot.frames_per_second * self.subframes)

    def number(self, index: int) -> float:
        """Frame number of a sample."""
        return sample_number(self.shot.first_frame, index, self.subframes)

    def loads(self, group: FeatherGroup, index: int) -> Loads:
        """Loads on a batch on the way to a sample."""
        start = self.time(max(index - 1, self.first))
        return self.loads_within(group, start, self.time(index), index > 0)

    def loads_within(self, group: FeatherGroup, start: float, end: float, gripped: bool) -> Loads:
        """Loads on a batch from start to end (s).

        gripped: whether grips act. They take hold of the settled feathers, so not while those
        settle.
        """
        shot, roots = self.shot, None
        if shot.wind_source is not None:
            roots = self.motion.frames(0.5 * (start + end))[0][group.members]
            roots = group.state.centre[:, 0] if group.is_flying else roots
        grips, points = group.grips if gripped else [], list(group.start)
        loads = frame_loads(shot, grips, group.feathers, points, start, end, roots, group.forces)
        for each in group.acting:
            loads = each.added(loads, group, start, end)
        return loads


class Stage:
    """A package's part in the frame loop. Methods that it does not need do nothing.

    name: of its arrays in a checkpoint.
    """

    name = ""

    def __init__(self, run: ShotRun) -> None:
        """Change the motion of roots, or ask for more feathers than those that are wanted."""
        self.run = run

    def prepare(self) -> None:
        """Prepare for the first sample, once all batches exist."""

    def begin(self, index: int) -> None:
        """Act before the feathers are stepped to a sample."""

    def note(self, index: int) -> None:
        """Note what has become of the feathers at a sample."""

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Add poses of feathers that are not stepped at a sample, by number, or change others."""

    def show(self, time: float, poses: list[FeatherPose]) -> list[FeatherPose]:
        """Change poses of the wanted feathers, as they are written, at a time in s."""
        return poses

    def finish(self, index: int) -> None:
        """Warn of what did not happen until the last sample that is wanted."""

    def checkpoint(self) -> Arrays:
        """Arrays that a later simulation needs to go on from a sample."""
        return {}

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a checkpoint."""

    def report(self) -> dict[str, Any]:
        """Figures of a bake's report so far."""
        return {}


class ShotLoad:
    """A kind of load in a shot, which gives each batch its own."""

    def __init__(self, run: ShotRun) -> None:
        self.run = run

    def key(self, feather: int) -> Hashable:
        """Return what feathers of one batch have in common, by number in the shot."""
        return None

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The load on a batch; None where it has none."""
        raise NotImplementedError


def make_groups(run: ShotRun) -> list[FeatherGroup]:
    """Make batches of the feathers of a shot that are solved: of one contact group, grid, barb
    taper, clamp, hooks, and loads that only whole batches have."""
    alike: dict[tuple[Any, ...], list[int]] = {}
    loads = [make(run) for make in brought(run.shot, "loads")]
    for f in run.solved.tolist():
        kind, options = run.shot.groom.feathers[f].kind, run.options.feathers[f]
        if options.is_simulated:
            island, hooked = int(run.islands[f]), has_open_hooks(kind, options)
            own = barb_course(kind), has_elastic_clamp(kind), hooked
            key = island, options, *own, *(load.key(f) for load in loads)
            alike.setdefault(key, []).append(f)
    found = []
    for (island, options, *_), members in counted("building", alike.items(), len(alike)):
        group = _make_group(run, np.array(members), island, options)
        own_loads = [load.on(group) for load in loads]
        group.acting = [each for each in own_loads if each is not None]
        found.append(group)
    return found


def _make_group(
    run: ShotRun, members: Indices, island: int, options: FeatherOptions
) -> FeatherGroup:
    shot, time = run.shot, run.time(run.first)
    placements = [shot.groom.feathers[f] for f in members]
    grid, drawn = (options.rows, options.columns), [run.drawn[f] for f in members]
    as_drawn = grid == (drawn[0].rows, drawn[0].columns)
    feathers = drawn if as_drawn else build_feathers(placements, *grid)
    model = model_of(placements, feathers, options, island != ALONE)
    positions, rotations = run.motion.frames(time)
    state = rest_state(model, positions[members], rotations[members])
    state.time[:] = time
    settings = replace(options, max_iterations=limit_iterations(model.unknowns))
    solver = Solver(model, settings, run.jobs)
    if shot.groom.drawn_gravity is not None:
        from featherfx.solver.inverse_statics import hang_as_drawn

        state = hang_as_drawn(shot.groom, placements, solver, state)
    names = [each.id for each in placements]
    place = {name: k for k, name in enumerate(names)}
    return FeatherGroup(
        options=options,
        island=island,
        members=members,
        feathers=feathers,
        maps=maps_between(members, placements, feathers, drawn),
        names=names,
        grips=grips_of(names, shot.grips, model),
        forces=[
            (place[each.feather], each, force_weights(each, feathers[place[each.feather]]))
            for each in shot.forces
            if each.feather in place
        ],
        solver=solver,
        own=solver.model,
        state=state,
        start=state.points.nodes.copy(),
        stirred=np.zeros(len(members), dtype=np.bool_),
    )


def drawn_feathers(shot: Shot) -> tuple[Feather, ...]:
    """All feathers of a shot on the grid of its quality. Raises InputError."""
    rows, columns = shot.quality.rows, shot.quality.columns
    return tuple(build_feathers(shot.groom.feathers, rows, columns))


def _from_preroll(shot: Shot, motion: Roots, subframes: int) -> tuple[Shot, Roots, int]:
    """Shot, roots and number of the first sample, where what moves is brought up from rest."""
    tolerance, rate = common_tolerance(shot), shot.frames_per_second
    run_up = run_up_of(motion, shot.preroll / rate, tolerance, -shot.handles / rate)
    if run_up is None:
        return shot, motion, -shot.handles * subframes
    colliders = tuple(each.brought_up(run_up, tolerance) for each in shot.colliders)
    begun = replace(shot, colliders=colliders, run_up=run_up)
    return begun, RunUpRoots(motion, run_up), -(shot.handles + shot.preroll) * subframes


def under(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """Arrays whose names begin with a prefix, without it."""
    return {n.removeprefix(prefix): arrays[n] for n in arrays if n.startswith(prefix)}


def prefixed(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """The inverse of `under`."""
    return {f"{prefix}{name}": value for name, value in arrays.items()}


class ErrorStage(Stage):
    """Promised and measured error of the feathers that are simulated in full."""

    def report(self) -> dict[str, Any]:
        """Return the figures of report_errors, and why no error is promised."""
        run, options, found = self.run, self.run.options, dict[int, tuple[float, bool]]()
        several = {int(f) for g in run.groups for f in g.members[g.several]}
        for f in sorted(int(f) for g in run.groups for f in g.members):
            error, is_unique = math.inf, True
            if options.promised_error is not None and options.measured:
                _, _, error, is_unique = options.measured[f]
                is_unique &= math.isfinite(error)
            if f in several or options.feathers[f].level != "full":
                error, is_unique = math.inf, is_unique and f not in several
            found[f] = error, is_unique
        told = report_errors(run.shot, options.promised_error, found)
        if options.promised_error is None:
            told |= {"error_not_promised": options.why_not_promised}
        return told


def report_errors(
    shot: Shot, promised: float | None, measured: Mapping[int, tuple[float, bool]]
) -> dict[str, Any]:
    """Return error_promised and error_measured, percent of the length, None where none is; ids by
    kind of feathers that have no unique answer (undefined); kinds that cannot keep the error
    (over_promised).

    measured: of feathers by number, the error over the length, inf where none was measured, and
    whether there is a unique answer, of which it is; else it is of mean pose and swing.
    """
    undefined, worst = dict[str, list[str]](), dict[str, float]()
    for f, (error, is_unique) in measured.items():
        placement = shot.groom.feathers[f]
        kind = placement.kind.name
        if not is_unique:
            undefined.setdefault(kind, []).append(placement.id)
        if math.isfinite(error):
            worst[kind] = max(worst.get(kind, 0.0), 100.0 * error)
    found: dict[str, Any] = {
        "error_promised": None if promised is None else 100.0 * promised,
        "error_measured": max(worst.values(), default=None),
        "undefined": undefined,
    }
    over = {k: each for k, each in worst.items() if promised and each > 100.0 * promised}
    return found | ({"over_promised": over} if over else {})
