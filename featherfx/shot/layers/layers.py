"""Feathers as they are shown: laid over those beneath them and over the skin, sample by sample.

What is simulated does not change. Every sample starts from the lifts of the one before, and the
first one from those that it comes to rest with. Feathers are taken from the lowest up: each is
lifted as it was, its laps over what is laid already are searched (lap_kernels.py), and the lift
that clears them is found (lift_kernels.py).

Where feathers come over each other that were not before, these lifts jump. So a sample is laid
twice: once as it has to be, and for good when so many samples after it have been laid once as the
shot's `ease` says. Lifts then rise before they have to, and fall after, at a speed that is limited:

    E(t) = max over s of  L(s) - speed |t - s|,

which is nowhere below L, and what lies on others that rise early is laid on them anew. What one
of these samples asks for again falls much slower than that: it would only come up again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.thread_team import new_team
from featherfx.algebra.types import Flags
from featherfx.feather.types import Feather, RowPoints, both, stacked
from featherfx.files.background import limit_threads
from featherfx.mechanics.model import Gaps
from featherfx.shot.frames import FeatherPose, StackingOrder, place
from featherfx.shot.layers.depths import Depths, Lifted
from featherfx.shot.layers.ground import ground_beneath
from featherfx.shot.layers.lap_kernels import meeting_pairs
from featherfx.shot.layers.lift_kernels import lay_feathers
from featherfx.shot.layers.pose_kernels import lift_points_of_all, lift_ways
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
    LayingRules,
    Lifts,
    Scratch,
    Stack,
    Vanes,
)
from featherfx.shot.motion.limbs import moving_limbs
from featherfx.shot.patterns import may_touch
from featherfx.shot.types import Shot

# s, in which a lift that is no longer asked for falls to 1 / e
FALL = 0.1
MANNER = LayingRules(kept=0.0, turns=8, follow=4.0, off=2.0, seen=0.1, slope=0.3)
# 1/s, lengths of its feather by which what is lifted less than that in the time of an ease rises or
# falls; what is lifted more takes that time (docs/contact.md has figures)
SPEED = 0.5
# of that speed, at which falls what will be asked for again: what is beneath it may sink so fast
SINKS = 0.125
# m, less than which a point may move and still count as resting where it was
_STILL = 1e-6
# times that the first sample is laid at most, until nothing moves any more
PASSES = 40
_OF_FEATHERS = "same", "moved", "settled", "strays"
_KEPT = "lift", "settled", "meets", "depths", "touching"
_STOOD = "stood", "ground"
_NO_ROWS = RowPoints(np.zeros((0, 1, 3)), np.zeros((0, 2, 3)))


def shot_stack(shot: Shot, drawn: Sequence[Feather]) -> tuple[Stack, Vanes, RowPoints]:
    """Find the stacking order of the feathers of a shot, with their vanes and their places at
    rest."""
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
    stack = among(stack_of(placements, vanes, rest), _touching(shot))
    return stack, vanes._replace(limb=moving_limbs(shot)), rest


def _touching(shot: Shot) -> NDArray[np.bool_]:
    """(F,) feathers that lie over others or under them."""
    assert shot.layers is not None
    return np.array(may_touch(shot, shot.layers.contact))


class PendingSample(NamedTuple):
    """A sample that is laid as it has to be: points of the feathers before they are lifted; their
    velocities, and accelerations where they are wanted, in single precision, as they are written,
    which many samples are held in; gaps; (V, 3) m, the skin; s since the sample before, 0 at the
    first; and what is kept of that laying."""

    points: RowPoints
    rates: tuple[RowPoints, RowPoints]
    gaps: list[Gaps | None]
    skin: Array
    duration: float
    kept: dict[str, NDArray[Any]]


class LayeredPlumage:
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
        self._lifted = Lifted(self.vanes.row.sum(axis=1))
        shape = self.vanes.present.shape
        # as it has to be, and as it is shown
        self.lifts, self._eased = _no_lifts(shape, pairs), _no_lifts(shape, pairs)
        self._start, self._pose = pose_like(rest, shape), pose_like(rest, shape)
        assert shot.layers is not None
        self._samples_ahead, self._waiting = shot.layers.samples_ahead, deque[PendingSample]()
        skin = shot.skin if shot.layers.contact.skin else None
        self._skin = ground_beneath(skin, self.needed, self.vanes, _nodes(rest.nodes))
        self._skin.ground.triangle[~_touching(shot)[self.needed]] = -1
        # where the feathers and the skin were when they last moved by _STILL or more
        self._stood = np.full_like(rest.nodes, np.nan), np.full_like(self._skin.points(0.0), np.nan)
        self._memory = self._kept()
        self._jobs, self._room, self._scratch = jobs, -1, list[Scratch]()

    def skin(self, time: float) -> Array:
        """(V, 3) m, the skin at a time in s since the first frame."""
        return self._skin.points(time)

    def ask(
        self,
        poses: list[FeatherPose],
        skin: Array,
        duration: float,
        accelerations: bool = True,
    ) -> None:
        """Lay the needed feathers at the next sample over each other and a skin (V, 3) m, as it
        has to be. poses: taken out of the list, since they are large. duration: s since the sample
        before; 0 at the first. accelerations: whether the laid poses have them; else they are of no
        rows."""
        points = stacked([pose.points for pose in poses])
        second = [pose.accelerations if accelerations else _NO_ROWS for pose in poses]
        rates = _single([pose.velocities for pose in poses]), _single(second)
        gaps = [pose.gaps for pose in poses]
        poses.clear()
        del second
        self._lay_as_asked(points, skin, duration)
        self._waiting.append(PendingSample(points, rates, gaps, skin, duration, self._kept()))

    def depths_of(self, points: RowPoints, skin: Array) -> Array:
        """(K,) thicknesses, how deep pairs of the stack that touch are where the needed feathers
        are laid from nothing at a pose, over a skin (V, 3) m; 0 for those that are clear. For
        layers that lay nothing else."""
        self.lifts.lift[:], self.lifts.meets[:] = 0.0, 0
        self._stood = np.full_like(points.nodes, np.nan), np.full_like(skin, np.nan)
        self._lay_as_asked(points, skin, 0.0)
        found = np.where(self.lifts.touching != 0, self.lifts.depths, 0.0)
        return np.maximum(found, 0.0)

    def _lay_as_asked(self, points: RowPoints, skin: Array, duration: float) -> None:
        """Lay a sample as it has to be; the first until it rests. What a lift has taken to feathers
        that it was not looked at with is laid as if it had moved."""
        lifts, moved = self.lifts, self._moved(points.nodes, skin)
        kept = float(np.exp(-duration / FALL)) if duration > 0.0 else 0.0
        met = lifts.meets.copy()
        for _ in range(1 if duration > 0.0 else 1 + PASSES):
            lifts.same[:], moved = ~moved, np.zeros_like(moved)
            self._begin(lifts, points, lifts.lift)
            places = self._places(lifts)
            lifts.same[self.stack.pairs[lifts.meets > met, 0]] = 0
            np.maximum(met, lifts.meets, out=met)
            self._lay(lifts, points, skin, kept, places)
            if not lifts.moved.any():
                break

    def _moved(self, points: Array, skin: Array) -> Flags:
        """(F,) which feathers, or the skin, moved by _STILL or more since they last did. points:
        (F, n, 1 + 2 m, 3) m; skin: (V, 3) m.

        A feather that is laid anew, though it moved by next to nothing, may come to lie otherwise.
        """
        (stood, ground), axes = self._stood, (1, 2, 3)
        moved = ~(np.abs(points - stood).max(axis=axes) < _STILL)
        if not (np.abs(skin - ground) < _STILL).all():
            moved[:] = True
            ground = skin
        if moved.any():
            # what stands is copied only where some do
            stood = points if moved.all() else np.where(moved[:, None, None, None], points, stood)
        self._stood = stood, ground
        return moved

    def lay(self, frame: float) -> list[FeatherPose]:
        """Poses of the needed feathers at the first sample that was asked for and is not yet laid
        for good, with regard to those that were asked for since. frame: its number."""
        (points, rates, gaps, skin, duration, kept), lifts = self._waiting.popleft(), self._eased
        before, pose, self._memory = lifts.lift.copy(), self._pose, kept
        eased = self._eased_lift(kept["lift"], before, duration)
        # what is as it was asked for on others that are stays
        lifts.same[:], lifts.settled[:] = (eased == kept["lift"]).all(axis=(1, 2)), 1
        lifts.depths[:], lifts.touching[:] = kept["depths"], kept["touching"]
        self._begin(lifts, points, eased)
        if not lifts.same.all():
            self._lay(lifts, points, skin, 1.0, self._places(lifts))
        self._depths.add(lifts.depths, lifts.touching != 0, frame)
        self._lifted.add(lifts.lift, frame)
        laid = RowPoints(pose.points.copy(), points.directors)
        velocities, accelerations = (both(lambda part: part.astype("f8"), each) for each in rates)
        if duration > 0.0:
            np.add(
                velocities.nodes,
                _along((lifts.lift - before) / duration, pose.way),
                out=velocities.nodes,
            )
        rows = (each.each() for each in (laid, velocities, accelerations))
        return list(map(FeatherPose, *rows, gaps))

    def _eased_lift(self, asked: Array, before: Array, duration: float) -> Array:
        """(F, n, 2 m + 1) m, lifts no lower than asked for that come down slowly from those before,
        much slower where they will be asked for again, and rise slowly to those asked for later."""
        least = SPEED * self.vanes.row.sum(axis=1)[:, None, None]
        eased, seconds, sinks = asked.copy(), 0.0, SINKS * least * duration
        others = [(before, duration, duration)] if duration > 0.0 else []
        for each in self._waiting:
            np.maximum(eased, np.minimum(before, each.kept["lift"]) - sinks, out=eased)
            seconds += each.duration
            others.append((each.kept["lift"], seconds, each.duration))
        for lift, way, step in others:
            speed = np.maximum(least, lift / ((self._samples_ahead(step) + 1) * step))
            np.maximum(eased, lift - way * speed, out=eased)
        seen = MANNER.seen * self.vanes.half[:, None, None]
        alike = (eased - asked <= seen).all(axis=(1, 2))
        eased[alike] = asked[alike]
        return eased

    def _begin(self, lifts: Lifts, points: RowPoints, begun: Array) -> None:
        """Lift points of all feathers as a laying begins."""
        heading = np.zeros((len(begun), 3))
        lift_ways(self.stack, self.vanes.limb, points.directors, heading, self._start.way)
        lifts.before[:] = lifts.lift[:] = self._start.lift[:] = begun
        spans = pairwise(np.linspace(0, len(begun), self._jobs + 1).astype(int).tolist())
        lift = partial(lift_points_of_all, self.vanes, points, self._start)
        with ThreadPoolExecutor(self._jobs) as pool:
            list(pool.map(lift, spans))
        # where what keeps its lift is
        for shown, start in zip(self._pose, self._start, strict=True):
            shown[:] = start

    def _lay(
        self, lifts: Lifts, points: RowPoints, skin: Array, kept: float, places: Indices
    ) -> None:
        """Lifts and pose of a sample that has begun. points: of all feathers; skin: (V, 3) m; kept:
        share of a lift that stays in any case; places: of the order of the stack."""
        manner = MANNER._replace(kept=kept)
        bodies = self.vanes, self.stack, places
        team = new_team(1), np.zeros(len(lifts.lift), dtype=np.int64)
        given, poses = (points, self._skin.ground, skin), (self._start, self._pose)
        lay = partial(lay_feathers, team, bodies, given, lifts, poses, manner)
        threads = limit_threads(self._jobs)
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lay, self._scratch[:threads]))

    def _places(self, lifts: Lifts) -> Indices:
        """(F,) places of the order of the stack, those first with the fewest beneath them; what may
        meet in the sample is noted, and scratch has room for it."""
        stack, meets, vanes = self.stack, lifts.meets, self.vanes
        height = np.zeros(len(stack.order), dtype=np.int64)
        meeting_pairs(vanes, stack, self._start, MANNER.follow, meets, height)
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
        return self._depths.report(self._names) | self._lifted.report(self._names)

    @property
    def laid(self) -> StackingOrder:
        """Stacking order of the feathers."""
        return StackingOrder(self.needed, self.stack)

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are kept between frames, for checkpoints."""
        return self._memory | {"eased": self._eased.lift.copy()}

    def _kept(self) -> dict[str, NDArray[Any]]:
        """Copy what later samples need of one that is laid as it has to be."""
        kept = {name: getattr(self.lifts, name).copy() for name in _KEPT}
        return kept | dict(zip(_STOOD, self._stood, strict=True))

    def restore(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `memory` gave."""
        for name in _KEPT:
            getattr(self.lifts, name)[:] = memory[name]
        self._stood = memory[_STOOD[0]], memory[_STOOD[1]]
        self._eased.lift[:], self._memory = memory["eased"], self._kept()


def _single(rates: Sequence[RowPoints]) -> RowPoints:
    """Rates of feathers, stacked, in single precision."""
    return both(lambda part: part.astype("f4"), stacked(rates))


def _no_lifts(shape: tuple[int, ...], pairs: int) -> Lifts:
    """Lifts of none. shape: (F, n, 2 m + 1)."""
    return Lifts(
        lift=np.zeros(shape),
        before=np.zeros(shape),
        **{name: np.zeros(shape[0], dtype=np.int8) for name in _OF_FEATHERS},
        meets=np.zeros(pairs, dtype=np.int8),
        depths=np.zeros(pairs),
        touching=np.zeros(pairs, dtype=np.int8),
    )


def _nodes(points: Array) -> Array:
    """(F, n, 2 m + 1, 3) nodes of the strips from nodes of rows, (F, n, 1 + 2 m, 3)."""
    m = points.shape[2] // 2
    return np.concatenate([points[:, :, :m:-1], points[:, :, : 1 + m]], axis=2)


def _along(values: Array, way: Array) -> Array:
    """(F, n, 1 + 2 m, 3) values (F, n, 2 m + 1) of strips times those (F, n, 3) of rows."""
    m = values.shape[2] // 2
    ways = values[..., None] * way[:, :, None]
    return np.concatenate([ways[:, :, m:], ways[:, :, :m][:, :, ::-1]], axis=2)
