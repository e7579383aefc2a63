"""Guided and rigid feathers as obstacles of simulated ones.

They are bodies of contact like all others, but led: a rigid one by its root, a guided one from
where it is to where its guides, seen from their roots when a step begins, put it when the step
ends. So it is behind them by a step, and jumps nowhere. What it meets is pushed, it is not. Its own
guides pass it: what lifts a guide lifts what follows it as well, which would go on lifting the
guide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.shapes import feathers_of
from featherfx.feather.types import Feather, RowMap, RowPoints, stacked
from featherfx.mechanics.model import Loads, no_loads
from featherfx.shot.contact.inactive_bodies import aside
from featherfx.shot.detail.detail import Resolution
from featherfx.shot.detail.followers import turned_by
from featherfx.shot.detail.guided import Followers, Shapes
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.detail.level_run import LevelRun
from featherfx.shot.detail.levels import NUMBER, LevelPlan
from featherfx.shot.groups import Group, maps_between, model_of
from featherfx.shot.motion.roots import RootFrames, Roots, arrived
from featherfx.shot.types import Shot
from featherfx.solver.contact.interval import LedMotion
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.solver import RootPath, Settings, Solver, hold_roots
from featherfx.solver.state import State, rest_state


class Batch(NamedTuple):
    """Obstacles of one level: their places in the groom, and the shapes that others meet."""

    level: str
    members: Indices
    feathers: list[Feather]
    solver: Solver


class Guides:
    """Guides (G,), by their numbers in the groom, as those see them that follow them.

    places: by number and level of a guide where it is solved: batch, place in that, and map to the
    grid of the followers. rest: shapes of all on that grid.
    """

    def __init__(
        self,
        numbers: Indices,
        followers: Followers,
        places: Mapping[tuple[int, int], tuple[int, int, RowMap | None]],
        rest: Sequence[RowPoints],
    ) -> None:
        self._numbers, self._followers, self._places = numbers, followers, places
        self._rest = rest

    def followed(self, states: Sequence[State], levels: LevelRun, roots: RootFrames) -> RowPoints:
        """The followers in their root frames. states: of the batches; roots: of the groom, then."""
        found, solved = [], []
        for f, rest in zip(self._numbers.tolist(), self._rest, strict=True):
            place = self._places.get((f, int(levels.fades.now[f])))
            solved.append(place is not None)
            if place is None:
                found.append(rest)
                continue
            batch, k, to_grid = place
            own = states[batch].points.at(k)
            found.append(own if to_grid is None else to_grid(own))
        points, positions = stacked(found), roots.positions[self._numbers]
        back = roots.rotations[self._numbers].swapaxes(1, 2)
        seen = turned_by(back, points.shifted(-positions))
        for k in np.flatnonzero(~np.array(solved)).tolist():
            seen.at(k).assign(points.at(k))
        return self._followers.points(seen)


class Obstacles:
    """Those of one island, in batches behind those that are solved.

    states: where each batch is. follows: (N,) ascending, numbers of a follower and its guide as
    one, the follower's times the number of feathers. guides: of the guided batch, if there is one.
    """

    def __init__(
        self,
        batches: Sequence[Batch],
        follows: Indices,
        guides: Guides | None,
        motion: Roots,
        levels: LevelRun,
    ) -> None:
        self.batches, self._follows, self._guides = list(batches), follows, guides
        self._motion, self._levels = motion, levels
        self._members = np.concatenate([follows[:0], *(each.members for each in batches)])
        self.states = [self._at_rest(each) for each in self.batches]
        self._standing = [np.zeros(len(each.members), dtype=np.bool_) for each in self.batches]

    def _at_rest(self, batch: Batch) -> State:
        roots = self._roots(batch, self._motion.frames(0.0))
        return rest_state(batch.solver.model, *roots)

    def _roots(self, batch: Batch, frames: RootFrames) -> RootFrames:
        return RootFrames(*(each[batch.members] for each in frames))

    @property
    def count(self) -> int:
        """Number of bodies."""
        return sum(len(each.members) for each in self.batches)

    def idle(self) -> Flags:
        """(O,) which are none now, because their feathers are simulated."""
        active = [self._levels.fades.active(b.members, NUMBER[b.level]) for b in self.batches]
        return ~np.concatenate(active) if active else np.zeros(0, dtype=np.bool_)

    def loads(self) -> list[Loads]:
        """None, on each batch."""
        return [no_loads(len(each.members)) for each in self.batches]

    def paths(self) -> list[RootPath]:
        """Of roots that stay where they are, of each batch."""
        return [hold_roots(state) for state in self.states]

    def may_touch(self, pairs: Indices, feather: Indices) -> Flags:
        """(N,) which pairs (N, 2) of bodies may touch: not two obstacles, nor one and its guide.
        feather: (B,) of each body its number in the groom."""
        led = pairs >= len(feather) - self.count
        own, other = feather[pairs].T
        count = len(self._levels.fades.now)
        code = np.where(led[:, 0], own * count + other, other * count + own)
        return ~led.all(axis=1) & ~(led.any(axis=1) & np.isin(code, self._follows))

    def go(self, states: Sequence[State], start: float, end: float) -> list[Array]:
        """Where the nodes of each batch go from start to end (s), (F, n, 1 + 2 m, 3) m; their
        states have the velocities. states: of the batches that are solved, at the start.

        What has not stood before begins where it would be at the start.
        """
        then, ends = arrived(self._motion, start), []
        roots = self._motion.frames(end)
        active, low = ~self.idle(), 0
        for k, batch in enumerate(self.batches):
            own = active[low : low + len(batch.members)]
            low += len(batch.members)
            local = self._local(batch, states, then)
            fresh = own & ~self._standing[k]
            if fresh.any():
                placed = _placed(local, self._roots(batch, then))
                self.states[k].points.nodes[fresh] = placed[fresh]
            self._standing[k] = own
            nodes, begin = _placed(local, self._roots(batch, roots)), self.states[k].points.nodes
            nodes = np.where(own[:, None, None, None], nodes, begin)
            speed = (nodes - begin) / (end - start) if end > start else np.zeros_like(nodes)
            self.states[k].velocity.nodes[...] = speed
            ends.append(nodes)
        return ends

    def _local(self, batch: Batch, states: Sequence[State], roots: RootFrames) -> RowPoints:
        if batch.level == "guided":
            assert self._guides is not None
            return self._guides.followed(states, self._levels, roots)
        return stacked([feather.rest for feather in batch.feathers])

    def led(
        self, grids: Grids, states: Sequence[State], idle: Flags, ends: Sequence[Array] = ()
    ) -> LedMotion | None:
        """What is not solved of all bodies: the idle (B,) stand aside, obstacles go where `go`
        says, or nowhere. None where there is neither. states: of all batches."""
        idle = self.all_idle(idle)
        away = aside(grids, states, idle)
        if not self.batches:
            return away
        fixed = np.arange(len(idle)) >= len(idle) - self.count
        free = ~idle & ~fixed
        if away is None:
            start = grids.together([state.points.nodes for state in states])
        else:
            start = away.start
        if not ends:
            return LedMotion(free, start, start, fixed)
        end, solved = start.copy(), len(states) - len(self.batches)
        for k, nodes in enumerate(ends):
            grids.put(nodes, solved + k, slice(None), end)
        end[idle] = start[idle]
        return LedMotion(free, start, end, fixed)

    def all_idle(self, idle: Flags) -> Flags:
        """The idle (B,) of all bodies from those of what is solved."""
        found = idle.copy()
        found[len(idle) - self.count :] = self.idle()
        return found

    def solved(self, states: Sequence[State], really: bool = True) -> list[State]:
        """Of all batches those that are solved, or the others."""
        count = len(states) - len(self.batches)
        return list(states[:count] if really else states[count:])

    def beside(self, states: Sequence[State], time: float) -> list[State]:
        """States of all batches, with the obstacles where they are at a time (s)."""
        solved = self.solved(states)
        self.arrive(self.go(solved, time, time))
        return [*solved, *self.states]

    def arrive(self, ends: Sequence[Array]) -> None:
        """The step is done: each batch is where it went."""
        self.states = [
            state._replace(points=state.points._replace(nodes=nodes))
            for state, nodes in zip(self.states, ends, strict=True)
        ]

    def still(self, start: float, end: float) -> bool:
        """Whether the roots of all obstacles are at end (s) where they were at start."""
        frames = arrived(self._motion, start), self._motion.frames(end)
        return all(
            np.array_equal(a[self._members], b[self._members]) for a, b in zip(*frames, strict=True)
        )

    def way(self, start: float, end: float) -> Array:
        """How far roots and directions of all are at end (s) from where they were at start."""
        frames, own = (self._motion.frames(start), self._motion.frames(end)), self._members
        ways = [(b[own] - a[own]).ravel() for a, b in zip(*frames, strict=True)]
        return np.concatenate(ways)

    def memory(self) -> dict[str, Any]:
        """What is kept between frames, for checkpoints."""
        found: dict[str, Any] = {}
        for k, (state, standing) in enumerate(zip(self.states, self._standing, strict=True)):
            found |= {f"obstacles{k}": state.points.nodes.copy(), f"standing{k}": standing.copy()}
        return found

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Take over what `memory` gave."""
        self.arrive([memory[f"obstacles{k}"].copy() for k in range(len(self.batches))])
        self._standing = [memory[f"standing{k}"].copy() for k in range(len(self.batches))]


