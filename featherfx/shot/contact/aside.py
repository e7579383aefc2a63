"""Feathers that are computed at another level of detail meanwhile stand aside, far from all others,
as bodies that are led."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.contact.interval import Led
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.contact.types import Candidates, Indices, Memory
from featherfx.solver.state import State

Flags = NDArray[np.bool_]

# m, between feathers that stand aside
APART = 1e4


def aside(grids: Grids, states: Sequence[State], idle: Flags) -> Led | None:
    """Where the idle (B,) of some batches stand; None where there are none."""
    if not idle.any():
        return None
    nodes = grids.together([state.points.nodes for state in states])
    nodes[idle, :, :, 0] += APART * (1.0 + np.flatnonzero(idle)[:, None, None])
    return Led(~idle, nodes, nodes)


def put_back(states: Sequence[State], before: Sequence[State], idle: Flags, first: Indices) -> None:
    """Give states of batches, in place, what the idle (B,) had before. first: body of each batch,
    and all."""
    for state, old, (low, high) in zip(states, before, pairwise(first), strict=True):
        for f in np.flatnonzero(idle[low:high]).tolist():
            state.take(old, f)


def forgotten(memory: Memory, candidates: Candidates, idle: Flags) -> Memory:
    """A memory without what the idle (B,) have felt."""
    _, rows, columns = memory.wall.shape
    kept = ~idle[candidates.pairs[memory.key // (rows * columns)]].any(axis=1)
    return memory._replace(
        key=memory.key[kept],
        force=memory.force[kept],
        side=memory.side[kept],
        wall=np.where(idle[:, None, None], 0.0, memory.wall),
    )
