"""Feathers as they are shown: laid over those beneath them and over the skin, sample by sample.

What is simulated does not change. Every sample starts from the lifts of the one before, and the
first one from those that it comes to rest with. Feathers are taken from the lowest up: each is
lifted as it was, its laps over what is laid already are searched (lap_kernels.py), and the lift
that clears them is found (lift_kernels.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.jit.team import new_team
from featherfx.shot.detail.carried import FeatherPose
from featherfx.shot.layers.depths import Depths
from featherfx.shot.layers.ground import ground_beneath
from featherfx.shot.layers.lap_kernels import meeting_pairs
from featherfx.shot.layers.lift_kernels import lay_feathers
from featherfx.shot.layers.pose_kernels import lift_points_of_all
from featherfx.shot.layers.stack import (
    among,
    beneath,
    part_of,
    pose_like,
    scratch_of,
    stack_of,
    vanes_of,
)
from featherfx.shot.layers.types import (
    Array,
    Indices,
    Laid,
    Lifts,
    Manner,
    Scratch,
    Stack,
    Vanes,
)
from featherfx.shot.patterns import may_touch
from featherfx.shot.placement import place
from featherfx.shot.types import Shot

# s, in which a lift that is no longer asked for falls to 1 / e
FALL = 0.1
MANNER = Manner(kept=0.0, turns=8, follow=4.0, off=2.0, seen=0.1, slope=0.3)
# m, what a point may move and still count as resting where it was
STILL = 1e-6
# times that the first sample is laid at most, until nothing moves any more
PASSES = 40
# of the numbers that a pose is marked by
_SEED = 20261123
_OF_FEATHERS = "same", "moved", "settled", "strays"
_KEPT = "lift", "settled", "depths", "touching"


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
        self._depths, pairs = Depths(self.stack), len(self.stack.pairs)
        shape = self.vanes.present.shape
        self.lifts = Lifts(
            lift=np.zeros(shape),
            before=np.zeros(shape),
            **{name: np.zeros(shape[0], dtype=np.int8) for name in _OF_FEATHERS},
            meets=np.zeros(pairs, dtype=np.int8),
            depths=np.zeros(pairs),
            touching=np.zeros(pairs, dtype=np.int8),
        )
        self._start, self._pose = pose_like(rest, shape), pose_like(rest, shape)
        assert shot.layers is not None
        skin = shot.skin if shot.layers.contact.skin else None
        self._skin = ground_beneath(skin, self.needed, self.vanes, _nodes(rest.nodes))
        self._skin.ground.triangle[~_touching(shot)[self.needed]] = -1
        self._marks = np.zeros(shape[0], dtype=np.uint64)
        self._jobs, self._room, self._scratch = jobs, -1, list[Scratch]()

    def skin(self, time: float) -> Array:
        """(V, 3) m, the skin at a time in s since the first frame."""
        return self._skin.points(time)

    def lay(
        self, poses: Sequence[FeatherPose], skin: Array, frame: float, duration: float
    ) -> list[FeatherPose]:
        """Poses of the needed feathers at a sample, laid over each other and a skin (V, 3) m.

        frame: its number. duration: s since the sample before; 0 at the first.
        """
        points, lifts, pose = stacked([pose.points for pose in poses]), self.lifts, self._pose
        self._lay(points, skin, duration)
        if not duration > 0.0:
            for _ in range(PASSES):
                self._lay(points, skin, duration)
                if not lifts.moved.any():
                    break
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
        lifts, marks, jobs = self.lifts, _marks(points, skin), self._jobs
        lifts.same[:], self._marks = marks == self._marks, marks
        lifts.before[:] = self._start.lift[:] = lifts.lift
        manner = MANNER._replace(kept=float(np.exp(-duration / FALL)) if duration > 0.0 else 0.0)
        with ThreadPoolExecutor(jobs) as pool:
            spans = pairwise(np.linspace(0, len(marks), jobs + 1).astype(int).tolist())
            lift = partial(lift_points_of_all, self.vanes, points, self._start)
            list(pool.map(lift, spans))
            # where what keeps its lift is
            for shown, begun in zip(self._pose, self._start, strict=True):
                shown[:] = begun
            bodies = self.vanes, self.stack, self._places(manner.follow)
            team = new_team(1), np.zeros(len(marks), dtype=np.int64)
            given, poses = (points, self._skin.ground, skin), (self._start, self._pose)
            lay = partial(lay_feathers, team, bodies, given, lifts, poses, manner)
            list(pool.map(lay, self._scratch))

    def _places(self, follow: float) -> Indices:
        """(F,) places of the order of the stack, those first with the fewest beneath them; what may
        meet in the sample is noted, and scratch has room for it."""
        stack, meets, vanes = self.stack, self.lifts.meets, self.vanes
        height = np.zeros(len(stack.order), dtype=np.int64)
        meeting_pairs(vanes, stack, self._start, follow, meets, height)
        most = int(np.diff(np.append(0, np.cumsum(meets, dtype=np.int64))[stack.first]).max())
        if most > self._room:
            self._room = most
            self._scratch = [scratch_of(vanes, most) for _ in range(self._jobs)]
        return np.argsort(height[stack.order], kind="stable")

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

    def memory(self) -> dict[str, NDArray[Any]]:
        """What is kept between samples, for checkpoints."""
        kept = {name: getattr(self.lifts, name).copy() for name in _KEPT}
        return kept | {"marks": self._marks.copy()}

    def restore(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `memory` gave."""
        for name in _KEPT:
            getattr(self.lifts, name)[:] = memory[name]
        self._marks = memory["marks"].astype(np.uint64)


def _marks(points: RowPoints, skin: Array) -> NDArray[np.uint64]:
    """(F,) numbers that change where a point of a feather or of the skin moves by STILL or more."""
    return np.asarray(_mark(points.nodes) + _mark(skin[None]))


def _mark(points: Array) -> NDArray[np.uint64]:
    """(N,) of N bodies' points (N, ..., 3) m."""
    words = (np.rint(points / STILL) + 0.0).reshape(len(points), -1).view(np.uint64)
    odd = np.random.default_rng(_SEED).integers(0, 2**63, words.shape[1], dtype=np.uint64)
    return np.asarray(words @ (odd | np.uint64(1)))


def _nodes(points: Array) -> Array:
    """(F, n, 2 m + 1, 3) nodes of the strips from nodes of rows, (F, n, 1 + 2 m, 3)."""
    m = points.shape[2] // 2
    return np.concatenate([points[:, :, :m:-1], points[:, :, : 1 + m]], axis=2)


def _along_dorsal(values: Array, dorsal: Array) -> Array:
    """(F, n, 1 + 2 m, 3) values (F, n, 2 m + 1) of strips times the directors (F, n, 3) of rows."""
    m = values.shape[2] // 2
    ways = values[..., None] * dorsal[:, :, None]
    return np.concatenate([ways[:, :, m:], ways[:, :, :m][:, :, ::-1]], axis=2)