def _placed(local: RowPoints, roots: RootFrames) -> Array:
    """Nodes of feathers, given in their root frames, in the world."""
    return turned_by(roots.rotations, local).shifted(roots.positions).nodes


def obstacles_of(
    shot: Shot,
    plan: LevelPlan,
    members: Indices,
    groups: Sequence[Group],
    motion: Roots,
    levels: LevelRun,
) -> Obstacles:
    """The obstacles among the feathers of an island, by their numbers in the groom. groups: what is
    solved of it. plan: of all feathers of the shot.

    Those that follow a guide that touches nothing are none.
    """
    nothing = np.zeros(0, dtype=np.int64)
    if shot.contact is None or not shot.contact.obstacles:
        return Obstacles([], nothing, None, motion, levels)
    solved = np.unique(np.concatenate([group.members for group in groups]))
    every, guided = plan.of("guided"), nothing
    guides, weights = guide_weights(shot, every, plan.leading) if len(every) else (nothing, None)
    if weights is not None:
        lost = weights[:, ~np.isin(guides, solved)].sum(axis=1) > 0.0
        own = np.isin(every, members) & ~lost
        guided, weights = every[own], weights[own]
        used = np.unique(weights.indices)
        guides, weights = guides[used], weights[:, used]
    rigid = np.intersect1d(plan.of("rigid"), members)
    chosen = (("guided", guided), ("rigid", rigid))
    # what steps are held to follows from those that are solved
    settings = groups[0].solver.settings
    some = [_batch(shot, level, own, settings) for level, own in chosen if len(own)]
    if weights is None or not len(guided):
        return Obstacles(some, nothing, None, motion, levels)
    pairs = weights.tocoo()
    count = len(shot.groom.feathers)
    follows = np.sort(guided[pairs.row] * count + guides[pairs.col])
    followers = some[0].feathers
    lead = _guides_of(shot, (guided, followers), guides, weights, groups)
    return Obstacles(some, follows, lead, motion, levels)


