"""Shelter from the wind of feathers that lie on each other and on a skin.

The air presses on a stack of vanes once, not on each of them: where n vanes lie on each other each
bears 1 / n of what it would bear alone. Over a skin the body bears it, and a rest is left for the
vane. The air's force goes with the square of its speed, so that a feather feels e of the speed with

    e^2 = mean of b over the vane's area,   b = e0^2 over the skin, 1 / n elsewhere

b is taken at rest, as the groom's layout leaves the feathers. 1 / n makes the load of n equal vanes
on each other that of one; e0 is chosen by eye, as no measured value of a plumage is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.barbs import outline_curve
from featherfx.feather.overlap import near_pairs, strips_of
from featherfx.files.disk_cache import kept
from featherfx.groom.course import shaft
from featherfx.groom.skin.skin import closest
from featherfx.groom.types import FeatherKind, Placement
from featherfx.shot.skin import BoundSkin

# e of a vane that lies over the skin
LEAST = 0.2
# e in steps, so that few batches do for many feathers
_STEPS = 10
# of a feather's length: the farthest that vanes lie on each other, and that one lies on a skin
_NEAR, NEAR_SKIN = 0.3, 0.3
# places along the vane where it is looked at, and by which others know where it is
_LOOKED_AT = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
_COURSE, _WIDTHS = 9, 33
_PAIRS_AT_ONCE = 4000


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
