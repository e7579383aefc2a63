"""Checks of one vane on the flattened feather: outlines that cross themselves, barbs that cross.

Lengths are shares of the feather's length; x runs along the rachis from the first barb on, y away
from it. A guide's barb leaves the rachis at its angle and turns by `curl` over the way to the
outline, at constant curvature, and by its course besides.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.groom.course import bends
from featherfx.groom.types import BarbGuide, VaneShape

_STEPS = 48


def _intersections(first: Array, second: Array) -> Flags:
    """(..., a, b) whether segment i of polylines first (..., a + 1, 2) meets j of second."""
    start_a, step_a = first[..., :-1, None, :], np.diff(first, axis=-2)[..., None, :]
    start_b, step_b = second[..., None, :-1, :], np.diff(second, axis=-2)[..., None, :, :]
    offset = start_b - start_a
    determinant = step_a[..., 0] * step_b[..., 1] - step_a[..., 1] * step_b[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_a = (offset[..., 0] * step_b[..., 1] - offset[..., 1] * step_b[..., 0]) / determinant
        along_b = (offset[..., 0] * step_a[..., 1] - offset[..., 1] * step_a[..., 0]) / determinant
    inside = (along_a >= 0) & (along_a <= 1) & (along_b >= 0) & (along_b <= 1)
    return np.asarray(inside & (np.abs(determinant) > 1e-14))


def crossing_segments(outline: Sequence[tuple[float, float]] | Array) -> list[tuple[int, int]]:
    """Pairs of segments of an outline, not neighbours, that meet."""
    points = np.asarray(outline, dtype=float).reshape(-1, 2)
    meets = np.triu(_intersections(points, points), 2)
    return [(int(i), int(j)) for i, j in np.argwhere(meets)]


def _arcs(guides: Sequence[BarbGuide], vane_length: float, lengths: Array) -> Array:
    """(G, _STEPS + 1, 2) points of the guides' barbs of given lengths (G,)."""
    along = np.linspace(0.0, 1.0, _STEPS + 1)
    middle = 0.5 * (along[1:] + along[:-1])
    heading = np.radians([guide.angle - guide.curl * middle for guide in guides])
    if any(guide.course for guide in guides):
        heading -= [bends(guide, middle)[:, 0] for guide in guides]
    steps = np.stack((np.cos(heading), np.sin(heading)), axis=2)
    steps *= (lengths / _STEPS)[:, None, None]
    start = [[[guide.position * vane_length, 0.0]] for guide in guides]
    return np.cumsum(np.concatenate((start, steps), axis=1), axis=1)


def _barbs(guides: Sequence[BarbGuide], edge: Array, vane_length: float) -> list[Array | None]:
    """The guides' barbs up to the outline (edge), None for one that never gets there.

    A barb's curvature depends on its length, so the length is found by bisection: the longest
    that has not yet met the edge.
    """

    def meets(lengths: Array) -> Flags:
        found = _intersections(_arcs(guides, vane_length, lengths), edge).any(axis=(1, 2))
        return np.asarray(found)

    short, long = np.zeros(len(guides)), np.full(len(guides), 3.0)
    ends = meets(long)
    for _ in range(40):
        middle = 0.5 * (short + long)
        met = meets(middle)
        short, long = np.where(met, short, middle), np.where(met, middle, long)
    barbs = _arcs(guides, vane_length, short)
    return [barb if end else None for barb, end in zip(barbs, ends, strict=True)]


@lru_cache(maxsize=1000)
def barbs_cross(vane: VaneShape, vane_length: float) -> tuple[int, ...]:
    """Numbers i of guides whose barb meets that of guide i + 1 within the vane.

    vane_length: share of the feather's length that carries barbs. Kept: kinds that differ in other
    things, and files that are read again, ask for the same.
    """
    edge = np.asarray(vane.outline, dtype=float) * (vane_length, 1.0)
    barbs = _barbs(vane.guides, edge, vane_length)
    return tuple(
        index
        for index, (first, second) in enumerate(pairwise(barbs))
        if first is not None and second is not None and _intersections(first, second).any()
    )