def _batch(shot: Shot, level: str, members: Indices, settings: Settings) -> Batch:
    """Feathers at a level, on the grid of the meshes: on half of it a bent vane is a millimetre
    elsewhere. Their model tells contact where vanes are and how stiff; nothing is solved with it.
    """
    placements, grid = [shot.groom.feathers[f] for f in members.tolist()], _grid_of(shot)
    feathers = feathers_of(placements, *grid)
    resolution = Resolution(level, *grid, 0, 1.0)
    model = model_of(placements, feathers, resolution, True)
    return Batch(level, members, feathers, Solver(model, settings))


def _grid_of(shot: Shot) -> tuple[int, int]:
    return shot.quality.rows, shot.quality.own_columns


def _guides_of(
    shot: Shot,
    followers: tuple[Indices, Sequence[Feather]],
    guides: Indices,
    weights: Any,
    groups: Sequence[Group],
) -> Guides:
    """Guides (G,) of some feathers and their shapes, with weights (F, G). groups: what is
    solved."""
    placements, (numbers, shapes) = shot.groom.feathers, followers
    own = [placements[f] for f in guides.tolist()]
    seen = feathers_of(own, shapes[0].rows, shapes[0].columns)
    by_number = dict(zip(guides.tolist(), seen, strict=True))
    places = {}
    for b, group in enumerate(groups):
        leading = np.flatnonzero(np.isin(group.members, guides)).tolist()
        chosen = group.members[leading].tolist()
        maps = maps_between(
            group.members[leading],
            [placements[f] for f in chosen],
            [group.feathers[k] for k in leading],
            [by_number[f] for f in chosen],
        )
        for f, k, to_grid in zip(chosen, leading, maps, strict=True):
            places[f, NUMBER[group.level]] = b, k, to_grid
    mirrored = [[placements[f].mirrored for f in some.tolist()] for some in (numbers, guides)]
    shape_of = Shapes(shapes, mirrored[0]), Shapes(seen, mirrored[1])
    rest = [feather.rest for feather in seen]
    return Guides(guides, Followers(*shape_of, weights), places, rest)
