"""Drawn geometry of a simulated feather, at densities of its own: a finer surface, single barbs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map
from featherfx.feather.profiles import at_places, vane_shares
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    BarbCurves,
    Feather,
    Indices,
    PointMap,
    RowMap,
    barb_slice,
)
from featherfx.groom.types import FeatherKind, Splits

if TYPE_CHECKING:
    from featherfx.feather.splits import SplitBarbs

# Pieces that a barb is drawn with.
BARB_SEGMENTS = 8
_RAMUS_FRACTION = 0.14  # of a vane's area
_MIN_GAP_RATIO = 0.1  # of a barb's mean distance from its neighbours; by eye
_END_FRACTION = 0.5  # of a ribbon's width, at its end; by eye


@lru_cache(maxsize=1024)
def render_feather(
    kind: FeatherKind, grid: tuple[int, int], render_grid: tuple[int, int], mirrored: bool
) -> tuple[Feather, RowMap | None]:
    """The feather to draw for one that is simulated, and the map to it.

    grid, render_grid: rows and columns. The map is None where the grids are equal. Raises
    InputError where a feather cannot be built at the grid.
    """
    fine = build_feather(kind, *render_grid, mirrored)
    if grid == render_grid:
        return fine, None
    return fine, density_map(build_feather(kind, *grid, mirrored), fine)


@lru_cache(maxsize=1024)
def barb_curves(kind: FeatherKind, grid: tuple[int, int], count: int, mirrored: bool) -> BarbCurves:
    """Barbs to draw of a feather that is simulated with a grid of rows and columns.

    count: barbs along each vane, at least 1, at equal distances on the rachis; those for which
    the outline leaves no length are left out. Barbs of vanes that may part follow the lips of
    splits. Raises InputError as build_feather does.

    A curve is a flat ribbon across its normals, as wide as the distance g to its neighbours: the
    barb with its barbules, which cover all of a hooked vane. Its end is half as wide. The ramus
    itself covers 0.14 of a vane (Jouve 2024, section 5.2), as wide a part of the distance on
    average. It tapers (Jouve et al. 2024, section 3), evenly, u from root to end:

        ramus = 0.14 mean(g) (3/2 - u)
    """
    rows = max(3, round(count / (1.0 - kind.calamus)) + 2)
    feather, whole = build_feather(kind, *grid, mirrored), _without_splits(kind)
    try:
        dense = build_feather(whole, rows, BARB_SEGMENTS, mirrored)
    except InputError as error:
        told = f"with {count} along a vane, as asked for, "
        raise InputError(
            *(replace(each, key="barbs", message=told + each.message) for each in error.problems)
        ) from error
    grown = [np.flatnonzero(dense.barb_length[side] > 0.0) for side in (LEADING, TRAILING)]
    nodes = np.arange(1 + 2 * BARB_SEGMENTS)
    own = [np.append(0, nodes[barb_slice(side, BARB_SEGMENTS)]) for side in (LEADING, TRAILING)]
    picked = np.concatenate(
        [row[:, None] * len(nodes) + barb for row, barb in zip(grown, own, strict=True)]
    )
    along = np.linspace(0.0, 1.0, BARB_SEGMENTS + 1)
    station = (dense.station / dense.station[-1])[np.concatenate(grown)]
    sign = np.repeat([1.0, -1.0], [len(row) for row in grown])
    u = 0.5 + 0.5 * sign[:, None] * along
    side = np.repeat(np.array([LEADING, TRAILING]), [len(row) for row in grown])
    points = dense.rest.nodes.reshape(-1, 3)[picked]
    to_dense = density_map(build_feather(whole, *grid, mirrored), dense, kind.may_part)
    points_map, strands = to_dense.nodes.picked(picked), None
    if kind.may_part:
        from featherfx.feather.splits import SplitBarbs

        each = (np.repeat(station, len(along)), np.repeat(side, len(along)))
        flat = points.reshape(-1, 3)
        strands = SplitBarbs.from_curves(feather, *each, np.tile(along, len(station)), flat)
        points = _at_rest(feather, points_map, strands)
    barbs = BarbCurves(
        points=points,
        widths=np.zeros(u.shape),
        ramus=np.zeros(u.shape),
        side=side,
        st=np.stack([u, np.broadcast_to(station[:, None], u.shape)], axis=-1),
        points_map=points_map,
        hooked=_hooked(kind, side, vane_shares(kind, station * kind.length), along),
        mirrored=mirrored,
        strands=strands,
    )
    whole_points = dense.rest.nodes.reshape(-1, 3)[picked]
    gaps = _gaps(barbs, whole_points, kind.length * (1.0 - kind.calamus) / count)
    widths = gaps * np.where(along < 1.0, 1.0, _END_FRACTION)
    ramus = _RAMUS_FRACTION * gaps.mean(axis=1, keepdims=True) * (1.5 - along)
    return replace(barbs, widths=widths, ramus=np.minimum(ramus / widths, 1.0))


def _hooked(kind: FeatherKind, side: Indices, places: Array, along: Array) -> Array:
    """(B, K) share of hooked barbules of barbs at places (B,) of the vane, at places (K,) along."""
    found = np.ones((len(side), len(along)))
    for number, vane in ((LEADING, kind.leading), (TRAILING, kind.trailing)):
        own = side == number
        across = at_places(vane.hooked.barb, along)
        found[own] = np.outer(at_places(vane.hooked.rachis, places[own]), across)
    return found


def _gaps(barbs: BarbCurves, points: Array, usual: float) -> Array:
    """(B, K) m, mean distances of barbs from their neighbours. usual: of one alone."""
    before, after = barbs.neighbours
    steps = points[after] - points[before]
    steps /= np.maximum(after - before, 1)[:, None, None]
    along = np.gradient(points, axis=1)
    along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-300)
    gaps = np.linalg.norm(np.cross(steps, along), axis=2)
    least = _MIN_GAP_RATIO * gaps.mean(axis=1, keepdims=True)  # where barbs meet
    return np.where((after > before)[:, None], np.maximum(gaps, least), usual)


def _without_splits(kind: FeatherKind) -> FeatherKind:
    if not kind.is_split:
        return kind
    leading, trailing = (replace(v, splits=Splits()) for v in (kind.leading, kind.trailing))
    return replace(kind, leading=leading, trailing=trailing)


def _at_rest(feather: Feather, points_map: PointMap, strands: SplitBarbs) -> Array:
    """(B, K, 3) m, barbs of a feather whose splits are open."""
    points = points_map(feather.rest)
    if feather.split.size == 0:
        return points
    parted = strands.parted(np.where(feather.split, 0.0, 1.0))
    if parted is None:
        return points
    joined = parted.joined(points.reshape(-1, 3), parted.positions(feather.rest))
    return joined.reshape(points.shape)
