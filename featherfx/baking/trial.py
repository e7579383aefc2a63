"""Bakes of a part of a shot, and what they say of the bake of all.

The whole is built once, for what is kept of it, and again to see what a bake takes for that. Trials
are bakes like any other, written to a folder that is removed: of as many feathers as their time
allows, up to all, and a few of the first frames, so that little is left to what is fixed or comes
once. The first, of a few, is done twice; what it took longer is what every process loads. Feathers
stand beside each other in a trial, the same share of every region, so that they push, cover and
follow each other as in the whole; what they take goes with the unknowns that are solved.

How much harder later frames are than the first is counted, not timed: a few feathers go through all
frames, and a frame costs as many Newton iterations as they take, and a part that goes with none.
"""

from __future__ import annotations

import gc
import mmap
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.baking.bake import peak_memory_bytes
from featherfx.baking.options import TRIAL_SECONDS, BakeOptions
from featherfx.baking.task import BakeTask
from featherfx.errors import InputWarning
from featherfx.files.memory import give_back_memory
from featherfx.phases import Account, phase
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options.options import FeatherOptions, ShotOptions, resolve_options
from featherfx.shot.patterns import may_touch
from featherfx.shot.subset import part_of
from featherfx.shot.types import Detail, Shot
from featherfx.usd.write.forms import choose_group
from featherfx.usd.write.output import unique_prim_names

# feathers of the first trials and of the next, and frames of each
_FEW, _MORE, _FRAMES = 12, 96, 6
# feathers that go through all frames, and their share of the time for trials
_COURSE, _OF_COURSE = 32, 0.25
# neighbours that are tried together
_TOGETHER = 16
# share of a bake's processor time that a trial may take where TRIAL_SECONDS are less, up to s of it
_OF_BAKE, _MAX_SECONDS = 1.0 / 6.0, 60.0
# over the feathers of the last trial, those that make a larger one worth its time
_WORTH = 1.5
# phases that go with what is solved, and those of the frames
_OF_WORK = ("settling", "preroll", "earlier", "simulating")
_LOOP = ("simulating", "writing")


@dataclass(frozen=True)
class Trial:
    """A bake of some feathers. frames: that it wrote. work: unknowns of a frame. once: by phase,
    (2,) s on the clock and of the processors. frame: (2,) those of a frame after the first, which
    are left out of once. memory: bytes that it added to the process."""

    feathers: int
    frames: int
    work: float
    once: dict[str, Array]
    frame: Array
    memory: float

    def of(self, name: str) -> Array:
        """(2,) s of a phase."""
        return self.once.get(name, np.zeros(2))

    @property
    def cost(self) -> float:
        """s of processor time."""
        return float(sum(self.once.values(), (self.frames - 1) * self.frame)[1])


@dataclass(frozen=True)
class ExpectedCost:
    """Expected cost of a bake. phases: s of wall time of each. processor: s of CPU time of all.
    memory: bytes of the process. trial: the largest that this was learnt from. seconds: that all of
    it took."""

    phases: dict[str, float]
    processor: float
    memory: float
    trial: Trial
    seconds: float


def expected(shot: Shot, jobs: int, budget: float | None = None) -> ExpectedCost:
    """Estimate the time of the phases of a bake on this machine as it is now.

    budget: s of processor time for the trials, None: TRIAL_SECONDS, or a share of the bake's.
    Raises SimulationError where one of the feathers that are tried cannot be simulated.
    """
    begin = time.perf_counter()
    # the solver takes its time to load, here as in a bake
    once = {"starting": time_of(lambda: import_module("featherfx.baking.frame_loop"))}
    held = resident_bytes(release=True)
    with phase("building"):
        simulate(shot, jobs)
        once["building"] = time_of(lambda: simulate(shot, jobs))
    trials, course = _tried(shot, jobs, budget)
    once = _whole(shot, trials, course) | once
    return ExpectedCost(
        phases={name: float(seconds[0]) for name, seconds in once.items()},
        processor=float(sum(seconds[1] for seconds in once.values())),
        memory=held + _memory(trials, len(shot.groom.feathers)),
        trial=trials[-1],
        seconds=time.perf_counter() - begin,
    )


def _whole(shot: Shot, trials: Sequence[Trial], course: TrialCourse | None) -> dict[str, Array]:
    """(2,) s that the phases of the whole take, by the first trial, which is done twice, and the
    last."""
    first, again, last = trials[0], trials[1], trials[-1]
    solved, others = 1.0, len(shot.groom.feathers) / last.feathers
    if others > 1.0:
        solved = work_of(shot) / last.work
    once = {
        name: np.maximum(first.of(name) - again.of(name), 0.0)
        + (solved if name in _OF_WORK else others) * seconds
        for name, seconds in last.once.items()
    }
    frame = last.frame * solved
    if course is not None:
        frame = frame * course.harder(last)
        if others > 1.0 and _pushing(shot).any():
            frame = frame * max(course.denser(last, work_of(shot)), 1.0)
    once["simulating"] = once["simulating"] + frame * (shot.last_frame - shot.first_frame)
    return once


