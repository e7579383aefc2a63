"""Bakes of a few feathers of a shot, and what they say of the bake of all.

A trial is a bake like any other, written to a folder that is removed. The first loads what every
process has to. The same again and one of more feathers tell what each phase costs by itself and
with the work of its feathers; a phase of the whole bake is what follows for its work. What a frame
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
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

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
# times as many feathers in the last, at least, and its most frames while there are more feathers
MORE, MOST_FRAMES = 6, 12
# phases that a frame costs, and those that come once; WRITER is the writer's own time, which passes
# while the next frames are simulated, and FIRST what simulating takes until the first is handed on
WRITER, FIRST = "writer", "first"
_OF_FRAMES = ("simulating", WRITER)
_ONCE = ("building", "settling", "preroll", FIRST, "finishing")
# those in which threads share the work
_SHARED = ("settling", "preroll", "simulating", "writing")


@dataclass(frozen=True)
class Trial:
    """A bake of some feathers. frames: that it wrote. work: unknowns of a frame, and rounds: those
    that threads go through one after another. shapes: different ones. phases: s of each on the
    clock. processor: s of each, and of WRITER and FIRST, which are left out of the others."""

    feathers: int
    frames: int
    work: float
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
    with phase("measuring", 3.0) as done:
        size = min(total, FEW), min(frames, FIRST_FRAMES)
        trials = [_trial(shot, *size, jobs)]
        done(1)
        if size != (total, frames):
            trials.append(_trial(shot, *size, jobs))
            done(2)
            left = budget - sum(each.worked for each in trials)
            trials.append(_trial(shot, *_larger(trials[1], left, total, frames), jobs))
    whole = Trial(total, frames, work_of(shot, 1), work_of(shot, jobs), _shapes(shot), {}, {})
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


def _larger(few: Trial, left: float, total: int, frames: int) -> tuple[int, int]:
    """Feathers and frames of a trial that takes the processor time left, or of the least that tells
    what is fixed from what goes with the feathers. few: of those of the first trial."""
    loop = sum(few.of(name) for name in _OF_FRAMES) / few.feathers
    once = max(few.worked / few.feathers - loop * (few.frames - 1), 1e-9)
    least = min(total, MORE * few.feathers)
    most = frames if least == total else min(frames, MOST_FRAMES)
    count = int(np.clip((left / least - once) / max(loop, 1e-9), min(few.frames, most), most))
    return int(np.clip(left / (once + loop * count), least, total)), count


def _extrapolated(trials: list[Trial], whole: Trial, name: str) -> float:
    """s of processor time of a phase, or of one frame of it, for the whole: a fixed part, and one
    that goes with the work."""
    works = [_measure(each, name) for each in (*trials, whole)][-3:]
    seconds = [each.of(name) for each in trials][-2:]
    if len(trials) == 1 or works[1] <= works[0]:
        return seconds[-1] * works[-1] / works[-2]
    fixed = (seconds[0] * works[1] - seconds[1] * works[0]) / (works[1] - works[0])
    fixed = float(np.clip(fixed, 0.0, seconds[1]))
    return fixed + (seconds[1] - fixed) * works[2] / works[1]


def _at_first(trials: list[Trial], name: str) -> float:
    """s that the first trial took longer than the same again: what every process loads once."""
    if len(trials) == 1:
        return 0.0
    return max(trials[0].of(name) - trials[1].of(name), 0.0) * trials[0].frames_of(name)


def _measure(trial: Trial, name: str) -> float:
    if name == "building":
        return float(trial.shapes)
    of_work = name in ("simulating", "settling", "preroll")
    return trial.work if of_work else float(trial.feathers)


def _trial(shot: Shot, feathers: int, frames: int, jobs: int) -> Trial:
    from featherfx.baking.loop import simulate_and_write

    part = part_of(shot.uneased(), _some(shot, feathers))
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
    return Trial(
        feathers=feathers,
        frames=frames,
        work=work_of(part, 1),
        rounds=work_of(part, jobs),
        shapes=_shapes(part),
        phases=phases,
        processor=_apart(processor, figures["writing_processor_seconds"], marks),
    )


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


def _some(shot: Shot, count: int) -> Any:
    """So many feathers: spread evenly, or, where they touch, neighbours, of those that push each
    other and of the others as many as there are of them in the whole."""
    total = len(shot.groom.feathers)
    if shot.contact is None or count == total:
        return np.unique(np.linspace(0, total - 1, count).astype(np.int64))
    push = np.array(may_touch(shot, shot.contact))
    own = [np.flatnonzero(push), np.flatnonzero(~push)]
    pushing = round(count * len(own[0]) / total)
    pushing = max(pushing, min(2, len(own[0])), count - len(own[1]))
    roots = np.array([each.position for each in shot.groom.feathers])
    return np.sort(
        np.concatenate(
            [
                _around(roots, numbers, size)
                for numbers, size in zip(own, (pushing, count - pushing), strict=True)
            ]
        )
    )


def _around(roots: Any, numbers: Any, count: int) -> Any:
    """So many of some feathers, the nearest to the middle one of them. roots: (F, 3) of all."""
    if not count:
        return numbers[:0]
    way = np.linalg.norm(roots[numbers] - roots[numbers[len(numbers) // 2]], axis=1)
    return numbers[np.argsort(way, kind="stable")[:count]]


def _shapes(shot: Shot) -> int:
    """How many different shapes and models are built."""
    return len(repeated_shapes(shot.groom.feathers)[0])


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
