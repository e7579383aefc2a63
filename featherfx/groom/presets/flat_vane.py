"""Checks of one vane on the flattened feather: outlines that cross themselves, barbs that cross.

Lengths are shares of the feather's length; x runs along the rachis from the first barb on, y away
from it. A guide's barb leaves the rachis at its angle and turns by `curl` over the way to the
outline, at constant curvature.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.groom.types import BarbGuide, VaneShape

_STEPS = 48


def _intersections(first: Array, second: Array) -> Flags:
    """(a, b) whether segment i of polyline first (a + 1, 2) meets segment j of second."""
    start_a, step_a = first[:-1, None], np.diff(first, axis=0)[:, None]
    start_b, step_b = second[None, :-1], np.diff(second, axis=0)[None]
    offset = start_b - start_a
    determinant = step_a[..., 0] * step_b[..., 1] - step_a[..., 1] * step_b[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = (offset[..., 0] * step_b[..., 1] - offset[..., 1] * step_b[..., 0]) / determinant
        along_b = (offset[..., 0] * step_a[..., 1] - offset[..., 1] * step_a[..., 0]) / determinant
    inside = (along_a >= 0) & (along_a <= 1) & (along_b >= 0) & (along_b <= 1)
    return inside & (np.abs(determinant) > 1e-14)


def crossing_segments(outline: Sequence[tuple[float, float]]) -> list[tuple[int, int]]:
    """Pairs of segments of an outline, not neighbours, that meet."""
    points = np.asarray(outline, dtype=float).reshape(-1, 2)
    meets = np.triu(_intersections(points, points), 2)
    return [(int(i), int(j)) for i, j in np.argwhere(meets)]


def _arc(guide: BarbGuide, origin: float, length: float) -> Array:
    """(_STEPS + 1, 2) points of a guide's barb of a given length."""
    along = np.linspace(0.0, 1.0, _STEPS + 1)
    middle = 0.5 * (along[1:] + along[:-1])
    heading = np.radians(guide.angle - guide.curl * middle)
    steps = np.column_stack((np.cos(heading), np.sin(heading))) * (length / _STEPS)
    return np.cumsum(np.vstack(([[origin, 0.0]], steps)), axis=0)


def _barb(guide: BarbGuide, edge: Array, vane_length: float) -> Array | None:
    """A guide's barb up to the outline (edge), or None where it never gets there.

    The barb's curvature depends on its length, so the length is found by bisection: the longest
    that has not yet met the edge.
    """
    origin = guide.position * vane_length
    short, long = 0.0, 3.0
    if not _intersections(_arc(guide, origin, long), edge).any():
        return None
    for _ in range(40):
        middle = 0.5 * (short + long)
        if _intersections(_arc(guide, origin, middle), edge).any():
            long = middle
        else:
            short = middle
    return _arc(guide, origin, short)


@lru_cache(maxsize=1000)
def barbs_cross(vane: VaneShape, vane_length: float) -> tuple[int, ...]:
    """Numbers i of guides whose barb meets that of guide i + 1 within the vane.

    vane_length: share of the feather's length that carries barbs. Kept: kinds that differ in other
    things, and files that are read again, ask for the same.
    """
    edge = np.asarray(vane.outline, dtype=float) * (vane_length, 1.0)
    barbs = [_barb(guide, edge, vane_length) for guide in vane.guides]
    return tuple(
        index
        for index, (first, second) in enumerate(pairwise(barbs))
        if first is not None and second is not None and _intersections(first, second).any()
    )
