"""Lifts of nodes, by which every feather is clear of those beneath it.

Feathers are taken from the lowest up: what is beneath is where it stays, so each is laid once and
for all, in a few turns of searching and lifting. A feather's lift is the least field that is
nowhere below what its laps ask for and that rises and falls by no more than a slope along shaft
and barbs:

    w(a) = max over nodes b of  r(b) - slope |a - b|,   |a - b| along shaft plus along barb,

which changes nowhere by more than r does anywhere, and is at most twice the feather's length.
What a search asked for that is asked for nowhere where it took the feather is halved back, and what
is asked for less than at the sample before goes back slowly. Below the vane the lift falls off to
the root, which stays.
"""

from featherfx.algebra.thread_team import say_done, ticket, wait_for
from featherfx.jit.compiled import kernel
from featherfx.shot.layers.lap_kernels import BESIDE, find_laps, ground_lacks
from featherfx.shot.layers.pose_kernels import lift_points

# of a point, that a node has at least where it is asked for all that is lacking there
SHARE = 0.1
# over the depth that is undone, the length of a feather: the largest lift
MOST = 2.0
# of a feather's length, lift that is asked for nowhere from which on it is taken back, by halves
SPARE, _HALVINGS = 0.02, 5
# thicknesses beyond what is to be between them, up to which feathers touch
TOUCH = 0.1


@kernel
def _raise(wanted, vanes, f, node, asked, slope):
    """Raise the wanted lift at a node of a feather. asked: by a point, m, and which share it has in
    that.

    Towards a share of none it falls to what the others' lifts give it anyway, so that nothing jumps
    where points pass from one triangle to the next.
    """
    (i, c), (need, share) = node, asked
    columns, before = vanes.exists.shape[3], max(i - 1, 0)
    near = min(vanes.row[f, before], vanes.barb[f, 1 if c < columns else 0, i])
    need -= slope * near * max(0.0, 1.0 - share / SHARE)
    wanted[i, c] = max(wanted[i, c], need)


@kernel
def _ask(vanes, lap, lifts, slope, wanted):
    """Raise what is wanted of the upper feather of a lap."""
    lift, total, other = lifts.lift, 0.0, 0.0
    for q in range(3):
        total += lap.weight[q]
        if lap.above == 1:
            other += lap.weight[q] * lift[lap.lower, lap.corner[q, 0], lap.corner[q, 1]]
    (i, c), (j, d) = lap.node, lap.after
    if lap.above == 1:
        need = lap.share * (lap.base + other) / lap.own
        _raise(wanted, vanes, lap.upper, (i, c), (need, 1.0 - lap.part), slope)
        if lap.part > 0.0:
            _raise(wanted, vanes, lap.upper, (j, d), (need, lap.part), slope)
        return
    lifted = (1.0 - lap.part) * lift[lap.lower, i, c] + lap.part * lift[lap.lower, j, d]
    need = (lap.base + lap.own * lifted) * lap.share / total
    for q in range(3):
        if lap.weight[q] > 0.0:
            corner = lap.corner[q, 0], lap.corner[q, 1]
            _raise(wanted, vanes, lap.upper, corner, (need, lap.weight[q] / total), slope)


@kernel
def _spread(values, vanes, f, slope):
    """Least field over values (n, 2 m + 1) that is nowhere steeper than a slope, in place; towards
    the root it falls to 0 there, if that is steeper, as where a follicle turns. So what lies over
    the base of a feather does not go up with its tip."""
    rows, columns, reach = values.shape[0], vanes.exists.shape[3], 0.0
    for i in range(rows - 1):
        fall = slope * vanes.row[f, i]
        reach += vanes.row[f, i]
        for c in range(values.shape[1]):
            values[i + 1, c] = max(values[i + 1, c], values[i, c] - fall)
    for i in range(rows - 2, -1, -1):
        fall, part = slope * vanes.row[f, i], vanes.row[f, i] / reach
        reach -= vanes.row[f, i]
        for c in range(values.shape[1]):
            after = values[i + 1, c]
            values[i, c] = max(values[i, c], after - max(fall, part * after))
    for i in range(rows):
        for c in range(2 * columns):
            fall = slope * vanes.barb[f, 1 if c < columns else 0, i]
            values[i, c + 1] = max(values[i, c + 1], values[i, c] - fall)
        for c in range(2 * columns, 0, -1):
            fall = slope * vanes.barb[f, 1 if c <= columns else 0, i]
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
def lay_feathers(team, bodies, given, lifts, poses, manner, scratch):
    """Lay all feathers, each on those that are laid, by a team of threads that all call this: each
    takes the next one, those on the ground first, and waits for those beneath it.

    team: counters, and (F,) zeros, who is done. bodies: vanes, stack and places, (F,) of its order,
    none before those beneath it. given: RowPoints before they are lifted, ground and skin (V, 3) m.
    poses: with the lifts of the sample before, and of this one. scratch: of this thread.
    """
    (vanes, stack, places), (counters, done) = bodies, team
    while True:
        place = ticket(counters, 0)
        if place >= places.shape[0]:
            return
        k = places[place]
        for pair in range(stack.first[k], stack.first[k + 1]):
            if lifts.meets[pair] != 0:
                wait_for(done, stack.pairs[pair, 1], 1)
        _lay(k, (vanes, stack), given, lifts, poses, manner, scratch)
        say_done(done, stack.order[k])


