"""The nodes of a grid as those of half its rows and columns, and small whole numbers for the rest.

What feathers do between the nodes that are kept, they do smoothly, so these lead to all others. In
the frame of its row, a barb's node x stands off the rachis r by what it does at rest and by d:

    r(i) = sum_k w_ik r_k + Q(i) (r0(i) - sum_k w_ik r0_k)
    x(i, j) = r(i) + Q(i) F0(i) (x0(i, j) + sum_kl w_ik v_jl d_kl)

0 marks the rest pose, k and l rows and nodes that are kept, w and v cubic Hermite weights over the
numbers of rows and nodes; F are frames of rows, Q tells how those between kept ones have turned. So
rest pose, rigid motions and what is kept are exact. What is missed of the others is rounded, in the
frame of the row, to steps of _DETAIL_STEP times the feather's length: no node is off by more than
half the diagonal of such a step, 0.065 % of the length, and most numbers are 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    cross,
    dot,
    scale,
    store,
    sub,
)
from featherfx.feather.density import hermite_weights
from featherfx.feather.types import Array, Indices, RowPoints, both, stacked
from featherfx.jit.compiled import kernel

_NO_LENGTH = 1e-12  # keeps a director that is 0 from being divided by 0


@kernel
def _unit(vector):
    return scale(1.0 / max(sqrt(dot(vector, vector)), _NO_LENGTH), vector)


@kernel
def _frame(lateral, dorsal):
    """Orthonormal columns along the rachis, d2 and d3 of directors that are nearly so."""
    lateral = _unit(lateral)
    dorsal = _unit(combined(1.0, dorsal, -dot(lateral, dorsal), lateral))
    return cross(lateral, dorsal), lateral, dorsal


@kernel
def _seen(frame, vector):
    return dot(frame[0], vector), dot(frame[1], vector), dot(frame[2], vector)


@kernel
def _turned(frame, vector):
    along = combined(vector[0], frame[0], vector[1], frame[1])
    return combined(1.0, along, vector[2], frame[2])


@kernel
def _spread_deviations(kept, rest, thin, f, spread):
    """Deviations (n, 1 + 2 m, 3) of the nodes of kept rows from how they stand off at rest, in the
    frames of their rows."""
    for r in range(thin.rows.shape[0]):
        row = thin.rows[r]
        now = _frame(kept.directors[f, r, 0], kept.directors[f, r, 1])
        then = _frame(rest.directors[f, row, 0], rest.directors[f, row, 1])
        spread[r] = 0.0
        for c in range(1, thin.nodes.shape[0]):
            away = _seen(now, sub(kept.nodes[f, r, c], kept.nodes[f, r, 0]))
            own = _seen(then, sub(rest.nodes[f, row, thin.nodes[c]], rest.nodes[f, row, 0]))
            deviation = sub(away, own)
            for j in range(spread.shape[1]):
                if thin.across[j, c] != 0.0:
                    accumulate(spread[r, j], thin.across[j, c], deviation)


@kernel
def lead_nodes(kept, rest, thin, spread, nodes, frames):
    """Nodes (F, N, 1 + 2 m, 3) as those that are kept lead them, and frames (F, N, 3, 3) of rows.

    kept, rest: RowPoints of F feathers. thin: ThinnedGrid's arrays. spread: (n, 1 + 2 m, 3), room.
    """
    few = kept.nodes.shape[1]
    for f in range(nodes.shape[0]):
        _spread_deviations(kept, rest, thin, f, spread)
        for i in range(nodes.shape[1]):
            lateral = dorsal = rest_lateral = rest_dorsal = rachis = 0.0, 0.0, 0.0
            missed = rest.nodes[f, i, 0, 0], rest.nodes[f, i, 0, 1], rest.nodes[f, i, 0, 2]
            for r in range(few):
                weight, row = thin.along[i, r], thin.rows[r]
                lateral = combined(1.0, lateral, weight, kept.directors[f, r, 0])
                dorsal = combined(1.0, dorsal, weight, kept.directors[f, r, 1])
                rest_lateral = combined(1.0, rest_lateral, weight, rest.directors[f, row, 0])
                rest_dorsal = combined(1.0, rest_dorsal, weight, rest.directors[f, row, 1])
                rachis = combined(1.0, rachis, weight, kept.nodes[f, r, 0])
                missed = combined(1.0, missed, -weight, rest.nodes[f, row, 0])
            now, then = _frame(lateral, dorsal), _frame(rest_lateral, rest_dorsal)
            rachis = add(rachis, _turned(now, _seen(then, missed)))
            own = _frame(rest.directors[f, i, 0], rest.directors[f, i, 1])
            for j in range(nodes.shape[2]):
                away = _seen(own, sub(rest.nodes[f, i, j], rest.nodes[f, i, 0]))
                for r in range(few):
                    away = combined(1.0, away, thin.along[i, r], spread[r, j])
                store(nodes[f, i, j], add(rachis, _turned(now, _seen(then, _turned(own, away)))))
            for k in range(3):
                column = _turned(now, _seen(then, own[k]))
                frames[f, i, 0, k], frames[f, i, 1, k], frames[f, i, 2, k] = column


@kernel
def add_detail(detail, step, frames, nodes):
    """Add to nodes (F, N, 1 + 2 m, 3) what they miss: detail (F, 3, N, 1 + 2 m), in steps (F,) m
    along the axes of frames (F, N, 3, 3)."""
    for f in range(nodes.shape[0]):
        for i in range(nodes.shape[1]):
            for j in range(nodes.shape[2]):
                for k in range(3):
                    missed = step[f] * detail[f, k, i, j]
                    for axis in range(3):
                        nodes[f, i, j, axis] += frames[f, i, axis, k] * missed


_DETAIL_STEP = 7.5e-4
_MAX_DETAIL = 2**30
# feathers at once, whose arrays a processor keeps at hand
_AT_ONCE = 128


class ThinnedGrid(NamedTuple):
    """The rows and nodes of a grid that are kept. rows: (n,). nodes: (1 + 2 k,), the rachis' first.
    along: (N, n) weights of the rows that are kept in all, and across: (1 + 2 m, 1 + 2 k) of the
    nodes."""

    rows: Indices
    nodes: Indices
    along: Array
    across: Array

    @property
    def columns(self) -> int:
        """Nodes of each barb that are kept."""
        return len(self.nodes) // 2

    def select(self, points: RowPoints) -> RowPoints:
        """Select the kept nodes and directors, or their rates."""
        nodes = points.nodes[..., self.rows[:, None], self.nodes, :]
        # in one order, so that kernels have one form
        return both(np.ascontiguousarray, RowPoints(nodes, points.directors[..., self.rows, :, :]))


@lru_cache(maxsize=256)
def choose_rows_and_nodes(
    rows: int, columns: int, kept: tuple[int, int] | None = None
) -> ThinnedGrid:
    """Choose the rows and columns of a grid to keep. kept: how many of both, default: half of them,
    at least 3 and 1."""
    some, few = kept or (max(3, rows // 2), max(1, columns // 2))
    chosen = np.rint(np.linspace(0, rows - 1, some)).astype(np.int64)
    barb = np.rint(np.arange(1, few + 1) * columns / few).astype(np.int64)
    over, _ = hermite_weights(np.append(0.0, barb), np.arange(columns + 1.0))
    across = np.zeros((1 + 2 * columns, 1 + 2 * few))
    for side in range(2):
        across[1 + side * columns :, 1 + side * few :][:columns, :few] = over[1:, 1:]
    return ThinnedGrid(
        rows=chosen,
        nodes=np.concatenate([[0], barb, columns + barb]),
        along=hermite_weights(chosen.astype(float), np.arange(float(rows)))[0],
        across=across,
    )


def detail_of(
    points: Sequence[RowPoints], rest: Sequence[RowPoints], lengths: Array, thin: ThinnedGrid
) -> NDArray[np.int32]:
    """(F, 3, N, 1 + 2 m) what the nodes that are kept miss of F feathers of one grid, in steps.

    rest: of each, in any place. lengths: (F,) of their rachises.
    """
    found = np.empty((len(points), 3, *points[0].nodes.shape[:2]), dtype=np.int32)
    for first in range(0, len(points), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        all_of = stacked(points[some])
        nodes, frames = _led(thin.select(all_of), stacked(rest[some]), thin)
        steps = (all_of.nodes - nodes) @ frames
        steps /= (_DETAIL_STEP * lengths[some])[:, None, None, None]
        # what is not finite is refused by its points
        steps = np.clip(
            np.nan_to_num(np.rint(steps, out=steps), copy=False), -_MAX_DETAIL, _MAX_DETAIL
        )
        found[some] = steps.transpose(0, 3, 1, 2)
    return found


def restored(
    kept: RowPoints, rest: RowPoints, lengths: Array, detail: NDArray[np.int32], thin: ThinnedGrid
) -> RowPoints:
    """All nodes and directors of F feathers again, from what is kept of them; as of detail_of."""
    nodes, frames = _led(kept, rest, thin)
    add_detail(detail, _DETAIL_STEP * lengths, frames, nodes)
    return RowPoints(nodes, np.stack([frames[..., 1], frames[..., 2]], axis=-2))


def _led(kept: RowPoints, rest: RowPoints, thin: ThinnedGrid) -> tuple[Array, Array]:
    """Return all nodes (F, N, 1 + 2 m, 3) as those that are kept lead them, and frames of the
    rows."""
    nodes, frames = np.empty_like(rest.nodes), np.empty((*rest.nodes.shape[:2], 3, 3))
    spread = np.empty((len(thin.rows), *rest.nodes.shape[2:]))
    lead_nodes(kept, rest, thin, spread, nodes, frames)
    return nodes, frames
