"""Places of the splits of a vane: given ones, and those that are drawn at random.

Drawn ones share out the stretch `where` among themselves; each lies in the middle of its part, or
aside of it by up to JITTER of the part times the irregularity. Those nearer than BESIDE of the part
to a given one are left out.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from featherfx.groom.types import MIN_SPLIT_DEPTH, FeatherKind, Splits, VaneShape

_JITTER = 0.3
_CLEARANCE_RATIO = 0.5
# share of the distance between two splits that both together may gape by
_MAX_GAPING = 0.8


class Split(NamedTuple):
    """position: share of the vane's length. depth: share of the barbs, from the edge. width: share
    of the feather's length, at the edge."""

    position: float
    depth: float
    width: float


def splits_of(splits: Splits, side: int) -> list[Split]:
    """All splits of one side's vane, by position; each side draws its own."""
    found = [Split(position, depth, splits.width) for position, depth in splits.places]
    if splits.count:
        found += _drawn(splits, side)
    return sorted(found)


def _drawn(splits: Splits, side: int) -> list[Split]:
    rng = np.random.default_rng((splits.seed, splits.pattern, side))
    first, last = splits.where
    aside, deeper, wider = splits.irregularity * rng.uniform(-1.0, 1.0, (3, splits.count))
    part = (last - first) / splits.count
    positions = first + part * (np.arange(splits.count) + 0.5 + _JITTER * aside)
    depths = np.clip(splits.depth * (1.0 + 0.5 * deeper), 0.0, 1.0)
    widths = splits.width * (1.0 + 0.5 * wider)
    columns = positions.tolist(), depths.tolist(), widths.tolist()
    return [
        split
        for split in map(Split, *columns)
        if all(abs(split.position - place) >= _CLEARANCE_RATIO * part for place, _ in splits.places)
    ]


def split_faults(kind: FeatherKind, vane: VaneShape) -> list[tuple[str, str]]:
    """(key, message) of splits that the vane has no room for."""
    splits = vane.splits
    if not vane.outline:
        key = "places" if splits.places else "count"
        return [(f"splits.{key}", "there is no vane on this side to be split")]
    first, last = max(vane.outline[0][0], 0.0), min(vane.outline[-1][0], 1.0)
    faults = [
        (
            f"splits.places[{index}][0]",
            f"{position:g} lies outside the vane, which reaches from {first:g} to {last:g}",
        )
        for index, (position, _) in enumerate(splits.places)
        if not first < position < last
    ]
    faults += [
        (f"splits.places[{index}][1]", f"{depth:g} is out of range. Give {MIN_SPLIT_DEPTH:g} to 1")
        for index, (_, depth) in enumerate(splits.places)
        if depth < MIN_SPLIT_DEPTH
    ]
    start, end = splits.where
    if end <= start:
        faults.append(("splits.where[1]", f"{end:g} is not above the first, {start:g}"))
    elif splits.count and (start < first or end > last):
        message = f"lies outside the vane, which reaches from {first:g} to {last:g}"
        faults.append(("splits.where", message))
    return faults or _crossings(kind, vane)


def _crossings(kind: FeatherKind, vane: VaneShape) -> list[tuple[str, str]]:
    """Splits whose edges would reach across each other's."""
    splits = vane.splits
    slant = min(np.sin(np.radians(guide.angle)) for guide in vane.guides) if vane.guides else 1.0
    across = (1.0 - kind.calamus) * float(slant)  # of shares of the vane's length
    faults = []
    given = sorted((position, index) for index, (position, _) in enumerate(splits.places))
    for (before, _), (position, index) in pairwise(given):
        if splits.width > _MAX_GAPING * across * (position - before) or position == before:
            message = (
                f"{position:g} crosses the split at {before:g}: both gape by {splits.width:g} of "
                f"the feather's length, and lie {across * (position - before):.3g} apart"
            )
            faults.append((f"splits.places[{index}][0]", message))
    if splits.count:
        part = (splits.where[1] - splits.where[0]) / splits.count
        apart = 1.0 - 2.0 * _JITTER * splits.irregularity if splits.count > 1 else 1.0
        least = across * part * (min(apart, _CLEARANCE_RATIO) if splits.places else apart)
        widest = splits.width * (1.0 + 0.5 * splits.irregularity)
        alone = splits.count == 1 and not splits.places
        if not alone and widest > _MAX_GAPING * least:
            message = (
                f"{splits.count} splits cross one another or those given: they gape by up to "
                f"{widest:.3g} of the feather's length, and lie {least:.3g} apart at least"
            )
            faults.append(("splits.count", message))
    return faults
