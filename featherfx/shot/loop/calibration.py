"""The promise as a measurement: grids and tolerances that keep an error, found on a sample.

Feathers are alike in strata by kind, size and load. Of each stratum a sample is
simulated before the first frame: where the shot begins, settling included, and where its loads are
largest. A feather that finds no rest there flutters: its way is chaotic, and is not measured. What
a setting errs by follows from what finer ones differ by,

    e = e_space + e_time,     e_space = 4/3 |x - x_s|,     e_time = 5/4 |x - x_t|

largest distance of any node at any frame, over the length. x_s has twice the rows and columns, of
which errors are of second order, and one coefficient more; x_t a tenth of the tolerance, of which
they go with the power 0.7. Each part is raised by as many levels of SPACE or TIME as it is too
large for, and measured again in the windows where it is large; where it is far below, it is lowered
once. Where the finest settings do not keep the error, the report has the figure. Where finer
settings do not come nearer to each other, the feather has no unique answer, as where it has several
rest poses or flutters; the report names it.

A window begins at rest under the loads of its first sample. What a shot brings into it is not in
its error, which is why a sample may err by a part of what is promised only (_MARGIN).

What is found depends on the shot alone: no share, thread or frame range changes it. Feathers push
nothing here, and shapes of meshes, which fit one grid, do not draw them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, SimulationError
from featherfx.feather.density import max_distance
from featherfx.feather.types import Feather, RowPoints
from featherfx.files.content import digest
from featherfx.files.disk_cache import keep, kept, kept_before, nothing_kept
from featherfx.groom.keys.preset import Quality
from featherfx.jit.compile_progress import working_time
from featherfx.mechanics.batch import may_slip
from featherfx.shot.fingerprint import shot_settings
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options.load_estimate import Deflection, LoadEstimate
from featherfx.shot.options.options import (
    MAX_COEFFICIENTS,
    SPACE,
    SPACE_NUMBERS,
    TIME,
    first_grid,
    given_grid,
)
from featherfx.shot.patterns import part_of
from featherfx.shot.roots import NO_RUN_UP, PickedRoots, RootFrames, Roots, some_roots
from featherfx.shot.types import MeasuredGrid, Shot

# strata a shot may have at least, and one for so many feathers
_MIN_STRATA, _FEATHERS_PER_STRATUM = 8, 20
# powers of two within which sizes and deflections are alike, from fine to coarse
_WIDTHS = (1.0, 2.0, 4.0, 100.0)
# of a feather's length, deflection below which all are alike
_MIN_DEFLECTION = 2e-3


class Stratum(NamedTuple):
    """Feathers that are treated alike. members: numbers, ascending. sample: of those measured, the
    ones that loads bend most, then by turns along the groom. is_free: they leave their roots."""

    members: Indices
    sample: Indices
    is_free: bool


def stratify(
    shot: Shot, solved: Indices, deflections: Sequence[Deflection], free: Flags
) -> list[Stratum]:
    """Divide the feathers of a shot that are solved into strata.

    solved: numbers. deflections: m, of each. free: (F,) which leave their roots.
    """
    most = max(_MIN_STRATA, len(solved) // _FEATHERS_PER_STRATUM)
    strata: dict[tuple[Any, ...], list[int]] = {}
    for width in _WIDTHS:
        strata = {}
        for f in solved.tolist():
            key = _key(shot, f, deflections[f], bool(free[f]), width)
            strata.setdefault(key, []).append(f)
        if len(strata) <= most:
            break
    return [
        Stratum(np.array(each), _sample(each, deflections), bool(free[each[0]]))
        for each in strata.values()
    ]


def _key(
    shot: Shot, f: int, deflection: Deflection, is_free: bool, width: float
) -> tuple[Any, ...]:
    kind = shot.groom.feathers[f].kind
    shares = (each / kind.length for each in (deflection.rachis, deflection.barb))
    sizes = kind.length, *(max(each, _MIN_DEFLECTION) for each in shares)
    octaves = (math.floor(math.log2(each) / width) for each in sizes)
    return kind.name, may_slip(kind), deflection.is_pulled, is_free, *octaves


def _sample(members: list[int], deflections: Sequence[Deflection]) -> Indices:
    """Numbers of the feathers of a stratum that are measured."""
    worst = max(members, key=lambda f: deflections[f].rachis + deflections[f].barb)
    extra = members[:: 4 * _FEATHERS_PER_STRATUM][1:]
    return np.unique([worst, *extra])


# of what is promised, what a sample may err by; of that, the parts of grids and of steps
_MARGIN, _SHARES = 0.5, {"space": 0.6, "time": 0.4}
# by how much an error falls from one level of SPACE and TIME to the next
_FALL = 2.0
# the error over the difference from what is finer: of second order, and of the power 0.7
REST_RATIOS = {"space": 4.0 / 3.0, "time": 5.0 / 4.0}
# what is finer: columns and intervals of rows, coefficients, tolerance
_FINER_RATIO, _MORE_COEFFICIENTS, TIGHTER_RATIO = 2, 1, 10.0
# rounds of measuring; levels at once; of a part's goal, to which it is lowered
_ROUNDS, _MAX_STEPS, _LOW = 5, 2, 0.5
# of its largest error in any window, below which a window is measured no more
_FAR = 0.25
# of its goal, error of steps from which on these are refined alone
_RESTLESS = 4.0
# least fall of an error from round to round, that shows that finer settings come nearer
MIN_FALL = 0.7
# m, a tolerance that binds no feather, and the least of a quality
_LARGEST, _MIN_TOLERANCE = 0.1, 1e-9
# s, of each window; frames of what is pulled, at most
WINDOW, _MAX_PULLED_FRAMES = 0.17, 36

# of SPACE and TIME, and which of them is finer
Level = tuple[int, int, str]
# (first, last) sample
Window = tuple[int, int]


class WindowRun(NamedTuple):
    """A feather as it was simulated, and its points at every sample of its windows, None where a
    step failed; whether it found no rest at the first."""

    feather: Feather | None
    points: list[RowPoints]
    flutters: bool


_FAILED = WindowRun(None, [], False)


def measure_grids(
    shot: Shot,
    solved: Indices,
    loads: LoadEstimate,
    deflections: Sequence[Deflection],
    free: Flags,
    until: float = math.inf,
) -> list[MeasuredGrid] | None:
    """Measure the grids of the feathers of a shot that promises an error; of every feather, where
    nothing is solved those to begin with. None where the time ends before.

    solved: numbers. deflections: m, of each. free: (F,) which leave their roots. until: s of CPU
    time of this process.
    """
    if shot.grids is not None:
        return [shot.grids[each.id] for each in shot.groom.feathers]
    shot = replace(shot, run_up=NO_RUN_UP, contact=None, colliders=(), preroll=0)
    # shapes of meshes fit one grid alone
    targets = tuple(each for each in shot.targets if each.points is None)
    shot = replace(shot, details=(), level_of_detail=None, targets=targets)
    # as feathers are solved, not as they are drawn on the skin
    shot = replace(shot, groom=replace(shot.groom, coat=None))
    key = digest([shot_settings(shot), solved])
    found = _known.get(key)
    if found is None:
        error = shot.quality.promised
        assert error is not None
        found = [first_grid(error)] * len(deflections)
        if not len(solved):
            return found
        strata = stratify(shot, solved, deflections, free)
        given = shot, strata, loads, deflections
        if until < math.inf:
            arrays = kept_before("calibrations", [key]) or _measured(*given, until)
            if arrays is None:
                return None
            keep("calibrations", [key], arrays)
        else:
            arrays = kept("calibrations", [key], lambda: _measured(*given) or {})
        rows = zip(*(arrays[name].tolist() for name in MeasuredGrid._fields), strict=True)
        for stratum, row in zip(strata, rows, strict=True):
            for f in stratum.members:
                found[f] = MeasuredGrid(*row)
        _known[key] = found
        while len(_known) > _MAX_KNOWN:
            _known.pop(next(iter(_known)))
    return found


# of the shots that this process measured last, and how many
_known: dict[str, list[MeasuredGrid]] = {}
_MAX_KNOWN = 8  # as many as a test or a tuner goes between


def _measured(
    shot: Shot,
    strata: Sequence[Stratum],
    loads: LoadEstimate,
    deflections: Sequence[Deflection],
    until: float = math.inf,
) -> dict[str, Array] | None:
    """Arrays of every stratum: its levels, the error over the length, whether it is unique; None
    where the time ends."""
    error = shot.quality.promised
    assert error is not None
    sample = np.unique(np.concatenate([each.sample for each in strata]))
    leaving = {f for each in strata if each.is_free for f in each.sample.tolist()}
    windows = [_windows(shot, loads, deflections, f, f in leaving) for f in sample.tolist()]
    search = _Search(shot, sample, error, windows)
    with nothing_kept(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the bake itself warns
        if not search.go(until):
            return None
    place = {f: k for k, f in enumerate(sample.tolist())}
    rows = []
    for stratum in strata:
        own = [search.found[place[f]] for f in stratum.sample.tolist()]
        rows.append(
            (
                max(each.space for each in own),
                max(each.time for each in own),
                max(each.error for each in own),
                all(each.is_unique for each in own),
            )
        )
    columns = (np.array(each) for each in zip(*rows, strict=True))
    return dict(zip(MeasuredGrid._fields, columns, strict=True))


def _windows(
    shot: Shot, loads: LoadEstimate, deflections: Sequence[Deflection], f: int, is_free: bool
) -> tuple[Window, ...]:
    """Samples at which a feather is measured: at the start, and at its largest load; of what is
    pulled or leaves its root, one window from the start on."""
    last, rate = shot.last_frame - shot.first_frame, shot.frames_per_second
    long = max(2, round(WINDOW * rate))
    if is_free or deflections[f].is_pulled:
        return ((0, min(last, _MAX_PULLED_FRAMES)),)
    # alike for many feathers, whose windows then are simulated together
    peak = long * ((round(float(loads.peak[f]) * rate) - 1) // long)
    if peak <= 0:
        return ((0, min(last, long)),)
    return (0, min(last, long)), (peak, min(last, peak + long))


class _Search:
    """Search for the levels of a sample of feathers, all at once."""

    def __init__(
        self, shot: Shot, sample: Indices, error: float, windows: Sequence[tuple[Window, ...]]
    ) -> None:
        self._shot, self._sample, self._windows = shot, sample, list(windows)
        self._goal, self._promised = _MARGIN * error, error
        self._roots = _KnownRoots(some_roots(root_motion(shot), sample))
        self._runs: list[dict[tuple[Level, Window], WindowRun]] = [{} for _ in sample]
        self._lengths = np.array([shot.groom.feathers[f].kind.length for f in sample])
        first = first_grid(error)
        self._levels = [(first.space, first.time) for _ in sample]
        # what of each is measured next, by which parts: none where finer runs are known
        self._wanted: list[tuple[str, ...]] = [("space", "time") for _ in sample]
        self._parts: list[dict[str, float]] = [{} for _ in sample]
        self.found = [first for _ in sample]

    def go(self, until: float) -> bool:
        """Measure until all have their levels; whether the time (s of this process) sufficed."""
        left = list(range(len(self._sample)))
        for number in range(_ROUNDS):
            if not self._run(left, until):
                return False
            left = [k for k in left if self._step(k, number)]
        return True

    def _step(self, k: int, number: int) -> bool:
        """Take what was measured of a feather into account; whether it goes on."""
        space, time = self._levels[k]
        if self._flutters(k):
            self.found[k] = self.found[k]._replace(is_unique=False)
            return False
        if not self._wanted[k]:
            # lowered: what is finer is known
            fine = {level for level, _ in self._runs[k] if level[2]}
            error = REST_RATIOS["space"] * max(self._distance(k, each) for each in fine)
            if error <= self._goal:
                self.found[k] = MeasuredGrid(space, time, error, True)
            return False
        before, parts = dict(self._parts[k]), self._parts[k]
        for name in self._wanted[k]:
            parts[name] = REST_RATIOS[name] * self._distance(k, (space, time, name))
        error, known = sum(parts.values()), self.found[k]
        over = {name: parts[name] / (share * self._goal) for name, share in _SHARES.items()}
        if error < known.error:
            self.found[k] = MeasuredGrid(space, time, error, True)
        if error <= self._goal:
            lower = {name: _steps(_LOW / max(each, 1e-9)) for name, each in over.items()}
            self._wanted[k] = ()
            return self._move(k, {name: -each for name, each in lower.items()})
        worse = max(self._wanted[k], key=lambda name: over[name])
        if number and not parts[worse] <= MIN_FALL * before[worse]:
            # finer settings do not come nearer to each other; where some of them are given, these
            # are why
            is_unique = error <= self._promised or bool(given_grid(self._shot.quality))
            self.found[k] = self.found[k]._replace(is_unique=is_unique)
            return False
        # where it errs by far less, finer settings are not measured
        by_window = {each: self._error(k, each) for each in self._windows[k]}
        most = _FAR * max(by_window.values())
        self._windows[k] = tuple(each for each, own in by_window.items() if own >= most)
        raised = {name: _steps(each) for name, each in over.items()}
        if over["time"] > _RESTLESS:
            raised["space"] = 0  # whether steps converge shows at less cost
        self._wanted[k] = tuple(name for name, each in raised.items() if each)
        return self._move(k, raised)

    def _flutters(self, k: int) -> bool:
        """Return whether a feather flutters at its levels where one of its windows begins."""
        own = (((*self._levels[k], ""), each) for each in self._windows[k])
        return any(self._runs[k][each].flutters for each in own if each in self._runs[k])

    def _move(self, k: int, steps: Mapping[str, int]) -> bool:
        """Go to other levels of a feather; whether there are any."""
        ladders = zip(self._levels[k], steps.values(), (SPACE, TIME), strict=True)
        space, time = (min(max(a + step, 0), len(each) - 1) for a, step, each in ladders)
        going, self._levels[k] = (space, time) != self._levels[k], (space, time)
        return going

    def _error(self, k: int, window: Window) -> float:
        """Return the error of a feather in one window, over its length, at its levels."""
        names = self._wanted[k]
        return max(self._distance(k, (*self._levels[k], name), [window]) for name in names)

    def _distance(self, k: int, level: Level, windows: Sequence[Window] = ()) -> float:
        """Distance of a feather at its levels from a finer run of it, over its length."""
        most, own = 0.0, (*self._levels[k], "")
        for window in windows or self._windows[k]:
            here, other = (self._runs[k][each, window] for each in (own, level))
            most = max(most, run_distance(here, other) / float(self._lengths[k]))
        return most

    def _run(self, chosen: Iterable[int], until: float) -> bool:
        """Simulate what is not known yet of some feathers, all of one level together; whether the
        time sufficed."""
        wanted: dict[tuple[Level, Window], list[int]] = {}
        for k in chosen:
            for finer, window in product(("", *self._wanted[k]), self._windows[k]):
                each = (*self._levels[k], finer), window
                if each not in self._runs[k]:
                    wanted.setdefault(each, []).append(k)
        for (level, window), left in sorted(wanted.items()):
            # finer runs come after those that show it
            members = [k for k in left if not self._flutters(k)]
            if not members:
                continue
            if working_time() > until:
                return False
            for k, run in zip(members, self._simulated(level, window, members), strict=True):
                self._runs[k][level, window] = run
        return True

    def _simulated(self, level: Level, window: Window, members: Sequence[int]) -> list[WindowRun]:
        order = np.argsort(self._sample[list(members)])
        chosen = np.array(members)[order]
        part = part_of(self._shot, self._sample[chosen])
        part = replace(part, quality=quality_at(part.quality, level))
        try:
            runs = simulate_window(part, window, PickedRoots(self._roots, chosen))
        except (SimulationError, InputError):  # or a vane that folds over itself on a finer grid
            if len(members) == 1:
                return [_FAILED]
            return [run for k in members for run in self._simulated(level, window, [k])]
        return [runs[place] for place in np.argsort(order)]


@dataclass
class _KnownRoots:
    """Roots of a sample, which windows of many runs ask for at the same times."""

    motion: Roots
    known: dict[float, RootFrames] = field(default_factory=dict)

    def frames(self, time: float) -> RootFrames:
        if time not in self.known:
            self.known[time] = self.motion.frames(time)
        return self.known[time]


def simulate_window(shot: Shot, window: Window, motion: Roots | None = None) -> list[WindowRun]:
    """Simulate the feathers of a shot in a window that they begin at rest. motion: of the roots,
    None: the shot's own."""
    first, last = (shot.first_frame + each for each in window)
    simulation = simulate(shot, frames=(first, last), begin=window[0], motion=motion)
    points: list[list[RowPoints]] = [[] for _ in shot.groom.feathers]
    for _ in simulation:
        for f, (_, now) in simulation.simulated().items():
            points[f].append(RowPoints(now.nodes.copy(), now.directors.copy()))
    feathers, fluttering = simulation.simulated(), simulation.fluttering()
    return [WindowRun(feathers[f][0], own, f in fluttering) for f, own in enumerate(points)]


