"""Drawn geometry of a simulated feather, at densities of its own: a finer surface, single barbs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.density import density_map
from featherfx.feather.profiles import barb_diameters
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    BarbCurves,
    Feather,
    PointMap,
    RowMap,
    barb_slice,
)
from featherfx.groom.types import FeatherKind, Splits

if TYPE_CHECKING:
    from featherfx.feather.splits import SplitBarbs

# Straight pieces that a barb is drawn with.
BARB_SEGMENTS = 8


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
    the outline leaves no length are left out. The diameter at the root is the vane's thickness,
    and falls as the stiffness of a round barb does. Barbs of vanes that may part follow the lips of
    splits. Raises InputError as build_feather does.
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
    barbs = [np.append(0, nodes[barb_slice(side, BARB_SEGMENTS)]) for side in (LEADING, TRAILING)]
    picked = np.concatenate(
        [row[:, None] * len(nodes) + barb for row, barb in zip(grown, barbs, strict=True)]
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
    return BarbCurves(
        points=points,
        widths=np.tile(barb_diameters(kind, along), (len(picked), 1)),
        side=side,
        st=np.stack([u, np.broadcast_to(station[:, None], u.shape)], axis=-1),
        points_map=points_map,
        strands=strands,
    )


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
