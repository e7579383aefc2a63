"""Cuts of a shot: named by it, or found where no smooth motion explains the acceleration.

From one frame k of a stage to the next everything is cut to another place where the second
differences of places

    a_k = x_(k-1) - 2 x_k + x_(k+1)

at k and at k + 1 are opposite, longer than a feather, and several times as long as those of the
frames beside them. A jump by J adds J to the one and -J to the other, in flight as at rest. A
motion that starts, stops, beats or bounces does not. Places are those of roots, and of points at a
feather's length along and across its shaft, so that turns count as well. Those of colliders count,
too. Where the frames of a stage end on one side, those of the other side tell. Beats, folds and
swings of the shot's own motion are smooth, however fast: they are left out.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError
from featherfx.packages import load_name
from featherfx.shot.frames import FrameCuts, StageClock
from featherfx.shot.motion.motion import uncut_motion
from featherfx.shot.roots import RootFrames, Roots, some_roots
from featherfx.shot.skin import BoundSkin
from featherfx.shot.sources import MovingSurface, TimedSurface
from featherfx.shot.types import Motion, Shot

# acceleration at a cut over that beside it, and over that and the way beside it where frames are on
# one side only
_MIN_RATIO, _MIN_ONE_SIDED_RATIO = 4.0, 10.0
# of a turn's chord (two radii): a turn by 120 degrees, without any frame beside it, is a cut
_MIN_TURN = 2.0 * math.sin(math.radians(60.0))
_MAX_COLLIDER_POINTS = 300  # that tell a cut
_MAX_FRAMES = 16  # whose places are held
_MAX_TIMES = 16  # times whose roots are held: all groups of feathers ask for the same few


class Cut(NamedTuple):
    """Cut of a thing. name: of it. more: number of others of its kind. way: m."""

    name: str
    more: int
    way: float


@dataclass
class CutTrack:
    """Places of N things at a stage's own frames. at: places (N, 3) m at a time in s. least: (N,)
    m, of a cut. clock: of the stage. first, last: own frames that there are. name: of a thing.
    turns: places are of N / 3 things, their roots first and then the ends of two arms, and one that
    is cut counts; else most of the places have to be cut."""

    at: Callable[[float], Array]
    least: Array
    clock: StageClock
    first: float
    last: float
    name: Callable[[int], str]
    turns: bool = False
    _places: OrderedDict[int, Array | None] = field(default_factory=OrderedDict)

    def cut(self, k: int) -> Cut | None:
        """Find what is cut from frame k of the shot to k + 1."""
        begin, end = (math.floor(self.clock.own(each) + 1e-6) for each in (k, k + 1))
        return next((each for j in range(begin, end) if (each := self._own_cut(j))), None)

    def _own_cut(self, j: int) -> Cut | None:
        x = [self._frame(i) for i in range(j - 2, j + 4)]
        if x[2] is None or x[3] is None:
            return None
        cut = self._are_cut(x)
        if not (cut.any() if self.turns else cut.mean() > 0.5):
            return None
        way = np.where(cut, _sizes(x[3] - x[2]), 0.0)
        things = len(way) // 3 if self.turns else 1
        by_thing = way.reshape(-1, things).max(axis=0)
        return Cut(self.name(int(by_thing.argmax())), int((by_thing > 0).sum()) - 1, by_thing.max())

    def _are_cut(self, x: Sequence[Array | None]) -> Flags:
        """(N,) which places are cut between the third and the fourth of six frames."""
        bends = [_bend(*x[i : i + 3]) for i in range(4)]
        before, after = bends[1], bends[2]
        if before is not None and after is not None:
            jump = np.minimum(_sizes(before), _sizes(after))
            opposite = np.einsum("ij,ij->i", before, after) < 0.0
            ways = [_step(x[1], x[2]), _step(x[3], x[4])]
            beside = [
                way if bend is None else bend
                for bend, way in zip((bends[0], bends[3]), ways, strict=True)
            ]
            most = np.max([_sizes(each) for each in beside if each is not None], axis=0)
            return opposite & (jump > self.least) & (jump > _MIN_RATIO * most)
        one = before if after is None else after
        if one is None:
            return self._are_turned(x)
        steps = [_step(x[0], x[1]), _step(x[1], x[2]), _step(x[3], x[4]), _step(x[4], x[5])]
        far = [bends[0], bends[3], *steps]
        most = np.max([_sizes(each) for each in far if each is not None], axis=0)
        return (_sizes(one) > self.least) & (_sizes(one) > _MIN_ONE_SIDED_RATIO * most)

    def _are_turned(self, x: Sequence[Array | None]) -> Flags:
        """(N,) the same where there are no other frames: places that turn about their roots."""
        before, after = x[2], x[3]
        found = np.zeros(len(self.least), dtype=np.bool_)
        if not self.turns or before is None or after is None:
            return found
        roots, ends = np.split(np.stack([before, after]), [len(found) // 3], axis=1)
        arms = ends - np.tile(roots, (1, 2, 1))
        found[len(found) // 3 :] = (
            _sizes(arms[1] - arms[0]) > _MIN_TURN * self.least[len(found) // 3 :]
        )
        return found

    def _frame(self, j: int) -> Array | None:
        """(N, 3) m at an own frame; None where there is none, or none that can be read."""
        if not self.first <= j <= self.last:
            return None
        if j not in self._places:
            start, distance = self.clock.grid
            codes = start + j * distance - self.clock.start
            try:
                found = self.at(codes / self.clock.step / self.clock.frames_per_second)
            except InputError:
                found = None
            self._places[j] = found
            if len(self._places) > _MAX_FRAMES:
                self._places.popitem(last=False)
        return self._places[j]


def _bend(before: Array | None, here: Array | None, after: Array | None) -> Array | None:
    if before is None or here is None or after is None:
        return None
    return before - 2.0 * here + after


def _step(before: Array | None, after: Array | None) -> Array | None:
    return None if before is None or after is None else after - before


def _sizes(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


class CutFinder(FrameCuts):
    """Cuts that tracks show. found: those that were asked about, by frame."""

    def __init__(self, tracks: Sequence[CutTrack], certain: frozenset[int]) -> None:
        """certain: frames of cuts that are known without tracks."""
        self._tracks, self._certain = tracks, certain
        self.found: dict[int, Cut | None] = {}

    @property
    def origin(self) -> tuple[str, list[int]]:
        """Return the frames that tell these cuts apart: tracks follow from the shot."""
        return "cuts", sorted(self._certain)

    def is_cut(self, k: int) -> bool:
        if k not in self.found:
            self.found[k] = next((cut for each in self._tracks if (cut := each.cut(k))), None)
        return self.found[k] is not None or k in self._certain


@dataclass(frozen=True)
class NamedCuts(FrameCuts):
    """Cuts that a shot names."""

    frames: frozenset[int]

    def is_cut(self, k: int) -> bool:
        return k in self.frames


def with_cuts(shot: Shot) -> Shot:
    """The shot with its cuts, and with stages that go on from each as later frames lead them."""
    if shot.cuts is not None:
        cuts: FrameCuts = NamedCuts(named_cuts(shot))
    else:
        certain: frozenset[int] = frozenset()
        if shot.motion.kind == "keys":
            certain = load_name("motion.keys:cut_frames")(shot.motion, shot)
        cuts = CutFinder([*_root_tracks(shot), *_collider_tracks(shot)], certain)
    skin, colliders, wind = shot.skin, shot.colliders, shot.wind_source
    if isinstance(skin, BoundSkin):
        skin = skin.led(lambda each: _led(each, clock), clock := replace(skin.clock, cuts=cuts))
    colliders = tuple(
        replace(each, surface=_led(each.surface, clock), clock=clock)
        for each in colliders
        for clock in [replace(each.clock, cuts=cuts)]
    )
    rules = shot.level_of_detail
    if rules is not None and rules.camera is not None:
        clock = replace(rules.camera.clock, cuts=cuts)
        rules = replace(rules, camera=replace(rules.camera, clock=clock))
    return replace(
        shot,
        frame_cuts=cuts,
        skin=skin,
        colliders=colliders,
        wind_source=wind and replace(wind, clock=replace(wind.clock, cuts=cuts)),
        level_of_detail=rules,
    )


def named_cuts(shot: Shot) -> frozenset[int]:
    """Cuts that a shot names, by the frames before them, counted from 0 s on."""
    return frozenset(number - shot.first_frame - 1 for number in shot.cuts or ())


def _led(surface: MovingSurface, clock: StageClock) -> MovingSurface:
    """A surface that its own frames lead on either side of a cut."""
    if surface.sampled is None:
        return surface
    knots = surface.knots or clock.knots(surface.sampled, (0, 0), is_linear=True)
    return surface.smoothed(replace(knots, ends=clock.ends))


def _root_tracks(shot: Shot) -> list[CutTrack]:
    shot = replace(shot, motion=_without_beats(shot.motion))
    if not shot.has_moving_roots:
        return []
    lengths = np.array([each.kind.length for each in shot.groom.feathers])
    clock, skin = StageClock(0.0, 1.0, shot.frames_per_second), shot.skin
    first, last = -float(shot.handles), float(shot.last_frame - shot.first_frame + shot.handles)
    if isinstance(skin, BoundSkin):
        clock = skin.clock
        surfaces = [part.surface for part in skin.parts]
        if ranges := [each.sampled for each in surfaces if each.sampled is not None]:
            start, distance = clock.grid
            first = (min(low for low, _ in ranges) - start) / distance - 1e-6
            last = (max(high for _, high in ranges) - start) / distance + 1e-6
        shot = replace(shot, skin=skin.led(lambda each: each.smoothed(None), clock))
    motion, ids = uncut_motion(shot), [each.id for each in shot.groom.feathers]

    def places(time: float) -> Array:
        roots, frames = motion.frames(time)
        return np.concatenate(
            [roots, *(roots + lengths[:, None] * frames[:, :, k] for k in (0, 1))]
        )

    def name(k: int) -> str:
        return f"root of feather '{ids[k]}'"

    return [CutTrack(places, np.tile(lengths, 3), clock, first, last, name, True)]


def _without_beats(motion: Motion) -> Motion:
    """A motion without what is smooth by itself."""
    if motion.kind == "act":
        parts = tuple(map(_without_beats, motion.values["motions"]))
        return replace(motion, values=motion.values | {"motions": parts})
    return motion if motion.kind in ("keys", "curve", "skin") else Motion("hold", {})


def _collider_tracks(shot: Shot) -> list[CutTrack]:
    longest = max(each.kind.length for each in shot.groom.feathers)
    found = []
    for each in shot.colliders:
        surface = each.surface
        if surface.sampled is None:
            continue
        stride = -(-len(surface.rest) // _MAX_COLLIDER_POINTS)
        raw = replace(each, surface=surface.smoothed(None))
        start, distance = each.clock.grid
        first, last = ((code - start) / distance for code in surface.sampled)
        least = np.full(len(surface.rest[::stride]), longest)
        found.append(
            CutTrack(
                partial(_strided, raw, stride),
                least,
                each.clock,
                first - 1e-6,
                last + 1e-6,
                f"collider {surface.path}".format,
            )
        )
    return found


def _strided(surface: TimedSurface, stride: int, time: float) -> Array:
    return surface.points(time)[::stride]


@dataclass
class CutRoots:
    """Roots with cuts, as the frame loop asks for them, from two threads."""

    motion: Roots
    clock: StageClock
    _known: dict[float, RootFrames] = field(default_factory=dict)
    _lock: Any = field(default_factory=Lock)

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame; at a cut, before it."""
        with self._lock:
            if time not in self._known:
                found = RootFrames(*(each.view() for each in self.motion.frames(time)))
                for each in found:
                    each.flags.writeable = False
                self._known[time] = found
                if len(self._known) > _MAX_TIMES:
                    del self._known[next(iter(self._known))]
            return self._known[time]

    def some(self, chosen: Indices) -> Roots:
        """Return those of feathers (K,), by numbers in ascending order."""
        return CutRoots(some_roots(self.motion, chosen), self.clock)

    def after(self, time: float) -> RootFrames:
        """The same; at a cut, after it."""
        return self.frames(self.clock.after(time))
