"""Broad phase of bodies: boxes sorted along one axis, each compared with those that begin before it
ends (sweep and prune, Baraff 1992).

Distances that bodies went in an interval.

Early rejection of points of a guest that are too far from its host to meet it.

What is left out here meets nothing in the interval, by the conditions of clearance_kernels.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import add, dot, scale, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.clearance_kernels import OVER_RATIO, ROUNDING_RATIO
from featherfx.solver.contact.search_kernels import box_distance, corner_place, side_normal


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


class GuestBounds(NamedTuple):
    """Bounds within which the points of a guest meet a host. up: (3,), and top: m, along it, beyond
    which none does. margin: m, gap below which they are followed. way: m, what they go past the
    host in the interval, at most; thickness: m, sum of both half thicknesses, at most."""

    up: tuple[float, float, float]
    top: float
    margin: float
    way: float
    thickness: float


@kernel
def room_of(guest, host, side, margin, way, search, half):
    """The Room of a pair. half: (B,) m, largest half thickness.

    What meets the host (clearance_kernels) is along a normal of it no farther on its own side than
    margin and thickness, and beside that by OVER_RATIO thicknesses: so far above the slab at most.
    """
    slab, thickness = search.bodies.slab[host], half[guest] + half[host]
    if side == 0:
        return GuestBounds((0.0, 0.0, 0.0), 1e300, margin, way, thickness)
    top = (slab[4] if side > 0 else -slab[3]) + margin + (1.0 + OVER_RATIO) * thickness
    return GuestBounds(
        (side * slab[0], side * slab[1], side * slab[2]), top, margin, way, thickness
    )


@kernel
def is_above(box, room):
    """Return whether all of a box (6,) is beyond the top of the bounds."""
    lowest = 0.0
    for k in range(3):
        lowest += min(room.up[k] * box[k], room.up[k] * box[3 + k])
    return lowest > room.top


@kernel
def _on(points, corners, weight):
    """The point with weights of corners, rows and nodes, in a pose (n, 1 + 2 m, 3)."""
    a, b, c = corners
    first = add(scale(weight[0], points[a[0], a[1]]), scale(weight[1], points[b[0], b[1]]))
    return add(first, scale(weight[2], points[c[0], c[1]]))


@kernel
def is_off(x, closest, now, columns, side, room):
    """Return whether a point at x that nothing is known of is beside its closest place on a host,
    or so far above it that they do not meet in the interval. now: (n, 1 + 2 m, 3) m, nodes of the
    host where x was looked for. side: where the point belongs, or 0."""
    place, weight = closest
    a, b = corner_place(place, 0, columns), corner_place(place, 1, columns)
    c = corner_place(place, 2, columns)
    normal = side_normal(place[0], now[a[0], a[1]], now[b[0], b[1]], now[c[0], c[1]])
    away = sub(x, _on(now, (a, b, c), weight))
    along = dot(normal, away)
    beside, most = sub(away, scale(along, normal)), OVER_RATIO * room.thickness + ROUNDING_RATIO
    if dot(beside, beside) > most * most:
        return True
    return side != 0 and side * along > room.thickness + room.margin + ROUNDING_RATIO


@kernel
def is_near(x, is_known, bounds, room):
    """Return whether a point may meet a host with such bounds (6,)."""
    if not is_known and dot(room.up, x) > room.top:
        return False
    return box_distance(x, bounds) <= room.margin * room.margin
