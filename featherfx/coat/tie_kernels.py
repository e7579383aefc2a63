"""Stacking values that keep overlapping leaves apart: neighbours in one cell, and first fit."""

from __future__ import annotations

from featherfx.jit.compiled import kernel

_SHARE_BITS = 8  # of the share of its gaps that a feather gets


@kernel
def count_pairs(starts, feather, place, found):
    """Pairs of different feathers in one cell; returns how many there are.

    starts: (C + 1,) first entry of each cell. feather, place: (N,) of the entries, the feather and
    its greatest s there. found: pair (K, 3), the lower number first and the greater s, written as
    far as there is room.
    """
    count = 0
    for cell in range(starts.shape[0] - 1):
        for a in range(starts[cell], starts[cell + 1]):
            for b in range(a + 1, starts[cell + 1]):
                if count < found.shape[0]:
                    found[count, 0] = min(feather[a], feather[b])
                    found[count, 1] = max(feather[a], feather[b])
                    found[count, 2] = max(place[a], place[b])
                count += 1
    return count


@kernel
def _nearest_free(f, start, values, fixed, neighbours, sign, share):
    """The value nearest to start, in the direction of sign, that is apart from all fixed ones."""
    value, moved = start, True
    while moved:
        moved = False
        for e in range(neighbours.starts[f], neighbours.starts[f + 1]):
            other, gap = neighbours.feather[e], share * neighbours.gap[e]
            if fixed[other] and abs(values[other] - value) < gap * (1.0 - 1e-9):
                value = values[other] + sign * gap
                moved = True
    return value


@kernel
def fit_values(order, neighbours, limits, values, fixed, share):
    """First fit of stacking values, in an order.

    Each feather takes the value nearest to its own that is apart from those of its neighbours
    before it, within limits (F, 2): how much earlier and later, m. Where there is none it takes the
    largest share of its gaps for which there is one, by bisection. values: (F,) m, own ones, then
    those found. fixed: (F,) False. share: (F,) of its gaps that a feather has got.
    """
    for place in range(order.shape[0]):
        f = order[place]
        own, size, step, got = values[f], 1.0, 1.0, 0.0
        found = own
        for _ in range(_SHARE_BITS):
            later = _nearest_free(f, own, values, fixed, neighbours, 1.0, size)
            earlier = _nearest_free(f, own, values, fixed, neighbours, -1.0, size)
            late, early = later - own, own - earlier
            may_late, may_early = late <= limits[f, 1], early <= limits[f, 0]
            step *= 0.5
            if may_late or may_early:
                found, got = (
                    later if may_late and (late <= early or not may_early) else earlier,
                    size,
                )
                if size == 1.0:
                    break
                size += step
            else:
                size -= step
        values[f], fixed[f], share[f] = found, True, got