@kernel
def _lay(k, bodies, given, lifts, poses, manner, scratch):
    """Lay the k-th feather of the order. What has not moved since the sample before, as all beneath
    it, keeps its lift where it kept it then or would have to rise: it was laid there, and what only
    falls to rise again would do so for ever."""
    (vanes, stack), (points, ground, skin), (start, pose) = bodies, given, poses
    f, own = stack.order[k], ((stack.first[k], stack.first[k + 1]), lifts.meets)
    lift, before, laps = lifts.lift[f], lifts.before[f], scratch.laps
    quiet, strays = lifts.same[f] != 0, False
    for pair in range(own[0][0], own[0][1]):
        if lifts.meets[pair] != 0:
            lower = stack.pairs[pair, 1]
            quiet = quiet and lifts.moved[lower] == 0
            strays = strays or lifts.strays[lower] != 0
    lifts.moved[f], lifts.strays[f] = 0, 0
    if quiet and lifts.settled[f] != 0:
        return
    ground_lacks(vanes, start, ground, skin, f, scratch.asked)
    # where nothing is lifted yet, so that all that is beneath takes this one with it
    count = find_laps(vanes, stack, start, manner.follow, own, laps, scratch.seen)
    _raise_lift(vanes, (lifts, f), manner, scratch, count, False)
    change = 1e300 if strays else _most_change(lift, before)
    for turn in range(manner.turns):
        least = manner.off if turn < manner.turns - 1 else manner.seen
        if change <= least * vanes.half[f]:
            break
        count = _look(bodies, given, (lifts, f), pose, (own, manner.follow), scratch)
        if turn < manner.turns - 1:
            _raise_lift(vanes, (lifts, f), manner, scratch, count, True)
            change = _most_change(lift, pose.lift[f])
    count = _take_back(bodies, given, (lifts, f), pose, (own, manner), scratch, count)
    least = manner.seen * vanes.half[f]
    if _most_change(lift, before) <= least or (quiet and _most_rise(before, lift) > least):
        _copy(before, lift)
    change = _most_change(lift, pose.lift[f])
    if change > manner.off * vanes.half[f]:
        # laps of where it was sought say nothing of where it stays
        count = _look(bodies, given, (lifts, f), pose, (own, manner.follow), scratch)
    elif change > 0.0:
        lift_points(vanes, points, lift, pose, f)
    for pair in range(own[0][0], own[0][1]):
        lifts.depths[pair], lifts.touching[pair] = -1e300, 0
    _pair_depths(vanes, laps, count, lifts)
    lifts.strays[f] = 1 if _most_change(lift, before) > manner.off * vanes.half[f] else 0
    lifts.settled[f] = 1 if _most_change(lift, before) == 0.0 else 0
    lifts.moved[f] = 0 if lifts.same[f] != 0 and lifts.settled[f] != 0 else 1


@kernel
def _look(bodies, given, place, pose, sought, scratch):
    """Search the laps of a feather where its lift takes it; returns how many there are. sought: as
    of find_laps, and follow."""
    (vanes, stack), (points, ground, skin), (lifts, f), (own, follow) = bodies, given, place, sought
    lift_points(vanes, points, lifts.lift[f], pose, f)
    ground_lacks(vanes, pose, ground, skin, f, scratch.asked)
    return find_laps(vanes, stack, pose, follow, own, scratch.laps, scratch.seen)


