"""Feathers of one contact group: they may touch each other and take common steps.

The motion of a wing may lead roots into the body, where nothing makes room for what is between: a
bird that is groomed with open wings and without `opens` has a folded pose that lies where its type
has it, not on this body.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputWarning
from featherfx.groom.skin.field import search_tree
from featherfx.groom.skin.skin import Body
from featherfx.mechanics.model import Loads
from featherfx.shot.contact.contact import MAX_NAMED, ShotContact
from featherfx.shot.contact.obstacles import Obstacles, obstacles_of
from featherfx.shot.contact.partition import pushing_islands
from featherfx.shot.loop.free_group import is_at_rest, is_undisturbed, skip_frame
from featherfx.shot.loop.groups import ALONE, Bounds, FeatherGroup
from featherfx.shot.loop.run import Arrays, ShotRun, Stage, prefixed, under
from featherfx.shot.motion.joints import of_wings
from featherfx.shot.motion.motion import root_motion, root_path
from featherfx.shot.roots import RootFrames, Roots
from featherfx.shot.types import Shot, may_touch
from featherfx.solver.solver import RootPath

# depth of a root in the body, over its feather's length, from which on it is told
_DEEP = 0.02
# frames that are looked at, at most
_LOOKS = 24


def warn_of_sunk(shot: Shot, motion: Roots) -> None:
    """Say which roots of wings that touch something a shot's motion leads into the body, deeper
    than they are at rest, and in which frame the deepest is."""
    groom, wings = shot.groom, of_wings(shot.groom)
    if shot.contact is None or groom.skin is None or wings.all():
        return
    some = wings & np.array(may_touch(shot, shot.contact))
    if not some.any():
        return
    body, coat = _body(groom.skin), np.flatnonzero(~wings)
    lengths = np.array([each.kind.length for each in groom.feathers])[some]
    rest = RootFrames(
        np.array([each.position for each in groom.feathers]),
        np.array([each.rotation for each in groom.feathers]),
    )
    usual = np.maximum(0.0, -body.gaps(rest.positions[some]))
    last = shot.last_frame - shot.first_frame
    frames = np.unique(np.linspace(0, last, _LOOKS).round().astype(int)).tolist()
    roots = (motion.frames(k / shot.frames_per_second) for k in frames)
    deep = np.stack([-body.gaps(_at_rest(now, rest, some, coat)) - usual for now in roots])
    found = (deep > _DEEP * lengths).any(axis=0)
    if not found.any():
        return
    frame, worst = np.unravel_index(np.where(found, deep, 0.0).argmax(), deep.shape)
    name = groom.feathers[int(np.flatnonzero(some)[worst])].id
    more = f" and of {int(found.sum()) - 1} more feathers" if found.sum() > 1 else ""
    warnings.warn(
        f"motion: leads the root of feather '{name}'{more} into the body, by"
        f" {1e3 * deep[frame, worst]:.2g} mm at frame {shot.first_frame + frames[frame]}: what"
        " contact finds between is squeezed there, and yields. In the groom, opens = true of"
        " [bird] has wings that lie on the body where they fold",
        InputWarning,
        stacklevel=2,
    )


def _body(corners: Array) -> Body:
    """The skin of a groom, seen from outside."""
    volume = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return Body(corners if volume > 0.0 else corners[:, ::-1], np.eye(3), np.zeros(3))


def _at_rest(now: RootFrames, rest: RootFrames, some: Flags, coat: Indices) -> Array:
    """(S, 3) m, where some roots (F,) are, carried back to the body at rest, each by that root of
    the coat that it is nearest to."""
    place = now.positions[some]
    near = coat[search_tree(now.positions[coat]).query(place)[1]]
    back = rest.rotations[near] @ now.rotations[near].swapaxes(1, 2)
    away = np.einsum("sij,sj->si", back, place - now.positions[near])
    return np.asarray(rest.positions[near] + away)


class ContactGroup:
    """Batches of one contact group (partition.py), whose states it brings on. groups: at least one.
    obstacles: of the contact group."""

    def __init__(self, run: ShotRun, groups: Sequence[FeatherGroup], obstacles: Obstacles) -> None:
        self._run, self.groups, self._obstacles = run, groups, obstacles
        self._led: tuple[tuple[float, float], list[RootPath]] = (np.nan, np.nan), []
        self.contact = ShotContact(
            run.shot,
            run.options,
            [group.solver for group in groups],
            [group.members for group in groups],
            [feather for group in groups for feather in group.feathers],
            obstacles,
        )

    @property
    def bounds(self) -> Bounds:
        """Tolerance and limits of their steps."""
        tolerances = [group.options.tolerance for group in self.groups]
        return Bounds(min(tolerances), self.contact.limits)

    def settle(self) -> None:
        """Bring the feathers to rest against each other where the shot begins."""
        run, states = self._run, [group.state for group in self.groups]
        loads = [run.loads(group, run.first) for group in self.groups]
        rested = self.contact.settle(states, loads)
        for group, state in zip(self.groups, rested, strict=True):
            group.state = state

    def advance(self, index: int) -> int:
        """Bring the feathers from the sample before to a sample; return how many nothing stirred.

        Raises SimulationError.
        """
        run, start, end = self._run, self._run.time(index - 1), self._run.time(index)
        paths = self._paths(start, end)
        loads = [run.loads(group, index) for group in self.groups]
        stirred = np.concatenate([group.stirred for group in self.groups])
        resting = self._resting(paths, loads, end - start) & ~stirred
        states, number = [group.state for group in self.groups], int(resting.sum())
        if resting.all() and not self.contact.stirred(states, start, end):
            self._pass(end - start)
            return number

        def loads_of(begin: float, stop: float) -> list[Loads]:
            return [run.loads_within(group, begin, stop, index > 0) for group in self.groups]

        states, reports = self.contact.advance(states, loads_of, self._paths, start, end, resting)
        for group, state, acting in zip(self.groups, states, loads, strict=True):
            group.state, group.loads = state, acting
        for group, report in zip(self.groups, reports, strict=False):
            group.report = report
        return number

    def _paths(self, start: float, end: float) -> list[RootPath]:
        """Return the paths of the roots from start to end (s); the last ones are kept."""
        if self._led[0] != (start, end):
            members = np.concatenate([group.members for group in self.groups])
            whole, low, paths = root_path(self._run.motion, members, start, end), 0, []
            for group in self.groups:
                own = slice(low, low + len(group.members))
                paths.append(whole.part(own))
                low = own.stop
            self._led = (start, end), paths
        return self._led[1]

    def _resting(self, paths: Sequence[RootPath], loads: Sequence[Loads], duration: float) -> Flags:
        """(B,) feathers of all batches that nothing stirs, unless others push them."""
        flags, solver = [], self.contact.solver
        left = np.split(solver.left_in_frame(), solver.grids.first[1:-1])
        for k, (group, path, acting) in enumerate(zip(self.groups, paths, loads, strict=True)):
            quiet = is_undisturbed(group.state, path, acting, group.loads)
            if quiet.any():  # seldom where roots move, and what follows looks at all nodes
                quiet &= is_at_rest(group.state, group.options.tolerance, duration, left[k])
            flags.append(quiet & self._run.shot.sleep)
        return np.concatenate(flags)

    def _pass(self, duration: float) -> None:
        """Let time pass in which all sleep."""
        for group in self.groups:
            everyone = np.ones(len(group.members), dtype=np.bool_)
            group.state = skip_frame(group.state, everyone, duration)


# figures of several islands as one: their sum, their least, one of them; else the largest
_SUMMED = (
    "nodes_grown_into_bodies", "obstacles", "pairs", "ordered_pairs", "most_contacts", "steps",
    "repeated_steps", "steps_with_contacts_off", "feather_solves", "unresolved_pairs",
    "crossed_pairs", "feathers_whose_contacts_yielded",
)  # fmt: skip


class ContactStage(Stage):
    """The contact groups of a shot."""

    name = "contact"

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        run.islands = pushing_islands(run.shot, run.drawn, root_motion(run.shot), run.options)
        pushed = np.isin(run.islands, run.islands[run.solved]) & (run.islands != ALONE)
        run.solved = np.union1d(run.solved, np.flatnonzero(pushed))
        self.contact_groups: list[ContactGroup] = []

    def prepare(self) -> None:
        """Put the batches of each contact group together."""
        run, own = self.run, dict[int, list[FeatherGroup]]()
        for group in run.groups:
            own.setdefault(group.island, []).append(group)
        own.pop(ALONE, None)
        warn_of_sunk(run.shot, run.motion)
        for number, some in own.items():
            members = np.flatnonzero(run.islands == number)
            obstacles = obstacles_of(run.shot, run.options, members, some, run.motion)
            self.contact_groups.append(ContactGroup(run, some, obstacles))
        run.step_groups += self.contact_groups

    def checkpoint(self) -> Arrays:
        """Contacts and obstacles of each group."""
        found: Arrays = {}
        for k, each in enumerate(self.contact_groups):
            found |= prefixed(f"{k}.", each.contact.memory())
        return found

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a checkpoint."""
        for k, each in enumerate(self.contact_groups):
            each.contact.restore(under(f"{k}.", arrays))

    def report(self) -> dict[str, Any]:
        """Figures of the contact of all groups so far, in SI units."""
        reports = [each.contact.report() for each in self.contact_groups]
        if not reports:
            return {}
        found = {name: _joint_figure(name, [each[name] for each in reports]) for name in reports[0]}
        rounds = sum(each["mean_rounds"] * each["steps"] for each in reports)
        found |= {"mean_rounds": rounds / max(found["steps"], 1), "islands": len(reports)}
        return {"contact": found}


def _joint_figure(name: str, values: Sequence[Any]) -> Any:
    if name in _SUMMED:
        return sum(values)
    if name == "shortest_step":
        return min((each for each in values if each > 0.0), default=0.0)
    if name in ("unresolved", "crossed"):
        every = [pair for each in values for pair in each]
        return sorted(every, key=lambda pair: -float(pair["depth"]))[:MAX_NAMED]
    return max(values)