def time_of(work: Callable[[], object]) -> Array:
    """(2,) s that some work takes, on the clock and of the processors."""
    begin = np.array([time.perf_counter(), time.process_time()])
    work()
    return np.array([time.perf_counter(), time.process_time()]) - begin


def _tried(shot: Shot, jobs: int, budget: float | None) -> tuple[list[Trial], TrialCourse | None]:
    """The trials that s of processor time suffice for, and the course of all frames, None where
    they tried them all."""
    total, frames = len(shot.groom.feathers), shot.last_frame - shot.first_frame + 1
    few, begin = (min(total, _FEW), min(frames, _FRAMES)), time.process_time()
    most = TRIAL_SECONDS if budget is None else budget
    with phase("measuring") as done:
        trials = [_trial(shot, *few, jobs), _trial(shot, *few, jobs)]
        done(2)
        course = _course(shot, jobs, _OF_COURSE * most) if frames > _FRAMES else None
        done(3)
        while trials[-1].feathers < total:
            left = most - (time.process_time() - begin)
            if budget is None:
                cost = float(sum(_whole(shot, trials, course).values(), np.zeros(2))[1])
                left = max(left, min(_OF_BAKE * cost, _MAX_SECONDS))
            count = _larger(trials, left, total)
            if count is None:
                break
            trials.append(_trial(shot, count, few[1], jobs))
            done(len(trials) + 1)
    return trials, course


def _larger(trials: Sequence[Trial], left: float, total: int) -> int | None:
    """Feathers of the trial that takes the s of processor time left; None where it would not be
    worth them. The first two trials are of the same."""
    last, before = trials[-1], trials[-2]
    if before.feathers == last.feathers:
        # what is fixed looks as if it went with these
        return min(
            total, _MORE, max(int(2.0 * last.feathers * left / last.cost), last.feathers + 1)
        )
    # more fixed costs than these tell, at most
    grown = (last.cost - before.cost) / (last.feathers - before.feathers)
    each = max(grown, 0.2 * last.cost / last.feathers)
    count = min(last.feathers + int((left - last.cost) / each), total)
    return count if count >= min(_WORTH * last.feathers, total) else None


def _memory(trials: Sequence[Trial], total: int) -> float:
    """Bytes that a bake of so many feathers adds: what it loads, and what goes with them."""
    first, few, last = trials[0], trials[1], trials[-1]
    each = max(last.memory - few.memory, 0.0) / max(last.feathers - few.feathers, 1)
    return max(first.memory, few.memory) + each * (total - few.feathers)


def _trial(shot: Shot, count: int, frames: int, jobs: int) -> Trial:
    from featherfx.baking.frame_loop import simulate_and_write

    part = part_of(shot, _some(shot, count))
    marks: list[Array] = []
    before = held = resident_bytes(release=True)

    def look(*_: object) -> None:
        nonlocal held
        held = max(held, resident_bytes())

    def mark(*_: object) -> None:
        look()
        marks.append(_spent(timed, _LOOP))

    with tempfile.TemporaryDirectory(prefix="featherfx-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        task = BakeTask(
            part,
            Path(folder) / "trial.usdc",
            (shot.first_frame, shot.first_frame + frames - 1),
            settings={},
            names=unique_prim_names([each.id for each in part.groom.feathers]),
            root="trial",
            finished=False,
            options=BakeOptions(
                jobs=jobs,
                meters_per_unit=1.0,
                up_axis="Z",
                group=choose_group(None, len(shot.groom.feathers)),
            ),
            whole=part,
            wanted=None,
            taken=None,
            origin=(0.0, 0.0, 0.0),
            dependences=None,
        )
        with Account(look) as timed:
            simulate_and_write(task, mark)
            once = {name: _spent(timed, (name,)) for name in timed.seconds()}
    # until the first frame is handed on, what others need is loaded; what comes after the last is
    # what nothing goes on beside
    loop = _spent(timed, _LOOP)
    once |= {"simulating": marks[1], "writing": loop - marks[-1]}
    once.pop("compiling", None)
    return Trial(
        feathers=len(part.groom.feathers),
        frames=frames,
        work=work_of(part),
        once=once,
        frame=(marks[-1] - marks[1]) / max(frames - 1, 1),
        memory=held - before,
    )


def _spent(timed: Account, names: Sequence[str]) -> Array:
    """(2,) s of some phases so far, on the clock and of the processors."""
    own, worked = timed.seconds(), timed.processor_seconds()
    return np.array([sum(each.get(name, 0.0) for name in names) for each in (own, worked)])


def resident_bytes(release: bool = False) -> int:
    """Return the resident memory of this process now, or its largest so far where that is unknown.

    release: give free memory back to the system first, where that is possible.
    """
    if release:
        gc.collect()
        give_back_memory()
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * mmap.PAGESIZE
    except OSError:
        return peak_memory_bytes() or 0


