"""Splits of a vane at rest: which gaps stand open, and how the barbs beside them give way.

A split lies in the strip between the two rows next to its place. At its edges the ends of the barbs
are moved apart by its width, further away by less, over a distance of SPLIT_SPREAD widths: a barb
of length L turns by 2 u / L more over its length, so that its end moves by u across it and its root
stays. Barbs between two splits are drawn together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.types import Array
from featherfx.groom.splits import Split

# widths of a split over which the barbs beside it are moved
SPLIT_SPREAD = 4.0


def strips_of(splits: Sequence[Split], place: Array, grown: Flags) -> dict[int, Split]:
    """Row below each split, and the split; of several in one strip the deepest.

    place: (n,) of the rows, share of the vane's length. grown: (n,) whether they have a barb.
    """
    between = np.flatnonzero(grown[:-1] & grown[1:])
    if len(between) == 0:
        return {}
    middle = 0.5 * (place[between] + place[between + 1])
    found: dict[int, Split] = {}
    for split in splits:
        row = int(between[np.argmin(np.abs(middle - split.position))])
        if row not in found or split.depth > found[row].depth:
            found[row] = split
    return found


def open_cells(splits: dict[int, Split], exists: Flags) -> Flags:
    """(n-1, m, 2) triangles that are open at rest. splits: of strips_of. exists: as the result."""
    result, columns = np.zeros(exists.shape, dtype=np.bool_), exists.shape[1]
    along = (np.arange(columns) + 0.5) / columns
    for row, split in splits.items():
        result[row] = (along >= min(1.0 - split.depth, along[-1]))[:, None]
    return result & exists


def splay(splits: dict[int, Split], across: Array, length: Array, size: float) -> Array:
    """(n,) rad, by how much more the barbs turn towards the tip.

    splits: of strips_of. across: (n,) m, places of the barbs along a line that crosses them.
    length: (n,) m, of the barbs, 0 for none. size: m, of the feather.
    """
    moved = np.zeros(len(length))
    for row, split in splits.items():
        half = 0.5 * split.width * size
        if half == 0.0:
            continue
        above = np.arange(len(length)) > row
        away = np.where(above, across - across[row + 1], across[row] - across)
        fading = np.maximum(1.0 - away / (2.0 * SPLIT_SPREAD * half), 0.0)
        moved += np.where(above, half, -half) * fading
    return np.divide(2.0 * moved, length, out=np.zeros_like(moved), where=length > 0.0)
