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
from featherfx.shot.layers.lap_kernels import find_laps, ground_lacks, lift_points
from featherfx.shot.layers.lift_kernels import lift_all, pair_depths
from featherfx.shot.layers.stack import (
    among,
    beneath,
    part_of,
    pose_like,
    scratch_for,
    stack_of,
    vanes_of,
)
from featherfx.shot.layers.types import (
    LAP,
    Array,
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
        count = len(self.needed)
        self._names = [shot.groom.feathers[f].id for f in self.needed]
        self._depths = Depths(self.stack)
        self._rank = np.empty(count, dtype=np.int64)
        self._rank[self.stack.order] = np.arange(count)
        shape = self.vanes.present.shape
        self.lifts = Lifts(*(np.zeros(shape) for _ in Lifts._fields))
        self._pose = pose_like(rest, shape)
        self._skins = []
        if shot.skin is not None and shot.layers is not None and shot.layers.contact.skin:
            self._skins = skins_beneath(shot.skin, self.needed, self.vanes, _nodes(rest.nodes))
            for skin in self._skins:
                skin.ground.triangle[~_touching(shot)[self.needed]] = -1
        self._rooms = [np.zeros(1024, dtype=LAP) for _ in range(PIECES * jobs)]
        self._scratch = [scratch_for(self.vanes) for _ in self._rooms]
        self._jobs = jobs

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
        laps, stale = np.zeros(0, dtype=LAP), np.ones(len(poses), dtype=np.bool_)
        with ThreadPoolExecutor(self._jobs) as pool:
            for number in range(MOST_ROUNDS if duration > 0.0 else FIRST_ROUNDS):
                self._pose_lifted(pool, points)
                self._ask_ground(pool, time)
                laps = self._found(pool, laps, stale)
                self._lift(laps, kept, number > 0)
                change = np.abs(lifts.lift - pose.lift).max(axis=(1, 2))
                stale = change > OFF * self.vanes.half

                if not stale.any():
                    break
            self._pose_lifted(pool, points)
            laps = self._found(pool, laps, change > SEEN * self.vanes.half)
        depths = np.full(len(self.stack.pairs), -np.inf)
        touching = np.zeros(len(depths), dtype=np.bool_)
        pair_depths(self.vanes, laps, lifts.lift, depths, touching)
        self._depths.add(depths, touching, frame)
        if duration > 0.0:
            rate = _along_dorsal((lifts.lift - lifts.before) / duration, pose.dorsal)
        else:
            rate = np.zeros_like(pose.points)
        return [
            FeatherPose(
                given.points._replace(nodes=own.copy()),
                given.velocities._replace(nodes=given.velocities.nodes + added),
                given.accelerations,
                given.gaps,
            )
            for own, given, added in zip(pose.points, poses, rate, strict=True)
        ]

    def of(self, wanted: Indices, laid: Sequence[FeatherPose]) -> list[FeatherPose]:
        """Those of the needed feathers' poses that are wanted, by numbers."""
        return [laid[k] for k in np.searchsorted(self.needed, wanted).tolist()]

    def _pose_lifted(self, pool: ThreadPoolExecutor, points: RowPoints) -> None:
        self._pose.lift[:] = self.lifts.lift
        self._each(pool, partial(lift_points, self.vanes, points, self._pose))

    def _ask_ground(self, pool: ThreadPoolExecutor, time: float) -> None:
        vanes, pose, wanted = self.vanes, self._pose, self.lifts.wanted
        for skin in self._skins:
            moved = skin.skin.points(time)
            self._each(pool, partial(ground_lacks, vanes, pose, skin.ground, moved, wanted))

    def _found(self, pool: ThreadPoolExecutor, before: Laps, stale: NDArray[np.bool_]) -> Laps:
        """Laps of all pairs, by upper feather; those of pairs that are not stale hold on."""
        search = partial(self._search, stale.astype(np.int8))
        found = list(pool.map(search, range(len(self._rooms))))
        hold = ~(stale[before["upper"]] | stale[before["lower"]])
        laps = np.concatenate([before[hold], *found])
        return laps[np.argsort(self._rank[laps["upper"]], kind="stable")] if hold.any() else laps

    def _search(self, stale: NDArray[np.int8], piece: int) -> Laps:
        pieces, pairs = len(self._rooms), len(self.stack.pairs)
        span = piece * pairs // pieces, (piece + 1) * pairs // pieces
        while True:
            room, seen = self._rooms[piece], self._scratch[piece]
            count = find_laps(self.vanes, self.stack, self._pose, stale, MARGIN, span, room, seen)
            if count <= len(room):
                return room[:count]
            self._rooms[piece] = np.zeros(int(1.25 * count), dtype=LAP)

    def _lift(self, laps: Laps, kept: float, begun: bool) -> None:
        first = np.searchsorted(self._rank[laps["upper"]], np.arange(len(self._rank) + 1))
        lift_all(self.vanes, self.stack, laps, first, self.lifts, kept, begun)

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