@dataclass(frozen=True)
class TrialCourse:
    """Cost of the frames after the first, of a few feathers. iterations: (K,) of Newton's method,
    of all of them; seconds: (K,) of processor time; work: unknowns of a frame."""

    iterations: Array
    seconds: Array
    work: float

    def harder(self, trial: Trial) -> float:
        """Return the cost of a frame of the shot over that of a frame of a trial of its first
        frames."""
        first = self.iterations[: trial.frames - 1].mean()
        spread = self.iterations - self.iterations.mean()
        if not spread.any() or not first:
            return 1.0
        of_one = max(float(spread @ self.seconds / (spread @ spread)), 0.0)
        of_one *= trial.work / self.work
        share = min(of_one * first / float(trial.frame[1]), 1.0)
        return float(1.0 - share + share * self.iterations.mean() / first)

    def denser(self, trial: Trial, work: float) -> float:
        """Return the cost of a frame of a shot with so many unknowns, over as many times that of a
        trial: feathers that push each other, which are together in a course, hold each other
        up more than the part of them that a trial has."""
        alike = self.harder(trial) * float(trial.frame[1]) / trial.work
        if not alike > 0.0:
            return 1.0
        own = float(self.seconds.mean()) + alike * max(work - self.work, 0.0)
        return own / (alike * work)


def _course(shot: Shot, jobs: int, most: float) -> TrialCourse:
    """A few feathers through the frames of a shot, or the first of them that s of processor time
    suffice for."""
    part = _pinned(shot)
    begin = time.process_time()
    marks, iterations = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        simulation = simulate(part, jobs)
        for _ in simulation.frames(lambda sample: False):
            iterations.append(sum(float(r.iterations.sum()) for r in simulation.counted().reports))
            marks.append(time.process_time())
            if marks[-1] - begin > most and len(marks) > _FRAMES:
                break
    return TrialCourse(np.array(iterations[1:]), np.diff(marks), work_of(part))


def _pinned(shot: Shot) -> Shot:
    """A few feathers that are simulated, at their levels: evenly among all, or of those that push
    others the longest, whose steps all go along with."""
    options, feathers = _options(shot), shot.groom.feathers
    push = np.flatnonzero(_pushing(shot))
    if len(push):
        lengths = np.array([feathers[f].kind.length for f in push])
        chosen = np.sort(push[np.argsort(-lengths, kind="stable")[:_COURSE]])
    else:
        numbers = options.leading if len(options.leading) else np.arange(len(feathers))
        places = np.linspace(0, len(numbers) - 1, min(_COURSE, len(numbers)))
        chosen = numbers[places.astype(np.int64)]
    part = part_of(shot, chosen)
    pinned = tuple(
        Detail(feathers=each.id, level=options.feathers[f].level)
        for f, each in zip(chosen, part.groom.feathers, strict=True)
    )
    return replace(part, details=part.details + pinned, level_of_detail=None)


def _pushing(shot: Shot) -> Flags:
    """(F,) whether each feather pushes others."""
    if shot.contact is None:
        return np.zeros(len(shot.groom.feathers), dtype=np.bool_)
    return np.array(may_touch(shot, shot.contact))


def _some(shot: Shot, count: int) -> Indices:
    """Numbers of about so many feathers: the same share of those of each region that push others,
    and of those that do not, and one of each at least."""
    feathers, push = shot.groom.feathers, _pushing(shot)
    if count == len(feathers):
        return np.arange(count)
    alike = defaultdict(list)
    for f, each in enumerate(feathers):
        alike[each.region, bool(push[f])].append(f)
    share = count / len(feathers)
    chosen = [
        _neighbours(shot, np.array(own), max(round(share * len(own)), 1)) for own in alike.values()
    ]
    return np.sort(np.concatenate(chosen))


def _neighbours(shot: Shot, numbers: Indices, count: int) -> Indices:
    """So many of some feathers, in groups of neighbours evenly among them."""
    roots = np.array([shot.groom.feathers[f].position for f in numbers])
    groups = max(count // _TOGETHER, 1)
    found = []
    for places, some in zip(
        np.array_split(np.arange(len(numbers)), groups),
        np.array_split(np.arange(count), groups),
        strict=True,
    ):
        way = np.linalg.norm(roots[places] - roots[places[len(places) // 2]], axis=1)
        found.append(numbers[places[np.argsort(way, kind="stable")[: len(some)]]])
    return np.sort(np.concatenate(found))


def _options(shot: Shot) -> ShotOptions:
    return resolve_options(shot, drawn_feathers(shot), root_motion(shot))


def work_of(shot: Shot) -> float:
    """Unknowns of a frame."""
    return 1.0 + sum(map(unknowns, _options(shot).feathers))


def unknowns(options: FeatherOptions) -> int:
    """Six a row, and two directions of coefficients for the two barbs of a row."""
    if not options.is_simulated:
        return 0
    return options.rows * (6 + 4 * options.coefficients)
