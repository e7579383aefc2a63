"""The layout of plumage at rest: feathers over each other like shingles, and over the skin.

Feathers are raised and rolled about their roots, and lifted a little, until they clear the skin and
each other by the layout's clearance (featherfx/feather/layout/move_kernels.py), those beneath
first. Of those that do not come clear, feathers of regions are shortened and, as short as they may
be, left out, where the layout allows it.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.thread_team import new_team
from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputWarning
from featherfx.feather.crossings import BODY
from featherfx.feather.layout.arrangement import (
    Arrangement,
    LayoutMeshes,
    SkinPlanes,
    arrangement_of,
    meshes_of,
)
from featherfx.feather.layout.choosing import covering
from featherfx.feather.layout.move_kernels import (
    MIN_TRAVEL,
    Limits,
    Neighbours,
    Travel,
    sweep,
)
from featherfx.feather.layout.overlap import Strips, shingle_pairs, strips_of
from featherfx.files.disk_cache import kept
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind, Groom, Layout, Placement
from featherfx.phases import ReportDone, phase

_MAX_SWEEPS = 30
_SWEEPS_PER_SEARCH = 10  # after which the skin's tangent planes are looked up again
# shares of the clearance: what may lack, and what moves are multiples of: of all, from where they
# are placed, and of the few that have not come to rest by that. What a change brings about dies out
# sooner with a coarse grain; with a fine one more feathers find room in a crowd
_SLACK, _GRAIN, _FINE_GRAIN = 0.1, 0.5, 0.04
_MIN_GRAIN = 1e-7  # m, where no clearance is asked for
# shortening: by how much in one round, rounds, and sweeps after each
_SHORTER, _MAX_ROUNDS, _SWEEPS_PER_ROUND = 0.9, 12, 5
_MAX_PARTED = 5  # how often meshes that pass through each other are given more clearance
_NO_PAIRS = np.zeros((0, 2), dtype=np.int64)
_SHORTER_STILL = 0.75  # by how much before it is dropped, down to the least
_DROPS = 5  # how often feathers give way, the last time all that must, and the others settle
_DROPS_OF_MESHES = 3
_MAX_NAMED = 5
# that share a sweep
_MAX_THREADS = 8
# hundredths of its time at which the parts of a layout end, measured on birds and a swan of 800 to
# 2,500 feathers: pairs found, settled, shortened, and each time that feathers have given way
_FOUND, _SETTLED, _SHORTENED, _DROPPED, _PARTED = 15, 25, 44, (56, 60, 64, 68, 71), (85, 92, 100)
_UNCHANGED = 1e-12  # relative, of a length
# figures of materials that no shape depends on; whatever is not named here is taken to matter
_VANE_STRENGTHS = (
    "modulus_along_barbs", "modulus_across_barbs", "shear_modulus", "surface_density",
    "barb_bending_normal", "barb_bending_in_plane", "bending_across", "twist_ratio", "loss_factor",
    "compression_guard", "barb_clamp_normal", "barb_clamp_in_plane", "hook_yield_across",
    "hook_yield_shear", "hook_strength", "poissons_ratio", "thickness_profile",
    "across_barbs_profile", "along_barbs_profile",
)  # fmt: skip
_SHAFT_STRENGTHS = (
    "youngs_modulus", "shear_modulus", "modulus_profile", "cortex_density", "core_density",
    "loss_factor",
)  # fmt: skip
_OF_KIND = ("kind", "prototype", "size")


@dataclass(frozen=True)
class Penetration:
    """Two feathers that pass through each other, or a feather and the skin (lower "")."""

    upper: str
    lower: str
    depth: float


@dataclass(frozen=True)
class LayoutReport:
    """Result of a layout, as it is reported.

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
    """List what a layout could not do."""
    doubts = []
    if report.dropped:
        named = ", ".join(report.dropped[:_MAX_NAMED])
        more = len(report.dropped) - _MAX_NAMED
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
            f"below {over}. [layout] has what they may do: move more (most_tilt, most_lift), be "
            "shortened (least_size) or left out (drop)"
        )
    return doubts


