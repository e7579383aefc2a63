"""Shelter from the wind of feathers that lie on each other and on a skin, and the wind on them.

The air presses on a stack of vanes once, not on each of them: where n vanes lie on each other each
bears 1 / n of what it would bear alone. Over a skin the body bears it, and a rest is left for the
vane. The air's force goes with the square of its speed, so that a feather feels e of the speed with

    e^2 = mean of b over the vane's area,   b = e0^2 over the skin, 1 / n elsewhere

b is taken at rest, as the groom's layout leaves the feathers. 1 / n makes the load of n equal vanes
on each other that of one; e0 is chosen by eye, as no measured value of a plumage is known.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.barbs import outline_curve
from featherfx.feather.crossings import near_pairs, strips_of
from featherfx.files.disk_cache import kept
from featherfx.groom.course import shaft
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import FeatherKind, Placement
from featherfx.mechanics.model import Loads
from featherfx.shot.loads import exposures
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun
from featherfx.shot.roots import RootFrames, arrived
from featherfx.shot.skin import BoundSkin

# e of a vane that lies over the skin
LEAST = 0.2
# e in steps, so that few batches do for many feathers
_STEPS = 10
# of a feather's length: the farthest that vanes lie on each other, and that one lies on a skin
_NEAR, NEAR_SKIN = 0.3, 0.3
# places along the vane where it is looked at, and by which others know where it is
_LOOKED_AT = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
# places by which the shaft, and the width of the vane, are known
_COURSE, _WIDTHS = 9, 33
_PAIRS_AT_ONCE = 4000  # bounds memory


class _Outlines(NamedTuple):
    """F feathers, in lengths of their own and their frames, a left one's mirrored to a right one's.

    course, turn: (F, 9, 3) and (F, 9, 3, 3), the shaft and its frames at even shares of its length.
    width: (F, 2, 33) of the leading and the trailing vane at even shares. looked_at: (F, 10, 3),
    points in the middle of either vane. weight: (F, 10) for the area about them.
    """

    course: Array
    turn: Array
    width: Array
    looked_at: Array
    weight: Array


def lying_exposures(placements: Sequence[Placement], skin: BoundSkin | None) -> Array:
    """(F,) e of feathers by how they lie at rest; 1 where neither vane nor skin is beneath."""
    shapes: dict[tuple[object, ...], int] = {}
    shape = [shapes.setdefault(_shape(each.kind), len(shapes)) for each in placements]
    places = [(p.kind.length, p.position, p.rotation, p.mirrored) for p in placements]
    own = [np.array(each) for each in zip(*places, strict=True)]
    parts = [
        (part.members, part.surface.rest, part.surface.triangles, part.surface.bones is None)
        for part in _parts(skin)
    ]
    known = [list(shapes), shape, own, strips_of(placements), parts]
    return kept("exposures", known, lambda: {"of": _lying(placements, skin)})["of"]


def _parts(skin: BoundSkin | None) -> Sequence[Any]:
    return () if skin is None else skin.parts


def _lying(placements: Sequence[Placement], skin: BoundSkin | None) -> Array:
    outlines = _outlines([placement.kind for placement in placements])
    position = np.array([p.position for p in placements]).reshape(-1, 1, 3)
    axes = np.array([p.rotation for p in placements]).reshape(-1, 3, 3).transpose(0, 2, 1).copy()
    axes[[p.mirrored for p in placements], 1] *= -1.0  # rows: x, y towards the leading vane, z
    length = np.array([p.kind.length for p in placements])
    points = position + length[:, None, None] * outlines.looked_at @ axes
    stacked = np.ones(points.shape[:2])
    pairs = near_pairs(strips_of(placements))
    for upper, lower in (pairs.T, pairs.T[::-1]):
        for begin in range(0, len(pairs), _PAIRS_AT_ONCE):
            own, other = (each[begin : begin + _PAIRS_AT_ONCE] for each in (upper, lower))
            seen = (points[own] - position[other]) @ axes[other].transpose(0, 2, 1)
            reach = _NEAR * np.minimum(length[own], length[other]) / length[other]
            seen /= length[other][:, None, None]
            np.add.at(stacked, own, _over(outlines, other, seen, reach))
    borne = np.where(_over_skin(points, axes[:, 2], length, skin), LEAST**2, 1.0 / stacked)
    mean = (outlines.weight * borne).sum(axis=1) / outlines.weight.sum(axis=1)
    return np.asarray(np.round(_STEPS * np.sqrt(mean)) / _STEPS)


def _shape(kind: FeatherKind) -> tuple[object, ...]:
    """Return what a kind's outline in lengths of its own follows from."""
    return kind.rachis, kind.calamus, kind.leading.outline, kind.trailing.outline


