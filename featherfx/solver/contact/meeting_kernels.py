"""Broad phase of bodies: boxes sorted along one axis, each compared with those that begin before it
ends (sweep and prune, Baraff 1992).

Distances that bodies went in an interval.
"""

from __future__ import annotations

from math import sqrt

from featherfx.jit.compiled import kernel


@kernel
def cover_ways(nodes, velocity, samples, duration, margin, low, high):
    """Boxes that feathers do not leave within a duration (s) as they, and their roots, move.

    nodes, velocity: (F, n, 1 + 2 m, 3) m and m/s. samples: (F, K, 6) m and rad, of their roots'
    paths. margin: m, that boxes are larger by. Written: low, high, (F, 3) m.
    """
    for f in range(nodes.shape[0]):
        square, turn = 0.0, 0.0
        for k in range(3):
            least, most = nodes[f, 0, 0, k], nodes[f, 0, 0, k]
            for i in range(nodes.shape[1]):
                for p in range(nodes.shape[2]):
                    least = min(least, nodes[f, i, p, k])
                    most = max(most, nodes[f, i, p, k])
            low[f, k], high[f, k] = least, most
            square += (most - least) ** 2
            turn += _farthest(samples, f, 3 + k)
        size = sqrt(square)
        for k in range(3):
            fastest = 0.0
            for i in range(nodes.shape[1]):
                for p in range(nodes.shape[2]):
                    fastest = max(fastest, abs(velocity[f, i, p, k]))
            way = max(fastest * duration, _farthest(samples, f, k) + turn * size)
            low[f, k] -= way + margin
            high[f, k] += way + margin


@kernel
def _farthest(samples, f, k):
    """Return how far one number of a root's path goes from its first value."""
    farthest = 0.0
    for at in range(1, samples.shape[1]):
        farthest = max(farthest, abs(samples[f, at, k] - samples[f, 0, k]))
    return farthest


@kernel
def list_meeting(order, low, high, found):
    """Write pairs to found, as many as it has room for; returns how many there are."""
    count = 0
    for at in range(order.shape[0]):
        a = order[at]
        for next_at in range(at + 1, order.shape[0]):
            b = order[next_at]
            if low[b, 0] > high[a, 0]:
                break
            if _apart(low, high, a, b):
                continue
            if count < found.shape[0]:
                found[count, 0], found[count, 1] = min(a, b), max(a, b)
            count += 1
    return count


@kernel
def _apart(low, high, a, b):
    """Return whether two boxes are apart in y or z."""
    apart = low[b, 1] > high[a, 1] or low[a, 1] > high[b, 1]
    return apart or low[b, 2] > high[a, 2] or low[a, 2] > high[b, 2]


@kernel
def _covers(low, high, a, b):
    """Return whether what begins later than both boxes and meets b meets a, too."""
    ends = high[b, 0] <= high[a, 0] and high[b, 1] <= high[a, 1] and high[b, 2] <= high[a, 2]
    return ends and low[a, 1] <= low[b, 1] and low[a, 2] <= low[b, 2]


@kernel
def _leader_of(leader, box):
    """First box of the part that a box is of; the way there is made shorter."""
    while leader[box] != box:
        leader[box] = leader[leader[box]]
        box = leader[box]
    return box


@kernel
def join_meeting(order, low, high, leader, kept):
    """Make one of the parts whose boxes meet; leader: of each box one before it in its part, or
    itself, at the end the first. kept: (B,) room for those that later ones are compared with.

    Of boxes of one part only those are kept that no other covers, so that many at one place are
    compared with a few.
    """
    count = 0
    for b in order:
        before, count, covered = count, 0, False
        for k in range(before):
            a = kept[k]
            if high[a, 0] < low[b, 0]:
                continue
            first, second = _leader_of(leader, a), _leader_of(leader, b)
            if first != second and not _apart(low, high, a, b):
                first, second = min(first, second), max(first, second)
                leader[second] = first
                second = first
            if first == second:
                covered = covered or _covers(low, high, a, b)
                if not covered and _covers(low, high, b, a):
                    continue
            kept[count] = a
            count += 1
        if not covered:
            kept[count] = b
            count += 1
    for box in range(leader.shape[0]):
        leader[box] = _leader_of(leader, box)


@kernel
def largest_moves(after, before, free, found):
    """(B,) m, how far any node of each body that is free (B,) is in one pose (B, n, 1 + 2 m, 3)
    from the other along an axis; no other has moved."""
    for body in range(after.shape[0]):
        found[body] = 0.0
        if not free[body]:
            continue
        for i in range(after.shape[1]):
            for p in range(after.shape[2]):
                for k in range(3):
                    way = abs(after[body, i, p, k] - before[body, i, p, k])
                    found[body] = max(found[body], way)