def laid_out(groom: Groom) -> tuple[Groom, LayoutReport | None]:
    """The groom with its feathers laid over each other, and how far that went.

    Unchanged, without a report, where the groom asks for no layout. Raises InputError for shapes
    that cannot be built.
    """
    if groom.layout is None or not groom.feathers:
        return groom, None
    layout, inputs = groom.layout, [_shapes(groom.feathers), groom.layout, groom.skin]
    laid = LayoutResult(**kept("layout", inputs, lambda: _laid(groom, layout)._asdict()))
    feathers = tuple(
        _moved(groom.feathers[f], laid, k) for k, f in enumerate(np.flatnonzero(laid.kept))
    )
    return replace(groom, feathers=feathers), _report(groom, laid)


def _shapes(placements: Sequence[Placement]) -> list[Any]:
    """Return what a layout depends on of feathers, without what only their motion does, so that it
    outlives a change of that. A kind counts as its prototype in its size."""
    known: dict[int, FeatherKind] = {}

    def shape(kind: FeatherKind) -> FeatherKind:
        if id(kind) not in known:
            none: dict[str, Any] = dict.fromkeys(_VANE_STRENGTHS, 0.0)
            vane = replace(kind.vane_material, **none)
            none = dict.fromkeys(_SHAFT_STRENGTHS, 0.0)
            shaft = replace(kind.rachis_material, **none)
            plain = replace(kind.uncoloured, vane_material=vane, rachis_material=shaft)
            known[id(kind)] = plain
        return known[id(kind)]

    units = [shape(each.prototype or each.kind) for each in placements]
    sizes = [None if each.prototype is None else each.size for each in placements]
    names = [each.name for each in fields(Placement) if each.name not in _OF_KIND]
    columns = zip(*map(attrgetter(*names), placements), strict=True)
    own = [np.stack(each) if isinstance(each[0], np.ndarray) else each for each in columns]
    return [units, sizes, *own]


class LayoutResult(NamedTuple):
    """A layout's result for the K of F feathers that it keeps, and their P pairs.

    kept: (F,). place: (K, 3) m and rotation: (K, 3, 3). rank: (K,) place in the order, upwards.
    fraction: (K,) of its length that a feather has kept. moves: (K, 3) raise (rad), roll (rad),
    lift (m). heights: (K,) m over the skin, NaN without one. pairs: (P, 2) and gaps: (P,) m.
    """

    kept: Flags
    place: Array
    rotation: Array
    rank: Indices
    fraction: Array
    moves: Array
    heights: Array
    pairs: Indices
    gaps: Array


def _laid(groom: Groom, layout: Layout) -> LayoutResult:
    skin = None if groom.skin is None else SkinPlanes(groom.skin)
    feathers = arrangement_of(groom.feathers)
    meshes = meshes_of(groom.feathers, groom.skin)
    with phase("layout", _SHORTENED if layout.drop is None else _PARTED[-1]) as done:
        restless = np.ones(len(feathers.size), dtype=np.bool_)
        sunk = np.zeros(len(restless), dtype=np.int64)
        solving = _Solving(feathers, meshes, skin, layout, done, restless, sunk)
        pairs, order = solving.solve(strips_of(groom.feathers))
    return _result(feathers, np.argsort(order), pairs, skin)


def _result(
    feathers: Arrangement, rank: Indices, pairs: Indices, skin: SkinPlanes | None
) -> LayoutResult:
    chosen = feathers.kept
    number = np.cumsum(chosen) - 1
    pairs = pairs[chosen[pairs].all(axis=1)]
    gaps, _ = feathers.gaps(pairs)
    over = ~np.isnan(gaps)
    return LayoutResult(
        kept=chosen,
        place=feathers.place[chosen],
        rotation=feathers.rotation[chosen],
        rank=rank[chosen],
        fraction=(feathers.size / feathers.placed_size)[chosen],
        moves=feathers.moves[chosen],
        heights=feathers.heights(skin)[chosen],
        pairs=number[pairs[over]],
        gaps=gaps[over],
    )


