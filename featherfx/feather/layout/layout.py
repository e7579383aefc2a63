"""The layout of plumage at rest: feathers over each other like shingles, and over the skin.

Feathers are raised and rolled about their roots, and lifted a little, until they clear the skin and
each other by the layout's clearance (featherfx/feather/layout/kernels.py), those beneath first. Of
those that do not come clear, feathers of regions are shortened and at last left out, where the
layout allows it (featherfx/feather/layout/solve.py).
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from featherfx.errors import InputWarning
from featherfx.feather.layout.overlap import shingle_pairs, strips_of
from featherfx.feather.layout.pose import Array, Indices, Pose, Skin, pose_of
from featherfx.feather.layout.solve import solve
from featherfx.groom.presets.kinds import resized
from featherfx.groom.types import Groom, Placement

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
    skin = None if groom.skin is None else Skin(groom.skin)
    pose = pose_of(groom.feathers)
    pairs, order = solve(pose, strips_of(groom.feathers), skin, groom.layout)
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    feathers = tuple(
        _moved(groom.feathers[k], pose, k, int(rank[k])) for k in np.flatnonzero(pose.kept).tolist()
    )
    report = _report(groom, pose, pairs, skin)
    return replace(groom, feathers=feathers), report


def _moved(feather: Placement, pose: Pose, k: int, rank: int) -> Placement:
    """The feather as feather k of a pose."""
    place, turned = pose.place[k].copy(), pose.turned[k].copy()
    moved = replace(feather, position=place, rotation=turned, rank=rank)
    share = float(pose.size[k] / pose.placed_size[k])
    if abs(share - 1.0) < _UNCHANGED:
        return moved
    prototype, size = feather.prototype or feather.kind, feather.size * share
    return replace(moved, kind=resized(prototype, size), prototype=prototype, size=size)


def measured(groom: Groom) -> LayoutReport:
    """What lies over what in a groom as it is, without any change to it."""
    skin = None if groom.skin is None else Skin(groom.skin)
    pairs, _ = shingle_pairs(strips_of(groom.feathers))
    pose = pose_of(groom.feathers)
    return _report(groom, pose, pairs, skin)


def cover(groom: Groom) -> float:
    """Mean number of feathers over a point of a vane, itself included."""
    from featherfx.feather.layout.kernels import count_cover

    pose, (pairs, _) = pose_of(groom.feathers), shingle_pairs(strips_of(groom.feathers))
    counts = np.zeros((len(groom.feathers), pose.maps.samples.shape[1]), dtype=np.int64)
    count_cover(pairs, *pose.surfaces, counts)
    inner = pose.maps.inner[pose.shape]
    within = np.arange(counts.shape[1]) < inner[:, None]
    return 1.0 + float(counts[within].sum() / inner.sum())


def _report(groom: Groom, pose: Pose, pairs: Indices, skin: Skin | None) -> LayoutReport:
    """Of the feathers that are kept."""
    kept = np.flatnonzero(pose.kept)
    number = np.cumsum(pose.kept) - 1
    pairs = pairs[pose.kept[pairs].all(axis=1)]
    gaps, _ = pose.gaps(pairs)
    over = ~np.isnan(gaps)
    pairs, gaps = number[pairs[over]], gaps[over]
    skin_gaps = pose.heights(skin)[kept]
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
        raised=np.degrees(pose.moves[kept, 0]),
        rolled=np.degrees(pose.moves[kept, 1]),
        lifted=pose.moves[kept, 2],
        shortened=pose.size[kept] / pose.placed_size[kept],
        dropped=tuple(groom.feathers[k].id for k in np.flatnonzero(~pose.kept)),
        unresolved=tuple(sorted(left, key=lambda each: (-each.depth, each.upper, each.lower))),
    )
