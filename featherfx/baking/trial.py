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
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.baking.bake import peak_memory_bytes
from featherfx.baking.options import TRIAL_SECONDS, BakeOptions
from featherfx.baking.task import BakeTask
from featherfx.baking.trial_feathers import (
    MAX_COURSE,
    largest_group,
    pick_course,
    pick_feathers,
    pushing_feathers,
)
from featherfx.errors import InputError, InputWarning, Problem
from featherfx.feather.types import Feather
from featherfx.files.process import give_back_memory
from featherfx.jit.compile_workers import working_time
from featherfx.phases import Account, phase
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import FeatherOptions, ShotOptions, resolve_options
from featherfx.shot.types import Shot, part_of
from featherfx.usd.write.output import choose_group, unique_prim_names

# feathers of the first trials and of the next, and frames of each
_FEW, _MORE, _FRAMES = 12, 96, 6
# of the time for trials, the part of feathers that go through all frames; over the cost of as many
# in a trial, what must be left for them
_OF_COURSE, _COURSE_RATIO = 0.25, 2.0
# of a budget, how far beyond it the first trial may go
_FIRST_TRIAL_RATIO = 0.25
# of the time left, what may go into building the whole
_BUILDING_RATIO = 0.3
# of the time left, what may go into measuring grids; cost of other grids over those that the
# measuring begins with
_MEASURING_RATIO, _OTHER_GRIDS = 0.3, (0.5, 4.0)
# share of a bake's processor time that a trial may take where TRIAL_SECONDS are less, up to s of it
_OF_BAKE, MAX_TRIAL_SECONDS = 1.0 / 6.0, 60.0
# of a time, what it is off by if it is measured again
_REPEATABILITY = 0.1
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
    it took. low, high: fractions of both times, between which they are expected."""

    phases: dict[str, float]
    processor: float
    memory: float
    trial: Trial
    seconds: float
    low: float
    high: float


class OutOfTimeError(InputError):
    """The time for trials ended before two frames of the first."""

    def __init__(self) -> None:
        text = (
            "is over before two frames of a few feathers were simulated, at"
            f" {working_time():.3g} s. Give more, or start again with what is now cached"
        )
        super().__init__(Problem("stats", "--seconds", text))


def expected(
    resolved: TimedOptions, jobs: int, until: float, budget: float | None = None
) -> ExpectedCost:
    """Estimate the time of the phases of a bake of a shot on this machine as it is now.

    until: working_time when the last trial ends. budget: s of it after which no other trial begins;
    None: TRIAL_SECONDS, or a share of the bake's. Raises SimulationError where one of the feathers
    that are tried cannot be simulated, OutOfTimeError where there is no time for any.
    """
    begin, shot = time.perf_counter(), resolved.shot
    # the solver takes its time to load, here as in a bake
    once = {"starting": time_of(lambda: import_module("featherfx.baking.frame_loop"))}
    held = resident_bytes(release=True)
    once |= _build_whole(shot, jobs, until)
    work = sum_unknowns(resolved.options.feathers)
    trials, course = _tried(shot, work, jobs, until, budget)
    fixed = float(sum(seconds[1] for seconds in once.values()))
    once = _whole(shot, work, trials, course) | once
    processor = float(sum(seconds[1] for seconds in once.values()))
    low, high = _range(shot, work, trials, course)
    if not resolved.options.is_measured:
        low, high = low * _OTHER_GRIDS[0], high * _OTHER_GRIDS[1]
    share = (processor - fixed) / processor
    return ExpectedCost(
        phases={name: float(seconds[0]) for name, seconds in once.items()},
        processor=processor,
        memory=held + _memory(trials, len(shot.groom.feathers)),
        trial=trials[-1],
        seconds=time.perf_counter() - begin,
        low=1.0 - share * (1.0 - low),
        high=1.0 + share * (high - 1.0),
    )


def _build_whole(shot: Shot, jobs: int, until: float) -> dict[str, Array]:
    """(2,) s of building the whole; empty where a part of the time left does not suffice. Building
    then goes with the feathers of a trial, which are built by themselves."""
    end = working_time() + _BUILDING_RATIO * (until - working_time())
    with phase("building"), Account(lambda _: require_time(0.0, end)):
        try:
            seconds = time_of(lambda: simulate(shot, jobs))
            if has_time_for(seconds[1], end):
                seconds = time_of(lambda: simulate(shot, jobs))
        except OutOfTimeError:
            return {}
    return {"building": seconds}


class TimedOptions(NamedTuple):
    """A shot that measures no grids any more, and the options of its feathers."""

    shot: Shot
    options: ShotOptions


def resolve_in_time(shot: Shot, drawn: Sequence[Feather], until: float) -> TimedOptions:
    """Resolve the options of a shot.

    until: working_time, s. A part of what is left may go into measuring grids, else those that the
    measuring begins with are taken.
    """
    now = working_time()
    end = now + _MEASURING_RATIO * max(until - now, 0.0)
    options = resolve_options(shot, drawn, root_motion(shot), end)
    if options.measured:
        names = [each.id for each in shot.groom.feathers]
        shot = replace(shot, grids=dict(zip(names, options.measured, strict=True)))
    return TimedOptions(shot, options)


def has_time_for(seconds: float, until: float) -> bool:
    """Return whether so many s of CPU time are left until then."""
    return working_time() + seconds < until


def require_time(seconds: float, until: float) -> None:
    """Raise OutOfTimeError where less than so many s of CPU time are left until then."""
    if not has_time_for(seconds, until):
        raise OutOfTimeError


def _range(
    shot: Shot, work: float, trials: Sequence[Trial], course: TrialCourse | None
) -> tuple[float, float]:
    """Return the lowest and the highest cost of all trials' phases, over the expected.

    They lie between an extrapolation by feathers and one by unknowns, between frames that are as
    hard as the first and as those that the course shows, and differ by twice the standard error of
    a frame's cost.
    """
    last, total = trials[-1], len(shot.groom.feathers)
    ratios = [1.0]
    if total > last.feathers:
        by_feathers, by_work = total / last.feathers, work / last.work
        ratios.append(by_feathers / by_work)
        if pushing_feathers(shot).any():
            # a contact group that is tried in part
            ratios.append(max(largest_group(shot) / last.feathers, 1.0) ** 0.5)
    spread = _REPEATABILITY
    if course is not None:
        ratios.append(1.0 / course.harder(last))
        costs = course.seconds
        spread += 2.0 * float(costs.std() / (costs.mean() * len(costs) ** 0.5))
        seen = len(costs) / max(shot.last_frame - shot.first_frame, 1)
        # frames that were not reached may all be like the hardest or the easiest
        ratios += [
            1.0 + (1.0 - seen) * (each / costs.mean() - 1.0) for each in np.sort(costs)[[0, -1]]
        ]
    return min(ratios) / (1.0 + spread), max(ratios) * (1.0 + spread)


def _whole(
    shot: Shot, work: float, trials: Sequence[Trial], course: TrialCourse | None
) -> dict[str, Array]:
    """(2,) s that the phases of the whole take, by the first trial, which is done twice, and the
    last. work: unknowns of a frame of the whole."""
    first, again, last = trials[0], trials[1], trials[-1]
    solved, others = 1.0, len(shot.groom.feathers) / last.feathers
    if others > 1.0:
        solved = work / last.work
    once = {
        name: np.maximum(first.of(name) - again.of(name), 0.0)
        + (solved if name in _OF_WORK else others) * seconds
        for name, seconds in last.once.items()
    }
    frame = last.frame * solved
    if course is not None:
        frame = frame * course.harder(last)
        if others > 1.0 and pushing_feathers(shot).any():
            frame = frame * max(course.denser(last, work), 1.0)
    once["simulating"] = once["simulating"] + frame * (shot.last_frame - shot.first_frame)
    return once


def time_of(work: Callable[[], object]) -> Array:
    """(2,) s that some work takes, on the clock and of the processors without compiling."""
    begin = np.array([time.perf_counter(), working_time()])
    work()
    return np.array([time.perf_counter(), working_time()]) - begin


def _tried(
    shot: Shot, work: float, jobs: int, until: float, budget: float | None
) -> tuple[list[Trial], TrialCourse | None]:
    """Return the trials that the time suffices for, and the course of all frames, None where they
    tried them all. until, budget: as of expected."""
    total, frames = len(shot.groom.feathers), shot.last_frame - shot.first_frame + 1
    few, begin = (min(total, _FEW), min(frames, _FRAMES)), working_time()
    most = TRIAL_SECONDS if budget is None else budget
    require_time(0.0, until)
    with phase("measuring") as done:
        # without it nothing is known
        first = _trial(shot, *few, jobs, until + _FIRST_TRIAL_RATIO * (budget or 0.0))
        if first is None:
            raise OutOfTimeError
        again = None
        if has_time_for(2.0 * first.cost, until):
            again = _trial(shot, *few, jobs, until)
        trials = [first, again or first]
        done(2)
        course = None
        cost = trials[1].cost * MAX_COURSE / few[0]
        if frames > _FRAMES and has_time_for(_COURSE_RATIO * cost, until):
            end = min(working_time() + _OF_COURSE * most, until)
            course = _course(shot, jobs, end, until)
        done(3)
        while trials[-1].feathers < total:
            left = most - (working_time() - begin)
            if budget is None:
                cost = float(sum(_whole(shot, work, trials, course).values(), np.zeros(2))[1])
                left = max(left, min(_OF_BAKE * cost, MAX_TRIAL_SECONDS))
            left = min(left, until - working_time())
            count = _larger(trials, left, total)
            larger = None if count is None else _trial(shot, count, few[1], jobs, until)
            if larger is None:
                break
            trials.append(larger)
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


def _trial(shot: Shot, count: int, frames: int, jobs: int, until: float) -> Trial | None:
    """Bake some feathers; None where the time ends before the second frame."""
    from featherfx.baking.frame_loop import simulate_and_write

    part = part_of(shot, pick_feathers(shot, count))
    marks: list[Array] = []
    before = held = resident_bytes(release=True)

    def look(*_: object) -> None:
        nonlocal held
        held = max(held, resident_bytes())

    def mark(*_: object) -> None:
        look()
        marks.append(_spent(timed, _LOOP))
        require_time(0.0, until)

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
            try:
                simulate_and_write(task, mark)
            except OutOfTimeError:
                frames = len(marks) - 1
                if frames < 2:
                    return None
            once = {name: _spent(timed, (name,)) for name in timed.seconds()}
    # until the first frame is handed on, what others need is loaded; what comes after the last is
    # what nothing goes on beside
    loop = _spent(timed, _LOOP)
    once |= {"simulating": marks[1], "writing": loop - marks[-1]}
    once.pop("compiling", None)
    return Trial(
        feathers=len(part.groom.feathers),
        frames=frames,
        work=_work_of(part),
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


def _course(shot: Shot, jobs: int, end: float, until: float) -> TrialCourse | None:
    """Simulate a few feathers through the frames of a shot, or the first of them; None where there
    is time for less than three.

    end, until: s of CPU time of this process, after which no frame begins, and when it ends.
    """
    part = pick_course(shot)
    marks, iterations = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        simulation = simulate(part, jobs)
        for draw, _ in simulation.samples(lambda sample: False, rates=1):
            draw()
            reports = simulation.counted().reports
            iterations.append(sum(float(r.iterations.sum()) for r in reports))
            marks.append(working_time())
            if marks[-1] > (end if len(marks) > _FRAMES else until):
                break
    if len(marks) < 3:
        return None
    return TrialCourse(np.array(iterations[1:]), np.diff(marks), _work_of(part))


def _work_of(shot: Shot) -> float:
    return sum_unknowns(resolve_options(shot, drawn_feathers(shot), root_motion(shot)).feathers)


def sum_unknowns(options: Sequence[FeatherOptions]) -> float:
    """Return the unknowns of a frame of some feathers, and one."""
    return 1.0 + sum(map(unknowns, options))


def unknowns(options: FeatherOptions) -> int:
    """Six a row, and two directions of coefficients for the two barbs of a row."""
    if not options.is_simulated:
        return 0
    return options.rows * (6 + 4 * options.coefficients)
