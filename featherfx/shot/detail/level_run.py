"""The feathers of a shot at their levels of detail: who is computed how, and what is shown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.types import Feather
from featherfx.shot.detail.changes import Fades, LevelChange, take_level_up
from featherfx.shot.detail.followers import Carried, rigid_poses
from featherfx.shot.detail.levels import NUMBER, LevelPlan
from featherfx.shot.frames import FeatherPose
from featherfx.shot.groups import Group, loads_within, poses_of
from featherfx.shot.islands import ALONE
from featherfx.shot.motion.motion import root_path
from featherfx.shot.motion.roots import RootFrames, Roots
from featherfx.shot.replay import Replay
from featherfx.shot.types import Shot
from featherfx.solver.step.root_path import RootPath

Poses = dict[tuple[int, int], FeatherPose]

_RIGID, _GUIDED = NUMBER["rigid"], NUMBER["guided"]


class LevelRun:
    """Levels while a shot goes on; `begin` before the feathers are stepped to a sample, `finish`
    after.

    drawn: all feathers on the meshes' grid. groups: all batches; a feather is in one for each
    level that it ever has. carried: those that follow guides. replay: those that were solved
    before. subframes: samples a frame. duration: s, between two samples.
    """

    def __init__(
        self,
        shot: Shot,
        plan: LevelPlan,
        drawn: Sequence[Feather],
        groups: Sequence[Group],
        motion: Roots,
        carried: Carried,
        replay: Replay,
        subframes: int,
    ) -> None:
        self._carried, self._wanted, self._replay = carried, carried.wanted, replay
        self._computing = np.union1d(self._wanted, carried.guides)
        self._steady = {*plan.steady.tolist(), *replay.numbers.tolist()}
        self._shot, self._drawn, self._motion = shot, drawn, motion
        self._groups = groups
        self.duration = 1.0 / (shot.frames_per_second * subframes)
        rules = shot.level_of_detail
        samples = subframes * (rules.fade if rules else 1)
        lengths = np.array([p.kind.length for p in shot.groom.feathers])
        self.fades = Fades(plan, lengths, samples, subframes, self.duration)
        self._place = {
            (int(f), NUMBER[group.level]): (group, k)
            for group in groups
            for k, f in enumerate(group.members)
        }
        lone = [g.members for g in groups if shot.contact is None or g.island == ALONE]
        self._lone = np.unique(np.concatenate(lone)) if lone else np.zeros(0, dtype=np.int64)
        self._led: tuple[tuple[float, float], RootPath] | None = None
        self._changes: list[LevelChange] = []
        self._known: tuple[int, Poses] | None = None

    def active(self, group: Group) -> Flags:
        """(M,) members of a group that are computed in it."""
        return self.fades.active(group.members, NUMBER[group.level])

    def fresh(self, group: Group) -> Flags:
        """(M,) members of a group that have just been taken up by it."""
        level = NUMBER[group.level]
        new = [change.feather for change in self._changes if change.after == level]
        return np.isin(group.members, new)

    def begin(self, index: int) -> None:
        """Begin the changes of level on the way to a sample, counted from the first frame's."""
        self._changes = self.fades.begin(index)
        starting = [c for c in self._changes if (c.feather, c.after) in self._place]
        if not starting:
            return
        poses, time = self._poses(index - 1), (index - 1) * self.duration
        roots = self._motion.frames(time)
        copied: set[int] = set()
        for change in starting:
            f = change.feather
            group, k = self._place[f, change.after]
            if id(group) not in copied:
                # a checkpoint may still hold the state
                group.state = group.state.copy()
                copied.add(id(group))
            source = self._place.get((f, change.before))
            root, pose = RootFrames(*(each[f] for each in roots)), poses[f, change.before]
            take_level_up(self._shot, self._drawn[f], pose, group, k, source, root, time)
        if self._shot.settle:
            self._settle([c for c in starting if c.before == _RIGID], time)

    def _settle(self, changes: Sequence[LevelChange], time: float) -> None:
        """Let feathers that were rigid begin in balance, not in mid-air at their rest shape."""
        chosen: dict[int, tuple[Group, list[int]]] = {}
        for change in changes:
            group, k = self._place[change.feather, change.after]
            chosen.setdefault(id(group), (group, []))[1].append(k)
        for group, members in chosen.values():
            loads = loads_within(self._shot, group, self._motion, time, time, False)
            velocity = group.state.velocity.at(members)
            settled, status, _ = group.solver.equilibrium(group.state, loads, feathers=members)
            for place, k in enumerate(members):
                if status[k] == 0:
                    group.state.take(settled, k)
                    group.state.velocity.at(k).assign(velocity.at(place))

    def finish(self, index: int) -> None:
        """Move the changes on, once all feathers are at a sample."""
        fading = self.fades.fading.tolist()
        if fading and index:
            self.fades.grow(fading, self._poses(index))

    def shown(self, index: int) -> list[FeatherPose]:
        """The poses of the wanted feathers at a sample."""
        poses, wanted = self._poses(index), self._wanted
        if self.fades.weight[wanted].any():
            return [self.fades.blended(f, poses) for f in wanted.tolist()]
        levels = self.fades.now[wanted].tolist()
        return [poses[of] for of in zip(wanted.tolist(), levels, strict=True)]

    def solved(self, index: int) -> dict[int, FeatherPose]:
        """By number, the poses at a sample of feathers that are always solved at one level, or were
        before; to be asked for last."""
        poses = self._poses(index)
        if self._shot.level_of_detail is None:
            self._known = None  # no level will change from here, and they are large
        return {f: pose for (f, _), pose in poses.items() if f in self._steady}

    def counts(self) -> tuple[int, int]:
        """How many of the wanted are rigid and guided, and nothing else."""
        now, to = self.fades.now[self._wanted], self.fades.to[self._wanted]
        rigid, guided = ((now == to) & (now == level) for level in (_RIGID, _GUIDED))
        return int(rigid.sum()), int(guided.sum())

    def path(self, group: Group, start: float, end: float) -> RootPath:
        """`held`, of the roots of a group whose feathers push nothing from start to end (s). The
        paths of all such groups are found at once."""
        if self._led is None or self._led[0] != (start, end):
            self._led = (start, end), root_path(self._motion, self._lone, start, end)
        own = np.searchsorted(self._lone, group.members)
        samples, base = (each[own] for each in self._led[1])
        return self.held(group, RootPath(samples, base))

    def held(self, group: Group, path: RootPath) -> RootPath:
        """A path on which the members that are not computed stay where they are."""
        idle = ~self.active(group)
        if not idle.any():
            return path
        samples, base = path.samples.copy(), path.base.copy()
        samples[idle, :, :3] = group.state.centre[idle, :1]
        samples[idle, :, 3:] = 0.0
        base[idle] = group.state.rotation[idle, 0]
        return RootPath(samples, base)

    def _poses(self, index: int) -> Poses:
        """By feather and level, of all that are computed."""
        if self._known is None or self._known[0] != index:
            self._known = None  # no longer wanted, and large
            self._known = index, self._computed(index)
        return self._known[1]

    def _computed(self, index: int) -> Poses:
        start, end = (index - 1) * self.duration, index * self.duration
        every = self._computing
        found = {(f, int(self.fades.now[f])): pose for f, pose in self._replay.poses(index).items()}
        for group in self._groups:
            level = NUMBER[group.level]
            own = poses_of(group, self.active(group))
            found |= {(f, level): pose for f, pose in own.items()}
        rigid = {int(f): self._drawn[f] for f in every[self.fades.active(every, _RIGID)]}
        if rigid:
            moved = rigid_poses(rigid, self._motion, start, end)
            found |= {(f, _RIGID): pose for f, pose in moved.items()}
        if self.fades.active(every, _GUIDED).any():
            guides = {f: self.fades.blended(f, found) for f in self._carried.guides.tolist()}
            moved = self._carried.poses(guides, self._motion, start, end)
            found |= {(f, _GUIDED): pose for f, pose in moved.items()}
        return found
