"""A subset of the feathers of a shot, as a shot of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.shot.types import Shot

if TYPE_CHECKING:
    from featherfx.shot.skin import BoundSkin


def part_of(shot: Shot, chosen: Indices) -> Shot:
    """The shot with some of its feathers, by their numbers (K,) in ascending order."""
    groom = replace(shot.groom, feathers=tuple(shot.groom.feathers[k] for k in chosen))
    skin = None if shot.skin is None else _skin(shot.skin, chosen)
    exposure = None if shot.exposure is None else shot.exposure[chosen]
    return replace(shot, groom=groom, skin=skin, exposure=exposure)


def _skin(skin: BoundSkin, chosen: Indices) -> BoundSkin:
    parts = []
    for part in skin.parts:
        kept = np.isin(part.members, chosen)
        if kept.any():
            members = np.searchsorted(chosen, part.members[kept])
            parts.append(replace(part, members=members, binding=part.binding.some(kept)))
    return replace(
        skin,
        ids=tuple(skin.ids[k] for k in chosen),
        rotations=skin.rotations[chosen],
        parts=tuple(parts),
        roots=tuple(skin.roots[k] for k in chosen),
        _warned=set(),
    )
