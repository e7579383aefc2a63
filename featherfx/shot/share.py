"""A share of a shot's feathers: disjoint work for several workers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.types import Shot


def share_numbers(shot: Shot, index: int, count: int) -> NDArray[np.int64]:
    """Numbers of every count-th feather from the index-th on, index from 1 to count.

    Raises InputError where there are none.
    """
    most = len(shot.groom.feathers)
    if not 1 <= index <= count <= most:
        message = f"{index}/{count} is out of range; allowed 1/1 to {most}/{most}"
        raise InputError(Problem(str(shot.source), "feathers", message))
    return np.arange(index - 1, most, count)


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
