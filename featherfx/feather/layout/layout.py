"""The layout of plumage at rest: feathers over each other like shingles, and over the skin.

Feathers are raised and rolled about their roots, and lifted a little, until they clear the skin and
each other by the layout's clearance (featherfx/feather/layout/move_kernels.py), those beneath
first. Of those that do not come clear, feathers of regions are shortened and at last left out,
where the layout allows it.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from featherfx.errors import InputWarning
from featherfx.feather.layout.arrangement import (
    Arrangement,
    Array,
    Indices,
    Mask,
    SkinPlanes,
    arrangement_of,
)
from featherfx.feather.layout.move_kernels import Limits, Neighbours, Travel, sweep
from featherfx.feather.layout.overlap import Strips, shingle_pairs, strips_of
from featherfx.groom.presets.kinds import resized
from featherfx.groom.types import Groom, Layout, Placement

_MOST_SWEEPS = 30
_SWEEPS_PER_SEARCH = 10  # after which the skin's tangent planes are looked up again
_SETTLED = 0.05  # share of the clearance that may be lacking
# shortening: by how much in one round, rounds, and sweeps after each
_SHORTER, _MOST_ROUNDS, _SWEEPS_PER_ROUND = 0.9, 12, 5
_DROPS = 3  # how often feathers are dropped and the others let settle
_MOST_NAMED = 5
_UNCHANGED = 1e-12  # relative, of a length


@dataclass(frozen=True)
class Penetration:
    """Two feathers that pass through each other, or a feather and the skin (lower "")."""

    upper: str
    lower: str
    depth: float


@dataclass(frozen=True)
class LayoutReport:
    """What a layout came to.

    pairs: (K, 2) numbers of feathers that lie over each other, the upper one first. gaps: (K,) m,
    the least distance of each pair; negative where they pass through each other. skin_gaps: (F,) m,
    least height over the skin, NaN without one. raised, rolled: (F,) deg, and lifted: (F,) m.
    shortened: (F,) share of its length that a feather has kept. dropped: ids of feathers that were
    left out; the others are numbered without them. unresolved: all that is left, the worst first.
    """

    pairs: Indices
    gaps: Array
    skin_gaps: Array
    raised: Array
    rolled: Array
    lifted: Array
    shortened: Array
    dropped: tuple[str, ...]
    unresolved: tuple[Penetration, ...]


def lay_out(groom: Groom) -> Groom:
    """The groom with its feathers laid over each other, where it asks for that.

    Gives an InputWarning where feathers were left out, and one where feathers pass through each
    other or the skin. Raises InputError for shapes that cannot be built.
    """
    result, report = laid_out(groom)
    for message in () if report is None else _doubts(report):
        warnings.warn(f"{groom.source}: layout: {message}", InputWarning, stacklevel=2)
    return result


def _doubts(report: LayoutReport) -> list[str]:
    """What a layout could not do."""
    doubts = []
    if report.dropped:
        named = ", ".join(report.dropped[:_MOST_NAMED])
        more = len(report.dropped) - _MOST_NAMED
        doubts.append(
            f"{len(report.dropped)} feathers that did not come clear are left out: {named}"
            + (f" and {more} more" if more > 0 else "")
        )
    if report.unresolved:
        worst = report.unresolved[0]
        over = f"'{worst.lower}'" if worst.lower else "the skin"
        doubts.append(
            f"{len(report.unresolved)} of {len(report.pairs)} pairs of feathers still pass through "
            f"each other or the skin; the worst is '{worst.upper}', {1e3 * worst.depth:.2g} mm "
            f"below {over}"
        )
    return doubts


def laid_out(groom: Groom) -> tuple[Groom, LayoutReport | None]:
    """The groom with its feathers laid over each other, and how far that went.

    Unchanged, without a report, where the groom asks for no layout. Raises InputError for shapes
    that cannot be built.
    """
    if groom.layout is None or not groom.feathers:
        return groom, None
    skin = None if groom.skin is None else SkinPlanes(groom.skin)
    feathers = arrangement_of(groom.feathers)
    pairs, order = _Solving(feathers, skin, groom.layout).solve(strips_of(groom.feathers))
    rank = np.argsort(order)
    kept = tuple(
        _moved(groom.feathers[k], feathers, k, int(rank[k]))
        for k in np.flatnonzero(feathers.kept).tolist()
    )
    return replace(groom, feathers=kept), _report(groom, feathers, pairs, skin)


def _moved(placement: Placement, feathers: Arrangement, k: int, rank: int) -> Placement:
    """The placement as feather k of an arrangement."""
    place, rotation = feathers.place[k].copy(), feathers.rotation[k].copy()
    moved = replace(placement, position=place, rotation=rotation, rank=rank)
    kept = float(feathers.size[k] / feathers.placed_size[k])
    if abs(kept - 1.0) < _UNCHANGED:
        return moved
    prototype, size = placement.prototype or placement.kind, placement.size * kept
    return replace(moved, kind=resized(prototype, size), prototype=prototype, size=size)


@dataclass(frozen=True)
class _Solving:
    """Moves, shortens and drops feathers until none pass through each other."""

    feathers: Arrangement
    skin: SkinPlanes | None
    layout: Layout

    def solve(self, strips: Strips) -> tuple[Indices, Indices]:
        """strips: of the feathers as they are placed.

        Returns pairs and order of shingle_pairs, of the feathers as they are moved.
        """
        pairs, order = shingle_pairs(strips)
        self._settle(pairs, order, _MOST_SWEEPS)
        strips = replace(strips, rank=np.argsort(order))
        pairs = self._search(strips)
        self._settle(pairs, order, _SWEEPS_PER_SEARCH)
        self._shorten(pairs, order)
        pairs = self._search(strips)
        if self.layout.drop is None:
            return pairs, order
        for number in range(_DROPS):
            if not self._drop(pairs, self.layout.drop):
                break
            if number == 0:
                self.feathers.put_back()  # what was in the way of others is gone
            self._settle(pairs, order, _MOST_SWEEPS)
            pairs = self._search(strips)
        self._drop(pairs, self.layout.drop)
        return pairs, order

    def _search(self, strips: Strips) -> Indices:
        """The pairs of feathers as they are moved, in the order that strips have."""
        pairs, _ = shingle_pairs(self.feathers.moved(strips))
        return pairs

    def _settle(self, pairs: Indices, order: Indices, sweeps: int) -> None:
        """Sweep until what clearance is lacking is small."""
        feathers, layout = self.feathers, self.layout
        order, pairs = order[feathers.kept[order]], pairs[feathers.kept[pairs].all(axis=1)]
        starts = np.searchsorted(pairs[:, 0], np.arange(len(feathers.size) + 1))
        neighbours = Neighbours(order, starts, pairs)
        tilt = np.radians(np.where(feathers.grown, layout.most_tilt, layout.most_tilt_placed))
        lift = np.full(len(tilt), layout.most_lift)
        least = np.stack([-0.5 * tilt, -tilt, np.zeros(len(tilt))], axis=1)
        limits = Limits(layout.clearance, least, np.stack([tilt, tilt, lift], axis=1))
        travel = Travel(np.zeros(len(tilt)), np.full(len(pairs), -1.0), np.zeros(len(pairs)))
        planes = np.zeros((0, 1, 4))
        for number in range(sweeps):
            if self.skin is not None and number % _SWEEPS_PER_SEARCH == 0:
                planes = self.skin.planes(feathers.world())
            lack = sweep(feathers, neighbours, planes, limits, travel)
            if lack < _SETTLED * layout.clearance:
                break

    def _shorten(self, pairs: Indices, order: Indices) -> None:
        """Shorten grown feathers that do not come clear, each the one whose tip is at fault."""
        size = self.feathers.size
        if self.layout.least_size >= 1.0:
            return
        least = self.layout.least_size * size
        for _ in range(_MOST_ROUNDS):
            gaps, places = self.feathers.gaps(pairs)
            through = np.flatnonzero(gaps < 0.0)
            # how far towards the tip, of the upper and the lower feather
            along = places[through, :, 0] / size[pairs[through]]
            may = (self.feathers.grown & (size > least))[pairs[through]]
            along = np.where(may, along, -np.inf)
            chosen = pairs[through, along.argmax(axis=1)][may.any(axis=1)]
            low = (self.feathers.heights(self.skin) < 0.0) & self.feathers.grown & (size > least)
            chosen = np.union1d(chosen, np.flatnonzero(low))
            if len(chosen) == 0:
                return
            size[chosen] = np.maximum(_SHORTER * size[chosen], least[chosen])
            self._settle(pairs, order, _SWEEPS_PER_ROUND)

    def _drop(self, pairs: Indices, depth: float) -> bool:
        """Drop grown feathers that pass through others or the skin by more than depth; if any."""
        kept, grown = self.feathers.kept, self.feathers.grown
        before = int(kept.sum())
        kept &= ~(grown & (self.feathers.heights(self.skin) < -depth))
        pairs = pairs[kept[pairs].all(axis=1)]
        gaps, _ = self.feathers.gaps(pairs)
        deep = gaps < -depth
        kept &= ~_covering(pairs[deep], -gaps[deep], grown)
        return int(kept.sum()) < before


def _covering(pairs: Indices, depths: Array, grown: Mask) -> Mask:
    """(F,) grown feathers of which every pair (K, 2) with one holds one: those in most first."""
    chosen = np.zeros(len(grown), dtype=np.bool_)
    keep = grown[pairs].any(axis=1)
    pairs, depths = pairs[keep], depths[keep]
    while len(pairs):
        # the depth decides between feathers of as many pairs
        weight = np.repeat(1.0 + depths / (depths.max() * (len(depths) + 1)), 2)
        count = np.bincount(pairs.ravel(), weights=weight, minlength=len(grown))
        worst = int(np.argmax(np.where(grown, count, -1.0)))
        chosen[worst] = True
        left = (pairs != worst).all(axis=1)
        pairs, depths = pairs[left], depths[left]
    return chosen


def measured(groom: Groom) -> LayoutReport:
    """What lies over what in a groom as it is, without any change to it."""
    skin = None if groom.skin is None else SkinPlanes(groom.skin)
    pairs, _ = shingle_pairs(strips_of(groom.feathers))
    return _report(groom, arrangement_of(groom.feathers), pairs, skin)


def cover(groom: Groom) -> float:
    """Mean number of feathers over a point of a vane, itself included."""
    pairs, _ = shingle_pairs(strips_of(groom.feathers))
    return arrangement_of(groom.feathers).cover(pairs)


def _report(
    groom: Groom, feathers: Arrangement, pairs: Indices, skin: SkinPlanes | None
) -> LayoutReport:
    """Of the feathers that are kept."""
    kept = np.flatnonzero(feathers.kept)
    number = np.cumsum(feathers.kept) - 1
    pairs = pairs[feathers.kept[pairs].all(axis=1)]
    gaps, _ = feathers.gaps(pairs)
    over = ~np.isnan(gaps)
    pairs, gaps = number[pairs[over]], gaps[over]
    skin_gaps = feathers.heights(skin)[kept]
    ids = [groom.feathers[k].id for k in kept]
    left = [
        Penetration(ids[pairs[k, 0]], ids[pairs[k, 1]], float(-gaps[k]))
        for k in np.flatnonzero(gaps < 0.0)
    ]
    left += [Penetration(ids[k], "", float(-skin_gaps[k])) for k in np.flatnonzero(skin_gaps < 0.0)]
    return LayoutReport(
        pairs=pairs,
        gaps=gaps,
        skin_gaps=skin_gaps,
        raised=np.degrees(feathers.moves[kept, 0]),
        rolled=np.degrees(feathers.moves[kept, 1]),
        lifted=feathers.moves[kept, 2],
        shortened=feathers.size[kept] / feathers.placed_size[kept],
        dropped=tuple(groom.feathers[k].id for k in np.flatnonzero(~feathers.kept)),
        unresolved=tuple(sorted(left, key=lambda each: (-each.depth, each.upper, each.lower))),
    )
