"""How far a pair without contacts is from having one, so that it needs no search until it moves.

A node at x meets a host with its triangle T only if (find_kernels), with n the normal of T, c the
mean of its corners, r how far these are from it, w = x - c, and t the sum of both half thicknesses:

    beside the normal through its closest point on T it is no farther than OVER t, so that
                                       |w - (n.w) n| <= OVER t + r,
    it is below the height that counts,     side n.w <= t + margin + ways,
    and no farther away than is searched,        |w| <= far + margin + ways + r,

ways: what both bodies go in the interval. So the pair has no contact if for a slack S > ways each
node fails one of these for each triangle, with S added to the right sides instead of ways. (A
normal of no length passes the first two.)

From one pose to the next, |w| changes by no more than x and c move; n.w and |w - (n.w) n| by that
and |w| times the way of n's tip. r changes by itself. Where it still counts, |w| is no more than
far + margin + ways + r. So every body adds up, search by search, how far its nodes went (as a
guest), and that, the change of r and (far + margin + 2 S + r) times the way of the normals' tips
(as a host: ways and r have grown by no more than S). While S is larger than what guest and host
added since and the ways together, the pair has no contact. Sums never shrink, however a body turns
back, so the poses in between need not be known.

This says nothing of contacts that are there: a pair that has any is looked at each time, and so is
one without an order, whose side goes by the start.
"""

from math import sqrt

from featherfx.algebra.vec3_kernels import add, dot, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.row_kernels import node_index
from featherfx.solver.contact.search_kernels import (
    box_distance,
    corner_node,
    guest_place,
    guest_point,
    side_normal,
    strip_point,
)

# how far beside its closest point, along the host, a node still meets it: thicknesses beyond an
# edge, and so much of its height above a crease, up to so many thicknesses
BESIDE, SLANT, CREASE = 1.0, 0.1, 20.0
OVER = BESIDE + SLANT * CREASE
# slack that is asked for, over the widest margin, and if there is less; m, for rounding
MOST, LESS, ROUNDED = 4.0, 1.0, 1e-9
# looks at a pair until its slack is asked for again: where there was some, and where not
SOON, LATE = 1, 8
# a triangle's size that lets no node be beside it, m
WIDE = 1e6


@kernel
def follow(body, search, clearance):
    """Add to what a body has gone since the search before, and renew its triangles."""
    present, ahead = search.surfaces.present[body], search.bodies.ahead[body]
    before, columns = clearance.nodes[body], (search.surfaces.present.shape[2] - 1) // 2
    most, moved, lost = MOST * search.widest, 0.0, False
    for i in range(present.shape[0]):
        for c in range(present.shape[1]):
            if present[i, c] == 0:
                continue
            p = strip_point(c, columns)
            away = sub(ahead[i, p], before[i, p])
            square = dot(away, away)
            # not a number is far, too
            lost = lost or not square < most * most
            moved = max(moved, square)
            store(before[i, p], ahead[i, p])
    if moved == 0.0 and not lost:
        return
    moved = sqrt(moved)
    grown, turned, largest = _renew(body, search, clearance)
    reach = search.surfaces.far[body] + search.widest + 2.0 * most + largest
    as_host = moved + grown + reach * turned
    # as much as makes every pair of the body be looked at
    enough = 2.0 * most
    clearance.as_guest[body] += enough if lost else moved
    clearance.as_host[body] += as_host if as_host < enough and not lost else enough
    clearance.size[body] = largest


@kernel
def _renew(body, search, clearance):
    """Renew a body's triangles; returns the most that a size grew or shrank, and that a normal's
    tip went, and the largest size."""
    exists, ahead = search.surfaces.exists[body], search.bodies.ahead[body]
    facets, columns = clearance.facets[body], search.surfaces.exists.shape[3]
    grown, turned, largest, count = 0.0, 0.0, 0.0, 0
    for side in range(2):
        for i in range(exists.shape[1]):
            for j in range(columns):
                for half in range(2):
                    if exists[side, i, j, half] == 0:
                        continue
                    change = _renew_facet(facets, count, ahead, (side, i, j, half), columns)
                    grown, turned = max(grown, change[0]), max(turned, change[1])
                    largest = max(largest, facets[6, count])
                    count += 1
    clearance.facet_count[body] = count
    return grown, sqrt(turned), largest


