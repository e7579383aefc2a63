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
# of a point, that a node has at least where it is asked for all that is lacking there
SHARE = 0.1
# thicknesses beside the other's edge from which on a point does not touch it
BESIDE = 1.0
# thicknesses beyond what is to be between them, up to which feathers touch
TOUCH = 0.1


@kernel
def _raise(wanted, vanes, f, node, need, share):
    """What is wanted at a node of a feather, of which a point that lacks something has a share.

    Towards a share of none it falls to what the others' lifts give it anyway, so that nothing jumps
    where points pass from one triangle to the next.
    """
    i, c = node
    columns, before = vanes.exists.shape[3], max(i - 1, 0)
    near = min(vanes.row[f, before], vanes.barb[f, 1 if c < columns else 0, i])
    need -= SLOPE * near * max(0.0, 1.0 - share / SHARE)
    wanted[i, c] = max(wanted[i, c], need)


@kernel
def _ask(vanes, laps, k, lifts):
    """Raise what is wanted of the upper feather of a lap."""
    lap = laps[k]
    lift, total, other = lifts.lift, 0.0, 0.0
    for q in range(3):
        total += lap.weight[q]
        if lap.above == 1:
            other += lap.weight[q] * lift[lap.lower, lap.corner[q, 0], lap.corner[q, 1]]
    wanted, (i, c), (j, d) = lifts.wanted, lap.node, lap.after
    if lap.above == 1:
        need = lap.share * (lap.base + other) / lap.own
        _raise(wanted, vanes, lap.upper, (i, c), need, 1.0 - lap.part)
        if lap.part > 0.0:
            _raise(wanted, vanes, lap.upper, (j, d), need, lap.part)
        return
    lifted = (1.0 - lap.part) * lift[lap.lower, i, c] + lap.part * lift[lap.lower, j, d]
    need = (lap.base + lap.own * lifted) * lap.share / total
    for q in range(3):
        if lap.weight[q] > 0.0:
            corner = lap.corner[q, 0], lap.corner[q, 1]
            _raise(wanted, vanes, lap.upper, corner, need, lap.weight[q] / total)


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
def lift_all(vanes, stack, laps, span, stale, lifts, kept, begun):
    """Lifts of the feathers at span[0] to span[1] - 1 of the order, from the lowest up.

    stale: (F,) those whose laps were searched; others are left, unless what lies beneath them was
    searched or lifted anew, so that what lies above a feather never matters to it. laps: (L,) of
    their pairs, in the order of these. kept: share of the lift before that is kept at least. begun:
    whether the lifts are of this sample, and do not fall: what is lifted off something is beside it
    at times, and would come and go.
    """
    lap = 0
    for k in range(span[0], span[1]):
        f, wanted = stack.order[k], lifts.wanted
        lifts.renewed[f] = stale[f]
        for pair in range(stack.first[k], stack.first[k + 1]):
            lower = stack.pairs[pair, 1]
            lifts.renewed[f] = max(lifts.renewed[f], max(stale[lower], lifts.renewed[lower]))
        if lifts.renewed[f] == 0:
            while lap < laps.shape[0] and laps[lap].pair < stack.first[k + 1]:
                lap += 1
            continue
        before, lift, asked = lifts.before[f], lifts.lift[f], lifts.asked[f]
        for i in range(wanted.shape[0]):
            for c in range(wanted.shape[1]):
                least = lift[i, c] if begun else kept * before[i, c]
                wanted[i, c] = max(asked[i, c], least)
        while lap < laps.shape[0] and laps[lap].pair < stack.first[k + 1]:
            _ask(vanes, laps, lap, lifts)
            lap += 1
        _spread(wanted, vanes, f)
        _to_root(wanted, vanes, f)
        for i in range(wanted.shape[0]):
            for c in range(wanted.shape[1]):
                lift[i, c] = wanted[i, c]


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
