"""Feathers as they are shown: laid over those beneath them and over the skin, sample by sample.

What is simulated does not change. Every sample starts from the lifts of the one before: points are
lifted by them, laps are searched in that pose (lap_kernels.py), and the lifts that clear them are
taken from the lowest feather up (lift_kernels.py).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.shot.detail.carried import FeatherPose
from featherfx.shot.layers.depths import Depths
from featherfx.shot.layers.ground import skins_beneath
from featherfx.shot.layers.lap_kernels import ground_lacks, lift_points
from featherfx.shot.layers.lift_kernels import lift_all, pair_depths
from featherfx.shot.layers.stack import (
    Room,
    among,
    beneath,
    part_of,
    pose_like,
    stack_of,
    vanes_of,
)
from featherfx.shot.layers.types import (
    Array,
    Ground,
    Indices,
    Laid,
    Laps,
    Lifts,
    Stack,
    Vanes,
)
from featherfx.shot.patterns import may_touch
from featherfx.shot.placement import place
from featherfx.shot.types import Shot

# gap up to which nodes are followed, in thicknesses
MARGIN = 4.0
# s, in which a lift that is no longer asked for falls to 1 / e
FALL = 0.1
# searches and passes for a sample at most, and for the first; change of a lift, over half a
# thickness, from which on a feather is searched again
MOST_ROUNDS, FIRST_ROUNDS, OFF = 4, 16, 1.0
# the same, from which on what is written is searched again for its depths
SEEN = 0.1
# pieces of work for each thread
PIECES = 8


def shot_stack(shot: Shot, drawn: Sequence[Feather]) -> tuple[Stack, Vanes, RowPoints]:
    """Which feathers of a shot lie over which, with their vanes and their places at rest."""
    assert shot.layers is not None
    placements = shot.groom.feathers
    thickness = np.array([each.kind.vane_material.thickness for each in placements])
    contact = shot.layers.contact
    if contact.thickness is not None:
        thickness[:] = contact.thickness
    rest = stacked(
        [
            place(feather.rest, own.position, own.rotation)
            for feather, own in zip(drawn, placements, strict=True)
        ]
    )
    vanes = vanes_of(drawn, 0.5 * thickness)
    return among(stack_of(placements, vanes, rest), _touching(shot)), vanes, rest


def _touching(shot: Shot) -> NDArray[np.bool_]:
    """(F,) feathers that lie over others or under them."""
    assert shot.layers is not None
    return np.array(may_touch(shot, shot.layers.contact))


class Layers:
    """The plumage of a shot in layers.

    drawn: all feathers on the meshes' grid. wanted: numbers of those that are shown; needed: with
    all that lie beneath them, ascending. jobs: threads.
    """

    def __init__(self, shot: Shot, drawn: Sequence[Feather], wanted: Indices, jobs: int) -> None:
        stack, vanes, rest = shot_stack(shot, drawn)
        self.needed = beneath(stack, wanted)
        self.stack, self.vanes = part_of(stack, vanes, self.needed)
        rest = rest.at(self.needed)
        self._names = [shot.groom.feathers[f].id for f in self.needed]
        self._depths = Depths(self.stack)
        shape = self.vanes.present.shape
        self.lifts = Lifts(
            lift=np.zeros(shape),
            before=np.zeros(shape),
            asked=np.zeros(shape),
            sought=np.zeros(shape),
            wanted=np.zeros(shape[1:]),
            renewed=np.zeros(shape[0], dtype=np.int8),
        )
        self._pose = pose_like(rest, shape)
        self._skins = []
        if shot.skin is not None and shot.layers is not None and shot.layers.contact.skin:
            self._skins = skins_beneath(shot.skin, self.needed, self.vanes, _nodes(rest.nodes))
            for skin in self._skins:
                skin.ground.triangle[~_touching(shot)[self.needed]] = -1
        self._jobs = jobs
        # places in the order, between which there are about as many pairs
        ends = np.linspace(0, len(self.stack.pairs), PIECES * jobs + 1)
        self._ends = np.searchsorted(self.stack.first, ends.astype(np.int64), side="right") - 1
        self._ends[0] = 0
        self._rooms = [Room(self.vanes) for _ in self._ends[1:]]

    def lay(
        self, poses: Sequence[FeatherPose], frame: float, time: float, duration: float
    ) -> list[FeatherPose]:
        """Poses of the needed feathers at a sample, laid over each other.

        frame: its number. time: s since the first one. duration: s since the sample before; 0 at
        the first.
        """
        points = stacked([pose.points for pose in poses])
        lifts, pose = self.lifts, self._pose
        kept = float(np.exp(-duration / FALL)) if duration > 0.0 else 0.0
        lifts.before[:] = lifts.lift
        stale, skins = np.ones(len(poses), dtype=np.bool_), self._moved(time)
        with ThreadPoolExecutor(self._jobs) as pool:
            for number in range(MOST_ROUNDS if duration > 0.0 else FIRST_ROUNDS):
                self._pose_lifted(pool, points, number == 0)
                self._ask_ground(pool, skins)
                self._lift(self._found(pool, stale), stale, kept, number > 0)
                change = np.abs(lifts.lift - lifts.sought).max(axis=(1, 2))
                stale = change > OFF * self.vanes.half
                if not stale.any():
                    break
            self._pose_lifted(pool, points, False)
            found = self._found(pool, change > SEEN * self.vanes.half)
        depths = np.full(len(self.stack.pairs), -np.inf)
        touching = np.zeros(len(depths), dtype=np.bool_)
        for laps in found:
            pair_depths(self.vanes, laps, lifts.lift, depths, touching)
        self._depths.add(depths, touching, frame)
        nodes, rates = pose.points.copy(), np.stack([given.velocities.nodes for given in poses])
        if duration > 0.0:
            rates += _along_dorsal((lifts.lift - lifts.before) / duration, pose.dorsal)
        return [
            FeatherPose(
                RowPoints(own, given.points.directors),
                RowPoints(rate, given.velocities.directors),
                given.accelerations,
                given.gaps,
            )
            for own, rate, given in zip(nodes, rates, poses, strict=True)
        ]

    def of(self, wanted: Indices, laid: Sequence[FeatherPose]) -> list[FeatherPose]:
        """Those of the needed feathers' poses that are wanted, by numbers."""
        return [laid[k] for k in np.searchsorted(self.needed, wanted).tolist()]

    def _pose_lifted(self, pool: ThreadPoolExecutor, points: RowPoints, fresh: bool) -> None:
        asked = self.vanes, points, self.lifts.lift, self._pose, fresh
        self._each(pool, partial(lift_points, *asked))

    def _moved(self, time: float) -> list[tuple[Ground, Array]]:
        """The skins at a time, (V, 3) m."""
        return [(skin.ground, skin.skin.points(time)) for skin in self._skins]

    def _ask_ground(self, pool: ThreadPoolExecutor, skins: list[tuple[Ground, Array]]) -> None:
        for ground, moved in skins:
            asked = self.vanes, self._pose, ground, moved, self.lifts.asked
            self._each(pool, partial(ground_lacks, *asked))

    def _found(self, pool: ThreadPoolExecutor, stale: NDArray[np.bool_]) -> list[Laps]:
        """Laps of all pairs, by upper feather; those of pairs that are not stale hold on."""
        stack, numbers = self.stack, stale.astype(np.int8)
        self.lifts.sought[stale] = self._pose.lift[stale]

        def search(room: Room, begin: int, end: int) -> Laps:
            span = int(stack.first[begin]), int(stack.first[end])
            return room.search((self.vanes, stack, self._pose), numbers, MARGIN, span)

        return list(pool.map(search, self._rooms, self._ends[:-1], self._ends[1:]))

    def _lift(
        self, found: Sequence[Laps], stale: NDArray[np.bool_], kept: float, begun: bool
    ) -> None:
        numbers = stale.astype(np.int8)
        for laps, *span in zip(found, self._ends[:-1], self._ends[1:], strict=True):
            args = (int(span[0]), int(span[1])), numbers, self.lifts, kept, begun
            lift_all(self.vanes, self.stack, laps, *args)

    def _each(self, pool: ThreadPoolExecutor, work: Callable[[int, int], object]) -> None:
        ends = np.linspace(0, len(self.vanes.half), PIECES * self._jobs + 1).astype(int).tolist()
        list(pool.map(work, ends[:-1], ends[1:]))

    def report(self) -> dict[str, Any]:
        """Figures of what was laid so far."""
        return self._depths.report(self._names)

    @property
    def laid(self) -> Laid:
        """Who lies over whom."""
        return Laid(self.needed, self.stack)

    def memory(self) -> dict[str, Array]:
        """What is kept between samples, for checkpoints."""
        return {"lift": self.lifts.lift.copy()}

    def restore(self, memory: Mapping[str, Array]) -> None:
        """Take over what `memory` gave."""
        self.lifts.lift[:] = memory["lift"]


def _nodes(points: Array) -> Array:
    """(F, n, 2 m + 1, 3) nodes of the strips from nodes of rows, (F, n, 1 + 2 m, 3)."""
    m = points.shape[2] // 2
    return np.concatenate([points[:, :, :m:-1], points[:, :, : 1 + m]], axis=2)


def _along_dorsal(values: Array, dorsal: Array) -> Array:
    """(F, n, 1 + 2 m, 3) values (F, n, 2 m + 1) of strips times the directors (F, n, 3) of rows."""
    m = values.shape[2] // 2
    ways = values[..., None] * dorsal[:, :, None]
    return np.concatenate([ways[:, :, m:], ways[:, :, :m][:, :, ::-1]], axis=2)