def _outlines(kinds: Sequence[FeatherKind]) -> _Outlines:
    found: dict[tuple[object, ...], _Outlines] = {}
    shapes = []
    for kind in kinds:
        key = _shape(kind)
        if key not in found:
            found[key] = _outline(kind)
        shapes.append(found[key])
    return _Outlines(*(np.stack(each) for each in zip(*shapes, strict=True)))


def _outline(kind: FeatherKind) -> _Outlines:
    course = np.linspace(0.0, 1.0, _COURSE)
    turn, mean = shaft(kind.rachis, course)
    shares = np.linspace(0.0, 1.0, _WIDTHS)
    width = np.zeros((2, _WIDTHS))
    for side, vane in enumerate((kind.leading, kind.trailing)):
        if vane.outline:
            x, y = outline_curve(vane.outline).T
            place = kind.calamus + x * (1.0 - kind.calamus)
            width[side] = np.interp(shares, place, y, left=0.0, right=0.0)
    at = kind.calamus + _LOOKED_AT * (1.0 - kind.calamus)
    frames, means = shaft(kind.rachis, at)
    half = 0.5 * np.array([np.interp(at, shares, width[0]), -np.interp(at, shares, width[1])])
    points = at[:, None] * means + half[:, :, None] * frames[:, :, 1]
    # a shaft without vanes is looked at all the same
    weight = np.abs(half).ravel() + 1e-9
    return _Outlines(course[:, None] * mean, turn, width, points.reshape(-1, 3), weight)


def _over(outlines: _Outlines, other: Indices, seen: Array, reach: Array) -> Flags:
    """(P, 10) whether points (P, 10, 3), in the frames and lengths of feathers other (P,), lie on
    their vanes. reach: (P,) lengths."""
    way = seen[:, :, None] - outlines.course[other][:, None]
    nearest = np.einsum("pkcx,pkcx->pkc", way, way).argmin(axis=2)
    way = np.take_along_axis(way, nearest[:, :, None, None], axis=2)[:, :, 0]
    frame = outlines.turn[other[:, None], nearest]
    along, aside, above = np.moveaxis(np.einsum("pkxi,pkx->pki", frame, way), 2, 0)
    share = nearest / (_COURSE - 1) + along
    place = np.clip(np.rint(share * (_WIDTHS - 1)), 0, _WIDTHS - 1).astype(np.int64)
    width = outlines.width[other[:, None], (aside < 0.0).astype(np.int64), place]
    inside = (share >= 0.0) & (share <= 1.0) & (np.abs(aside) < width)
    return np.asarray(inside & (np.abs(above) <= reach[:, None]))