@kernel
def _corner(points, place, k, columns):
    row, node = corner_node(place, k)
    x = points[row, node_index(place[0], node, columns)]
    return x[0], x[1], x[2]


@kernel
def _renew_facet(facets, k, points, place, columns):
    """Renew triangle k; returns how much its size changed, and the square of its normal's way."""
    a, b = _corner(points, place, 0, columns), _corner(points, place, 1, columns)
    c = _corner(points, place, 2, columns)
    middle, normal = scale(1.0 / 3.0, add(add(a, b), c)), side_normal(place[0], a, b, c)
    to_a, to_b, to_c = sub(a, middle), sub(b, middle), sub(c, middle)
    size = sqrt(max(dot(to_a, to_a), max(dot(to_b, to_b), dot(to_c, to_c))))
    turn, grown = 0.0, abs(size - facets[6, k])
    for axis in range(3):
        turn += (normal[axis] - facets[3 + axis, k]) ** 2
        facets[axis, k], facets[3 + axis, k] = middle[axis], normal[axis]
    facets[6, k] = size
    facets[7, k] = size if dot(normal, normal) > 0.5 else WIDE
    return grown, turn


@kernel
def is_clear(pair, guest, host, bodies, clearance):
    """Whether a pair cannot have come to touch since it was looked at."""
    left = clearance.until[pair] - clearance.as_guest[guest] - clearance.as_host[host]
    return left > bodies.way[guest] + bodies.way[host]


@kernel
def clear(pair, guest, host, side, search, clearance):
    """Note for how long a pair in which no contact was found has none."""
    if clearance.wait[pair] > 0:
        clearance.wait[pair] -= 1
        return
    ways, gone = search.bodies.way[guest] + search.bodies.way[host], 0.0
    clearance.wait[pair] = LATE
    for slack in (MOST * search.widest, LESS * search.widest):
        if slack - ROUNDED > ways and _has_slack(guest, host, side, slack, search, clearance):
            gone = clearance.as_guest[guest] + clearance.as_host[host]
            clearance.until[pair] = slack - ROUNDED + gone
            clearance.wait[pair] = SOON
            return


@kernel
def _has_slack(guest, host, side, slack, search, clearance):
    """Whether all nodes of a guest have a slack (m) over a host."""
    surfaces, bounds = search.surfaces, search.bodies.bounds[host]
    thickness = clearance.half[guest] + clearance.half[host]
    # margins may grow before this is asked again
    reach = surfaces.far[host] + search.widest + slack
    limits = OVER * thickness + slack, thickness + search.widest + slack, reach
    away = reach + clearance.size[host]
    for i in range(surfaces.guests.shape[1]):
        for c in range(surfaces.guests.shape[2]):
            if surfaces.guests[guest, i, c] == 0:
                continue
            p, fraction = guest_point(c, surfaces.exists.shape[3], surfaces.columns[guest])
            x = guest_place(search.bodies.ahead[guest], i, p, fraction)
            if box_distance(x, bounds) > away * away:
                continue
            if _meets_one(x, clearance.facets[host], clearance.facet_count[host], side, limits):
                return False
    return True


@kernel
def _meets_one(x, facets, count, side, limits):
    """Whether a node lacks the slack over one of the triangles (8, k). limits: beside, height and
    distance that count, with the slack, m."""
    beside, height, reach = limits
    met = 0
    for k in range(count):
        w0, w1, w2 = x[0] - facets[0, k], x[1] - facets[1, k], x[2] - facets[2, k]
        along = w0 * facets[3, k] + w1 * facets[4, k] + w2 * facets[5, k]
        square = w0 * w0 + w1 * w1 + w2 * w2
        far, wide = reach + facets[6, k], beside + facets[7, k]
        low, near = side * along <= height, square <= far * far
        met |= int(low & near & (square - along * along <= wide * wide))
    return met != 0
