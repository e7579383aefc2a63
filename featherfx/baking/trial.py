"""Bakes of a few feathers of a shot, and what they say of the bake of all.

A trial is a bake like any other, written to a folder that is removed. The first loads what every
process has to. The same again and one of more feathers tell what each phase costs by itself and
with the work of its feathers; a phase of the whole bake is what follows for its work. Feathers that
push each other cost many times what others do, so their work counts apart: where there are both,
one trial has more of those and one more of the others. What a frame
costs is taken from the frames after the first. All that is done with processor times, which other
programs on the machine change less; how long they take on the clock, with its threads, the writer
beside them and whatever else is running, all trials tell together. Feathers of one grid share a
batch whose threads wait for each other, so that the clock goes by rounds of all threads.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from featherfx.baking.options import TRIAL_SECONDS, BakeOptions
from featherfx.baking.task import Task
from featherfx.errors import InputWarning
from featherfx.feather.build import repeated_shapes
from featherfx.phases import Account, phase
from featherfx.shot.detail.detail import CARRIED, Resolution
from featherfx.shot.detail.levels import level_plan
from featherfx.shot.loads.wind import exposures
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.patterns import may_touch
from featherfx.shot.share import part_of
from featherfx.shot.simulate import drawn_feathers
from featherfx.shot.types import LEVELS, Shot
from featherfx.usd.write.forms import chosen_group
from featherfx.usd.write.output import unique_prim_names

# feathers and frames of the first trial
FEW, FIRST_FRAMES = 12, 3
# times as many feathers in a larger one, at least, and of those that push each other, and its most
# frames while there are more feathers
MORE, MORE_PUSHING, MOST_FRAMES = 6, 4, 12
# neighbours that are tried together, of feathers that push each other, and for how many frames at
# least, since their first ones are easier than the rest
TOGETHER, PUSHING_FRAMES = 8, 8
# phases that a frame costs, and those that come once; WRITER is the writer's own time, which passes
# while the next frames are simulated, and FIRST what simulating takes until the first is handed on
WRITER, FIRST = "writer", "first"
_OF_FRAMES = ("simulating", WRITER)
_ONCE = ("building", "settling", "preroll", FIRST, "finishing")
# those in which threads share the work
_SHARED = ("settling", "preroll", "simulating", "writing")
# those that go with the work of feathers
_OF_WORK = ("simulating", "settling", "preroll")


@dataclass(frozen=True)
class Trial:
    """A bake of some feathers. pushing: how many of them push each other. frames: that it wrote.
    work: unknowns of a frame, of_pushing: those of pushing feathers, and rounds: those that threads
    go through one after another. shapes: different ones. phases: s of each on the clock. processor:
    s of each, and of WRITER and FIRST, which are left out of the others."""

    feathers: int
    pushing: int
    frames: int
    work: float
    of_pushing: float
    rounds: float
    shapes: int
    phases: dict[str, float]
    processor: dict[str, float]

    @property
    def seconds(self) -> float:
        """s that it took, without compiling."""
        return sum(self.phases.values()) - self.phases.get("compiling", 0.0)

    @property
    def worked(self) -> float:
        """s of processor time of that."""
        return sum(self.processor.values()) - self.processor.get("compiling", 0.0)

    def frames_of(self, name: str) -> int:
        """Times that a phase came; the first frame is settled, not simulated."""
        return max(self.frames - (name == "simulating"), 1) if name in _OF_FRAMES else 1

    def of(self, name: str) -> float:
        """s of processor time of a phase, or of one frame of it."""
        return self.processor.get(name, 0.0) / self.frames_of(name)


@dataclass(frozen=True)
class Expected:
    """What a bake will take. phases: s of each on the clock. processor: s of all. cores: that the
    threads of the trials had at a time. trials: what that was learnt from."""

    phases: dict[str, float]
    processor: float
    cores: float
    trials: tuple[Trial, ...]


def expected(shot: Shot, jobs: int, budget: float = TRIAL_SECONDS) -> Expected:
    """What the phases of a bake will take on this machine as it is now.

    budget: s of processor time for the trials. Raises SimulationError where one of the feathers
    that are tried cannot be simulated.
    """
    total, frames = len(shot.groom.feathers), shot.last_frame - shot.first_frame + 1
    begin, worked = time.perf_counter(), time.process_time()
    # the solver takes its time to load, here as in a bake
    import_module("featherfx.baking.loop")
    loading, loaded = time.perf_counter() - begin, time.process_time() - worked
    whole = _measured(shot, frames, jobs)
    with phase("measuring", 4.0) as done:
        pushing, first = _few(whole), min(frames, FIRST_FRAMES)
        few = pushing, min(total, FEW) - pushing
        trials = [_trial(shot, *few, first, jobs)]
        done(1)
        if (sum(few), first) != (total, frames):
            trials.append(_trial(shot, *few, first, jobs))
            done(2)
            left = budget - sum(each.worked for each in trials)
            for number, size in enumerate(_larger(trials[1], left, whole), 3):
                trials.append(_trial(shot, *size, jobs))
                done(number)
    each = {name: _extrapolated(trials, whole, name) for name in (*_ONCE, *_OF_FRAMES)}
    processor = {
        name: _at_first(trials, name) + seconds * whole.frames_of(name)
        for name, seconds in each.items()
    }
    alone, shared = _clock(trials, whole)
    # the writer's last frame is what nothing goes on beside
    phases = {name: alone * processor[name] for name in ("building", "finishing")} | {
        "starting": loading,
        "settling": shared * processor["settling"],
        "preroll": shared * processor["preroll"],
        "simulating": shared * sum(processor[name] for name in ("simulating", FIRST, WRITER)),
        "writing": alone * each[WRITER],
    }
    cores = sum(t.worked for t in trials) / sum(t.seconds for t in trials)
    return Expected(phases, loaded + sum(processor.values()), cores, tuple(trials))


def _clock(trials: Sequence[Trial], whole: Trial) -> tuple[float, float]:
    """s on the clock of one of processor time, where one thread works, and where all do."""

    def of_all(names: Iterable[str]) -> float:
        worked = sum(t.processor.get(name, 0.0) for t in trials for name in names)
        taken = sum(t.phases.get(name, 0.0) for t in trials for name in names)
        return taken / worked if worked > 0.0 else 1.0

    uneven = (whole.rounds / whole.work) / (trials[-1].rounds / trials[-1].work)
    return of_all(("building", "finishing")), uneven * of_all((*_SHARED, WRITER))


def _few(whole: Trial) -> int:
    """How many of the feathers of the first trial push each other: as many as of all, at least two
    of these and of the others where there are."""
    total, pushing = whole.feathers, whole.pushing
    count, others = min(total, FEW), total - pushing
    share = max(round(count * pushing / total), min(2, pushing), count - others)
    return min(share, max(count - min(2, others), count - others))


def _larger(few: Trial, left: float, whole: Trial) -> list[tuple[int, int, int]]:
    """Pushing feathers, others and frames of the trials that take the processor time left, or of
    the least that tell what is fixed from what goes with the feathers: one of more pushing feathers
    and one of more others, where there are both. few: of those of the first trial."""
    own = few.pushing, few.feathers - few.pushing
    most = whole.pushing, whole.feathers - whole.pushing
    grown = [k for k in (1, 0) if most[k] > own[k]]
    if not grown:
        return [(*own, whole.frames)]
    loop = sum(few.of(name) for name in _OF_FRAMES)
    once = max(few.worked - loop * (few.frames - 1), 1e-9)
    sizes = []
    for k in grown:
        least = min(most[k], (MORE, MORE_PUSHING)[k == 0] * own[k])
        # as if all that the few took were due to these
        each_loop, each_once = (max(seconds / own[k], 1e-9) for seconds in (loop, once))
        budget = left / len(grown)
        ends = whole.frames if least == sum(most) else min(whole.frames, MOST_FRAMES)
        first = min(PUSHING_FRAMES if k == 0 else few.frames, ends)
        frames = int(np.clip((budget / least - each_once) / each_loop, first, ends))
        count = int(np.clip(budget / (each_once + each_loop * frames), least, most[k]))
        sizes.append((count, own[1], frames) if k == 0 else (own[0], count, frames))
    return sizes


def _extrapolated(trials: list[Trial], whole: Trial, name: str) -> float:
    """s of processor time of a phase, or of one frame of it, for the whole: a fixed part, and parts
    that go with the work, none below 0, by least squares over the frames of all trials but the
    first."""
    if len(trials) == 1:
        return trials[0].of(name)
    learnt = trials[1:]
    weights = np.sqrt([float(each.frames_of(name)) for each in learnt])
    measures = np.array([_measures(each, name) for each in learnt])
    most = np.maximum(measures.max(axis=0), 1e-9)
    seconds = np.array([each.of(name) for each in learnt])
    parts, _ = nnls(weights[:, None] * measures / most, weights * seconds)
    return float(parts @ (np.array(_measures(whole, name)) / most))


def _at_first(trials: list[Trial], name: str) -> float:
    """s that the first trial took longer than the same again: what every process loads once."""
    if len(trials) == 1:
        return 0.0
    return max(trials[0].of(name) - trials[1].of(name), 0.0) * trials[0].frames_of(name)


def _measures(trial: Trial, name: str) -> tuple[float, ...]:
    """What a phase costs: 1 for its fixed part, and the work that it goes with."""
    if name in _OF_WORK:
        return 1.0, trial.work - trial.of_pushing, trial.of_pushing
    return 1.0, float(trial.shapes if name == "building" else trial.feathers)


def _measured(shot: Shot, frames: int, jobs: int) -> Trial:
    """A trial of a shot of which no time has been taken."""
    push = _pushing(shot)
    return Trial(
        feathers=len(push),
        pushing=int(push.sum()),
        frames=frames,
        work=work_of(shot, 1),
        of_pushing=work_of(part_of(shot, np.flatnonzero(push)), 1) if push.any() else 0.0,
        rounds=work_of(shot, jobs),
        shapes=len(repeated_shapes(shot.groom.feathers)[0]),
        phases={},
        processor={},
    )


def _trial(shot: Shot, pushing: int, others: int, frames: int, jobs: int) -> Trial:
    from featherfx.baking.loop import simulate_and_write

    part = part_of(shot.uneased(), _some(shot, pushing, others))
    last = shot.first_frame + frames - 1
    names = unique_prim_names([each.id for each in part.groom.feathers])
    group = chosen_group(None, len(shot.groom.feathers))
    options = BakeOptions(jobs=jobs, meters_per_unit=1.0, up_axis="Z", group=group)
    with tempfile.TemporaryDirectory(prefix="featherfx-") as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        path = Path(folder) / "trial.usdc"
        times = (shot.first_frame, last)
        task = Task(
            part,
            path,
            times,
            settings={},
            names=names,
            root="trial",
            finished=False,
            options=options,
            whole=part,
            wanted=None,
            taken=None,
            origin=(0.0, 0.0, 0.0),
            dependences=None,
        )
        marks: list[float] = []
        with Account() as timed:
            _, figures = simulate_and_write(task, lambda *_: marks.append(time.process_time()))
            phases, processor = timed.seconds(), timed.processor_seconds()
    told = _apart(processor, figures["writing_processor_seconds"], marks)
    return replace(_measured(part, frames, jobs), phases=phases, processor=told)


def _apart(phases: dict[str, float], writer: float, marks: Sequence[float]) -> dict[str, float]:
    """Processor times of phases with WRITER and FIRST, which were taken for parts of others.

    writer: the writer's own, which it took beside the frames. marks: processor time at the begin,
    after the first frame and after each that follows."""
    beside = sum(phases.get(name, 0.0) for name in ("simulating", "writing"))
    writer = min(writer, beside)
    # of a single frame all is simulating, as of a shot of one
    frames = len(marks) - 1
    own = marks[-1] - marks[1] - writer * (frames - 1) / frames if frames > 1 else beside - writer
    own = min(max(own, 0.0), beside - writer)
    first = beside - writer - own
    return phases | {"simulating": own, FIRST: first, "writing": 0.0, WRITER: writer}


def _pushing(shot: Shot) -> Any:
    """(F,) whether each feather pushes others."""
    if shot.contact is None:
        return np.zeros(len(shot.groom.feathers), dtype=np.bool_)
    return np.array(may_touch(shot, shot.contact))


def _some(shot: Shot, pushing: int, others: int) -> Any:
    """Numbers of so many feathers that push each other, and of so many others: spread evenly where
    nothing touches, else neighbours, of those that push each other several groups."""
    total = len(shot.groom.feathers)
    if shot.contact is None or pushing + others == total:
        return np.unique(np.linspace(0, total - 1, pushing + others).astype(np.int64))
    roots = np.array([each.position for each in shot.groom.feathers])
    push = _pushing(shot)
    groups = np.array_split(np.flatnonzero(push), max(pushing // TOGETHER, 1))
    sizes = [len(each) for each in np.array_split(np.arange(pushing), len(groups))]
    chosen = [_around(roots, *each) for each in zip(groups, sizes, strict=True)]
    return np.sort(np.concatenate([*chosen, _around(roots, np.flatnonzero(~push), others)]))


def _around(roots: Any, numbers: Any, count: int) -> Any:
    """So many of some feathers, the nearest to the middle one of them. roots: (F, 3) of all."""
    if not count:
        return numbers[:0]
    way = np.linalg.norm(roots[numbers] - roots[numbers[len(numbers) // 2]], axis=1)
    return numbers[np.argsort(way, kind="stable")[:count]]


def work_of(shot: Shot, jobs: int) -> float:
    """Unknowns of a frame that threads go through one after another, in the mean of the frames."""
    plan = level_plan(shot, drawn_feathers(shot), root_motion(shot))
    batches: dict[Any, list[float]] = defaultdict(list)
    for f, exposure in enumerate(exposures(shot).tolist()):
        for each in plan.resolutions[f]:
            share = float((plan.table[:, f] == LEVELS.index(each.level)).mean())
            key = None if shot.contact else (each, exposure)
            batches[key].append(share * unknowns(each))
    return sum(_rounds(batch, jobs) for batch in batches.values()) or 1.0


def _rounds(batch: list[float], jobs: int) -> float:
    return float(np.mean(batch)) * math.ceil(len(batch) / jobs)


def unknowns(resolution: Resolution) -> int:
    """Six a row, and two directions of coefficients for the two barbs of a row."""
    if resolution.level in CARRIED:
        return 0
    return resolution.rows * (6 + 4 * resolution.coefficients)
