"""Points of a feather carried to another grid, its barbs as long as at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.feather.barb_length_kernels import keep_lengths
from featherfx.feather.density import density_map
from featherfx.feather.types import Feather, RowMap, RowPoints, both


def carried(to_fine: RowMap, points: RowPoints) -> RowPoints:
    """Points on another grid, its barbs as long as at rest."""
    still = both(np.zeros_like, points)
    return carried_moving(to_fine, points, still, still)[0]


def carried_moving(
    to_fine: RowMap, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
) -> tuple[RowPoints, RowPoints, RowPoints]:
    """The same with their first and second rates."""
    found = to_fine(points), to_fine(velocities), to_fine(accelerations)
    keep_lengths(to_fine.pieces, *(each.nodes for each in found))
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
