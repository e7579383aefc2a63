"""How far each node is lifted so that every feather is clear of those beneath it.

Feathers are taken from the lowest up, so that what is beneath is where it stays, and one pass is
enough. A feather's lift is the least field that is nowhere below what its laps ask for and that
rises and falls by no more than SLOPE a metre along shaft and barbs:

    w(a) = max over nodes b of  r(b) - SLOPE |a - b|,   |a - b| along shaft plus along barb,

which changes nowhere by more than r does anywhere. What is asked for less than at the sample before
goes back slowly. Below the vane the lift falls off to the root, which stays.
"""

from featherfx.jit.compiled import kernel

# what a lift may rise along shaft or barb
SLOPE = 0.1
# thicknesses beside the other's edge from which on a point does not touch it
BESIDE = 1.0
# thicknesses beyond what is to be between them, up to which feathers touch
TOUCH = 0.1


@kernel
def _ask(laps, k, lifts):
    """Raise what one lap asks for of its upper feather."""
    lap = laps[k]
    lift, total, other = lifts.lift, 0.0, 0.0
    for q in range(3):
        total += lap.weight[q]
        if lap.above == 1:
            other += lap.weight[q] * lift[lap.lower, lap.corner[q, 0], lap.corner[q, 1]]
    wanted, (i, c), (j, d) = lifts.wanted[lap.upper], lap.node, lap.after
    if lap.above == 1:
        need = lap.share * (lap.base + other) / lap.own
        wanted[i, c] = max(wanted[i, c], need)
        wanted[j, d] = max(wanted[j, d], need)
        return
    lifted = (1.0 - lap.part) * lift[lap.lower, i, c] + lap.part * lift[lap.lower, j, d]
    need = (lap.base + lap.own * lifted) * lap.share / total
    for q in range(3):
        if lap.weight[q] > 0.0:
            i, c = lap.corner[q, 0], lap.corner[q, 1]
            wanted[i, c] = max(wanted[i, c], need)


@kernel
def _spread(values, vanes, f):
    """Least field over values (n, 2 m + 1) that is nowhere steeper than SLOPE, in place."""
    rows, columns = values.shape[0], vanes.exists.shape[3]
    for i in range(rows - 1):
        fall = SLOPE * vanes.row[f, i]
        for c in range(values.shape[1]):
            values[i + 1, c] = max(values[i + 1, c], values[i, c] - fall)
    for i in range(rows - 2, -1, -1):
        fall = SLOPE * vanes.row[f, i]
        for c in range(values.shape[1]):
            values[i, c] = max(values[i, c], values[i + 1, c] - fall)
    for i in range(rows):
        for c in range(2 * columns):
            fall = SLOPE * vanes.barb[f, 1 if c < columns else 0, i]
            values[i, c + 1] = max(values[i, c + 1], values[i, c] - fall)
        for c in range(2 * columns, 0, -1):
            fall = SLOPE * vanes.barb[f, 1 if c <= columns else 0, i]
            values[i, c - 1] = max(values[i, c - 1], values[i, c] - fall)


@kernel
def _to_root(values, vanes, f):
    """Rows below the vane go with its first one, less and less."""
    first, columns = vanes.first[f], vanes.exists.shape[3]
    whole = 0.0
    for i in range(first):
        whole += vanes.row[f, i]
    way = 0.0
    for i in range(first):
        share = way / whole
        for c in range(values.shape[1]):
            values[i, c] = share * share * values[first, columns]
        way += vanes.row[f, i]


@kernel
def lift_all(vanes, stack, laps, first, lifts, kept, begun):
    """Lifts of all feathers from the lowest up.

    laps: (L,), of stack.order[k] first[k] to first[k + 1] - 1. kept: share of the lift before that
    is kept at least. begun: whether the lifts are of this sample, and do not fall: what is lifted
    off something is beside it at times, and would come and go. wanted: what the skin asks for; used
    up.
    """
    for k in range(stack.order.shape[0]):
        f = stack.order[k]
        for lap in range(first[k], first[k + 1]):
            _ask(laps, lap, lifts)
        wanted, before, lift = lifts.wanted[f], lifts.before[f], lifts.lift[f]
        for i in range(wanted.shape[0]):
            for c in range(wanted.shape[1]):
                least = lift[i, c] if begun else kept * before[i, c]
                wanted[i, c] = max(wanted[i, c], least)
        _spread(wanted, vanes, f)
        _to_root(wanted, vanes, f)
        for i in range(wanted.shape[0]):
            for c in range(wanted.shape[1]):
                lift[i, c], wanted[i, c] = wanted[i, c], 0.0


@kernel
def pair_depths(vanes, laps, lift, depths, touching):
    """How deep each pair (K,) is, over the thickness, by its laps; below 0 how far apart. touching:
    (K,) becomes 1 for those that are no farther apart than they are to be, but for TOUCH."""
    for k in range(laps.shape[0]):
        lap = laps[k]
        thickness = vanes.half[lap.upper] + vanes.half[lap.lower]
        if lap.beside > BESIDE * thickness:
            continue
        guest, host = (lap.upper, lap.lower) if lap.above == 1 else (lap.lower, lap.upper)
        (i, c), (j, d), part = lap.node, lap.after, lap.part
        apart = lap.own * ((1.0 - part) * lift[guest, i, c] + part * lift[guest, j, d])
        for q in range(3):
            apart -= lap.weight[q] * lift[host, lap.corner[q, 0], lap.corner[q, 1]]
        depth = lap.base - lap.clear - (apart if lap.above == 1 else -apart)
        depths[lap.pair] = max(depths[lap.pair], depth / thickness)
        if depth + lap.clear > -TOUCH * thickness:
            touching[lap.pair] = 1