def run_distance(one: WindowRun, other: WindowRun) -> float:
    """Return the largest distance (m) of a feather's nodes from a finer run of it."""
    if one.feather is None or other.feather is None:
        return math.inf
    return max_distance(one.feather, other.feather, one.points, other.points)


def quality_at(quality: Quality, level: Level) -> Quality:
    """Return the quality that simulates all feathers at one level; its own numbers overrule it."""
    grid = dict(zip(SPACE_NUMBERS, SPACE[level[0]], strict=True)) | given_grid(quality)
    tolerance, relative = (
        quality.tolerance or _LARGEST,
        1.0 if quality.tolerance else TIME[level[1]],
    )
    found = quality.on_grid(*grid.values(), tolerance=tolerance, relative_tolerance=relative)
    return refine_quality(found, level[2]) if level[2] else found


def refine_quality(quality: Quality, name: str, times: int = 1) -> Quality:
    """Return the quality of one grid finer in "space" or "time", so many times."""
    if name == "time":
        ratio = TIGHTER_RATIO**times
        assert quality.tolerance is not None
        return replace(
            quality,
            tolerance=max(quality.tolerance / ratio, _MIN_TOLERANCE),
            relative_tolerance=quality.relative_tolerance / ratio,
        )
    return replace(
        quality,
        rows=_FINER_RATIO**times * (quality.rows - 1) + 1,
        columns=_FINER_RATIO**times * quality.own_columns,
        coefficients=min(quality.coefficients + times * _MORE_COEFFICIENTS, MAX_COEFFICIENTS),
    )


def _steps(ratio: float) -> int:
    """Return by how many levels an error falls by a ratio."""
    return math.ceil(min(math.log(max(ratio, 1.0)) / math.log(_FALL), _MAX_STEPS))
