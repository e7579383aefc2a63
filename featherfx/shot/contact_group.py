"""An island of feathers that may touch each other, in the frame loop: all in common steps."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Flags, Indices
from featherfx.mechanics.model import Loads
from featherfx.shot.contact.contact import MOST_NAMED, ShotContact
from featherfx.shot.contact.obstacles import Obstacles, obstacles_of
from featherfx.shot.contact.root_inside_body import warn_of_sunk
from featherfx.shot.counts import Advanced, Bounds
from featherfx.shot.detail.cycle import SLACK, repeats_together
from featherfx.shot.detail.levels import LevelPlan
from featherfx.shot.detail.sleep import is_at_rest, is_undisturbed, skip_frame
from featherfx.shot.free_group import Alone, FreeRootPaths
from featherfx.shot.groups import Group, loads_within
from featherfx.shot.islands import ALONE
from featherfx.shot.motion.motion import root_path
from featherfx.shot.motion.roots import Roots
from featherfx.shot.types import Shot
from featherfx.solver.solver import RootPath


class Together:
    """Batches of one island (islands.py), whose states it brings on. groups: at least one.
    obstacles: of the island."""

    def __init__(
        self, shot: Shot, groups: Sequence[Group], motion: Roots, obstacles: Obstacles
    ) -> None:
        self._shot, self.groups, self._motion = shot, groups, motion
        self._obstacles = obstacles
        # what contact kept after the samples that the batches' cycles keep
        self._kept: deque[dict[str, Any]] = deque()
        self._led: tuple[tuple[float, float], list[RootPath]] = (np.nan, np.nan), []
        self.contact = ShotContact(
            shot,
            [group.solver for group in groups],
            [group.members for group in groups],
            [feather for group in groups for feather in group.feathers],
            obstacles,
        )

    @property
    def bounds(self) -> Bounds:
        """What their steps are held to."""
        tolerances = [group.solver.settings.tolerance for group in self.groups]
        return Bounds(min(tolerances), self.contact.limits)

    def settle(self, loads: Sequence[Loads]) -> None:
        """Bring the feathers to rest against each other. loads: on each batch."""
        states = [group.state for group in self.groups]
        rested = self.contact.settle(states, loads)
        for group, state in zip(self.groups, rested, strict=True):
            group.state = state

    def advance(
        self,
        start: float,
        end: float,
        loads: Sequence[Loads],
        stirred: Sequence[Flags],
        begun: bool,
    ) -> Advanced:
        """Bring the feathers from start to end (s).

        loads: on each batch, from start to end. stirred: per batch, feathers that something else
        has changed. begun: whether the first frame is past, so that grips act and cycles count.
        """
        paths = self._paths(start, end)
        resting = self._resting(paths, loads, end - start) & ~np.concatenate(stirred)
        done = self._advance((start, end), paths, loads, resting, begun)
        if begun and any(group.cycle for group in self.groups):
            self._keep(paths, loads)
        return done

    def _advance(
        self,
        span: tuple[float, float],
        paths: Sequence[RootPath],
        loads: Sequence[Loads],
        resting: Flags,
        begun: bool,
    ) -> Advanced:
        start, end = span
        states, number = [group.state for group in self.groups], int(resting.sum())
        if resting.all() and not self.contact.stirred(states, start, end):
            self._pass(end - start)
            return Advanced([], resting=number)
        if begun and self._shot.cycle and self._repeats(paths, loads, end):
            self._replay(paths, end - start)
            return Advanced([], repeated=len(resting))

        def loads_of(begin: float, stop: float) -> list[Loads]:
            return [
                loads_within(self._shot, group, self._motion, begin, stop, begun)
                for group in self.groups
            ]

        states, reports = self.contact.advance(states, loads_of, self._paths, start, end, resting)
        for group, state, acting in zip(self.groups, states, loads, strict=True):
            group.state, group.loads = state, acting
        return Advanced(reports, resting=number)

    def _repeats(self, paths: Sequence[RootPath], loads: Sequence[Loads], end: float) -> bool:
        """Whether all feathers do what they did a cycle before, and colliders and obstacles, which
        are then where they were, do as well."""
        cycles = [group.cycle for group in self.groups]
        if not repeats_together(cycles, paths, loads):
            return False
        before = end - self._shot.cycle / self._shot.frames_per_second
        moved = [each.points(end) - each.points(before) for each in self._shot.colliders]
        moved += [self._obstacles.way(before, end)] if self._obstacles.count else []
        if moved:
            known = zip(cycles, paths, strict=True)
            moved += [cycle.ways(path) for cycle, path in known if cycle is not None]
        return all(np.abs(each).max(initial=0.0) <= SLACK for each in moved)

    def _replay(self, paths: Sequence[RootPath], duration: float) -> None:
        for group, path in zip(self.groups, paths, strict=True):
            assert group.cycle is not None
            everyone = np.ones(len(group.members), dtype=np.bool_)
            group.state = group.cycle.replayed(group.state, everyone, path, duration)
        self.contact.go_on(self._kept[0])

    def _keep(self, paths: Sequence[RootPath], loads: Sequence[Loads]) -> None:
        """Note what a later cycle may replay."""
        for group, path, acting in zip(self.groups, paths, loads, strict=True):
            if group.cycle is not None:
                group.cycle.keep(group.state, path, acting)
                self._kept = deque(self._kept, group.cycle.period)
        self._kept.append(self.contact.memory())

    def memory(self) -> dict[str, NDArray[Any]]:
        """What is kept between frames, for checkpoints."""
        found = dict(self.contact.memory())
        for k, kept in enumerate(self._kept):
            found |= {f"{k}:{name}": value for name, value in kept.items()}
        return found

    def restore(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `memory` gave."""
        self.contact.restore({name: each for name, each in memory.items() if ":" not in name})
        kept: dict[int, dict[str, Any]] = {}
        for name, value in memory.items():
            number, told, own = name.partition(":")
            if told:
                kept.setdefault(int(number), {})[own] = value
        self._kept = deque(kept[k] for k in sorted(kept))

    def _paths(self, start: float, end: float) -> list[RootPath]:
        """Of the roots from start to end (s); those asked for last are kept."""
        if self._led[0] != (start, end):
            members = np.concatenate([group.members for group in self.groups])
            whole, low, paths = root_path(self._motion, members, start, end), 0, []
            for group in self.groups:
                own = slice(low, low + len(group.members))
                paths.append(whole.part(own))
                low = own.stop
            self._led = (start, end), paths
        return self._led[1]

    def _resting(self, paths: Sequence[RootPath], loads: Sequence[Loads], duration: float) -> Flags:
        """(B,) feathers of all batches that nothing stirs, unless others push them."""
        flags = []
        for group, path, acting in zip(self.groups, paths, loads, strict=True):
            quiet = is_undisturbed(group.state, path, acting, group.loads)
            if quiet.any():  # seldom where roots move, and what follows looks at all nodes
                quiet &= is_at_rest(group.state, group.solver.settings.tolerance, duration)
            flags.append(quiet & self._shot.sleep)
        return np.concatenate(flags)

    def _pass(self, duration: float) -> None:
        """Let time pass in which all sleep."""
        for group in self.groups:
            everyone = np.ones(len(group.members), dtype=np.bool_)
            group.state = skip_frame(group.state, everyone, duration)


