"""Who touches whom while feathers change their level of detail.

What is computed at another level meanwhile stands aside, far from all others, as bodies that are
led. Of two feathers that are both computed at the same two levels those of one level touch: each
would feel the other twice, and a level that is taken up begins where its rows put it, in those of
the other level by as much as the two differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from featherfx.solver.contact.interval import LedMotion
from featherfx.solver.contact.surfaces import Grids
from featherfx.solver.contact.types import Candidates, ContactMemory, Indices
from featherfx.solver.state import State

Flags = NDArray[np.bool_]

# m, between feathers that stand aside
APART = 1e4


class Partners:
    """Bodies of the same feathers at several levels. feather: (B,) whose each is. level: (B,)."""

    def __init__(self, feather: Indices, level: Indices) -> None:
        self._feather, self._level = (
            np.unique(each, return_inverse=True)[1] for each in (feather, level)
        )
        self.several = len(np.unique(feather)) < len(feather)
        self._known = np.zeros(0, dtype=np.bool_), 0

    def apart(self, pairs: Indices, idle: Flags) -> Flags | None:
        """(N,) which pairs (N, 2) do not touch because their feathers do at a level that both are
        computed at; None where that is as it was. idle: (B,) of bodies."""
        if not self.several or (
            len(pairs) == self._known[1] and np.array_equal(idle, self._known[0])
        ):
            return None
        self._known = idle.copy(), len(pairs)
        computed = np.zeros((self._feather.max() + 1, self._level.max() + 1), dtype=np.bool_)
        computed[self._feather[~idle], self._level[~idle]] = True
        first, second = self._level[pairs].T
        feathers = self._feather[pairs].T
        both = computed[feathers[0], second] & computed[feathers[1], first]
        return np.asarray(both & (first != second))


def aside(grids: Grids, states: Sequence[State], idle: Flags) -> LedMotion | None:
    """Where the idle (B,) of some batches stand; None where there are none."""
    if not idle.any():
        return None
    nodes = grids.together([state.points.nodes for state in states])
    nodes[idle, :, :, 0] += APART * (1.0 + np.flatnonzero(idle)[:, None, None])
    return LedMotion(~idle, nodes, nodes, np.zeros_like(idle))


def put_back(states: Sequence[State], before: Sequence[State], idle: Flags, first: Indices) -> None:
    """Give states of batches, in place, what the idle (B,) had before. first: body of each batch,
    and all."""
    for state, old, (low, high) in zip(states, before, pairwise(first), strict=True):
        for f in np.flatnonzero(idle[low:high]).tolist():
            state.take(old, f)


def forgotten(memory: ContactMemory, candidates: Candidates, idle: Flags) -> ContactMemory:
    """A memory without what the idle (B,) have felt."""
    _, rows, columns = memory.wall.shape
    kept = ~idle[candidates.pairs[memory.key // (rows * columns)]].any(axis=1)
    return memory._replace(
        key=memory.key[kept],
        force=memory.force[kept],
        side=memory.side[kept],
        wall=np.where(idle[:, None, None], 0.0, memory.wall),
    )
