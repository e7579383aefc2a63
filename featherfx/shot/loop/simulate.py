"""The frame loop: a shot in, frames out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from featherfx.errors import InputError, Problem, SimulationError
from featherfx.feather.types import Feather, RowPoints
from featherfx.packages import brought
from featherfx.phases import counted
from featherfx.shot.frames import FeatherPose, Frame, not_finite
from featherfx.shot.loop.checkpoint import Checkpoint, SimulatedSample
from featherfx.shot.loop.counts import Counts
from featherfx.shot.loop.free_group import free_groups
from featherfx.shot.loop.groups import poses_of
from featherfx.shot.loop.replay import Replay
from featherfx.shot.loop.run import LayerStage, ShotRun, Stage, make_groups
from featherfx.shot.loop.settled import moving_with_roots
from featherfx.shot.options.options import FeatherOptions
from featherfx.shot.roots import RootFrames, root_rates
from featherfx.shot.types import Shot

_NOWHERE = np.zeros((0, 3))


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
        replay: Replay | None = None,
    ) -> None:
        self._run = run = ShotRun(shot, subframes, jobs, wanted, replay or Replay())
        self._stages: list[Stage] = [make(run) for make in brought(shot, "stages")]
        self._layers = next((s for s in self._stages if isinstance(s, LayerStage)), None)
        run.groups = make_groups(run)
        for stage in self._stages:
            stage.prepare()
        self._free = free_groups(run)
        run.step_groups += self._free
        self.feathers: tuple[Feather, ...] = tuple(run.drawn[f] for f in run.wanted)
        self.options: list[FeatherOptions] = [run.options.feathers[f] for f in run.wanted]
        self._counts, self._index = Counts(), run.first - 1
        # simulated and not yet laid for good; the checkpoint after the frame that was yielded last;
        # figures at the last frame that is wanted
        self._waiting = deque[SimulatedSample]()
        self._after: Checkpoint | None = None
        self._figures: dict[str, Any] | None = None
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
    def report(self) -> dict[str, Any]:
        """Counts over all feathers and frames so far, of those that are wanted."""
        found = dict(self._figures or self._report())
        layers = {} if self._layers is None else self._layers.report()
        contact = found.pop("contact", {}) | layers
        return found | ({"contact": contact} if contact else {})

    def _report(self) -> dict[str, Any]:
        """Figures so far, but for those of layers."""
        found = self._counts.summary()
        for stage in self._stages:
            found |= {} if stage is self._layers else stage.report()
        return found

    @property
    def laid(self) -> Any:
        """Stacking order of the feathers in its frames and all beneath them; None: not laid."""
        return None if self._layers is None else self._layers.laid

    def __iter__(self) -> Iterator[Frame]:
        for finish in self.ahead():
            for frame, self._after in finish():
                yield frame

    def ahead(
        self, saved: Callable[[int], bool] | None = None, accelerations: bool = True
    ) -> Iterator[Callable[[], Iterator[tuple[Frame, Checkpoint | None]]]]:
        """As iterating, with what is left to do for each frame: to be called once, in their order,
        by any thread, while the next frame is simulated. Gives frames as they are finished, each
        with the checkpoint after it, and is to be gone through to its end. Raises what iterating
        raises.

        saved: whether the checkpoint after a sample, counted from the first that is wanted, is
        asked for; all by default. accelerations: whether frames need them. Many samples wait to be
        laid, and hold only what is asked for.
        """
        for index in self._samples:
            keeps = saved is None or saved(index - self._begin_at)
            sample = self._posed(index, keeps)
            finish = partial(self._finished, sample, accelerations)
            del sample
            if index < self._begin_at:
                deque(finish(), maxlen=0)
            else:
                yield finish
            # what it holds is large, and the caller's alone from here on
            del finish
        if self._samples_ahead:
            yield partial(self._finished, None)

    @property
    def _samples_ahead(self) -> int:
        """Samples that are simulated before one is laid for good."""
        return 0 if self._layers is None else self._layers.samples_ahead

    def _simulated(self) -> Iterator[int]:
        """Simulate the samples of the frames that are wanted, one after the other, those before,
        and those after that the last of them depend on."""
        run, end = self._run, self._end_at
        with ExitStack() as solvers:
            for group in run.groups:
                solvers.enter_context(group.solver)
            if self._index < run.first < 0:
                self._simulate(run.first)  # settles, which is a phase of its own
            preroll = range(self._index + 1, 0)
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
            last = (run.shot.last_frame - run.shot.first_frame) * run.subframes
            self._figures = self._report()
            # what cannot be simulated is not among the frames that are wanted
            with suppress(SimulationError):
                for index in range(end + 1, min(end + self._samples_ahead, last) + 1):
                    self._simulate(index)
                    yield index

    def _simulate(self, index: int) -> None:
        """Bring all feathers to a sample; those of the preroll are below 0.

        `_posed` and `_finished` make a frame of it. Raises SimulationError, which names the frame.
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

    def _posed(self, index: int, keeps: bool) -> SimulatedSample:
        """Poses where the simulation stands: of what was solved, and of what follows. keeps:
        whether a checkpoint is asked for."""
        run = self._run
        poses = dict(run.replay.poses(index))
        for group in run.groups:
            poses |= poses_of(group)
        solved = dict(poses)
        for stage in self._stages:
            stage.follow(index, poses)
        skin = _NOWHERE if self._layers is None else self._layers.skin(run.time(index))
        checkpoint = self._checkpoint() if keeps else None
        shown = [poses[f] for f in run.posed.tolist()]
        return SimulatedSample(index, shown, skin, checkpoint, solved)

    def _finished(
        self, sample: SimulatedSample | None, accelerations: bool = True
    ) -> Iterator[tuple[Frame, Checkpoint | None]]:
        """The frames that are finished with a sample; None: there is none after the last. Each is
        laid when the one before was taken, since frames are large."""
        run, layers = self._run, self._layers
        waits, waiting = self._samples_ahead if sample else 0, self._waiting
        if sample is not None:
            run.replay.note(sample.sample, sample.solved)
            if layers is not None:
                duration = run.time(1) if sample.sample else 0.0
                layers.ask(sample.poses, sample.skin, duration, accelerations)
                sample = sample._replace(poses=[], skin=_NOWHERE)
            waiting.append(sample._replace(solved={}))
        while len(waiting) > waits and waiting[0].sample <= self._end_at:
            index, poses, _, checkpoint, _ = waiting.popleft()
            if layers is not None:
                poses = layers.lay(run.number(index))
            if index >= self._begin_at:
                yield self._frame(index, poses), checkpoint and self._with_layers(checkpoint)
            del poses, checkpoint

    def _frame(self, index: int, poses: list[FeatherPose]) -> Frame:
        """poses: of the feathers in its frames, laid."""
        run, time, number = self._run, self._run.time(index), self._run.number(index)
        if (bad := not_finite(poses)) is not None:
            name = run.shot.groom.feathers[run.wanted[bad]].id
            raise SimulationError(name, time, "a point is not finite", number)
        for stage in self._stages:
            poses = stage.show(time, poses)
        return Frame(number, time, tuple(poses))

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
            self._counts.skip(each.advance(index))
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
        return self._after or self._with_layers(self._checkpoint())

    def _checkpoint(self) -> Checkpoint:
        """A checkpoint without what layers keep."""
        run, stages = self._run, (each for each in self._stages if each is not self._layers)
        return Checkpoint(
            self._index,
            tuple(group.state for group in run.groups),
            tuple(group.start for group in run.groups),
            {stage.name: stage.checkpoint() for stage in stages if stage.name},
            run.wanted,
            run.replay.numbers,
        )

    def _with_layers(self, standing: Checkpoint) -> Checkpoint:
        layers = self._layers
        if layers is None:
            return standing
        return replace(standing, stages=standing.stages | {layers.name: layers.checkpoint()})

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
    replay: Replay | None = None,
) -> Simulation:
    """Simulate a shot.

    jobs: threads. frames: first and last of those wanted, inclusive; default: all of the shot's.
    Those before are simulated, too, because the motion depends on its past. subframes: samples a
    frame, at evenly spaced times from the first frame to the last. start: where a simulation of
    the same shot and subframes stood; goes on after it. wanted: numbers of the feathers in the
    frames, ascending, None: all; others are simulated only where they guide some of these, lie
    beneath them or may touch them. replay: motion that is not simulated again, and what keeps that
    which is. Raises InputError where a feather cannot be built and, while iterating,
    SimulationError.
    """
    return Simulation(shot, jobs, frames, subframes, start, wanted, replay)
