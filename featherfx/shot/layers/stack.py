"""Stacking order of feathers, by the groom's layers or its rest pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from heapq import heapify, heappop, heappush
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.layout.overlap import Strips, shingle_pairs, strips_of
from featherfx.feather.types import LEADING, Feather, RowPoints
from featherfx.files.disk_cache import kept
from featherfx.groom.types import Placement
from featherfx.shot.layers.lap_kernels import FADE, find_laps, most_laps
from featherfx.shot.layers.pose_kernels import FIELDS, lift_points_of_all
from featherfx.shot.layers.types import (
    LAP,
    Array,
    Bytes,
    Indices,
    PosedVanes,
    Scratch,
    Stack,
    Vanes,
)

# feathers may come over each other that are, at rest, so many times as far apart as they are wide
_REACH = 1.5
# cosine of the angle between two dorsal sides from which on feathers lie over each other
FACING = 0.3
# depth at rest, over the shorter feather's length, from which on a layout's order does not count
_WRONG = 0.05
# heights over a feather's length up to which points tell who lies over whom at rest
_NEAR = 0.1
# pairs whose laps at rest are searched together
PAIRS_AT_ONCE = 200
# what is kept between surfaces, which are bent between their nodes: over the distance of rows, but
# at most so many thicknesses. More adds up, over feathers over feathers, until none lies any more:
# with 0.08 and 6 the pigeon's coat rises by centimetres, and more of it crosses.
_CLEAR, MAX_CLEAR = 0.024, 1.8
# depth, over a feather's length, that is undone; beyond twice that the order counts for nothing
DEEPEST = 1.0


def stack_of(placements: Sequence[Placement], vanes: Vanes, rest: RowPoints) -> Stack:
    """The order in which a layout laid the feathers; without one, who is seen over whom at rest,
    and upstream over downstream where that says nothing.

    rest: of all feathers.
    """
    strips = strips_of(placements)

    def compute() -> dict[str, Any]:
        return _seen_stack(strips, vanes, rest)._asdict()

    return Stack(**kept("stack", [strips, vanes, rest], compute))


def _seen_stack(strips: Strips, vanes: Vanes, rest: RowPoints) -> Stack:
    pairs, order = shingle_pairs(replace(strips, reach=_REACH * strips.reach), FACING)
    stack = sorted_stack(pairs, order)
    ranked = strips.rank.min(initial=0) >= 0
    depth, votes = _seen_at_rest(stack, vanes, rest, 1.0 if ranked else _NEAR)
    if not ranked:
        return _by_votes(stack.pairs, votes, order)
    # a layout leaves some feathers on the wrong side of others, by up to their length
    length = vanes.row.sum(axis=1)
    return sorted_stack(stack.pairs[depth <= _WRONG * length[stack.pairs].min(axis=1)], order)


def _seen_at_rest(
    stack: Stack, vanes: Vanes, rest: RowPoints, deepest: float
) -> tuple[Array, Indices]:
    """(K,) m, how deep the upper feather of each pair is below the lower one, and by how many
    points it is over it, less those by which it is under it. Of all pairs, also of those that lie
    the other way round, up to a depth over their length."""
    count = len(stack.pairs)
    depth, votes = np.zeros(count), np.zeros(count, dtype=np.int64)
    for laps in laps_at_rest(stack, vanes, rest, deepest):
        below = laps["base"] - laps["clear"]
        np.maximum.at(depth, laps["pair"], below)
        np.add.at(votes, laps["pair"], np.where(below > 0.0, -1, 1))
    return depth, votes


def laps_at_rest(
    stack: Stack, vanes: Vanes, rest: RowPoints, deepest: float
) -> Iterator[NDArray[Any]]:
    """Laps of all pairs at rest, up to heights of _NEAR and a depth over their length, some at a
    time: laps of all pairs at once would be the most that a bake holds."""
    length = vanes.row.sum(axis=1)
    pose, every = pose_like(rest, vanes.present.shape), np.ones(len(stack.pairs), dtype=np.int8)
    lift_points_of_all(vanes, rest, pose, (0, len(length)))
    seen = vanes._replace(deepest=deepest * length)
    follow = _NEAR * float((length / vanes.half).max(initial=0.0))
    scratch, count = scratch_of(vanes, PAIRS_AT_ONCE), len(stack.pairs)
    for begin in range(0, count, PAIRS_AT_ONCE):
        span = begin, min(begin + PAIRS_AT_ONCE, count)
        found = find_laps(seen, stack, pose, follow, (span, every), scratch.laps, scratch.seen)
        laps = scratch.laps[:found]
        yield laps[laps["beside"] <= vanes.half[laps["upper"]] + vanes.half[laps["lower"]]]


def _by_votes(pairs: Indices, votes: Indices, order: Indices) -> Stack:
    """Feathers in an order in which as many pairs as can be lie as their votes say.

    order: (F,), where votes say nothing. Of a ring, who is over all others but one that is over it
    comes first, and that pair is left out.
    """
    told = np.flatnonzero(votes)
    over = np.where(votes[told, None] > 0, pairs[told], pairs[told, ::-1])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    above: dict[int, list[int]] = {}
    waiting = np.bincount(over[:, 0], minlength=len(order))
    for upper, lower in over.tolist():
        above.setdefault(lower, []).append(upper)
    queue = [(int(waiting[f]), int(rank[f]), f) for f in range(len(order))]
    heapify(queue)
    placed = np.full(len(order), -1)
    found: list[int] = []
    while queue:
        count, _, f = heappop(queue)
        if placed[f] >= 0 or count != waiting[f]:
            continue
        placed[f] = len(found)
        found.append(f)
        for upper in above.get(f, ()):
            waiting[upper] -= 1
            heappush(queue, (int(waiting[upper]), int(rank[upper]), upper))
    agreeing = over[placed[over[:, 0]] > placed[over[:, 1]]]
    return sorted_stack(agreeing, np.array(found, dtype=np.int64))


def scratch_of(vanes: Vanes, pairs: int) -> Scratch:
    """Allocate what a search of so many pairs writes to, and what lifts one feather."""
    shape = vanes.present.shape[1:]
    # the system gives memory for as much of it as is written to
    laps = np.empty(pairs * most_laps(*shape) + 1, dtype=LAP)
    seen = np.zeros((*shape, 5), dtype=np.int64)
    wanted, asked, least, most = np.zeros((4, *shape))
    return Scratch(laps, wanted, asked, least, most, seen)


def pose_like(points: RowPoints, shape: tuple[int, ...]) -> PosedVanes:
    """Room for a pose of points, lifted along their dorsal directors. shape: (F, n, 2 m + 1)."""
    count, rows = shape[:2]
    return PosedVanes(
        points=np.zeros_like(points.nodes),
        way=np.ascontiguousarray(points.directors[:, :, 1]),
        lift=np.zeros(shape),
        boxes=np.zeros((count, rows, 6)),
        bounds=np.zeros((count, 6)),
        frames=np.zeros((count, 4, 3)),
        own=np.zeros((count, 6)),
        heights=np.zeros((count, *FIELDS, 2)),
    )


def sorted_stack(pairs: Indices, order: Indices) -> Stack:
    """Pairs (K, 2), upper and lower, by the place of the upper in an order (F,)."""
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    upper = rank[pairs[:, 0]]
    chosen = np.lexsort((rank[pairs[:, 1]], upper))
    first = np.searchsorted(upper[chosen], np.arange(len(order) + 1))
    return Stack(order.astype(np.int64), np.ascontiguousarray(pairs[chosen]), first)


def among(stack: Stack, touching: NDArray[np.bool_]) -> Stack:
    """The stack with the pairs alone of which both feathers touch others, (F,)."""
    return sorted_stack(stack.pairs[touching[stack.pairs].all(axis=1)], stack.order)


def beneath(stack: Stack, chosen: Indices) -> Indices:
    """Numbers of some feathers and of all that lie beneath them, through any number between."""
    needed = np.zeros(len(stack.order), dtype=np.bool_)
    needed[chosen] = True
    for k in range(len(stack.order) - 1, -1, -1):
        if needed[stack.order[k]]:
            needed[stack.pairs[stack.first[k] : stack.first[k + 1], 1]] = True
    return np.flatnonzero(needed)


def part_of(stack: Stack, vanes: Vanes, some: Indices) -> tuple[Stack, Vanes]:
    """The stack and vanes of some feathers alone, (K,) ascending, counted in them."""
    place = np.full(len(stack.order), -1)
    place[some] = np.arange(len(some))
    both, order = (place[stack.pairs] >= 0).all(axis=1), place[stack.order]
    fields = {name: values[some] for name, values in vanes._asdict().items()}
    return sorted_stack(place[stack.pairs[both]], order[order >= 0]), Vanes(**fields)


def vanes_of(feathers: Sequence[Feather], halves: Array) -> Vanes:
    """Vanes of feathers of one grid. halves: (F,) m, half thickness."""
    count, (n, m) = len(feathers), (feathers[0].rows, feathers[0].columns)
    row, barb = np.zeros((count, n - 1)), np.zeros((count, 2, n))
    exists = np.stack([feather.cell for feather in feathers]).astype(np.int8)
    for f, feather in enumerate(feathers):
        row[f], barb[f] = np.diff(feather.station), feather.barb_length / m
    present = _present(exists.astype(bool))
    return Vanes(
        present=present,
        exists=exists,
        half=halves,
        row=row,
        barb=barb,
        first=np.argmax(present.any(axis=2), axis=1),
        deepest=DEEPEST * row.sum(axis=1),
        clear=np.minimum(_CLEAR * row.mean(axis=1), MAX_CLEAR * 2.0 * halves),
        reach=np.full(count, 2.0 * FADE * halves.max(initial=0.0)),
        limb=np.zeros(count, dtype=np.int64),
    )


def _present(exists: NDArray[np.bool_]) -> Bytes:
    """(F, n, 2 m + 1), which nodes of the strip a triangle has."""
    count, _, rows, m, _ = exists.shape
    present = np.zeros((count, rows + 1, 2 * m + 1), dtype=np.int8)
    for side in range(2):
        node = np.zeros((count, rows + 1, m + 1), dtype=bool)
        first, second = exists[:, side, :, :, 0], exists[:, side, :, :, 1]
        node[:, :-1, :-1] |= first
        node[:, :-1, 1:] |= first | second
        node[:, 1:, :-1] |= first | second
        node[:, 1:, 1:] |= second
        own = slice(m, None) if side == LEADING else slice(m, None, -1)
        present[:, :, own] |= node
    return present
