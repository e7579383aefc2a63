"""Guided and rigid feathers as obstacles of simulated ones.

They are bodies of contact like all others, but led: a rigid one by its root, a guided one from
where it is to where its guides, seen from their roots when a step begins, put it when the step
ends. So it is behind them by a step, and jumps nowhere. What it meets is pushed, it is not. Its own
guides pass it: what lifts a guide lifts what follows it as well, which would go on lifting the
guide.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.types import Feather, RowMap, RowPoints, stacked
from featherfx.mechanics.model import Loads, no_loads
from featherfx.shot.loop.groups import FeatherGroup, maps_between, model_of
from featherfx.shot.options import FeatherOptions, ShotOptions
from featherfx.shot.roots import RootFrames, Roots, arrived
from featherfx.shot.types import Shot
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.contact.types import LedMotion
from featherfx.solver.solver import RootPath, Solver, hold_roots
from featherfx.solver.state import State, rest_state

if TYPE_CHECKING:
    from featherfx.shot.detail.guided import Followers


class Batch(NamedTuple):
    """Obstacles of one level: their places in the groom, and the shapes that others meet."""

    level: str
    members: Indices
    feathers: list[Feather]
    solver: Solver


class Guides:
    """Guides (G,), by their numbers in the groom, as those see them that follow them.

    places: of each where it is solved: batch, place in that, and map to the grid of the followers.
    """

    def __init__(
        self,
        numbers: Indices,
        followers: Followers,
        places: Sequence[tuple[int, int, RowMap | None]],
    ) -> None:
        self._numbers, self._followers, self._places = numbers, followers, places

    def followed(self, states: Sequence[State], roots: RootFrames) -> RowPoints:
        """The followers in their root frames. states: of the batches; roots: of the groom, then."""
        from featherfx.shot.detail.guided import turned_by  # only for those that are guided

        found = []
        for batch, k, to_grid in self._places:
            own = states[batch].points.at(k)
            found.append(own if to_grid is None else to_grid(own))
        points, positions = stacked(found), roots.positions[self._numbers]
        back = roots.rotations[self._numbers].swapaxes(1, 2)
        return self._followers.points(turned_by(back, points.shifted(-positions)))


class Obstacles:
    """Those of one island, in batches behind those that are solved.

    states: where each batch is. total: number of feathers of the shot. follows: (N,) ascending,
    numbers of a follower and its guide as one, the follower's times the total. guides: of the
    guided batch, if there is one.
    """

    def __init__(
        self,
        batches: Sequence[Batch],
        follows: Indices,
        guides: Guides | None,
        motion: Roots,
        total: int,
    ) -> None:
        self.batches, self._follows, self._guides = list(batches), follows, guides
        self._motion, self._total = motion, total
        self._members = np.concatenate([follows[:0], *(each.members for each in batches)])
        self.states = [self._at_rest(each) for each in self.batches]
        self._placed = False

    def _at_rest(self, batch: Batch) -> State:
        roots = self._roots(batch, self._motion.frames(0.0))
        return rest_state(batch.solver.model, *roots)

    def _roots(self, batch: Batch, frames: RootFrames) -> RootFrames:
        return RootFrames(*(each[batch.members] for each in frames))

    @property
    def count(self) -> int:
        """Number of bodies."""
        return sum(len(each.members) for each in self.batches)

    def loads(self) -> list[Loads]:
        """None, on each batch."""
        return [no_loads(len(each.members)) for each in self.batches]

    def paths(self) -> list[RootPath]:
        """Return the paths of roots that stay where they are, of each batch."""
        return [hold_roots(state) for state in self.states]

    def may_touch(self, pairs: Indices, feather: Indices) -> Flags:
        """(N,) which pairs (N, 2) of bodies may touch: not two obstacles, nor one and its guide.
        feather: (B,) of each body its number in the groom."""
        led = pairs >= len(feather) - self.count
        own, other = feather[pairs].T
        code = np.where(led[:, 0], own * self._total + other, other * self._total + own)
        return ~led.all(axis=1) & ~(led.any(axis=1) & np.isin(code, self._follows))

    def go(self, states: Sequence[State], start: float, end: float) -> list[Array]:
        """Find where the nodes of each batch go from start to end (s), (F, n, 1 + 2 m, 3) m; their
        states have the velocities. states: of the batches that are solved, at the start.

        The first time they begin where they would be at the start.
        """
        then, ends = arrived(self._motion, start), []
        roots = self._motion.frames(end)
        for k, batch in enumerate(self.batches):
            local = self._local(batch, states, then)
            if not self._placed:
                self.states[k].points.nodes[...] = _placed(local, self._roots(batch, then))
            nodes, begin = _placed(local, self._roots(batch, roots)), self.states[k].points.nodes
            speed = (nodes - begin) / (end - start) if end > start else np.zeros_like(nodes)
            self.states[k].velocity.nodes[...] = speed
            ends.append(nodes)
        self._placed = True
        return ends

    def _local(self, batch: Batch, states: Sequence[State], roots: RootFrames) -> RowPoints:
        if batch.level == "guided":
            assert self._guides is not None
            return self._guides.followed(states, roots)
        return stacked([feather.rest for feather in batch.feathers])

    def led(
        self, grids: Grids, states: Sequence[State], ends: Sequence[Array] = ()
    ) -> LedMotion | None:
        """Lead the bodies that are not solved: obstacles go where `go` says, or nowhere. None where
        there are none. states: of all batches."""
        if not self.batches:
            return None
        start = grids.together([state.points.nodes for state in states])
        fixed = np.arange(len(start)) >= len(start) - self.count
        if not ends:
            return LedMotion(~fixed, start, start, fixed)
        end, solved = start.copy(), len(states) - len(self.batches)
        for k, nodes in enumerate(ends):
            grids.put(nodes, solved + k, slice(None), end)
        return LedMotion(~fixed, start, end, fixed)

    def solved(self, states: Sequence[State], really: bool = True) -> list[State]:
        """Select the batches that are solved, or the others."""
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
        """Return whether the roots of all obstacles are at end (s) where they were at start."""
        frames = arrived(self._motion, start), self._motion.frames(end)
        return all(
            np.array_equal(a[self._members], b[self._members]) for a, b in zip(*frames, strict=True)
        )

    def memory(self) -> dict[str, Any]:
        """Return the arrays that are kept between frames, for checkpoints."""
        found = {f"obstacles{k}": each.points.nodes.copy() for k, each in enumerate(self.states)}
        return found | {"placed": np.array(self._placed)}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Take over what `memory` gave."""
        self.arrive([memory[f"obstacles{k}"].copy() for k in range(len(self.batches))])
        self._placed = bool(memory["placed"])


