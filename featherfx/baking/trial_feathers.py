"""Feathers of a trial: a part of a shot that stands for the whole."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from featherfx.algebra.types import Flags, Indices
from featherfx.shot.contact.partition import shot_islands
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import resolve_options
from featherfx.shot.patterns import Detail
from featherfx.shot.types import Shot, may_touch, part_of

# feathers that go through all frames; neighbours that are tried together
MAX_COURSE, _TOGETHER = 32, 16


def pick_course(shot: Shot) -> Shot:
    """Return a few feathers that are simulated, at their levels, as a shot: evenly among all, or of
    those that push others the longest, whose steps all go along with."""
    feathers = shot.groom.feathers
    options = resolve_options(shot, drawn_feathers(shot), root_motion(shot))
    push = np.flatnonzero(pushing_feathers(shot))
    if len(push):
        lengths = np.array([feathers[f].kind.length for f in push])
        chosen = np.sort(push[np.argsort(-lengths, kind="stable")[:MAX_COURSE]])
    else:
        numbers = options.leading if len(options.leading) else np.arange(len(feathers))
        places = np.linspace(0, len(numbers) - 1, min(MAX_COURSE, len(numbers)))
        chosen = numbers[places.astype(np.int64)]
    part = part_of(shot, chosen)
    pinned = tuple(
        Detail(feathers=each.id, level=options.feathers[f].level)
        for f, each in zip(chosen, part.groom.feathers, strict=True)
    )
    return replace(part, details=part.details + pinned, level_of_detail=None)


def pushing_feathers(shot: Shot) -> Flags:
    """Return (F,) whether each feather pushes others."""
    if shot.contact is None:
        return np.zeros(len(shot.groom.feathers), dtype=np.bool_)
    return np.array(may_touch(shot, shot.contact))


def pick_feathers(shot: Shot, count: int) -> Indices:
    """Return the numbers of about so many feathers: the same share of those of each region that
    push others, and of those that do not, and one of each at least."""
    feathers, push = shot.groom.feathers, pushing_feathers(shot)
    if count == len(feathers):
        return np.arange(count)
    alike = defaultdict(list)
    for f, each in enumerate(feathers):
        alike[each.region, bool(push[f])].append(f)
    share = count / len(feathers)
    groups = _whole_groups(shot, np.flatnonzero(push), round(share * push.sum()))
    chosen = [groups] + [
        _neighbours(shot, np.array(own), max(round(share * len(own)), 1))
        for (_, pushes), own in alike.items()
        if not (pushes and len(groups))
    ]
    return np.sort(np.concatenate(chosen))


def _whole_groups(shot: Shot, push: Indices, count: int) -> Indices:
    """Return at least so many of the feathers that push others, in whole contact groups evenly
    among those that are small enough; none where all are larger."""
    if not len(push):
        return push
    group = shot_islands(shot)[push]
    sizes = np.bincount(group)
    small = np.flatnonzero((sizes > 0) & (sizes <= max(count, 1)))
    if sizes[small].sum() < count:
        return push[:0]
    order = small[np.argsort(np.arange(len(small)) * 0.6180339887 % 1.0)]
    last = int(np.searchsorted(np.cumsum(sizes[order]), count))
    return push[np.isin(group, order[: last + 1])]


def _neighbours(shot: Shot, numbers: Indices, count: int) -> Indices:
    """Return so many of some feathers, in groups of neighbours evenly among them."""
    roots = np.array([shot.groom.feathers[f].position for f in numbers])
    groups = max(count // _TOGETHER, 1)
    found = []
    for places, some in zip(
        np.array_split(np.arange(len(numbers)), groups),
        np.array_split(np.arange(count), groups),
        strict=True,
    ):
        way = np.linalg.norm(roots[places] - roots[places[len(places) // 2]], axis=1)
        found.append(numbers[places[np.argsort(way, kind="stable")[: len(some)]]])
    return np.sort(np.concatenate(found))


def largest_group(shot: Shot) -> int:
    """Return the number of feathers of the largest contact group."""
    groups = shot_islands(shot)
    return int(np.bincount(groups[groups >= 0], minlength=1).max())