@kernel
def _take_back(bodies, given, place, pose, sought, scratch, count):
    """Halve what a lift has too much: what one search asked for, and nothing where that took the
    feather, since it came from a steep place that it has left. All that lies on it would go up as
    far, and meet steep places in turn. Returns how many laps there are then. sought: as of
    find_laps, and manner; count: laps where the feather is."""
    (vanes, _), (lifts, f), (own, manner) = bodies, place, sought
    lift, enough, least = lifts.lift[f], manner.off * vanes.half[f], scratch.least
    _want(vanes, place, manner, scratch, count, False)
    _copy(scratch.wanted, least)
    tried = False
    for _ in range(_HALVINGS):
        if _most_rise(least, lift) <= SPARE * vanes.deepest[f]:
            break
        _copy(lift, scratch.most)
        for i in range(lift.shape[0]):
            for c in range(lift.shape[1]):
                lift[i, c] = 0.5 * (min(least[i, c], lift[i, c]) + lift[i, c])
        count = _look(bodies, given, place, pose, (own, manner.follow), scratch)
        _want(vanes, place, manner, scratch, count, False)
        tried = _most_rise(lift, scratch.wanted) > enough
        _copy(lift if tried else scratch.wanted, least)
        if tried:
            _copy(scratch.most, lift)
    if tried:
        count = _look(bodies, given, place, pose, (own, manner.follow), scratch)
    return count


@kernel
def _copy(source, target):
    for i in range(source.shape[0]):
        for c in range(source.shape[1]):
            target[i, c] = source[i, c]


@kernel
def _most_change(first, second):
    """The most that two fields (n, 2 m + 1) differ anywhere."""
    most = 0.0
    for i in range(first.shape[0]):
        for c in range(first.shape[1]):
            most = max(most, abs(first[i, c] - second[i, c]))
    return most


@kernel
def _most_rise(first, second):
    """The most that a field (n, 2 m + 1) is above another one, the first."""
    most = 0.0
    for i in range(first.shape[0]):
        for c in range(first.shape[1]):
            most = max(most, second[i, c] - first[i, c])
    return most


@kernel
def _raise_lift(vanes, place, manner, scratch, count, begun):
    """Lift one feather as wanted."""
    _want(vanes, place, manner, scratch, count, begun)
    _copy(scratch.wanted, place[0].lift[place[1]])


@kernel
def _want(vanes, place, manner, scratch, count, begun):
    """Find the lift that is wanted of one feather by its laps, of which there are so many. place:
    lifts, and the feather. begun: whether its lift is of this sample, and does not fall: what is
    lifted off something is beside it at times, and would come and go."""
    (lifts, f), wanted = place, scratch.wanted
    before, lift = lifts.before[f], lifts.lift[f]
    for i in range(wanted.shape[0]):
        for c in range(wanted.shape[1]):
            least = lift[i, c] if begun else manner.kept * before[i, c]
            wanted[i, c] = max(scratch.asked[i, c], least)
    for k in range(count):
        _ask(vanes, scratch.laps[k], lifts, manner.slope, wanted)
    if begun:
        # what fell onto what was not seen from where it was would come and go
        for i in range(wanted.shape[0]):
            for c in range(wanted.shape[1]):
                if wanted[i, c] - lift[i, c] > manner.off * vanes.half[f]:
                    wanted[i, c] = max(wanted[i, c], before[i, c])
    _spread(wanted, vanes, f, manner.slope)
    for i in range(wanted.shape[0]):
        for c in range(wanted.shape[1]):
            wanted[i, c] = min(wanted[i, c], MOST * vanes.deepest[f])
    _to_root(wanted, vanes, f)


@kernel
def _pair_depths(vanes, laps, count, lifts):
    """Find how deep the pairs of so many laps are, over the thickness, below 0 how far apart, and
    which are no farther apart than they are to be, but for TOUCH."""
    lift = lifts.lift
    for k in range(count):
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
        lifts.depths[lap.pair] = max(lifts.depths[lap.pair], depth / thickness)
        if depth + lap.clear > -TOUCH * thickness:
            lifts.touching[lap.pair] = 1