def _over_skin(points: Array, dorsal: Array, length: Array, skin: BoundSkin | None) -> Flags:
    """(F, 10) whether points (F, 10, 3) m lie over the skin that their feathers grow on: what is
    nearest of it is below them, not beside. dorsal: (F, 3). length: (F,) m."""
    found = np.zeros(points.shape[:2], dtype=bool)
    for part in _parts(skin):
        if part.surface.bones is not None:
            continue
        own = points[part.members]
        corners = part.surface.rest[part.surface.triangles]
        triangle, weight = closest(own.reshape(-1, 3), corners)
        foot = np.einsum("pk,pkx->px", weight, corners[triangle]).reshape(own.shape)
        gap = own - foot
        distance = np.linalg.norm(gap, axis=2)
        above = np.einsum("fkx,fx->fk", gap, dorsal[part.members])
        near = distance <= NEAR_SKIN * length[part.members][:, None]
        found[part.members] = near & (np.abs(above) >= 0.5 * distance)
    return found


# m/s, to which roots' velocities are rounded, so that even motion gives equal winds
_DIGITS = 9


class ShelterLoads(ShotLoad):
    """The shelter that a plumage gives its feathers."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._exposures = exposures(run.shot).tolist()
        self._solved = run.solved[run.options.simulated[run.solved]]
        kinds = [run.shot.groom.feathers[f].kind for f in self._solved]
        middles = [0.5 * kind.length * (1.0 + kind.calamus) for kind in kinds]
        self._middles = np.array(middles)[:, None] * np.array([1.0, 0.0, 0.0])
        self.place = {f: k for k, f in enumerate(self._solved.tolist())}
        self.root_rates = lru_cache(1)(self._root_rates)

    def key(self, feather: int) -> Hashable:
        """Exposure."""
        return self._exposures[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The shelter of a batch; None where all of the wind reaches it."""
        exposure = self._exposures[group.members[0]]
        return None if exposure == 1.0 else _Shelter(exposure, self)

    def _carried(self, roots: RootFrames) -> Array:
        """(S, 3) m, the middles of vanes as their roots carry them."""
        return roots.positions + np.einsum("fij,fj->fi", roots.rotations, self._middles)

    def _own(self, roots: RootFrames) -> RootFrames:
        return RootFrames(*(each[self._solved] for each in roots))

    def _root_rates(self, start: float, end: float, changing: bool) -> tuple[Array, Array]:
        """(S, 3) m/s, velocities from start to end (s) of the middles of simulated vanes as their
        roots carry them, and (S, 3) m/s^2, their change since the span before; 0 where that is not
        asked for."""
        duration, motion, own = end - start, self.run.motion, self._own
        begin, reached = own(arrived(motion, start)), own(motion.frames(start))
        way = self._carried(own(motion.frames(end))) - self._carried(begin)
        change = np.zeros_like(way)
        if not duration > 0.0:
            return change, change
        if changing:
            # a cut turns the velocity before it with the root
            before = self._carried(reached) - self._carried(own(arrived(motion, start - duration)))
            turned = np.einsum("fij,fkj,fk->fi", begin.rotations, reached.rotations, before)
            change = np.round((way - turned) / duration**2, _DIGITS)
        return np.round(way / duration, _DIGITS), change


class _Shelter(GroupLoad):
    """Shelter of a batch, as long as it is on its roots."""

    def __init__(self, exposure: float, shelter: ShelterLoads) -> None:
        self._exposure, self._shelter = exposure, shelter

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with the part of the wind that reaches the batch."""
        if group.is_flying:
            return loads
        velocity, change = self._shelter.root_rates(start, end, loads.added_mass.size > 0)
        own = [self._shelter.place[f] for f in group.members.tolist()]
        return sheltered(loads, self._exposure, velocity[own], change[own])


def sheltered(loads: Loads, exposure: float, velocity: Array, change: Array) -> Loads:
    """Loads of a batch whose feathers all have one exposure.

    velocity: (F, 3) m/s, of the roots. change: (F, 3) m/s^2, of that since the loads before.
    """
    return loads._replace(
        wind_mean=exposure * loads.wind_mean + (1.0 - exposure) * velocity,
        wind_change=exposure * loads.wind_change + (1.0 - exposure) * change,
        wind_amplitude=exposure * loads.wind_amplitude,
        added_mass=exposure**2 * loads.added_mass,
    )