def _placed(local: RowPoints, roots: RootFrames) -> Array:
    """Nodes of feathers, given in their root frames, in the world."""
    from featherfx.shot.detail.guided import turned_by

    return turned_by(roots.rotations, local).shifted(roots.positions).nodes


def obstacles_of(
    shot: Shot,
    options: ShotOptions,
    members: Indices,
    groups: Sequence[FeatherGroup],
    motion: Roots,
) -> Obstacles:
    """The obstacles among the feathers of an island, by their numbers in the groom. groups: what is
    solved of it. options: of all feathers of the shot.

    Those that follow a guide that touches nothing are none.
    """
    nothing, count = np.zeros(0, dtype=np.int64), len(shot.groom.feathers)
    if shot.contact is None or not shot.contact.obstacles:
        return Obstacles([], nothing, None, motion, count)
    solved = np.unique(np.concatenate([group.members for group in groups]))
    every, guided = options.at_level("guided"), nothing
    guides, weights = nothing, None
    if len(every):
        from featherfx.shot.detail.guides import guide_weights

        guides, weights = guide_weights(shot, every, options.leading)
    if weights is not None:
        lost = weights[:, ~np.isin(guides, solved)].sum(axis=1) > 0.0
        own = np.isin(every, members) & ~lost
        guided, weights = every[own], weights[own]
        used = np.unique(weights.indices)
        guides, weights = guides[used], weights[:, used]
    rigid = np.intersect1d(options.at_level("rigid"), members)
    chosen = (("guided", guided), ("rigid", rigid))
    # what steps are held to follows from those that are solved
    steps = groups[0].options
    some = [_batch(shot, options, level, own, steps) for level, own in chosen if len(own)]
    if weights is None or not len(guided):
        return Obstacles(some, nothing, None, motion, count)
    pairs = weights.tocoo()
    follows = np.sort(guided[pairs.row] * count + guides[pairs.col])
    followers = some[0].feathers
    lead = _guides_of(shot, (guided, followers), guides, weights, groups)
    return Obstacles(some, follows, lead, motion, count)


def _batch(
    shot: Shot, options: ShotOptions, level: str, members: Indices, steps: FeatherOptions
) -> Batch:
    """Feathers at a level, on the grid of the meshes: on half of it a bent vane is a millimetre
    elsewhere. Their model tells contact where vanes are and how stiff; nothing is solved with it.
    """
    placements = [shot.groom.feathers[f] for f in members.tolist()]
    own = options.feathers[int(members[0])]
    feathers = build_feathers(placements, own.rows, own.columns)
    model = model_of(placements, feathers, own, True)
    return Batch(level, members, feathers, Solver(model, steps))


def _guides_of(
    shot: Shot,
    followers: tuple[Indices, Sequence[Feather]],
    guides: Indices,
    weights: Any,
    groups: Sequence[FeatherGroup],
) -> Guides:
    """Guides (G,) of some feathers and their shapes, with weights (F, G). groups: what is
    solved."""
    placements, (numbers, shapes) = shot.groom.feathers, followers
    own = [placements[f] for f in guides.tolist()]
    seen = build_feathers(own, shapes[0].rows, shapes[0].columns)
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
            places[f] = b, k, to_grid
    mirrored = [[placements[f].mirrored for f in some.tolist()] for some in (numbers, guides)]
    from featherfx.shot.detail.guided import Followers, Shapes

    shape_of = Shapes(shapes, mirrored[0]), Shapes(seen, mirrored[1])
    return Guides(guides, Followers(*shape_of, weights), [places[f] for f in guides.tolist()])
