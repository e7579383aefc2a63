"""Feathers that stand in each other's place.

Their pairs grow as the square of their number, and with them the time and the memory of all that
compares a feather with those around: layouts, contact, layers, shelter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.errors import InputError, Problem
from featherfx.groom.types import Placement
from featherfx.limits import CROWD_PAIRS, MAX_NEIGHBOURS

# side of the cubes that roots are counted in, over the length of the shortest feathers there are
# in them: whatever compares feathers compares those of one cube
_SIDE = 0.5


def refuse_crowds(placements: Sequence[Placement], source: str, key: str, instead: str) -> None:
    """Raise InputError where so many feathers stand at one place that comparing them would not end.

    source, key: of the problem. instead: what helps besides placing them apart.
    """
    length = np.array([each.kind.length for each in placements])
    root = np.array([each.position for each in placements]).reshape(-1, 3)
    octave = np.floor(np.log2(length))
    cube = np.floor(root / (_SIDE * 2.0 ** octave[:, None]))
    _, cubes, counts = np.unique(
        np.column_stack([octave, cube]), axis=0, return_inverse=True, return_counts=True
    )
    pairs = int((counts * (counts - 1) // 2).sum())
    if pairs <= max(CROWD_PAIRS, MAX_NEIGHBOURS * len(placements) // 2):
        return
    some = np.flatnonzero(cubes.ravel() == counts.argmax())
    message = (
        f"{len(placements)} feathers make at least {pairs} pairs that stand within half a length of"
        f" each other, more than {CROWD_PAIRS}, or {MAX_NEIGHBOURS} neighbours a feather (beside"
        f" '{placements[some[0]].id}' stand {len(some) - 1}). Place them apart, {instead}"
    )
    raise InputError(Problem(source, key, message))
