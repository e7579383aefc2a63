"""All nodes of feathers as those that are kept lead them (featherfx/feather/detail.py)."""

from __future__ import annotations

from math import sqrt

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
