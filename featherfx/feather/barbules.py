"""Barbules of drawn barbs: curves from each barb to its neighbours, which close a hooked vane.

Along each barb stand N distal barbules, which reach the next barb, and N proximal ones, which reach
the one before (Lucas and Stettenheim 1972, Avian Anatomy, chapter 5). They leave their barb at 45
degrees towards its end (by eye). With d the distance of two on their barb, one is d sin 45 wide at
its root, so that each sort covers the vane by itself, and 0.7 times as wide at its end (by eye).
Points are means of the barbs' points, so that they move with these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import scipy

from featherfx.algebra.vectors import dots, unit
from featherfx.feather.barb_looks import drawn_barbs
from featherfx.feather.types import Array, BarbCurves, Indices
from featherfx.files.content import stable_number
from featherfx.groom.types import FeatherKind

# points of a barbule, and of its width at the root how much is left there
POINTS = 3
_TAPER = np.array([1.0, 0.85, 0.7])
_ANGLE = np.pi / 4.0
DISTAL, PROXIMAL = 1, 2


@dataclass(frozen=True)
class Barbules:
    """C barbules of B barbs with K points each. barb: (C,) that they stand on. sort: (C,) DISTAL or
    PROXIMAL. widths: (C, 3) m. matrix: (3 C, B K) means of the barbs' points."""

    barb: Indices
    sort: Indices
    widths: Array
    matrix: Any


def barbed_feather(
    kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool, id: str, barbules: int
) -> BarbCurves:
    """As drawn_barbs, with so many barbules on either side of each barb; the barbs are then as
    wide as their ramus. Raises InputError as build_feather does."""
    if not barbules:
        return drawn_barbs(kind, grid, count, mirrored, id)
    look = kind.barbs
    variant = stable_number(id) % look.variants if look.moves_barbs else 0
    return _with_barbules(kind, grid, count, mirrored, variant, barbules)


@lru_cache(maxsize=64)
def _with_barbules(
    kind: FeatherKind,
    grid: tuple[int, int],
    count: int,
    mirrored: bool,
    variant: int,
    barbules: int,
) -> BarbCurves:
    barbs = drawn_barbs(kind, grid, count, mirrored, variant)
    steps = np.diff(barbs.points, axis=1)
    lengths = np.linalg.norm(steps, axis=2).sum(axis=1)
    found = [
        _of_sort(barbs, lengths, sort, other, barbules)
        for sort, other in zip((DISTAL, PROXIMAL), barbs.neighbours[::-1], strict=True)
    ]
    barb, sort, spacing, matrix = zip(*found, strict=True)
    widths = np.sin(_ANGLE) * np.concatenate(spacing)[:, None] * _TAPER
    own = Barbules(
        np.concatenate(barb), np.concatenate(sort), widths, scipy.sparse.vstack(matrix, "csr")
    )
    whole = np.ones_like(barbs.ramus)
    return replace(barbs, widths=barbs.widths * barbs.ramus, ramus=whole, barbules=own)


def _of_sort(
    barbs: BarbCurves, lengths: Array, sort: int, other: Indices, count: int
) -> tuple[Indices, Indices, Array, Any]:
    """Barb, sort, distance on the barb and points of the barbules of one sort.

    other: (B,) barbs that they reach; those of a barb that is its own are left out.
    """
    barb = np.repeat(np.flatnonzero(other != np.arange(len(other))), count)
    each = barbs.widths.shape[1]
    root = np.tile((np.arange(count) + 0.5) / count, len(barb) // count)
    nearest = np.round(root * (each - 1)).astype(np.int64)
    way = barbs.points[other[barb], nearest] - barbs.points[barb, nearest]
    tangent = unit(np.gradient(barbs.points, axis=1))[barb, nearest]
    ahead = dots(way, tangent)
    gap = np.linalg.norm(way - ahead[:, None] * tangent, axis=1)
    end = np.clip(root + (gap / np.tan(_ANGLE) - ahead) / lengths[other[barb]], 0.0, 1.0)
    half = 0.5 * (root + end)
    places = ((root, barb, 1.0), (half, barb, 0.5), (half, other[barb], 0.5), (end, other[barb], 1))
    rows, columns, values = [], [], []
    for (at, on, share), point in zip(places, (0, 1, 1, 2), strict=True):
        before = np.minimum((at * (each - 1)).astype(np.int64), each - 2)
        ahead = at * (each - 1) - before
        for node, weight in ((before, 1.0 - ahead), (before + 1, ahead)):
            rows.append(POINTS * np.arange(len(barb)) + point)
            columns.append(on * each + node)
            values.append(share * weight)
    shape = POINTS * len(barb), each * len(other)
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    matrix = scipy.sparse.csr_array(entries, shape=shape)
    return barb, np.full(len(barb), sort), lengths[barb] / count, matrix
