"""Choice of the feathers of a layout to change for pairs that do not come clear."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices


def covering(pairs: Indices, depths: Array, must: Flags, grown: Flags) -> Flags:
    """(F,) grown feathers of which every pair (K, 2) that must and has one holds one: those in most
    pairs first, whether these must or not."""
    chosen = np.zeros(len(grown), dtype=np.bool_)
    keep = grown[pairs].any(axis=1)
    pairs, depths, must = pairs[keep], depths[keep], must[keep]
    while must.any():
        # the depth decides between feathers of as many pairs
        weight = np.repeat(1.0 + depths / (max(depths.max(), 1e-9) * (len(depths) + 1)), 2)
        count = np.bincount(pairs.ravel(), weights=weight, minlength=len(grown))
        may = np.intersect1d(pairs[must], np.flatnonzero(grown))
        worst = int(may[np.argmax(count[may])])
        chosen[worst] = True
        left = (pairs != worst).all(axis=1)
        pairs, depths, must = pairs[left], depths[left], must[left]
    return chosen