def islands_together(
    shot: Shot,
    groups: Sequence[Group],
    motion: Roots,
    plan: LevelPlan,
    islands: Indices,
    duration: float,
) -> tuple[list[Together], list[Alone]]:
    """The islands of a shot, of their batches, and batches of feathers that push nothing. plan: of
    all feathers of the shot; islands: (F,) of each, or ALONE. duration: s, between two samples."""
    lone = [group for group in groups if shot.contact is None or group.island == ALONE]
    paths = FreeRootPaths(lone, motion)
    alone = [Alone(shot, group, paths, duration) for group in lone]
    if shot.contact is None:
        return [], alone
    own: dict[int, list[Group]] = {}
    for group in groups:
        own.setdefault(group.island, []).append(group)
    own.pop(ALONE, None)
    warn_of_sunk(shot, motion)
    found = []
    for number, some in own.items():
        members = np.flatnonzero(islands == number)
        obstacles = obstacles_of(shot, plan, members, some, motion)
        found.append(Together(shot, some, motion, obstacles))
    return found, alone


def contact_memory(islands: Sequence[Together]) -> dict[str, NDArray[Any]]:
    """What islands keep between frames, for checkpoints."""
    return {
        f"{k}.{name}": value
        for k, each in enumerate(islands)
        for name, value in each.memory().items()
    }


def restore_contact(islands: Sequence[Together], memory: Mapping[str, NDArray[Any]]) -> None:
    """Take over what `contact_memory` gave."""
    for k, each in enumerate(islands):
        own = f"{k}."
        each.restore(
            {n.removeprefix(own): value for n, value in memory.items() if n.startswith(own)}
        )


# figures of several islands as one: their sum, their least, one of them; else the largest
_SUMMED = (
    "nodes_grown_into_bodies", "obstacles", "pairs", "ordered_pairs", "most_contacts", "steps",
    "repeated_steps", "steps_with_contacts_off", "feather_solves", "unresolved_pairs",
    "crossed_pairs",
)  # fmt: skip


def contact_report(islands: Sequence[Together]) -> dict[str, Any]:
    """Figures of the contact of all islands so far, in SI units."""
    reports = [each.contact.report() for each in islands]
    if not reports:
        return {}
    found = {name: _of_all(name, [each[name] for each in reports]) for name in reports[0]}
    rounds = sum(each["mean_rounds"] * each["steps"] for each in reports)
    return found | {"mean_rounds": rounds / max(found["steps"], 1), "islands": len(reports)}


def _of_all(name: str, values: Sequence[Any]) -> Any:
    if name in _SUMMED:
        return sum(values)
    if name == "shortest_step":
        return min((each for each in values if each > 0.0), default=0.0)
    if name in ("unresolved", "crossed"):
        every = [pair for each in values for pair in each]
        return sorted(every, key=lambda pair: -float(pair["depth"]))[:MOST_NAMED]
    return max(values)
