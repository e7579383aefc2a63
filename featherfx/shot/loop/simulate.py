"""The frame loop: a shot in, frames out."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem, SimulationError, require_type
from featherfx.feather.types import Feather, RowPoints
from featherfx.files.atomic_write import write_whole
from featherfx.packages import brought
from featherfx.phases import counted
from featherfx.shot.frames import FeatherPose, Frame, not_finite
from featherfx.shot.loop.free_group import free_groups, moving_with_roots
from featherfx.shot.loop.groups import Counts, poses_of
from featherfx.shot.loop.run import Arrays, ShotRun, Stage, make_groups, prefixed, under
from featherfx.shot.options import FeatherOptions, ShotOptions
from featherfx.shot.roots import RootFrames, Roots, root_rates
from featherfx.shot.types import Shot
from featherfx.solver.state import State


@dataclass(frozen=True)
class Checkpoint:
    """State of a simulation after a sample.

    index: number of the sample, 0 at the first frame, counted in frames times subframes.
    states: one per group of feathers. starts: per group (F, n, 1 + 2 m, 3) m, nodes at the
    first frame, from which grips count. stages: arrays that the stages of the frame loop keep, by
    their names. wanted: (W,) numbers of the feathers in its frames.
    """

    index: int
    states: tuple[State, ...]
    starts: tuple[Array, ...]
    stages: dict[str, Arrays] = field(default_factory=dict)
    wanted: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def save(self, path: str | Path) -> None:
        """Write it to an .npz file, whole or not at all."""
        arrays = {"index": np.array(self.index), "groups": np.array(len(self.states))}
        arrays |= {"wanted": self.wanted}
        for k, (state, start) in enumerate(zip(self.states, self.starts, strict=True)):
            arrays |= prefixed(f"{k}.", state.arrays()) | {f"{k}.start": start}
        for name, own in self.stages.items():
            arrays |= prefixed(f"{name}/", own)
        write_whole(Path(path), lambda file: np.savez(file, **arrays))  # type: ignore[arg-type]

    @staticmethod
    def load(path: str | Path) -> Checkpoint:
        """Read what save wrote. Raises InputError where the file is not that."""
        require_type("path", path, str | Path, "the path of a file that Checkpoint.save wrote")
        try:
            with np.load(path, allow_pickle=False) as file:
                groups = range(int(file["groups"]))
                states = tuple(State.from_arrays(under(f"{k}.", file)) for k in groups)
                starts = tuple(file[f"{k}.start"] for k in groups)
                names = sorted({name.partition("/")[0] for name in file if "/" in name})
                stages = {name: under(f"{name}/", file) for name in names}
                return Checkpoint(int(file["index"]), states, starts, stages, file["wanted"])
        except FileNotFoundError:
            told = "there is no such file. Check the path"
            raise InputError(Problem(str(path), "", told)) from None
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
            lacks = f": {error}" if isinstance(error, KeyError) else ""
            told = f"is no checkpoint{lacks}. Give a file that Checkpoint.save wrote"
            raise InputError(Problem(str(path), "", told)) from error


class Simulation:
    """Goes once through the frames of a shot; `report` is complete after the last one.

    feathers: one per placement that is wanted, in groom order, on the grid of the quality, whatever
    is simulated; options: how they are. Between two frames, `checkpoint` is all that a
    later simulation of the same shot needs to go on from there. report: newton_iterations and
    substeps per feather and frame (mean, max), rejected_substeps; substeps_over_tolerance (accepted
    with a local error above the tolerance), substeps_with_barbs_passing and
    substeps_with_hooks_slipping, accepted because none shorter is allowed (substep_limits, by
    keys), of feathers_over_tolerance feathers, worst_substeps (the ten that this was worst for, by
    local error over tolerance, m), worst_residual (m, distance of a step from its solution),
    feathers_unsolved, of which that is above the tolerance, worst_unsolved (the ten farthest, m),
    worst_step_error (m), skipped work by kind; and the figures of its stages.
    """

    def __init__(
        self,
        shot: Shot,
        jobs: int,
        frames: tuple[int, int] | None,
        subframes: int = 1,
        start: Checkpoint | None = None,
        wanted: Sequence[int] | None = None,
        begin: int | None = None,
        motion: Roots | None = None,
    ) -> None:
        self._run = run = ShotRun(shot, subframes, jobs, wanted, begin, motion)
        self._stages: list[Stage] = [make(run) for make in brought(shot, "stages")]
        run.groups = make_groups(run)
        for stage in self._stages:
            stage.prepare()
        self._free = free_groups(run)
        run.step_groups += self._free
        self.feathers: tuple[Feather, ...] = tuple(run.drawn[f] for f in run.wanted)
        self._ids = tuple(shot.groom.feathers[f].id for f in run.wanted)
        self.options: list[FeatherOptions] = [run.options.feathers[f] for f in run.wanted]
        self._counts, self._index = Counts(), run.first - 1
        # after the frame that was yielded last
        self._after: Checkpoint | None = None
        if start is not None:
            self.take_over(start)
        first, last = frames or (shot.first_frame, shot.last_frame)
        self._begin_at, self._end_at = (
            (frame - shot.first_frame) * subframes for frame in (first, last)
        )
        self._samples = self._simulated()

    @property
    def shot(self) -> Shot:
        """The shot that is simulated."""
        return self._run.shot

    @property
    def resolved(self) -> ShotOptions:
        """Options of all feathers of the shot."""
        return self._run.options

    @property
    def report(self) -> dict[str, Any]:
        """Counts over all feathers and frames so far, of those that are wanted."""
        found = self._counts.summary()
        for stage in self._stages:
            found |= stage.report()
        return found

    def __iter__(self) -> Iterator[Frame]:
        for draw, after in self.samples():
            frame, self._after = draw(), after
            yield frame

    def samples(
        self, saved: Callable[[int], bool] | None = None, rates: int = 2
    ) -> Iterator[tuple[Callable[[], Frame], Checkpoint | None]]:
        """As iterating, each frame as what draws it, with the checkpoint after it. Raises what
        iterating raises.

        Another thread may draw one frame at a time while the next sample is simulated. saved:
        whether the checkpoint after a sample, counted from the first that is wanted, is asked for;
        all by default. rates: as of ShotRun.
        """
        self._run.rates = rates
        for index in self._samples:
            if index >= self._begin_at:
                keeps = saved is None or saved(index - self._begin_at)
                solved: dict[int, FeatherPose] = {}
                for group in self._run.groups:
                    solved |= poses_of(group)
                yield partial(self._frame, index, solved), self._checkpoint() if keeps else None

    def _simulated(self) -> Iterator[int]:
        """Simulate the samples of the frames that are wanted, one after the other, and those
        before."""
        run, end = self._run, self._end_at
        with ExitStack() as solvers:
            for group in run.groups:
                solvers.enter_context(group.solver)
            if self._index < run.first < min(0, self._begin_at):
                self._simulate(run.first)  # settles, which is a phase of its own
            preroll = range(self._index + 1, min(0, self._begin_at))
            for index in counted("preroll", preroll, len(preroll)) if preroll else ():
                self._simulate(index)
            earlier = range(self._index + 1, self._begin_at)
            for index in counted("earlier", earlier, len(earlier)) if earlier else ():
                self._simulate(index)
                yield index
            for index in range(self._index + 1, end + 1):
                self._simulate(index)
                self._counts.frame(run.rigid, run.guided)
                yield index
            for stage in self._stages:
                stage.finish(self._index)

    def _simulate(self, index: int) -> None:
        """Bring all feathers to a sample; those of the preroll are below 0.

        `_frame` makes a frame of it. Raises SimulationError, which names the frame.
        """
        try:
            for stage in self._stages:
                stage.begin(index)
            self._load(index)
            if index == self._run.first:
                self._settle()
            else:
                self._solve(index)
            for stage in self._stages:
                stage.note(index)
        except SimulationError as error:
            number = self._run.number(index)
            raise SimulationError(error.feather, error.time, error.reason, number) from error
        self._index = index

    def _frame(self, index: int, poses: dict[int, FeatherPose]) -> Frame:
        """Frame of a sample: what was solved, which is given, and what follows."""
        run, time, number = self._run, self._run.time(index), self._run.number(index)
        for stage in self._stages:
            stage.follow(index, poses)
        shown = [poses[f] for f in run.wanted.tolist()]
        if (bad := not_finite(shown)) is not None:
            name = run.shot.groom.feathers[run.wanted[bad]].id
            raise SimulationError(name, time, "a point is not finite", number)
        for stage in self._stages:
            shown = stage.show(time, shown)
        return Frame(number, time, tuple(shown), self._ids, self.feathers)

    def _load(self, index: int) -> None:
        """Renew the models of batches that loads change."""
        for group in self._run.groups:
            if group.renew(self._run.time(index - 1), self._run.time(index)):
                group.stirred[:] = True

    def _settle(self) -> None:
        """Settle all feathers where the simulation begins, carried by their roots if these move."""
        run = self._run
        if run.shot.settle:
            for each in run.step_groups:
                if each not in self._free:
                    each.settle()
            for each in counted("settling", self._free, len(self._free)):
                each.settle()
        now = run.time(run.first)
        rates = root_rates(run.motion, now - run.time(1), now)
        if any(values.any() for rate in rates[1:] for values in rate):
            for group in run.groups:
                own = tuple(RootFrames(*(each[group.members] for each in rate)) for rate in rates)
                group.state = moving_with_roots(group.state, own)
        self._arrive(run.first)

    def _solve(self, index: int) -> None:
        """Step all batches to a sample."""
        for each in self._run.step_groups:
            for group in each.groups:
                group.report = None
            self._counts.slept += each.advance(index)
            for group in each.groups:
                if group.report is not None:
                    number = self._run.number(index)
                    self._counts.add(group.report, group.names, number, each.bounds)
        self._arrive(index)

    def _arrive(self, index: int) -> None:
        """End the way to a sample; grips count from where nodes are at the first frame."""
        for group in self._run.groups:
            group.stirred[:] = False
            if index == 0:
                group.start = group.state.points.nodes.copy()

    def checkpoint(self) -> Checkpoint:
        """The simulation after the frame that was yielded last."""
        return self._after or self._checkpoint()

    def _checkpoint(self) -> Checkpoint:
        run = self._run
        return Checkpoint(
            self._index,
            tuple(group.state for group in run.groups),
            tuple(group.start for group in run.groups),
            {stage.name: stage.checkpoint() for stage in self._stages if stage.name},
            run.wanted,
        )

    def counted(self) -> Counts:
        """Return what was counted since the last call, or the first frame; the report begins
        anew."""
        counts, self._counts = self._counts, Counts()
        return counts

    def simulated(self) -> dict[int, tuple[Feather, RowPoints]]:
        """By number, of the feathers in the frames, what is simulated in full, and where it is
        after the frame that was simulated last."""
        wanted = set(self._run.wanted.tolist())
        return {
            int(f): (group.feathers[k], group.state.points.at(k))
            for group in self._run.groups
            if group.level == "full"
            for k, f in enumerate(group.members)
            if int(f) in wanted
        }

    def fluttering(self) -> set[int]:
        """Return the numbers of the feathers that found no rest where the simulation began."""
        return {int(f) for group in self._run.groups for f in group.members[group.fluttering]}

    def take_over(self, start: Checkpoint) -> None:
        """Stand where another simulation of the shot stood. Raises InputError for one of others."""
        run = self._run
        own = [group.state.points.nodes.shape for group in run.groups]
        if own != [state.points.nodes.shape for state in start.states]:
            message = "is of other feathers or another quality. Use a checkpoint of this shot"
            raise InputError(Problem(str(run.shot.source), "start", message))
        self._index, self._after = start.index, None
        for group, state, first in zip(run.groups, start.states, start.starts, strict=True):
            group.renew(run.time(start.index - 1), run.time(start.index))
            group.state, group.start = state, first
            if start.index:
                group.loads = run.loads(group, start.index)
        for stage in self._stages:
            stage.restore(start.stages.get(stage.name, {}))


def simulate(
    shot: Shot,
    jobs: int = 1,
    frames: tuple[int, int] | None = None,
    subframes: int = 1,
    start: Checkpoint | None = None,
    wanted: Sequence[int] | None = None,
    begin: int | None = None,
    motion: Roots | None = None,
) -> Simulation:
    """Simulate a shot.

    jobs: threads. frames: first and last of those wanted, inclusive; default: all of the shot's.
    Those before are simulated, too, because the motion depends on its past. subframes: samples a
    frame, at evenly spaced times from the first frame to the last. start: where a simulation of
    the same shot and subframes stood; goes on after it. wanted: numbers of the feathers in the
    frames, ascending, None: all; others are simulated only where they guide some of these or may
    touch them. begin: sample at which feathers settle, with no preroll. motion: of the roots, None:
    the shot's own. Raises InputError where a feather cannot be built and, while iterating,
    SimulationError.
    """
    return Simulation(shot, jobs, frames, subframes, start, wanted, begin, motion)
