"""A feather taken up at another level of detail: rows and rates from the pose that it has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import LEADING, TRAILING, Feather
from featherfx.mechanics.batch import has_elastic_clamp
from featherfx.shot.detail.guided import Shapes, Turns, overlaps
from featherfx.shot.detail.rigid import FeatherPose
from featherfx.shot.groups import Group
from featherfx.shot.placement import place
from featherfx.shot.types import Shot
from featherfx.solver.settle.take_up import take_up

Array = NDArray[np.float64]


def take_level_up(
    shot: Shot,
    drawn: Feather,
    pose: FeatherPose,
    group: Group,
    k: int,
    source: tuple[Group, int] | None,
    root: tuple[Array, Array],
    time: float,
) -> None:
    """Put feather k of a group into the pose of the same feather as drawn, in place.

    The turns from row to row are shared out over the new rows, so that nothing is stretched; the
    rates are those of the pose. Barbs keep the coefficients that both levels have, if the source,
    a group and the place in it, has any, and else begin at rest. root: position (3,) m and rotation
    (3, 3), at a time in s.
    """
    placement = shot.groom.feathers[int(group.members[k])]
    feather, mirrored = group.feathers[k], [placement.mirrored]
    position, rotation = root
    local = pose.points - position
    local[:, 1:3] = pose.points[:, 1:3]
    given, own = Shapes([drawn], mirrored), Shapes([feather], mirrored)
    taken = given.turns((local @ rotation)[None])
    blend = overlaps(own.shares[0], given.shares[0])
    rows, columns = own.size
    along = (blend @ taken.along[0])[None]
    world = place(
        own.posed(Turns(along, np.zeros((1, 2, rows, columns, 3))))[0], position, rotation
    )
    second, third = world[:, 1], world[:, 2]
    frames = np.stack([np.cross(second, third), second, third], axis=-1)
    velocity = _resampled(pose.velocities, drawn, feather)
    coefficients = np.zeros_like(group.state.coefficient[k])
    if source is not None:
        coefficients = _coefficients(group, k, source, has_elastic_clamp(placement.kind))
    take_up(group.solver.model, group.state, k, frames, world[:, 0], coefficients, velocity, time)


def _resampled(values: Array, given: Feather, wanted: Feather) -> Array:
    """Rates (n, P, 3) of one grid on another, linear between rows and between barb nodes.

    The density maps (featherfx/feather/density.py) would be exact for turning feathers as well,
    but take longer to make than a feather to step.
    """
    if given.points.shape == wanted.points.shape:
        return values
    rows = _linear(*(each.station / each.station[-1] for each in (wanted, given)))
    across = _linear(*(np.linspace(0.0, 1.0, each.columns + 1) for each in (wanted, given)))
    along = np.einsum("ni,ipc->npc", rows, values)
    parts = [along[:, :3]]
    for side in (LEADING, TRAILING):
        first = 3 + side * given.columns
        barb = np.concatenate([along[:, :1], along[:, first : first + given.columns]], axis=1)
        parts.append(np.einsum("mj,njc->nmc", across[1:], barb))
    return np.concatenate(parts, axis=1)


def _linear(places: Array, knots: Array) -> Array:
    """(K, n) weights of values at knots (n,) at places (K,)."""
    return np.stack([np.interp(places, knots, unit) for unit in np.eye(len(knots))], axis=1)


def _coefficients(group: Group, k: int, source: tuple[Group, int], clamp: bool) -> Array:
    """(2, n, 2 C) from those of the source: curvature shapes are the same polynomials in any
    number, and an elastic clamp is the last of each direction."""
    before, f = source
    given, wanted = before.state.coefficient[f], group.state.coefficient[k]
    count, most = given.shape[2] // 2, wanted.shape[2] // 2
    found = np.zeros_like(wanted)
    stations = [each.station / each.station[-1] for each in (before.feathers[f], group.feathers[k])]
    pairs = [(c, c) for c in range(min(count, most) - clamp)]
    pairs += [(count - 1, most - 1)] if clamp and count and most else []
    for start, to in ((0, 0), (count, most)):
        for old, new in pairs:
            for side in (0, 1):
                values = given[side, :, start + old]
                found[side, :, to + new] = np.interp(stations[1], stations[0], values)
    found[group.feathers[k].barb_length == 0.0] = 0.0
    return found
