"""Points of a feather carried to another grid, its barbs as long as at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.feather.carry_kernels import (
    LINE_WIDTH,
    MovingPoints,
    RowMapArrays,
    carry_feather,
    carry_feathers,
)
from featherfx.feather.density import density_map
from featherfx.feather.types import Feather, Indices, RowMap, RowPoints, both
from featherfx.jit.views import views_of


def carried(to_fine: RowMap, points: RowPoints) -> RowPoints:
    """Points on another grid, its barbs as long as at rest."""
    still = both(np.zeros_like, points)
    return carried_moving(to_fine, points, still, still)[0]


def carried_moving(
    to_fine: RowMap, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
) -> MovingPoints:
    """The same with their first and second rates."""
    parts = points, velocities, accelerations
    given = MovingPoints(*(both(np.ascontiguousarray, each) for each in parts))
    found = _empty(to_fine)
    carry_feather(_way(to_fine), given, np.zeros((to_fine.nodes.width, LINE_WIDTH)), found)
    return found


def _way(to_fine: RowMap) -> RowMapArrays:
    return RowMapArrays(to_fine.nodes.matrix, to_fine.directors.matrix, to_fine.pieces)


def _empty(to_fine: RowMap, *before: int) -> MovingPoints:
    """Room for what is carried, with axes in front."""
    shapes = [(*before, *each.shape) for each in (to_fine.nodes, to_fine.directors)]
    return MovingPoints(*(RowPoints(*map(np.empty, shapes)) for _ in MovingPoints._fields))


class Carrier:
    """Carries feathers of one grid to another, each by a map of its own (F of them)."""

    def __init__(self, maps: Sequence[RowMap]) -> None:
        self._first = maps[0]
        self._ways = views_of([_way(each) for each in maps])

    def __call__(
        self, some: Indices, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
    ) -> MovingPoints:
        """As carried_moving, of some (K,) of the feathers that are given (F, ...)."""
        found = _empty(self._first, len(some))
        lines = np.zeros((self._first.nodes.width, LINE_WIDTH))
        given = MovingPoints(points, velocities, accelerations)
        carry_feathers(self._ways.views, some, given, lines, found)
        return found


def farthest(
    coarse: Feather, fine: Feather, points: Sequence[RowPoints], wanted: Sequence[RowPoints]
) -> float:
    """m, largest distance of the nodes of a coarse feather from where a fine one has them, in any
    of some poses; nodes of barbs that are not there do not count."""
    to_coarse = density_map(fine, coarse)
    grown = np.repeat(coarse.barb_length.T > 0.0, coarse.columns, axis=1)
    there = np.concatenate([np.ones((coarse.rows, 1), dtype=np.bool_), grown], axis=1)
    ways = [
        np.linalg.norm(a.nodes - carried(to_coarse, b).nodes, axis=-1)[there].max()
        for a, b in zip(points, wanted, strict=True)
    ]
    return float(max(ways))
