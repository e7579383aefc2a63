"""Feathers as they are shown: laid over those beneath them and over the skin, sample by sample.

What is simulated does not change. Every sample starts from the lifts of the one before. Feathers
are taken from the lowest up: each is lifted as it was, its laps over what is laid already are
searched (lap_kernels.py), and the lift that clears them is found (lift_kernels.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.shot.detail.carried import FeatherPose
from featherfx.shot.layers.depths import Depths
from featherfx.shot.layers.ground import ground_beneath
from featherfx.shot.layers.lift_kernels import lay_feathers
from featherfx.shot.layers.stack import (
    among,
    beneath,
    by_height,
    part_of,
    pose_like,
    scratch_of,
    stack_of,
    vanes_of,
)
from featherfx.shot.layers.types import Array, Indices, Laid, Lifts, Manner, Stack, Vanes
from featherfx.shot.patterns import may_touch
from featherfx.shot.placement import place
from featherfx.shot.types import Shot

# s, in which a lift that is no longer asked for falls to 1 / e
FALL = 0.1
MANNER = Manner(kept=0.0, anew=True, turns=8, follow=4.0, off=1.0, seen=0.1, slope=0.1)
# laps of a feather that there is room for at first
ROOM = 4096


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
        stack, self.vanes = part_of(stack, vanes, self.needed)
        self.stack, self._heights = by_height(stack)
        rest = rest.at(self.needed)
        self._names = [shot.groom.feathers[f].id for f in self.needed]
        self._depths, pairs = Depths(self.stack), len(self.stack.pairs)
        shape = self.vanes.present.shape
        self.lifts = Lifts(
            lift=np.zeros(shape),
            before=np.zeros(shape),
            moved=np.zeros(shape[0], dtype=np.int8),
            settled=np.zeros(shape[0], dtype=np.int8),
            strays=np.zeros(shape[0], dtype=np.int8),
            depths=np.zeros(pairs),
            touching=np.zeros(pairs, dtype=np.int8),
        )
        self._start, self._pose = pose_like(rest, shape), pose_like(rest, shape)
        assert shot.layers is not None
        skin = shot.skin if shot.layers.contact.skin else None
        self._skin = ground_beneath(skin, self.needed, self.vanes, _nodes(rest.nodes))
        self._skin.ground.triangle[~_touching(shot)[self.needed]] = -1
        self._under: Array | None = None
        self._scratch = [scratch_of(self.vanes, ROOM) for _ in range(jobs)]

    def lay(
        self, poses: Sequence[FeatherPose], frame: float, time: float, duration: float
    ) -> list[FeatherPose]:
        """Poses of the needed feathers at a sample, laid over each other.

        frame: its number. time: s since the first one. duration: s since the sample before; 0 at
        the first.
        """
        points, lifts, pose = stacked([pose.points for pose in poses]), self.lifts, self._pose
        self._lay(points, self._skin.points(time), duration)
        self._depths.add(lifts.depths, lifts.touching != 0, frame)
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

    def _lay(self, points: RowPoints, skin: Array, duration: float) -> None:
        """Lifts and pose of the next sample. points: of all feathers; skin: (V, 3) m."""
        kept = float(np.exp(-duration / FALL)) if duration > 0.0 else 0.0
        anew = self._under is None or not np.array_equal(skin, self._under)
        manner, self._under = MANNER._replace(kept=kept, anew=anew), skin
        self.lifts.before[:] = self.lifts.lift
        given = points, self._skin.ground, skin

        def work(job: int, begin: int, end: int) -> None:
            bodies, poses = (self.vanes, self.stack), (self._start, self._pose)
            while begin < end:
                args = manner, (begin, end), self._scratch[job]
                begin = lay_feathers(bodies, given, self.lifts, poses, *args)
                if begin < end:
                    more = 2 * len(self._scratch[job].laps)
                    self._scratch[job] = scratch_of(self.vanes, more)

        if len(self._scratch) == 1:
            work(0, 0, len(self.stack.order))
            return
        with ThreadPoolExecutor(len(self._scratch)) as pool:
            for low, high in pairwise(self._heights.tolist()):
                ends = np.linspace(low, high, len(self._scratch) + 1).astype(int).tolist()
                list(pool.map(work, range(len(self._scratch)), ends[:-1], ends[1:]))

    def of(self, wanted: Indices, laid: Sequence[FeatherPose]) -> list[FeatherPose]:
        """Those of the needed feathers' poses that are wanted, by numbers."""
        return [laid[k] for k in np.searchsorted(self.needed, wanted).tolist()]

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
        self._under = None


def _nodes(points: Array) -> Array:
    """(F, n, 2 m + 1, 3) nodes of the strips from nodes of rows, (F, n, 1 + 2 m, 3)."""
    m = points.shape[2] // 2
    return np.concatenate([points[:, :, :m:-1], points[:, :, : 1 + m]], axis=2)


def _along_dorsal(values: Array, dorsal: Array) -> Array:
    """(F, n, 1 + 2 m, 3) values (F, n, 2 m + 1) of strips times the directors (F, n, 3) of rows."""
    m = values.shape[2] // 2
    ways = values[..., None] * dorsal[:, :, None]
    return np.concatenate([ways[:, :, m:], ways[:, :, :m][:, :, ::-1]], axis=2)
