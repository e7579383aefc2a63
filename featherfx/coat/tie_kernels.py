"""Stacking values that keep overlapping leaves apart: neighbours in one cell, and first fit."""

from __future__ import annotations

from featherfx.jit.compiled import kernel

_ROUNDING = 1e-9  # of gaps


@kernel
def count_pairs(starts, feather, gap, found):
    """Pairs of different feathers in one cell; returns how many there are.

    starts: (C + 1,) first entry of each cell. feather, gap: (N,) of the entries. found: pair
    (K, 3), the lower number first and the greater gap, written as far as there is room.
    """
    count = 0
    for cell in range(starts.shape[0] - 1):
        for a in range(starts[cell], starts[cell + 1]):
            for b in range(a + 1, starts[cell + 1]):
                if count < found.shape[0]:
                    found[count, 0] = min(feather[a], feather[b])
                    found[count, 1] = max(feather[a], feather[b])
                    found[count, 2] = max(gap[a], gap[b])
                count += 1
    return count


@kernel
def _find_share(value, near, count):
    """The least share of its gap that a value is apart from others; 1 at most."""
    share = 1.0
    for k in range(count):
        share = min(share, abs(near[k, 0] - value) / near[k, 1])
    return share


@kernel
def _find_near(neighbours, f, values, low, high, near):
    """Values and gaps of neighbours within a gap of low to high, sorted. Returns their count."""
    count = 0
    for e in range(neighbours.starts[f], neighbours.starts[f + 1]):
        value, gap = values[neighbours.feather[e]], neighbours.gap[e]
        if low - gap < value < high + gap:
            k = count
            while k > 0 and near[k - 1, 0] > value:
                near[k, 0], near[k, 1] = near[k - 1, 0], near[k - 1, 1]
                k -= 1
            near[k, 0], near[k, 1] = value, gap
            count += 1
    return count


@kernel
def fit_values(order, neighbours, own, limits, values, near):
    """Fit stacking values between those of their neighbours, in an order.

    Each feather takes the value nearest to its own that is apart from its neighbours', or else the
    one with the largest share of its gaps. own: (F,) m. limits: (F, 2) m, how much earlier and
    later it may be. values: (F,) m, inf where not yet found. near: (N, 2), scratch memory for the
    neighbours of one.
    """
    for place in range(order.shape[0]):
        f = order[place]
        low, high = own[f] - limits[f, 0], own[f] + limits[f, 1]
        count, best = _find_near(neighbours, f, values, low, high, near), -1.0
        if low <= values[f] <= high and _find_share(values[f], near, count) >= 1.0 - _ROUNDING:
            continue
        # its own value and both limits; of each neighbour, a gap to either side, and half way on
        for k in range(-3, 3 * count):
            if k < 0:
                value = own[f] if k == -3 else (low if k == -2 else high)
            elif k % 3 < 2:
                value = near[k // 3, 0] + (2 * (k % 3) - 1) * (1.0 + _ROUNDING) * near[k // 3, 1]
            else:
                value = 0.5 * (near[k // 3, 0] + near[min(k // 3 + 1, count - 1), 0])
            share = _find_share(value, near, count) if low <= value <= high else -1.0
            nearer = abs(value - own[f]) < abs(values[f] - own[f])
            if share > best or (share == best and nearer):
                values[f], best = value, share
