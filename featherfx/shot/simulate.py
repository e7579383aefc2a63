"""The frame loop: a shot in, frames out."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem, SimulationError
from featherfx.feather.shapes import build_feathers
from featherfx.feather.types import Feather, RowPoints
from featherfx.mechanics.model import Loads
from featherfx.phases import counted
from featherfx.shot.checkpoint import NOWHERE, Checkpoint, Reach
from featherfx.shot.contact_group import (
    Together,
    contact_memory,
    contact_report,
    islands_together,
    restore_contact,
)
from featherfx.shot.counts import Counts
from featherfx.shot.detail.cycle import memory_of, restore, warn_if_never
from featherfx.shot.detail.detail import Resolution
from featherfx.shot.detail.estimate import Estimate
from featherfx.shot.detail.followers import GuidedFeathers
from featherfx.shot.detail.levels import level_plan
from featherfx.shot.detail.sampled_poses import SampledPoses
from featherfx.shot.direction.follow_through import FollowThrough
from featherfx.shot.direction.shapes import refuse_other_shapes
from featherfx.shot.direction.targets import Reached
from featherfx.shot.direction.unsimulated_targets import warn_of_unfelt
from featherfx.shot.energy import Energy, energy_of
from featherfx.shot.frames import FeatherPose, Frame, not_finite, sample_number
from featherfx.shot.free_group import Alone
from featherfx.shot.groups import (
    Group,
    give_cycles,
    grips_of,
    loads_within,
    make_groups,
    pulled,
)
from featherfx.shot.hooks import Hooks
from featherfx.shot.islands import with_pushing
from featherfx.shot.layers.crossed import warn_of_crossed
from featherfx.shot.layers.layers import Layers
from featherfx.shot.layers.types import Laid
from featherfx.shot.loads.types import Grip
from featherfx.shot.loads.wet import clumping
from featherfx.shot.motion.cuts import cut_roots
from featherfx.shot.motion.roots import RootFrames, root_rates
from featherfx.shot.patterns import last_fitting
from featherfx.shot.replay import Replay
from featherfx.shot.reshaped import reshaped
from featherfx.shot.settled import moving_with_roots
from featherfx.shot.start import from_preroll
from featherfx.shot.types import Shot, Wind

# of a frame, step in which a feather that has left its root begins to fall: the first one is of
# first order
FIRST_STEP = 1.0 / 32.0


class Simulation:
    """Goes once through the frames of a shot; `report` is complete after the last one.

    feathers: one per placement that is wanted, in groom order, on the grid of the quality, whatever
    is simulated; resolutions: what is. Between two frames, `checkpoint` is all that a
    later simulation of the same shot needs to go on from there. report: newton_iterations and
    substeps per feather and frame (mean, max), rejected_substeps; substeps_over_tolerance (accepted
    with a local error above the tolerance), substeps_with_barbs_passing and
    substeps_with_hooks_slipping, accepted because none shorter is allowed (substep_limits, by
    keys), of feathers_over_tolerance feathers, worst_substeps (the ten that this was worst for, by
    local error over tolerance, m), worst_residual (m, distance of a step from its solution),
    feathers_unsolved, of which that is above the tolerance, worst_unsolved (the ten farthest, m),
    worst_step_error (m), skipped work by kind; error_estimated and error_promised (percent of the
    length; None, and error_not_promised says why).
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
        self._subframes, self._counts = subframes, Counts()
        self.shot, motion, self._first = from_preroll(shot, subframes)
        self._motion = motion = cut_roots(self.shot, motion)
        shot, drawn = self.shot, drawn_feathers(shot)
        chosen = range(len(drawn)) if wanted is None else wanted
        self._wanted: Indices = np.array(chosen, dtype=np.int64)
        self.feathers: tuple[Feather, ...] = tuple(drawn[f] for f in self._wanted)
        self._layers = Layers(shot, drawn, self._wanted, jobs) if shot.layers else None
        computed = self._layers.needed if self._layers else self._wanted
        if self._layers and shot.contact is None:
            warn_of_crossed(shot, drawn, computed, self._layers.stack)
        plan = level_plan(shot, drawn, motion)
        refuse_other_shapes(shot, drawn, plan.resolutions, motion)
        warn_of_unfelt(shot, plan.resolutions)
        guided = GuidedFeathers(shot, drawn, plan, computed)
        self._replay = replay = replay or Replay()
        asked = np.setdiff1d(np.union1d(computed, guided.guides), replay.numbers)
        solved, islands = with_pushing(shot, drawn, plan, asked)
        self.resolutions: list[Resolution] = [plan.resolutions[f] for f in self._wanted]
        self._groups = groups = make_groups(
            shot, drawn, plan.resolutions, solved, motion, jobs, islands, self._time(self._first)
        )
        if shot.cycle:
            give_cycles(shot, groups, subframes)
        duration = 1.0 / (shot.frames_per_second * subframes)
        self._poses = SampledPoses(plan, drawn, groups, motion, guided, replay, computed, duration)
        self._islands, self._alone = islands_together(shot, groups, motion, plan, islands, duration)
        self._through = FollowThrough(shot, drawn, motion, computed)
        self._hooks = Hooks(shot, self._groups)
        self._wets, self._renewed = last_fitting(shot.wets, shot.groom.feathers), list[Group]()
        self._estimate = Estimate(shot, self._groups, plan.air)
        self._reached = Reached(shot)
        self._index = self._first - 1
        # simulated and not yet laid for good; the checkpoint after what was yielded last; figures
        # at the last frame that is wanted
        self._waiting = deque[Reach]()
        self._after: Checkpoint | None = None
        self._figures: dict[str, Any] | None = None
        if start is not None:
            self.take_over(start)
        wanted = frames or (shot.first_frame, shot.last_frame)
        self._begin_at, self._end_at = ((f - shot.first_frame) * subframes for f in wanted)
        self._samples = self._run()

    @property
    def report(self) -> dict[str, Any]:
        """Counts over all feathers and frames so far, of those that are wanted."""
        found = dict(self._figures or self._counted())
        layers = {} if self._layers is None else self._layers.report()
        contact = found.pop("contact") | layers
        return found | ({"contact": contact} if contact else {})

    def _counted(self) -> dict[str, Any]:
        found = self._counts.summary() | self._estimate.report() | self._hooks.report()
        return found | self._reached.report() | {"contact": contact_report(self._islands)}

    @property
    def laid(self) -> Laid | None:
        """Who is laid over whom, of the feathers in its frames and all beneath them."""
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
            reach = self._reached_at(index, keeps)
            finish = partial(self._finished, reach, accelerations)
            del reach
            if index < self._begin_at:
                deque(finish(), maxlen=0)
            else:
                yield finish
            # what it holds is large, and the caller's alone from here on
            del finish
        if self._samples_ahead:
            yield partial(self._finished, None)

    def _finished(
        self, reach: Reach | None, accelerations: bool = True
    ) -> Iterator[tuple[Frame, Checkpoint | None]]:
        """The frames that are finished with a sample; None: there is none after the last. Each is
        laid when the one before was taken, since frames are large."""
        waits, waiting = self._samples_ahead if reach else 0, self._waiting
        if reach is not None:
            self._replay.note(reach.sample, reach.solved)
            if self._layers is not None:
                duration = self._time(1) if reach.sample else 0.0
                self._layers.ask(reach.poses, reach.skin, duration, accelerations)
                reach = reach._replace(poses=[], skin=NOWHERE)
            waiting.append(reach._replace(solved={}))
        while len(waiting) > waits and waiting[0].sample <= self._end_at:
            index, poses, _, standing, _ = waiting.popleft()
            if self._layers is not None:
                poses = self._layers.of(self._wanted, self._layers.lay(self._number(index)))
            if index >= self._begin_at:
                yield self._frame(index, poses), standing and self._with_layers(standing)
            del poses, standing

    @property
    def _samples_ahead(self) -> int:
        """Samples that are simulated before one is laid for good."""
        return self.shot.layers.samples_ahead(self._time(1)) if self.shot.layers else 0

    def _run(self) -> Iterator[int]:
        """Reach the samples of the frames that are wanted, one after the other, those before, and
        those after that the last of them depend on."""
        end = self._end_at
        with ExitStack() as solvers:
            for group in self._groups:
                solvers.enter_context(group.solver)
            if self._index < self._first < 0:
                self._reach(self._first)  # settles, which is a phase of its own
            preroll = range(self._index + 1, 0)
            for index in counted("preroll", preroll, len(preroll)) if preroll else ():
                self._reach(index)
            earlier = range(self._index + 1, self._begin_at)
            for index in counted("earlier", earlier, len(earlier)) if earlier else ():
                self._reach(index)
                yield index
            for index in range(self._index + 1, end + 1):
                self._reach(index)
                self._counts.frame(*self._poses.counts)
                yield index
            cycles = [group.cycle for group in self._groups]
            warn_if_never(cycles, self.shot.cycle, self._index // self._subframes)
            self._reached.warn()
            last = (self.shot.last_frame - self.shot.first_frame) * self._subframes
            self._figures = self._counted()
            # what cannot be simulated is not among the frames that are wanted
            with suppress(SimulationError):
                for index in range(end + 1, min(end + self._samples_ahead, last) + 1):
                    self._reach(index)
                    yield index

    def _reach(self, index: int) -> None:
        """As _go_to; an error names the frame."""
        try:
            self._go_to(index)
        except SimulationError as error:
            number = self._number(index)
            raise SimulationError(error.feather, error.time, error.reason, number) from error

    def _go_to(self, index: int) -> None:
        """Bring all feathers to the sample with this index; those of the preroll are below 0."""
        if index > 0:
            self._say_cuts(index - 1)
            self._hooks.preen(self._time(index - 1), self._time(index))
        self._renewed = [group for group in self._groups if self._renew(group, index)]
        if index == self._first:
            self._begin()
        else:
            for island in self._islands:
                self._advance(island, index)
            for alone in self._alone:
                self._advance(alone, index)
        if index == 0:
            for group in self._groups:
                group.start = group.state.points.nodes.copy()
        if index >= 0:
            self._note(index)
        self._hooks.note(self._number(index))
        self._index = index

    def _note(self, index: int) -> None:
        """Note how far feathers are bent, and off their targets."""
        self._estimate.note()
        for group in self._groups:
            nodes, number = group.state.points.nodes, self._number(index)
            self._reached.note(group.pulls, nodes, self._time(index), number)

    def _say_cuts(self, index: int) -> None:
        """Say what is somewhere else right after the sample with this index."""
        frame, between = divmod(index, self._subframes)
        if not between:
            number = self._number(index + self._subframes)
            self._motion.warn(frame, [each.id for each in self.shot.groom.feathers], number)
            if self._islands:
                self._islands[0].contact.bodies.warn(frame, number)

    def _renew(self, group: Group, index: int) -> bool:
        """Whether feathers of a group have another model than before: wetter or drier, directed, or
        free of their roots."""
        left = self._leaves(group, index)
        if left:
            group.leave_roots()
            group.begin_anew(FIRST_STEP * self._time(1))
        return group.renew(self._time(index)) or left

    def _leaves(self, group: Group, index: int) -> bool:
        """Whether feathers of a group leave their roots on the way to the sample with this index,
        or have before, and their model does not say so yet."""
        if group.free is None or group.flying:
            return False
        return index > 0 and self._time(index - 1) > group.free - 0.5 * self._time(1)

    def _reached_at(self, index: int, keeps: bool) -> Reach:
        """The sample where the simulation stands. keeps: whether a checkpoint is asked for."""
        (poses, solved), time = self._poses.at(index), self._time(index)
        poses = self._through.of(poses, self._time(index - 1), time)
        skin = NOWHERE if self._layers is None else self._layers.skin(time)
        standing = self._standing() if keeps else None
        return Reach(index, poses, skin, standing, solved)

    def _begin(self) -> None:
        """Settle all feathers where the simulation begins, carried by their roots if these move."""
        now = self._time(self._first)
        if self.shot.settle:
            self._settle()
        rates = root_rates(self._motion, now - self._time(1), now)
        if any(values.any() for rate in rates[1:] for values in rate):
            for group in self._groups:
                own = tuple(RootFrames(*(each[group.members] for each in rate)) for rate in rates)
                group.state = moving_with_roots(group.state, own)

    def _settle(self) -> None:
        for island in self._islands:
            island.settle([self._loads(group, self._first) for group in island.groups])
        for alone in counted("settling", self._alone, len(self._alone)):
            alone.settle([self._loads(group, self._first) for group in alone.groups])

    def checkpoint(self) -> Checkpoint:
        """The simulation after the frame that was yielded last."""
        return self._after or self._with_layers(self._standing())

    def _with_layers(self, standing: Checkpoint) -> Checkpoint:
        layers = {} if self._layers is None else self._layers.memory()
        return replace(standing, layers=layers)

    def _standing(self) -> Checkpoint:
        """A checkpoint without what layers keep."""
        return Checkpoint(
            self._index,
            tuple(group.state for group in self._groups),
            tuple(group.start for group in self._groups),
            contact_memory(self._islands),
            memory_of([group.cycle for group in self._groups]),
            wanted=self._wanted,
            replayed=self._replay.numbers,
        )

    def act(self, wind: Wind, pulls: Sequence[tuple[Grip, Array]] = ()) -> None:
        """From here on this is the wind, and the shot's grips are joined by some that lead their
        points to places (3,) m in the world."""
        self.shot = replace(self.shot, wind=wind)
        for group in self._groups:
            group.grips = grips_of(group.names, self.shot.grips) + pulled(group, pulls)

    def reshaped(self, other: Simulation) -> bool:
        """Stand where a simulation of the same feathers in other shapes stands, its deviations from
        rest carried over; False, and nothing is done, where something else is simulated."""
        own, others = self._groups, other._groups
        if [each.names for each in own] != [each.names for each in others] or any(
            now.state.coefficient.shape != was.state.coefficient.shape
            for now, was in zip(own, others, strict=True)
        ):
            return False
        start = other.checkpoint()
        models = [
            (was.solver.model, now.solver.model) for was, now in zip(others, own, strict=True)
        ]
        states = [reshaped(*pair, state) for pair, state in zip(models, start.states, strict=True)]
        self.take_over(replace(start, states=tuple(states)))
        return True

    def energy(self) -> Energy:
        """J, of all feathers that are solved, after the frame that was simulated last."""
        gravity = np.asarray(self.shot.gravity, dtype=float)
        of_all = [energy_of(each.solver.model, each.state, gravity) for each in self._groups]
        return Energy(*np.sum(of_all, axis=0).tolist())

    def counted(self) -> Counts:
        """What was counted since the last call, or the first frame; the report begins anew."""
        counts, self._counts = self._counts, Counts()
        return counts

    def simulated(self) -> dict[int, tuple[Feather, RowPoints]]:
        """By number, of the feathers in the frames, what is simulated in full, and where it is
        after the frame that was simulated last."""
        wanted = set(self._wanted.tolist())
        return {
            int(f): (group.feathers[k], group.state.points.at(k))
            for group in self._groups
            if group.level == "full"
            for k, f in enumerate(group.members)
            if int(f) in wanted
        }

    def take_over(self, start: Checkpoint) -> None:
        """Stand where another simulation of the shot stood. Raises InputError for one of others."""
        own = [group.state.points.nodes.shape for group in self._groups]
        if own != [state.points.nodes.shape for state in start.states]:
            message = "is of other feathers, or of another quality"
            raise InputError(Problem(str(self.shot.source), "start", message))
        self._index, self._after = start.index, None
        for group, state, first in zip(self._groups, start.states, start.starts, strict=True):
            group.state, group.start = state, first
            if self._leaves(group, start.index):
                group.leave_roots()
            self._renew(group, start.index)
            if start.index:
                group.loads = self._loads(group, start.index)
        restore_contact(self._islands, start.contact)
        if self._layers is not None:
            self._layers.restore(start.layers)
        restore([group.cycle for group in self._groups], start.cycles)
        self._hooks.begin()

    def _number(self, index: int) -> float:
        """Frame of the sample with this index."""
        return sample_number(self.shot.first_frame, index, self._subframes)

    def _time(self, index: int) -> float:
        """s since the first frame."""
        return index / (self.shot.frames_per_second * self._subframes)

    def _loads(self, group: Group, index: int) -> Loads:
        """What acts on a group on the way to the sample with this index."""
        start, end = self._time(max(index - 1, self._first)), self._time(index)
        return loads_within(self.shot, group, self._motion, start, end, index > 0)

    def _advance(self, some: Together | Alone, index: int) -> None:
        """Bring batches that are stepped together to the sample with this index."""
        loads = [self._loads(group, index) for group in some.groups]
        stirred = [self._stirred(each) for each in some.groups]
        done = some.advance(self._time(index - 1), self._time(index), loads, stirred, index > 0)
        self._counts.skip(done)
        for group, report in zip(some.groups, done.reports, strict=False):
            self._counts.add(report, group.names, self._number(index), some.bounds)
            self._estimate.stepped(group, report)

    def _stirred(self, group: Group) -> Flags:
        """(F,) feathers of a group that are other ones than at the last sample."""
        every = any(group is each for each in self._renewed)
        return self._hooks.stirred(group) | every

    def _frame(self, index: int, poses: list[FeatherPose]) -> Frame:
        """poses: of the feathers in its frames, laid."""
        time, number = self._time(index), self._number(index)
        if (bad := not_finite(poses)) is not None:
            name = self.shot.groom.feathers[self._wanted[bad]].id
            raise SimulationError(name, time, "a point is not finite", number)
        if self.shot.wets:
            clumps = [clumping(self.shot, self._wets[f], time) for f in self._wanted.tolist()]
            poses = [replace(p, clumped=each) for p, each in zip(poses, clumps, strict=True)]
        return Frame(number, time, tuple(poses))


def drawn_feathers(shot: Shot) -> tuple[Feather, ...]:
    """All feathers of a shot on the grid of its quality. Raises InputError."""
    rows, columns = shot.quality.rows, shot.quality.columns
    return tuple(build_feathers(shot.groom.feathers, rows, columns))


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
    which is. Raises InputError where a feather cannot
    be built and, while iterating, SimulationError.
    """
    return Simulation(shot, jobs, frames, subframes, start, wanted, replay)
