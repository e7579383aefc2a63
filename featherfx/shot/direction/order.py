"""Fractions of the angles of channels that the stacking order of feathers leaves them.

Who lies over whom is told by the rest pose. Raised by r and turned by t about its shaft (rad), a
point at x along and y across its feather goes up by u = r x + t y. Where an upper and a lower
feather of a coat have such points over each other at rest, with a gap g,

    s_l u_l <= s_u u_u + GIVE (x_u + |y_u|) + g

holds for the shares s of its angles that each gets; GIVE is what layers lift on top of it. Where
the upper one goes down there, both get the same share; then shares follow from the topmost feather
down.

Limbs are directed as a whole: feathers of a folded wing lie on each other by the dozen, the upper
ones with their roots farther back, and by the rule above none but the topmost would move. Their
poses are laid in layers, rigid, and a limb gets the largest share, to a step of bisection, with
which no pair is deep that is clear without the channels.

A share is that of the keys at which it is smallest and the same at all times, so feathers move as
smoothly as their channels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.shapes import build_feathers
from featherfx.feather.types import Feather, stacked
from featherfx.files.content import members
from featherfx.files.disk_cache import kept
from featherfx.shot.frames import place
from featherfx.shot.layers.layers import LayeredPlumage, shot_stack
from featherfx.shot.layers.stack import laps_at_rest
from featherfx.shot.layers.types import Stack
from featherfx.shot.motion.limbs import limbs_of
from featherfx.shot.roots import RootFrames
from featherfx.shot.types import Shot

# of a length, by which layers let feathers rise on those beneath them; below the slope of a lift
GIVE = 0.2
# thicknesses from which on a pair is deep
_DEEP = 1.0
# halvings of the interval that a limb's share is in
_HALVINGS = 4
# of a shot, what a pose of rigid feathers does not depend on
_NOT_POSED = {
    "name", "grips", "forces", "details", "shelters", "exposure", "targets", "wind", "wets",
    "level_of_detail", "cycle", "settle", "preroll", "run_up", "inputs", "colliders", "wind_source",
}  # fmt: skip

# root frames at a time (s) with (F,) shares of what channels ask for
Posed = Callable[[float, Array], RootFrames]


class ChannelAngles(NamedTuple):
    """Angles of channels at K times (s). angles: (K, F, 2) rad, raised and turned, below 0 the
    other way."""

    times: list[float]
    angles: Array


class _Limits(NamedTuple):
    """P places where an upper feather lies over a lower one. pair: (P,) its number. rise: (P, 2, K)
    m, how far both go up there at each time; room: (P,) m, what the lower one may go up."""

    pair: Indices
    rise: Array
    room: Array


def shares(shot: Shot, asked: ChannelAngles, posed: Posed) -> Array:
    """(F,) share of what is asked of it that each feather of a layered shot gets."""
    inputs = [each for each in members(shot) if each[0] not in _NOT_POSED]

    def compute() -> dict[str, Any]:
        drawn = build_feathers(shot.groom.feathers, shot.quality.rows, shot.quality.columns)
        limbs = limbs_of(shot.groom)
        # what presses a coat down leaves it in order
        coat = np.maximum(asked.angles, (0.0, -np.inf)) * np.equal(limbs, 0)[:, None]
        found = _of_coat(shot, drawn, coat)
        for limb in np.unique(
            limbs[np.any(asked.angles, axis=(0, 2)) & np.greater(limbs, 0)]
        ).tolist():
            found = _with_limb(shot, drawn, (limbs == limb, asked.times, posed), found)
        return {"shares": found}

    return kept("order", inputs, compute)["shares"]


def _of_coat(shot: Shot, drawn: Sequence[Feather], angles: Array) -> Array:
    """(F,) by the rule for two points over each other."""
    stack, vanes, rest = shot_stack(shot, drawn)
    if not angles.any() or not len(stack.pairs):
        return np.ones(len(drawn))
    local = stacked([feather.rest for feather in drawn]).nodes[..., :2]
    m = drawn[0].columns
    way = np.concatenate([local[:, :, :m:-1], local[:, :, : 1 + m]], axis=2)
    moved: Flags = np.asarray(np.any(angles, axis=(0, 2)))
    concerned: Flags = np.asarray(moved[stack.pairs].any(axis=1))
    parts = [
        _of_laps(laps[concerned[laps["pair"]]], way, angles)
        for laps in laps_at_rest(stack, vanes, rest, 1.0)
    ]
    limits = _Limits(*(np.concatenate(each) for each in zip(*parts, strict=True)))
    each = [_at_once(stack, limits, k) for k in range(len(angles))]
    return np.asarray(np.min(each, axis=0))


def _of_laps(laps: NDArray[Any], way: Array, angles: Array) -> _Limits:
    """Those of some laps that may limit. way: (F, n, 2 m + 1, 2) m, along and across, of nodes."""
    above = laps["above"] == 1
    guest = np.where(above, laps["upper"], laps["lower"])
    host = np.where(above, laps["lower"], laps["upper"])
    node, after, part, corner = laps["node"], laps["after"], laps["part"][:, None], laps["corner"]
    own = (1.0 - part) * way[guest, node[:, 0], node[:, 1]]
    own = (own + part * way[guest, after[:, 0], after[:, 1]]) * laps["own"][:, None]
    there = way[host[:, None], corner[:, :, 0], corner[:, :, 1]]
    there = (laps["weight"][:, :, None] * there).sum(axis=1)
    upper, lower = np.where(above[:, None], own, there), np.where(above[:, None], there, own)
    levers = (laps["upper"], upper), (laps["lower"], lower)
    rise = np.stack([np.einsum("kpa,pa->pk", angles[:, f], lever) for f, lever in levers], axis=1)
    room = np.maximum(laps["clear"] - laps["base"], 0.0)
    room += GIVE * (np.maximum(upper[:, 0], 0.0) + np.abs(upper[:, 1]))
    limits = (np.maximum(rise[:, 1], 0.0) - np.minimum(rise[:, 0], 0.0)).max(axis=1) > room
    return _Limits(laps["pair"][limits].astype(np.int64), rise[limits], room[limits])


def _at_once(stack: Stack, limits: _Limits, k: int) -> Array:
    """(F,) shares at one time."""
    found = np.ones(len(stack.order))
    upper, lower = stack.pairs[limits.pair].T
    down, up = limits.rise[:, 0, k], limits.rise[:, 1, k]
    sinks = (down < 0.0) & (up - down > limits.room)
    both = limits.room[sinks] / (np.maximum(up, 0.0) - down)[sinks]
    for feathers in (upper, lower):
        np.minimum.at(found, feathers[sinks], both)
    holds = np.flatnonzero((down >= 0.0) & (up > limits.room))
    rank = np.empty(len(stack.order), dtype=np.int64)
    rank[stack.order] = np.arange(len(stack.order))
    holds = holds[np.argsort(-rank[lower[holds]], kind="stable")]
    starts = np.flatnonzero(np.diff(lower[holds], prepend=-1))
    for own in np.split(holds, starts[1:]) if len(holds) else ():
        most = (found[upper[own]] * down[own] + limits.room[own]) / up[own]
        found[lower[own[0]]] = min(found[lower[own[0]]], most.min())
    return found


def _with_limb(
    shot: Shot, drawn: Sequence[Feather], limb: tuple[Flags, list[float], Posed], share: Array
) -> Array:
    """Shares (F,) with that of a limb: its feathers (F,), times (s), and poses."""
    own, times, posed = limb
    layers = LayeredPlumage(shot, drawn, np.flatnonzero(own), 1)
    concerned = own[layers.needed[layers.stack.pairs]].all(axis=1)

    def deep(time: float, part: float) -> Flags:
        given = np.where(own, part, share)
        positions, rotations = posed(time, given)
        points = [place(drawn[f].rest, positions[f], rotations[f]) for f in layers.needed]
        depths = layers.depths_of(stacked(points), layers.skin(time))
        return np.asarray((depths > _DEEP) & concerned)

    most = 1.0
    for time in times:
        crossing = deep(time, most)
        if not crossing.any():
            continue
        crossed = deep(time, 0.0)
        if (crossing & ~crossed).any():
            most = _bisected(partial(_clear, deep, time, crossed), most)
    return np.where(own, most, share)


def _clear(deep: Callable[[float, float], Flags], time: float, crossed: Flags, part: float) -> bool:
    return not (deep(time, part) & ~crossed).any()


def _bisected(clear: Callable[[float], bool], most: float) -> float:
    """The largest share found that is clear, below one that is not."""
    least = 0.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if clear(middle) else (least, middle)
    return least
