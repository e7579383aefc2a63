"""Which bodies' boxes meet: sorted along one axis, each is compared with those that begin before
it ends (sweep and prune, Baraff 1992)."""

from __future__ import annotations

import numpy as np

from featherfx.jit.compiled import kernel
from featherfx.solver.contact.types import Array, Indices


def meeting(low: Array, high: Array) -> Indices:
    """(N, 2) pairs of boxes that meet, the smaller number first, in ascending order.

    low, high: (B, 3) m, corners of the boxes.
    """
    order = np.argsort(low[:, 0], kind="stable")
    found = np.zeros((max(1024, 8 * len(low)), 2), dtype=np.int64)
    count = _meeting(order, low, high, found)
    if count > len(found):
        found = np.zeros((count, 2), dtype=np.int64)
        _meeting(order, low, high, found)
    pairs = found[:count]
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


@kernel
def _meeting(order, low, high, found):
    """Write pairs to found, as many as it has room for; returns how many there are."""
    count = 0
    for at in range(order.shape[0]):
        a = order[at]
        for next_at in range(at + 1, order.shape[0]):
            b = order[next_at]
            if low[b, 0] > high[a, 0]:
                break
            apart = low[b, 1] > high[a, 1] or low[a, 1] > high[b, 1]
            if apart or low[b, 2] > high[a, 2] or low[a, 2] > high[b, 2]:
                continue
            if count < found.shape[0]:
                found[count, 0], found[count, 1] = min(a, b), max(a, b)
            count += 1
    return count