def _moved(placement: Placement, laid: LayoutResult, k: int) -> Placement:
    """The placement as the k-th of those that a layout keeps."""
    place, rotation = laid.place[k].copy(), laid.rotation[k].copy()
    moved = replace(placement, position=place, rotation=rotation, rank=int(laid.rank[k]))
    fraction = float(laid.fraction[k])
    if abs(fraction - 1.0) < _UNCHANGED:
        return moved
    prototype, size = placement.prototype or placement.kind, placement.size * fraction
    kind = adjusted(prototype, Change(scale=size))
    return replace(moved, kind=kind, prototype=prototype, size=size)


@dataclass(frozen=True)
class _Solving:
    """Moves, shortens and at last drops feathers until none pass through each other.

    What becomes of a feather depends on those that it meets, they on theirs, and each on nothing
    else: not on when others are done. So a change of one row moves those that it reaches, and
    leaves others as they are to the last digit.

    done: is told of parts, those that were not needed counted as done. crossed: pairs as keys, one
    for every time that their meshes were found to pass through each other: so many clearances more
    are between them, since samples and maps miss what a corner pierces. sunk: (F,) likewise how
    often their meshes passed through the skin. met: the pairs of the last settling, as keys;
    restless: (F,) what has not come to rest, or is wanted otherwise since.
    """

    feathers: Arrangement
    meshes: LayoutMeshes
    skin: SkinPlanes | None
    layout: Layout
    done: ReportDone
    restless: Flags
    sunk: Indices
    crossed: list[Indices] = field(default_factory=list)
    met: list[Indices] = field(default_factory=list)

    def solve(self, strips: Strips) -> tuple[Indices, Indices]:
        """strips: of the feathers as they are placed.

        Returns pairs and order of shingle_pairs, of the feathers as they are moved.
        """
        pairs, order = shingle_pairs(strips)
        self.done(_FOUND)
        self._settle(pairs, order, _MAX_SWEEPS, _GRAIN)
        self.done(_SETTLED)
        strips = replace(strips, rank=np.argsort(order))
        pairs = self._search(strips)
        self._settle(pairs, order, _SWEEPS_PER_SEARCH)
        self._shorten(pairs, order)
        self.done(_SHORTENED)
        pairs = self._search(strips)
        if self.layout.drop is None:
            return pairs, order
        for number in range(_DROPS):
            some = self._give_way(pairs, self.layout.drop, number == _DROPS - 1)
            if number == 0 and some:
                self.feathers.put_back()  # what was in the way of others is gone
                self.restless[:] = True
            elif not (some or self.restless.any()):
                break
            self._settle(pairs, order, _MAX_SWEEPS, _GRAIN if number == 0 else _FINE_GRAIN)
            self.done(_DROPPED[number])
            pairs = self._search(strips)
        for number in range(_DROPS_OF_MESHES):
            self.done(_PARTED[number - 1] if number else _DROPPED[-1])
            self._part_meshes(pairs, order)
            last = number == _DROPS_OF_MESHES - 1
            some = self._give_way(pairs, self.layout.drop, last, crossed=True)
            if not (some or self.restless.any()):
                break
        return pairs, order

    def _search(self, strips: Strips) -> Indices:
        """The pairs of feathers as they are moved, in the order that strips have."""
        pairs, _ = shingle_pairs(self.feathers.moved(strips))
        return pairs

    def _settle(
        self, pairs: Indices, order: Indices, sweeps: int, grain: float = _FINE_GRAIN
    ) -> None:
        """Sweep until nothing moves, from what is restless and pairs that are new; others move when
        they are met. grain: share of the clearance."""
        feathers = self.feathers
        order, pairs = order[feathers.kept[order]], pairs[feathers.kept[pairs].all(axis=1)]
        starts = np.searchsorted(pairs[:, 0], np.arange(len(feathers.size) + 1))
        neighbours = Neighbours(order, starts, pairs)
        limits, travel = self._limits(pairs, grain), self._travel(pairs)
        planes, threads = np.zeros((0, 1, 4)), min(os.cpu_count() or 1, _MAX_THREADS)
        each = [feathers.with_scratch() for _ in range(threads)]
        still, known = False, np.zeros_like(travel.gone)
        with ThreadPoolExecutor(threads) as pool:
            for number in range(sweeps):
                if self.skin is not None and (still or number % _SWEEPS_PER_SEARCH == 0):
                    planes = self.skin.planes(feathers.world())
                    travel.landed[travel.gone > known] = -1.0
                    known = travel.gone.copy()
                team = new_team(1), np.zeros(len(known), dtype=np.int64)
                how, before = (neighbours, planes, limits, travel), travel.gone.copy()
                list(pool.map(lambda own, team=team, how=how: sweep(team, own, *how), each))
                still = bool((travel.gone == before).all())
                # at rest on planes that are those of where it is
                self.restless[:] = travel.gone > (before if self.skin is None else known)
                if not self.restless.any():
                    break

    def _limits(self, pairs: Indices, share: float) -> Limits:
        feathers, layout = self.feathers, self.layout
        tilt = np.radians(np.where(feathers.grown, layout.most_tilt, layout.most_tilt_placed))
        lift = np.where(tilt > 0.0, layout.most_lift, 0.0)
        grain = max(share * layout.clearance, _MIN_GRAIN)
        turn = grain / feathers.placed_size
        return Limits(
            clearance=layout.clearance * (1.0 + self._times_crossed(pairs).astype(float)),
            ground=layout.clearance * (1.0 + self.sunk.astype(float)),
            slack=_SLACK * layout.clearance,
            least=np.stack([-0.5 * tilt, -tilt, np.zeros(len(tilt))], axis=1),
            most=np.stack([tilt, tilt, lift], axis=1),
            grain=np.stack([turn, turn, np.full(len(turn), grain)], axis=1),
        )

    def _travel(self, pairs: Indices) -> Travel:
        keys, none = self._keys(pairs), np.zeros(len(self.restless))
        new = ~np.isin(keys, np.concatenate([*self.met, keys[:0]]))
        look = self.restless[pairs].any(axis=1) | new
        self.met[:] = [keys]
        return Travel(
            gone=none,
            landed=np.where(self.restless, -1.0, 0.0),
            room=np.where(look, -1.0, MIN_TRAVEL),
            seen=np.zeros(len(pairs)),
        )

    def _keys(self, pairs: Indices) -> Indices:
        """(K,) one number for each pair, whichever comes first."""
        return np.asarray(pairs.min(axis=1) * len(self.feathers.size) + pairs.max(axis=1))

    def _times_crossed(self, pairs: Indices) -> Indices:
        """(K,) how often the meshes of pairs were found to pass through each other."""
        keys, found = self._keys(pairs), np.sort(np.concatenate([*self.crossed, _NO_PAIRS[:, 0]]))
        return np.searchsorted(found, keys, "right") - np.searchsorted(found, keys)

    def _through(self) -> tuple[Indices, Indices]:
        """(K, 2) feathers whose meshes pass through each other, and (L,) grown ones through the
        skin."""
        found = self.meshes.crossed(self.feathers)
        skin = found[:, 0] == BODY
        sunk = found[skin, 1]
        return found[~skin], sunk[self.feathers.grown[sunk]]

    def _part_meshes(self, pairs: Indices, order: Indices) -> None:
        """Ask for more clearance where meshes pass through each other although samples do not."""
        for _ in range(_MAX_PARTED):
            found, sunk = self._through()
            keys = self._keys(found)
            wider = np.isin(self._keys(pairs), keys)
            self.restless[sunk] = True
            if not (wider.any() or self.restless.any()):
                return
            self.sunk[sunk] += 1
            self.crossed.append(keys)
            self.restless[pairs[wider]] = True
            self._settle(pairs, order, _SWEEPS_PER_ROUND)

    def _shorten(self, pairs: Indices, order: Indices) -> None:
        """Shorten grown feathers that do not come clear, each the one whose tip is at fault."""
        size = self.feathers.size
        if self.layout.least_size >= 1.0:
            return
        least = self.layout.least_size * size
        for _ in range(_MAX_ROUNDS):
            gaps, places = self.feathers.gaps(pairs)
            through = np.flatnonzero(gaps < 0.0)
            # how far towards the tip, of the upper and the lower feather
            along = places[through, :, 0] / size[pairs[through]]
            may = (self.feathers.grown & (size > least))[pairs[through]]
            along = np.where(may, along, -np.inf)
            chosen = pairs[through, along.argmax(axis=1)][may.any(axis=1)]
            low = (self.feathers.heights(self.skin) < 0.0) & self.feathers.grown & (size > least)
            chosen = np.union1d(chosen, np.flatnonzero(low))
            if not (len(chosen) or self.restless.any()):
                return
            size[chosen] = np.maximum(_SHORTER * size[chosen], least[chosen])
            self.restless[chosen] = True
            self._settle(pairs, order, _SWEEPS_PER_ROUND)

    def _give_way(self, pairs: Indices, depth: float, last: bool, crossed: bool = False) -> bool:
        """Shorten grown feathers that pass through others or the skin by more than depth, and drop
        those that are as short as they may be, or all of them the last time; if any.

        crossed: also those whose meshes pass through each other by less.
        """
        feathers, grown = self.feathers, self.feathers.grown
        low = feathers.kept & grown & (feathers.heights(self.skin) < -depth)
        through, sunk = self._through()
        low[sunk] |= crossed
        pairs = pairs[(feathers.kept & ~low)[pairs].all(axis=1)]
        gaps, _ = feathers.gaps(pairs)
        deep = gaps < -depth
        through = through[~low[through].any(axis=1)]
        depths = np.append(-gaps[deep], np.zeros(len(through)))
        must = np.append(np.ones(deep.sum(), np.bool_), np.full(len(through), crossed))
        chosen = low | covering(np.concatenate([pairs[deep], through]), depths, must, grown)
        least = self.layout.least_size * feathers.placed_size
        shorter = chosen & (feathers.size > least) & (not last)
        feathers.size[shorter] = np.maximum(_SHORTER_STILL * feathers.size, least)[shorter]
        feathers.kept[chosen & ~shorter] = False
        self.restless[shorter] = True
        self.restless[~feathers.kept] = False
        return bool(chosen.any())


