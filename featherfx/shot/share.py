"""A share of a shot's feathers: disjoint work for several workers.

Feathers that nothing follows are dealt out in turn. A feather that follows guides needs these
simulated in its own share, so followers and guides are cut by where they stand: in halves of equal
work across the longest side of their box, and these again. Only guides near a cut are simulated in
more than one share.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.shot.detail.guides import guide_weights, uses_guides
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.types import Shot

Indices = NDArray[np.int64]

# work of a feather that follows guides, over that of one that is simulated
FOLLOWING = 0.1


def share_numbers(shot: Shot, index: int, count: int) -> Indices:
    """Numbers (K,), ascending, of the feathers of a share, index from 1 to count.

    Raises InputError where there are none.
    """
    most = len(shot.groom.feathers)
    if not 1 <= index <= count <= most:
        message = f"{index}/{count} is out of range; allowed 1/1 to {most}/{most}"
        raise InputError(Problem(str(shot.source), "feathers", message))
    if not uses_guides(shot) or count == 1:
        return np.arange(index - 1, most, count)
    return np.flatnonzero(_shares(shot, count) == index - 1)


def _shares(shot: Shot, count: int) -> Indices:
    """(F,) share of every feather, from 0."""
    # compiled code, which what is not shared out by guides does without
    from featherfx.feather.shapes import feathers_of
    from featherfx.shot.detail.levels import level_plan
    from featherfx.shot.motion.motion import root_motion

    placements, quality = shot.groom.feathers, shot.quality
    drawn = feathers_of(placements, quality.rows, quality.columns)
    plan = level_plan(shot, drawn, root_motion(shot))
    guided = plan.of("guided")
    share = np.arange(len(placements)) % count
    if not len(guided):
        return share
    guides, weights = guide_weights(shot, guided, plan.leading)
    together = np.union1d(guided, guides)
    roots = np.array([placements[f].position for f in together])
    work = np.where(np.isin(together, guided), FOLLOWING, 1.0)
    share[together] = _cut(roots, work, count)
    # guides of other shares that each simulates, too
    load = np.bincount(share[together], work, count)
    for k in range(count):
        followed = guides[np.unique(weights[share[guided] == k].indices)]
        load[k] += float((share[followed] != k).sum())
    for f in np.setdiff1d(np.arange(len(placements)), together):
        share[f] = int(np.argmin(load))
        load[share[f]] += 1.0
    return _none_empty(share, count)


def _cut(roots: NDArray[np.float64], work: NDArray[np.float64], count: int) -> Indices:
    """(N,) parts of roots (N, 3), from 0, of about equal work (N,)."""
    if count == 1 or len(roots) < 2:
        return np.zeros(len(roots), dtype=np.int64)
    first = count // 2
    axis = int(np.argmax(np.ptp(roots, axis=0)))
    order = np.argsort(roots[:, axis], kind="stable")
    done = np.cumsum(work[order])
    place = int(np.searchsorted(done, done[-1] * first / count))
    low, high = order[:place], order[place:]
    part = np.empty(len(roots), dtype=np.int64)
    part[low] = _cut(roots[low], work[low], first)
    part[high] = first + _cut(roots[high], work[high], count - first)
    return part


def _none_empty(share: Indices, count: int) -> Indices:
    """With one feather of the largest share for each that has none."""
    for k in range(count):
        if not (share == k).any():
            share[np.flatnonzero(share == np.argmax(np.bincount(share)))[-1]] = k
    return share


def part_of(shot: Shot, chosen: NDArray[np.int64]) -> Shot:
    """The shot with some of its feathers, by their numbers (K,) in ascending order."""
    groom = replace(shot.groom, feathers=tuple(shot.groom.feathers[k] for k in chosen))
    skin = None if shot.skin is None else _skin(shot.skin, chosen)
    return replace(shot, groom=groom, skin=skin)


def _skin(skin: BoundSkin, chosen: NDArray[np.int64]) -> BoundSkin:
    parts = []
    for part in skin.parts:
        kept = np.isin(part.members, chosen)
        if kept.any():
            members = np.searchsorted(chosen, part.members[kept])
            parts.append(replace(part, members=members, binding=part.binding.some(kept)))
    return BoundSkin(
        ids=tuple(skin.ids[k] for k in chosen),
        rotations=skin.rotations[chosen],
        start=skin.start,
        parts=tuple(parts),
        roots=tuple(skin.roots[k] for k in chosen),
    )
