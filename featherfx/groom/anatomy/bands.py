"""Bands of a wing: marks that run straight through its feathers where the wing is folded.

Both edges of a band are lines in the plane of the folded wing. Each leads from a place on the
rachis of the innermost feather of some rows to one on that of the outermost. Another feather has
the band where its rachis crosses these lines, and as oblique as they are:

    root + t length way = inner + s (outer - inner),    tan(slant) = (line, way) / (line, beside)

beside: across the feather in the wing's plane, to its leading vane.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.keys.anatomy import WingBand
from featherfx.groom.materials import Pattern

MAX_SLANT = 75.0  # deg
_BESIDE = 0.2  # of its length, from its rachis to a line along it that is on its vane
_ROUNDED = 3  # digits, so that both wings share their kinds
_MIN_SHARE = 2e-3  # of a feather's vane, of a band that counts


class FoldedRow(NamedTuple):
    """Feathers of a folded wing from the innermost outwards, in its plane. roots, ways: (n, 2) m
    and units. lengths: (n,) m. calamus: share of the rachis without a vane."""

    roots: Array
    ways: Array
    lengths: Array
    calamus: float


def marks_of(band: WingBand, rows: Sequence[FoldedRow]) -> list[list[Pattern | float | None]]:
    """The mark of each feather of each row; None where the band passes it by, and deg by which it
    leans where that is too much for a mark."""
    ends = np.array([_vane(rows[0], 0, band.inner), _vane(rows[-1], -1, band.outer)])
    inner, lines = ends[0], ends[1] - ends[0]
    return [[_mark(band, row, k, inner, lines) for k in range(len(row.roots))] for row in rows]


def _vane(row: FoldedRow, k: int, shares: tuple[float, float]) -> Array:
    """(2, 2) m, places at shares of a vane."""
    along = row.calamus + (1.0 - row.calamus) * np.array(shares)
    return np.asarray(row.roots[k] + row.lengths[k] * along[:, None] * row.ways[k])


def _mark(
    band: WingBand, row: FoldedRow, k: int, inner: Array, lines: Array
) -> Pattern | float | None:
    way, line = row.ways[k], lines.mean(axis=0)
    beside = np.array([-way[1], way[0]])
    beside *= np.sign(beside @ line) or 1.0
    places = []
    for start, edge in zip(inner, lines, strict=True):
        across = np.array([-edge[1], edge[0]])
        if abs(way @ across) < 1e-9 * np.linalg.norm(edge):
            away = abs((start - row.roots[k]) @ beside)
            return 90.0 if away < _BESIDE * row.lengths[k] else None  # along the feather
        along = ((start - row.roots[k]) @ across) / (way @ across) / row.lengths[k]
        places.append((along - row.calamus) / (1.0 - row.calamus))
    low, high = (round(float(each), _ROUNDED) for each in np.clip(np.sort(places), 0.0, 1.0))
    slant = float(np.degrees(np.arctan2(line @ way, line @ beside)))
    if high - low < _MIN_SHARE:
        return None
    if abs(slant) > MAX_SLANT:
        return abs(slant)
    return Pattern(
        kind="bars", colour=band.colour, start=low, end=high, count=1, size=1.0,
        soft=band.soft, slant=round(slant, 1),
    )  # fmt: skip
