"""The promise as a measurement: grids and tolerances that keep an error, found on a sample.

A sample of each stratum (grids.py) is simulated before the first frame: where the shot begins,
settling included, and where its loads are largest. What a setting errs by follows from what finer
ones differ by,

    e = e_space + e_time,     e_space = 4/3 |x - x_s|,     e_time = 5/4 |x - x_t|

largest distance of any node at any frame, over the length. x_s has twice the rows and columns, of
which errors are of second order, and one coefficient more; x_t a tenth of the tolerance, of which
they go with the power 0.7. Each part is raised by as many levels of SPACE or TIME as it is too
large for, and measured again in the windows where it is large; where it is far below, it is lowered
once. Where the finest settings do not keep the error, the report has the figure.

A feather that finds no rest flutters, and finer settings may lead ever elsewhere: it has no unique
answer, and the report names it. Its mean pose and swing are unique. There

    e = max(|m - m_s|, |m - m_t|)

m the mean pose as seen from the root, and the RMS distance from it; over _MEAN_TIMES, the longer
one where the shorter one does not suffice, on grids within _MAX_MEAN_WORK. That is measured of the
feather of each kind that loads bend most; others of the kind that flutter take the same grid.

A window begins at rest under the loads of its first sample. What a shot brings into it is not in
its error, which is why a sample may err by a part of what is promised only (_MARGIN).

Feathers push nothing here, and shapes of meshes, which fit one grid, do not draw them.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, SimulationError
from featherfx.files.disk_cache import nothing_kept
from featherfx.jit.compile_workers import working_time
from featherfx.phases import phase
from featherfx.shot.loads import Deflection, LoadEstimate
from featherfx.shot.loop.grids import Stratum
from featherfx.shot.loop.window_runs import (
    FAILED_RUN,
    MIN_FALL,
    REST_RATIOS,
    WINDOW,
    Level,
    Window,
    WindowRun,
    mean_run_distance,
    quality_at,
    run_distance,
    simulate_window,
)
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import SPACE, TIME, first_grid, given_grid
from featherfx.shot.roots import PickedRoots, RootFrames, Roots, some_roots
from featherfx.shot.types import MeasuredGrid, Shot, part_of

# of what is promised, what a sample may err by; of that, the parts of grids and of steps
_MARGIN, _SHARES = 0.5, {"space": 0.6, "time": 0.4}
# by how much an error falls from one level of SPACE and TIME to the next
_FALL = 2.0
# rounds of measuring; levels at once; of a part's goal, to which it is lowered
_ROUNDS, _MAX_STEPS, _LOW = 12, 2, 0.5
# of its largest error in any window, below which a window is measured no more
_FAR = 0.25
# of its goal, error of steps from which on these are refined alone
_RESTLESS = 4.0
# frames of what is pulled, at most
_MAX_PULLED_FRAMES = 36
# s, over which means are taken: some ten periods of a flapping plume, and four times as many; and
# times the frames of a shot, which these are at most
_MEAN_TIMES, _MAX_SHOTS = (1.0, 4.0), 8
# nodes times s of a run of which means are taken, at most: some twenty seconds of a core
_MAX_MEAN_WORK = 3000.0


def measure_strata(
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
    bent = [-deflections[f].rachis / shot.groom.feathers[f].kind.length for f in sample.tolist()]
    with nothing_kept(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the bake itself warns
        if not search.go(np.argsort(bent, kind="stable").tolist(), until):
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
        self._first = first = first_grid(error)
        self._levels = [(first.space, first.time) for _ in sample]
        # what of each is measured next, by which parts: none where finer runs are known
        self._wanted: list[tuple[str, ...]] = [("space", "time") for _ in sample]
        # errors by part and window, and levels by which parts were raised, the last time
        self._seen: list[dict[tuple[str, Window], float]] = [{} for _ in sample]
        self._raised: list[dict[str, int]] = [{} for _ in sample]
        # windows whose poses have an answer, and others; how many of _MEAN_TIMES were tried
        self._calm, self._restless = list(windows), [list[Window]() for _ in sample]
        self._means = [0 for _ in sample]
        self._standing: dict[str, int] = {}  # for those of its kind that flutter
        # of poses, and in the end
        self._of_poses, self.found = [first for _ in sample], [first for _ in sample]

    def go(self, order: Sequence[int], until: float) -> bool:
        """Measure until all have their levels; whether the time (s of this process) sufficed.

        order: of the sample; what comes first stands for others of its kind that flutter.
        """
        left = list(order)
        with phase("calibrating", _ROUNDS, at_most=True, whole=True) as done:
            for number in range(_ROUNDS):
                if not self._run(left, until):
                    return False
                left = [k for k in left if self._step(k)]
                done(number + 1)
        for k, own in enumerate(self.found):
            if not own.is_unique:
                poses, means = self._of_poses[k], self.found[self._standing.get(self._kind(k), k)]
                space, time = (max(each) for each in zip(poses[:2], means[:2], strict=True))
                error = max(means.error, poses.error if math.isfinite(poses.error) else 0.0)
                self.found[k] = MeasuredGrid(space, time, error, False)
        return True

    def _kind(self, k: int) -> str:
        return self._shot.groom.feathers[int(self._sample[k])].kind.name

    def _step(self, k: int) -> bool:
        """Take what was measured of a feather into account; whether it goes on."""
        if restless := [each for each in self._windows[k] if self._flutters(k, each)]:
            return self._set_aside(k, restless)
        space, time = self._levels[k]
        if not self._wanted[k]:
            # lowered: what is finer is known
            runs = {level for level, _ in self._runs[k] if level[2]}
            fine = [e for e in runs if all((e, each) in self._runs[k] for each in self._windows[k])]
            error = REST_RATIOS["space"] * max(self._distance(k, each) for each in fine)
            if error <= self._goal:
                self.found[k] = self.found[k]._replace(space=space, time=time, error=error)
            return self._take_means(k)
        windows, before = self._windows[k], dict(self._seen[k])
        seen = self._seen[k]
        for name, each in product(self._wanted[k], windows):
            seen[name, each] = self._part(k, name, each)
        parts = {name: max(seen[name, each] for each in windows) for name in _SHARES}
        goal, shares, error = self._goal, _SHARES, sum(parts.values())
        if self._means[k]:
            goal, shares, error = self._promised, dict.fromkeys(_SHARES, 1.0), max(parts.values())
        over = {name: parts[name] / (share * goal) for name, share in shares.items()}
        if error < self.found[k].error:
            self.found[k] = self.found[k]._replace(space=space, time=time, error=error)
        if error <= goal:
            lower = {name: -_steps(_LOW / max(each, 1e-9)) for name, each in over.items()}
            self._wanted[k] = ()
            return not self._means[k] and (self._move(k, lower) or self._take_means(k))
        if self._means[k] and self._take_means(k):
            return True
        # parts of which finer settings do not come nearer to each other, where they err most; where
        # some of these are given, they are why
        by_window = {each: max(seen[name, each] for name in self._wanted[k]) for each in windows}
        stuck = dict[str, list[Window]]()
        for name in self._wanted[k]:
            steps = self._raised[k].get(name, 0) if over[name] > _RESTLESS else 1
            least = MIN_FALL**steps
            own = [
                w for w in windows if not seen[name, w] <= least * before.get((name, w), math.inf)
            ]
            if max(windows, key=lambda each: seen[name, each]) in own:
                stuck[name] = own
        apart = [each for own in stuck.values() for each in own if by_window[each] > self._promised]
        is_judged = self._means[k] or self.found[k].error <= self._promised
        if apart and not is_judged and not given_grid(self._shot.quality):
            return self._set_aside(k, apart)
        # where it errs by far less, finer settings are not measured
        most = _FAR * max(by_window.values())
        self._windows[k] = tuple(each for each, own in by_window.items() if own >= most)
        raised = {name: 0 if name in stuck else _steps(each) for name, each in over.items()}
        if over["time"] > _RESTLESS and raised["time"] and time < len(TIME) - 1:
            raised["space"] = 0  # whether steps converge shows at less cost
        self._raised[k], self._wanted[k] = (
            raised,
            tuple(name for name, each in raised.items() if each),
        )
        return self._move(k, raised) or self._take_means(k)

    def _set_aside(self, k: int, windows: Sequence[Window]) -> bool:
        """Measure a feather anew before the first of windows without one answer; whether it goes
        on."""
        # what a feather has come to in one goes on in later ones
        self._restless[k][:0] = [each for each in self._calm[k] if each >= min(windows)]
        self._calm[k] = tuple(each for each in self._calm[k] if each < min(windows))
        self._begin(k, self._calm[k], self._first)
        return bool(self._calm[k]) or self._take_means(k)

    def _begin(self, k: int, windows: tuple[Window, ...], found: MeasuredGrid) -> None:
        """Measure a feather without one answer from the levels found so far on, by both parts."""
        self._windows[k], self._wanted[k] = windows, tuple(_SHARES)
        self._levels[k], self._seen[k], self._raised[k] = (found.space, found.time), {}, {}
        self.found[k] = found._replace(error=math.inf, is_unique=False)

    def _take_means(self, k: int) -> bool:
        """Go on with means, over the next of _MEAN_TIMES; whether there are any."""
        number, shot, poses = self._means[k], self._shot, self.found[k]
        stands = self._standing.setdefault(self._kind(k), k) if self._restless[k] else -1
        if number == 0 and self._restless[k] and self._calm[k]:
            self._of_poses[k] = poses
        if stands != k or number == len(_MEAN_TIMES):
            return False
        first, last = self._restless[k][-1][0], shot.last_frame - shot.first_frame
        frames = round(_MEAN_TIMES[number] * shot.frames_per_second)
        window = first, first + min(frames, _MAX_SHOTS * max(last, 1))
        self._begin(k, (window,), self._first if number == 0 else self.found[k])
        self._means[k] += 1
        return True

    def _flutters(self, k: int, window: Window) -> bool:
        """Return whether poses are asked of a feather that flutters where a window begins."""
        run = self._runs[k].get(((*self._levels[k], ""), window))
        return run is not None and run.flutters and not self._means[k]

    def _move(self, k: int, steps: Mapping[str, int]) -> bool:
        """Go to other levels of a feather; whether there are any."""
        ladders = zip(self._levels[k], steps.values(), (SPACE, TIME), strict=True)
        space, time = (min(max(a + step, 0), len(each) - 1) for a, step, each in ladders)
        while space > self._levels[k][0] and self._mean_work(k, space) > _MAX_MEAN_WORK:
            space -= 1
        going, self._levels[k] = (space, time) != self._levels[k], (space, time)
        return going

    def _mean_work(self, k: int, space: int) -> float:
        """Nodes times s of the finer run at a level of SPACE, where means are taken, else 0."""
        if not self._means[k]:
            return 0.0
        finer, (first, last) = (
            quality_at(self._shot.quality, (space, 0, "space")),
            self._windows[k][0],
        )
        nodes = finer.rows * (1 + 2 * finer.own_columns)
        return nodes * (last - first) / self._shot.frames_per_second

    def _part(self, k: int, name: str, window: Window) -> float:
        """Return a part of the error of a feather in a window, over its length, at its levels."""
        ratio = 1.0 if self._means[k] else REST_RATIOS[name]
        return ratio * self._distance(k, (*self._levels[k], name), [window])

    def _distance(self, k: int, level: Level, windows: Sequence[Window] = ()) -> float:
        """Distance of a feather at its levels from a finer run of it, over its length."""
        most, own = 0.0, (*self._levels[k], "")
        apart = mean_run_distance if self._means[k] else run_distance
        for window in windows or self._windows[k]:
            here, other = (self._runs[k][each, window] for each in (own, level))
            most = max(most, apart(here, other) / float(self._lengths[k]))
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
            members = [k for k in left if not self._flutters(k, window)]
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
                return [FAILED_RUN]
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


def _steps(ratio: float) -> int:
    """Return by how many levels an error falls by a ratio."""
    return math.ceil(min(math.log(max(ratio, 1.0)) / math.log(_FALL), _MAX_STEPS))
