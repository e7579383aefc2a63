"""Roots and bodies that are somewhere else in no time: a cut in the animation, not a motion.

Within one frame a root goes farther than its feather is long, and ten times as far as in the frames
before and after: no feather can be led along that way (a wing that beats within a few frames stands
twice at one height, so what counts there is how far it has come halfway, too). So it is carried
rigidly to where it arrives and goes on from there with the motion that follows. Smooth curves
through the frames on both sides (algebra/interpolation.py) would swing about the cut; near one,
places between frames come from the frames of its own side.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from featherfx.algebra.rotation import shared_turns
from featherfx.algebra.types import Array, Flags
from featherfx.errors import InputError, InputWarning
from featherfx.shot.roots import RootFrames, Roots
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Shot

# way within a frame, over that of the frames beside it, from which on it is a cut
FARTHER = 10.0
# intervals of frames on either side that a smooth curve through five frames looks at
_REACH = 2
# of a frame: as near a time is a frame
_NEAR = 1e-6
# times whose roots are kept: all groups of feathers ask for the same few
_KEPT = 16


@dataclass
class CutFinder:
    """Tells in which frames of a shot things are cut.

    moved: (N,) m, how far each goes from frame k to k + 1. least: (N,) m, of a cut. last: number
    of the last frame, from 0. halfway: (N,) m, how far each goes to or from halfway, the farther.
    """

    moved: Callable[[int], Array]
    least: Array
    last: int
    halfway: Callable[[int], Array] | None = None
    _known: dict[int, Flags] = field(default_factory=dict)

    def cut(self, k: int) -> Flags:
        """(N,) what is cut from frame k to k + 1."""
        if not 0 <= k < self.last:
            return np.zeros(len(self.least), dtype=np.bool_)
        if k not in self._known:
            own, beside = self.moved(k), [j for j in (k - 1, k + 1) if 0 <= j < self.last]
            found = (own > self.least) & bool(beside)
            for moved in (self.moved, self.halfway):
                if moved is not None and found.any():
                    found &= own > FARTHER * np.max([moved(j) for j in beside], axis=0)
            self._known[k] = found
        return self._known[k]

    def near(self, k: int) -> Flags:
        """(N,) what is cut so near to the frames k and k + 1 that curves would see it."""
        return np.any([self.cut(j) for j in range(k - _REACH, k + _REACH + 1)], axis=0)

    def tangents(self, k: int, places: Callable[[int], Array]) -> tuple[Array, Array]:
        """Ways of places (N, 3) a frame at k and at k + 1, as seen from between them."""
        own = places(k + 1) - places(k)
        rates = []
        for beside, ahead in ((k - 1, k), (k + 1, k + 1)):
            open_end = self.cut(beside) | (not 0 <= beside < self.last)
            other = places(ahead + (beside > k)) - places(ahead - (beside < k))
            rates.append(np.where(open_end[:, None], own, 0.5 * (own + other)))
        return rates[0], rates[1]


@dataclass
class CutRoots:
    """Roots with cuts. motion: as it comes. lengths: (F,) m, of the feathers. frame: s. last:
    number of the last frame, from 0."""

    motion: Roots
    lengths: Array
    frame: float
    last: int
    _frames: dict[int, RootFrames] = field(default_factory=dict)
    _known: dict[tuple[float, bool], RootFrames] = field(default_factory=dict)

    @cached_property
    def finder(self) -> CutFinder:
        return CutFinder(self.moved, self.lengths, self.last, self.halfway)

    def moved(self, k: int) -> Array:
        """(F,) m, how far roots, or where feathers of their lengths would end, go from frame k to
        k + 1; 0 where frames that are yet to come cannot be read."""
        try:
            return self._way(self._at(k), self._at(k + 1))
        except InputError:
            return np.zeros(len(self.lengths))

    def halfway(self, k: int) -> Array:
        """(F,) m, the same from frame k to halfway, or from there to k + 1, the farther."""
        middle = self.motion.frames((k + 0.5) * self.frame)
        return np.maximum(self._way(self._at(k), middle), self._way(middle, self._at(k + 1)))

    def _way(self, before: RootFrames, after: RootFrames) -> Array:
        """(F,) m, how far roots or ends go."""
        way = after.positions - before.positions
        turn = after.rotations[:, :, 0] - before.rotations[:, :, 0]
        tip = way + self.lengths[:, None] * turn
        return np.asarray(np.sqrt(np.maximum((way**2).sum(axis=1), (tip**2).sum(axis=1))))

    def frames(self, time: float) -> RootFrames:
        """Return where the roots are at a time, s since the first frame; at a cut, before it."""
        return self._kept(time, False)

    def after(self, time: float) -> RootFrames:
        """The same; at a cut, after it."""
        k = round(time / self.frame)
        return self._kept(time, abs(time / self.frame - k) < _NEAR)

    def _kept(self, time: float, after: bool) -> RootFrames:
        """Roots at a time; after: at a frame, from it on."""
        if (time, after) not in self._known:
            self._known[time, after] = self._found(time, after)
            if len(self._known) > _KEPT:
                del self._known[next(iter(self._known))]
        return RootFrames(*(values.copy() for values in self._known[time, after]))

    def _found(self, time: float, after: bool) -> RootFrames:
        k = time / self.frame
        if after:
            return self._between(round(k), 0.0, time)
        if abs(k - round(k)) < _NEAR:
            return self._at(round(k))
        return self._between(math.floor(k), k - math.floor(k), time)

    def _at(self, k: int) -> RootFrames:
        if k not in self._frames:
            self._frames[k] = self.motion.frames(k * self.frame)
            self._frames.pop(k - 4 * _REACH, None)
        return self._frames[k]

    def _between(self, k: int, fraction: float, time: float) -> RootFrames:
        """Roots at a share of the way from frame k to k + 1."""
        found = self.motion.frames(time) if fraction else self._at(k)
        near = self.finder.near(k) if 0 <= k < self.last else np.zeros(len(self.lengths), bool)
        if not near.any():
            return found
        before, after, cut = self._at(k), self._at(k + 1), self.finder.cut(k)
        positions = curve(self.finder, k, fraction, lambda j: self._at(j).positions)
        turned = shared_turns(before.rotations, after.rotations, np.full(len(cut), fraction))
        turned = np.where(cut[:, None, None], after.rotations, turned)
        return RootFrames(
            np.where(near[:, None], positions, found.positions),
            np.where(near[:, None, None], turned, found.rotations),
        )

    def warn(self, k: int, names: Sequence[str], number: float) -> None:
        """Say which roots are cut from frame k to k + 1, whose number is given."""
        found = np.flatnonzero(self.finder.cut(k))
        if len(found):
            way = self.moved(k)[found]
            worst = found[int(np.argmax(way))]
            say_cut(f"root of feather '{names[worst]}'", len(found), float(way.max()), number)


@dataclass
class CutSurface:
    """A body with cuts, each of all of it. surface: as it comes. least: m, of a cut. frame: s.
    last: number of the last frame, from 0."""

    surface: TimedSurface
    least: float
    frame: float
    last: int
    _points: dict[int, Array] = field(default_factory=dict)

    @cached_property
    def finder(self) -> CutFinder:
        return CutFinder(self.moved, np.array([self.least]), self.last)

    def moved(self, k: int) -> Array:
        """(1,) m, the least that any point goes from frame k to k + 1."""
        ways = np.linalg.norm(self._at(k + 1) - self._at(k), axis=1)
        return np.array([ways.min(initial=np.inf)])

    def points(self, time: float) -> Array:
        """(V, 3) m, all points at a time in s since the first frame; at a cut, before it."""
        k = time / self.frame
        if abs(k - round(k)) < _NEAR:
            return self.surface.points(time)
        return self._between(math.floor(k), k - math.floor(k), time)

    def after(self, time: float) -> Array:
        """The same; at a cut, after it."""
        k = round(time / self.frame)
        near = abs(time / self.frame - k) < _NEAR
        return self._between(k, 0.0, time) if near else self.points(time)

    def warn(self, k: int, number: float) -> None:
        """Say so where it is cut from frame k to k + 1, whose number is given."""
        if self.finder.cut(k)[0]:
            what = f"collider {self.surface.surface.path}"
            say_cut(what, 1, float(self.moved(k)[0]), number)

    def is_cut(self, time: float) -> bool:
        """Return whether it is cut at a time."""
        k = round(time / self.frame)
        return abs(time / self.frame - k) < _NEAR and bool(self.finder.cut(k)[0])

    def _at(self, k: int) -> Array:
        if k not in self._points:
            self._points[k] = self.surface.points(k * self.frame)
            self._points.pop(k - 16, None)
        return self._points[k]

    def _between(self, k: int, fraction: float, time: float) -> Array:
        if not (0 <= k < self.last and self.finder.near(k)[0]):
            return self.surface.points(time)
        return curve(self.finder, k, fraction, self._at)


def curve(finder: CutFinder, k: int, fraction: float, places: Callable[[int], Array]) -> Array:
    """(N, 3) m, at a share of the way from frame k to k + 1 on a cubic that sees no cut; what is
    cut there comes along the way that it goes on from frame k + 1."""
    start, end, u = places(k), places(k + 1), fraction
    first, last = finder.tangents(k, places)
    across = u * u * (3.0 - 2.0 * u)
    cubic = start + across * (end - start) + u * (1.0 - u) * ((1.0 - u) * first - u * last)
    ahead = finder.cut(k + 1) | (k + 1 >= finder.last)
    way = np.where(ahead[:, None], 0.0, places(min(k + 2, finder.last)) - end)
    return np.where(finder.cut(k)[:, None], end - (1.0 - u) * way, cubic)


def say_cut(what: str, count: int, way: float, number: float) -> None:
    """Warn that something is somewhere else in a frame with this number. way: m."""
    more = f" and {count - 1} more" if count > 1 else ""
    warnings.warn(
        f"{what}{more}: cut to another place at frame {number:g}, {way:.3g} m away, more than"
        f" {FARTHER:g} times as far as in the frames beside it."
        " It is carried along, without that speed",
        InputWarning,
        stacklevel=2,
    )


def cut_roots(shot: Shot, motion: Roots) -> CutRoots:
    """The motion of a shot's roots, as it is where it is cut."""
    lengths = np.array([each.kind.length for each in shot.groom.feathers])
    return CutRoots(motion, lengths, 1.0 / shot.frames_per_second, _last(shot))


def cut_surfaces(shot: Shot, surfaces: Sequence[TimedSurface], least: float) -> list[CutSurface]:
    """Bodies of a shot, as they are where they are cut. least: m, of a cut."""
    frame, last = 1.0 / shot.frames_per_second, _last(shot)
    return [CutSurface(each, least, frame, last) for each in surfaces]


def _last(shot: Shot) -> int:
    return shot.last_frame - shot.first_frame