def measure_layout(groom: Groom) -> LayoutReport:
    """Measure the stacking order in a groom as it is, without any change to it."""

    def compute() -> dict[str, Any]:
        skin = None if groom.skin is None else SkinPlanes(groom.skin)
        pairs, order = shingle_pairs(strips_of(groom.feathers))
        return _result(arrangement_of(groom.feathers), np.argsort(order), pairs, skin)._asdict()

    return _report(groom, LayoutResult(**kept("overlap", [groom.feathers, groom.skin], compute)))


def cover(groom: Groom) -> float:
    """Mean number of feathers over a point of a vane, itself included."""

    def compute() -> dict[str, Any]:
        pairs, _ = shingle_pairs(strips_of(groom.feathers))
        return {"cover": arrangement_of(groom.feathers).cover(pairs)}

    return float(kept("cover", [groom.feathers], compute)["cover"])


def _report(groom: Groom, laid: LayoutResult) -> LayoutReport:
    """Report on the feathers that are kept."""
    ids = [groom.feathers[k].id for k in np.flatnonzero(laid.kept)]
    left = [
        Penetration(ids[laid.pairs[k, 0]], ids[laid.pairs[k, 1]], float(-laid.gaps[k]))
        for k in np.flatnonzero(laid.gaps < 0.0)
    ]
    left += [
        Penetration(ids[k], "", float(-laid.heights[k])) for k in np.flatnonzero(laid.heights < 0.0)
    ]
    return LayoutReport(
        pairs=laid.pairs,
        gaps=laid.gaps,
        skin_gaps=laid.heights,
        raised=np.degrees(laid.moves[:, 0]),
        rolled=np.degrees(laid.moves[:, 1]),
        lifted=laid.moves[:, 2],
        shortened=laid.fraction,
        dropped=tuple(groom.feathers[k].id for k in np.flatnonzero(~laid.kept)),
        unresolved=tuple(sorted(left, key=lambda each: (-each.depth, each.upper, each.lower))),
    )
