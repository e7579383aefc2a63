"""Changes of level without a pop: both levels are simulated while one passes into the other.

A feather's points are (1 - w) a + w b, a those of the level that it leaves and b those of the one
that it takes up. From one sample to the next w grows by at most

    min(1 / N, JUMP length / (samples a frame) / |b - a|),

N the samples of a fade and |b - a| the largest distance of any point, so what a change adds to the
motion of a and b, dw |b - a|, is below JUMP of the feather's length a frame, however far the levels
are apart; the fade takes longer then. The rate of w is part of the velocities.

The level that is taken up begins in the pose that the feather has, with its rows and rates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.density import linear_weights
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Feather,
    RowPoints,
    barb_slice,
    both,
    stacked,
    turned,
)
from featherfx.mechanics.batch import has_elastic_clamp, row_frames
from featherfx.shot.detail.guided import Shapes, Turns, overlaps
from featherfx.shot.detail.levels import LevelPlan, Numbers
from featherfx.shot.frames import FeatherPose
from featherfx.shot.groups import Group
from featherfx.shot.motion.roots import RootFrames
from featherfx.shot.placement import place
from featherfx.shot.types import Shot
from featherfx.solver.settle.reinitialise import set_pose

# of a feather's length, what a change may add to the way of a point within a frame
JUMP = 0.004


@dataclass(frozen=True)
class LevelChange:
    """A feather that takes up a new level. before, after: numbers of levels."""

    feather: int
    before: int
    after: int


class Fades:
    """The levels of all feathers while the shot goes on.

    lengths: (F,) m. samples: of a fade at least. per_frame: samples in a frame. duration: s, of a
    sample. now, to: (F,) the level and the one that is taken up, the same where none is; weight:
    (F,) w, and grown: (F,) what the last sample added to it.
    """

    def __init__(
        self, plan: LevelPlan, lengths: Array, samples: int, per_frame: int, duration: float
    ) -> None:
        self.plan, self._lengths, self._per_frame = plan, lengths, per_frame
        self._most, self._duration = 1.0 / max(samples, 1), duration
        self.now: Numbers = plan.at(0).copy()
        self.to: Numbers = self.now.copy()
        self.weight, self.grown = np.zeros(len(lengths)), np.zeros(len(lengths))

    def begin(self, index: int) -> list[LevelChange]:
        """End the fades that are through and begin those to the levels of a sample."""
        through = self.weight >= 1.0
        self.now[through] = self.to[through]
        self.weight[through] = self.grown[through] = 0.0
        wanted = self.plan.at(-(-index // self._per_frame))
        starting = np.flatnonzero((self.now == self.to) & (wanted != self.now))
        self.to[starting] = wanted[starting]
        return [LevelChange(int(f), int(self.now[f]), int(self.to[f])) for f in starting]

    def active(self, members: Indices, level: int) -> Flags:
        """(M,) which of some feathers are to be computed at a level."""
        return np.asarray((self.now[members] == level) | (self.to[members] == level))

    @property
    def fading(self) -> Indices:
        """Feathers that change."""
        return np.flatnonzero(self.now != self.to)

    def grow(self, feathers: Sequence[int], poses: Mapping[tuple[int, int], FeatherPose]) -> None:
        """Move fades on by a sample. poses: by feather and level."""
        for f in feathers:
            before, after = (
                poses[f, int(level)].points.nodes for level in (self.now[f], self.to[f])
            )
            apart = float(np.linalg.norm(after - before, axis=2).max())
            allowed = JUMP * self._lengths[f] / self._per_frame
            self.grown[f] = min(self._most, allowed / max(apart, 1e-30), 1.0 - self.weight[f])
            self.weight[f] += self.grown[f]

    def blended(self, feather: int, poses: Mapping[tuple[int, int], FeatherPose]) -> FeatherPose:
        """A feather's pose from those of its levels."""
        first = poses[feather, int(self.now[feather])]
        weight = self.weight[feather]
        if weight == 0.0:
            return first
        second = poses[feather, int(self.to[feather])]
        way = both(np.subtract, second.points, first.points)
        rate = self.grown[feather] / self._duration
        change = both(np.subtract, second.velocities, first.velocities)
        bend = both(np.subtract, second.accelerations, first.accelerations)
        return FeatherPose(
            both(lambda a, w: a + weight * w, first.points, way),
            both(lambda a, c, w: a + weight * c + rate * w, first.velocities, change, way),
            both(
                lambda a, b, c: a + weight * b + 2.0 * rate * c, first.accelerations, bend, change
            ),
        )

    def memory(self) -> dict[str, Any]:
        """What is kept between frames, for checkpoints."""
        names = ("now", "to", "weight", "grown")
        return {name: getattr(self, name).copy() for name in names}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Take over what `memory` gave."""
        for name, array in memory.items():
            getattr(self, name)[:] = array


def take_level_up(
    shot: Shot,
    drawn: Feather,
    pose: FeatherPose,
    group: Group,
    k: int,
    source: tuple[Group, int] | None,
    root: RootFrames,
    time: float,
) -> None:
    """Put feather k of a group into the pose of the same feather as drawn, in place.

    The turns from row to row are spread over the new rows, so that nothing is stretched; the
    rates are those of the pose. Barbs keep the coefficients that both levels have, if the source,
    a group and the place in it, has any, and else begin at rest. root: of that feather alone, at a
    time in s.
    """
    placement = shot.groom.feathers[int(group.members[k])]
    feather, mirrored = group.feathers[k], [placement.mirrored]
    position, rotation = root.positions, root.rotations
    local = turned(rotation, pose.points.shifted(-position))
    given, own = Shapes([drawn], mirrored), Shapes([feather], mirrored)
    taken = given.turns(stacked([local]))
    blend = overlaps(own.stations[0], given.stations[0])
    rows, columns = own.size
    along = (blend @ taken.along[0])[None]
    world = place(
        own.posed(Turns(along, np.zeros((1, 2, rows, columns, 3)))).at(0), position, rotation
    )
    frames, centres = row_frames(world.directors), world.nodes[:, 0]
    velocity = _resampled(pose.velocities, drawn, feather)
    coefficients = np.zeros_like(group.state.coefficient[k])
    if source is not None:
        coefficients = _coefficients(group, k, source, has_elastic_clamp(placement.kind))
    set_pose(group.solver.model, group.state, k, frames, centres, coefficients, velocity, time)


def _resampled(values: RowPoints, given: Feather, wanted: Feather) -> RowPoints:
    """Rates of one grid on another, linear between rows and between barb nodes.

    The density maps (featherfx/feather/density.py) would be exact for turning feathers as well,
    but take longer to make than a feather to step.
    """
    if given.cell.shape == wanted.cell.shape:
        return values
    rows = linear_weights(*(each.station / each.station[-1] for each in (given, wanted)))
    nodes = linear_weights(*(np.linspace(0.0, 1.0, each.columns + 1) for each in (given, wanted)))
    along = both(lambda part: np.einsum("ni,ipc->npc", rows, part), values)
    root, parts = along.nodes[:, :1], [along.nodes[:, :1]]
    for side in (LEADING, TRAILING):
        barb = np.concatenate([root, along.nodes[:, barb_slice(side, given.columns)]], axis=1)
        parts.append(np.einsum("mj,njc->nmc", nodes[1:], barb))
    return along._replace(nodes=np.concatenate(parts, axis=1))


def _coefficients(group: Group, k: int, source: tuple[Group, int], clamp: bool) -> Array:
    """(2, n, 2 C) from those of the source: curvature shapes are the same functions in any
    number, and an elastic clamp is the last of each direction."""
    before, f = source
    given, wanted = before.state.coefficient[f], group.state.coefficient[k]
    count, most = given.shape[2] // 2, wanted.shape[2] // 2
    found = np.zeros_like(wanted)
    both = before.feathers[f], group.feathers[k]
    rows = linear_weights(*(each.station / each.station[-1] for each in both))
    pairs = [(c, c) for c in range(min(count, most) - clamp)]
    pairs += [(count - 1, most - 1)] if clamp and count and most else []
    for start, to in ((0, 0), (count, most)):
        for old, new in pairs:
            found[:, :, to + new] = given[:, :, start + old] @ rows.T
    found[group.feathers[k].barb_length == 0.0] = 0.0
    return found
