"""Distance of a pair without contacts from having one: it needs no search until it has moved so
far.

A node at x meets a host with its triangle T only if (find_kernels), with n the normal of T, y its
point closest to x, w = x - y, and t the sum of both half thicknesses:

    beside the normal through y it is no farther than OVER_RATIO t,   |w - (n.w) n| <= OVER_RATIO t,
    it is below the height that counts,     side n.w <= t + margin + ways,
    and no farther away than is searched,   |w| <= far + margin + ways,

ways: what both bodies go past each other in the interval (way_between). So the pair has no contact
if for a slack S > ways each node fails one of these for each triangle, with S added to the right
sides instead of ways. (A normal of no length passes the first two.)

Every body has a frame of its own, which turns and goes with it (follow). From one pose to the next,
w changes by no more than its ends move in the host's frame; n.w and |w - (n.w) n| by that and |w|
times the way of n's tip, where |w| is that in the pose in which it counts: far + margin + S at
most. So every body adds up, search by search, how far its nodes went in its frame (as a guest), and
that and (far + margin + S) times the way of the normals' tips (as a host). The guest's nodes also
move with its frame: no farther than its origin does in the host's frame, and its axes turn there,
times how far the nodes are from the origin. (The difference of two rotations has the two singular
values that its Frobenius norm is made of, and zero.) While S and the margin of then are larger than
what guest and host added since, what their frames went past each other, the ways and the margin of
now together, the pair has no contact. Sums never shrink, however a body turns back, so the poses in
between need not be known. A bird that walks keeps its pairs, as its feathers move together.

This says nothing of contacts that are there: a pair that has any is looked at each time, and so is
one without an order, whose side goes by the start.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import add, cross, dot, length, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.search_kernels import (
    box_distance,
    closest_weights,
    corner_of,
    guest_place,
    guest_point,
    side_normal,
    strip_point,
)

# how far beside its closest point, along the host, a node still meets it: thicknesses beyond an
# edge, and so much of its height above a crease, up to so many thicknesses
BESIDE_RATIO, SLANT_RATIO, CREASE_RATIO = 1.0, 0.1, 20.0
OVER_RATIO = BESIDE_RATIO + SLANT_RATIO * CREASE_RATIO
# slacks that are asked for one after the other, over the widest margin; m, for rounding
_SLACK_RATIOS, ROUNDING_RATIO = (4.0, 1.0, 0.3, 0.1, 0.03), 1e-9
# looks at a pair until its slack is asked for again: where there was some, and where not
_SOON, _LATE = 1, 8
# a triangle's size that lets no node be beside it, m
_WIDE = 1e6
# rows of a facet: middle, normal, size and width, corners
_MIDDLE, _NORMAL, _SIZE, _WIDTH, _CORNER = 0, 3, 6, 7, 8


@kernel
def way_between(bodies, guest, host):
    """m, how far a point of a guest goes past one of a host in the interval, at most."""
    led = sub(bodies.ahead[guest, 0, 0], bodies.start[guest, 0, 0])
    other = sub(bodies.ahead[host, 0, 0], bodies.start[host, 0, 0])
    return bodies.swing[guest] + bodies.swing[host] + length(sub(led, other))


@kernel
def _counts(surfaces, body, i, c):
    """Return whether a node of the strip has a triangle or may touch others."""
    return surfaces.present[body, i, c] != 0 or surfaces.guests[body, i, c] != 0


@kernel
def _fit_frame(points, surfaces, body, frame):
    """A frame (4, 3) of a body in a pose: its middle, and axes from the root to it and across."""
    width = surfaces.present.shape[2]
    columns = (width - 1) // 2
    root = points[0, 0, 0], points[0, 0, 1], points[0, 0, 2]
    along, across, count = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0
    for i in range(points.shape[0]):
        for c in range(width):
            if surfaces.present[body, i, c] == 0:
                continue
            away = sub(points[i, strip_point(c, columns)], root)
            along, count = add(along, away), count + 1
            if c != columns:
                across = add(across, scale(1.0 if c > columns else -1.0, away))
    size = length(along)
    first = scale(1.0 / size if size > 0.0 else 0.0, along)
    across = sub(across, scale(dot(across, first), first))
    wide = length(across)
    if not (size > 0.0 and wide > 1e-6 * size):
        # any frame serves
        first, across, wide = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0
    second = scale(1.0 / wide, across)
    store(frame[0], add(root, scale(1.0 / max(count, 1), along)))
    store(frame[1], first)
    store(frame[2], second)
    store(frame[3], cross(first, second))


@kernel
def _local(frame, x):
    """A place in a frame (4, 3)."""
    away = sub(x, frame[0])
    return dot(frame[1], away), dot(frame[2], away), dot(frame[3], away)


@kernel
def follow(body, search, clearance):
    """Add to what a body has changed since the search before, and renew its triangles."""
    surfaces, ahead, frame = search.surfaces, search.bodies.ahead[body], clearance.frame[body]
    before, width = clearance.nodes[body], search.surfaces.present.shape[2]
    most, moved, extent, lost = _SLACK_RATIOS[0] * search.widest, 0.0, 0.0, False
    _fit_frame(ahead, surfaces, body, frame)
    for i in range(ahead.shape[0]):
        for c in range(width):
            if not _counts(surfaces, body, i, c):
                continue
            p = strip_point(c, (width - 1) // 2)
            x = _local(frame, ahead[i, p])
            away = sub(x, before[i, p])
            square = dot(away, away)
            # not a number is far, too
            lost = lost or not square < most * most
            moved, extent = max(moved, square), max(extent, dot(x, x))
            store(before[i, p], x)
    clearance.extent[body] = sqrt(extent)
    if moved == 0.0 and not lost:
        return
    moved = sqrt(moved)
    turned, largest = _renew(body, search, clearance)
    as_host = moved + (surfaces.far[body] + search.widest + most) * turned
    # as much as makes every pair of the body be looked at
    enough = 2.0 * most
    clearance.as_guest[body] += enough if lost else moved
    clearance.as_host[body] += as_host if as_host < enough and not lost else enough
    clearance.size[body] = largest


@kernel
def _renew(body, search, clearance):
    """Renew a body's triangles; returns the most that a normal's tip went, and the largest size."""
    exists, nodes = search.surfaces.exists[body], clearance.nodes[body]
    facets, columns = clearance.facets[body], search.surfaces.exists.shape[3]
    turned, largest, count = 0.0, 0.0, 0
    for side in range(2):
        for i in range(exists.shape[1]):
            for j in range(columns):
                for half in range(2):
                    if exists[side, i, j, half] == 0:
                        continue
                    place = side, i, j, half
                    turned = max(turned, _renew_facet(facets, count, nodes, place, columns))
                    largest = max(largest, facets[_SIZE, count])
                    count += 1
    clearance.facet_count[body] = count
    return sqrt(turned), largest


@kernel
def _renew_facet(facets, k, points, place, columns):
    """Renew triangle k; returns the square of its normal's way."""
    a, b = corner_of(points, place, 0, columns), corner_of(points, place, 1, columns)
    c = corner_of(points, place, 2, columns)
    middle, normal = scale(1.0 / 3.0, add(add(a, b), c)), side_normal(place[0], a, b, c)
    to_a, to_b, to_c = sub(a, middle), sub(b, middle), sub(c, middle)
    size, turn = sqrt(max(dot(to_a, to_a), max(dot(to_b, to_b), dot(to_c, to_c)))), 0.0
    for axis in range(3):
        turn += (normal[axis] - facets[_NORMAL + axis, k]) ** 2
        facets[_MIDDLE + axis, k], facets[_NORMAL + axis, k] = middle[axis], normal[axis]
        facets[_CORNER + axis, k], facets[_CORNER + 3 + axis, k] = a[axis], b[axis]
        facets[_CORNER + 6 + axis, k] = c[axis]
    facets[_SIZE, k] = size
    facets[_WIDTH, k] = size if dot(normal, normal) > 0.5 else _WIDE
    return turn


@kernel
def _pose(guest, host, frames, pose):
    """A guest's frame in the host's, to pose (12,): the origin, and the axes."""
    own, other = frames[guest], frames[host]
    away = sub(own[0], other[0])
    for k in range(3):
        pose[k] = dot(other[1 + k], away)
        for q in range(3):
            pose[3 + 3 * k + q] = dot(other[1 + k], own[1 + q])


@kernel
def _gone(guest, host, pose, clearance):
    """m, how far a guest's nodes have gone past the host with its frame, at most, since it had a
    pose (12,) there."""
    own, other = clearance.frame[guest], clearance.frame[host]
    away, moved, turned = sub(own[0], other[0]), 0.0, 0.0
    for k in range(3):
        moved += (dot(other[1 + k], away) - pose[k]) ** 2
        for q in range(3):
            turned += (dot(other[1 + k], own[1 + q]) - pose[3 + 3 * k + q]) ** 2
    return sqrt(moved) + sqrt(0.5 * turned) * clearance.extent[guest]


@kernel
def is_clear(pair, guest, host, reach, clearance):
    """Return whether a pair cannot have come to touch since it was looked at. reach: m, its margin,
    and what the bodies go past each other."""
    left = clearance.until[pair] - clearance.as_guest[guest] - clearance.as_host[host]
    return left > reach and left - _gone(guest, host, clearance.pose[pair], clearance) > reach


@kernel
def clear(pair, bodies, side, reach, search, clearance):
    """Note for how long a pair in which no contact was found has none. bodies: guest and host.
    reach: margin and way between them, m."""
    if clearance.wait[pair] > 0:
        clearance.wait[pair] -= 1
        return
    (guest, host), (margin, way) = bodies, reach
    clearance.wait[pair] = _LATE
    for part in _SLACK_RATIOS:
        slack = part * search.widest
        if slack - ROUNDING_RATIO <= way:
            return
        if _has_slack(guest, host, side, (margin, slack), search, clearance):
            gone = clearance.as_guest[guest] + clearance.as_host[host]
            clearance.until[pair] = margin + slack - ROUNDING_RATIO + gone
            clearance.wait[pair] = _SOON
            _pose(guest, host, clearance.frame, clearance.pose[pair])
            return


@kernel
def _has_slack(guest, host, side, room, search, clearance):
    """Return whether all nodes of a guest have a slack over a host. room: margin and slack, m."""
    surfaces, bounds = search.surfaces, search.bodies.bounds[host]
    thickness, (margin, slack) = clearance.half[guest] + clearance.half[host], room
    reach = surfaces.far[host] + margin + slack
    limits = OVER_RATIO * thickness + slack, thickness + margin + slack, reach
    away, frame = reach + clearance.size[host], clearance.frame[host]
    facets, count = clearance.facets[host], clearance.facet_count[host]
    for i in range(surfaces.guests.shape[1]):
        for c in range(surfaces.guests.shape[2]):
            if surfaces.guests[guest, i, c] == 0:
                continue
            p, fraction = guest_point(c, surfaces.exists.shape[3], surfaces.columns[guest])
            x = guest_place(search.bodies.ahead[guest], i, p, fraction)
            if box_distance(x, bounds) > away * away:
                continue
            y = _local(frame, x)
            if _may_meet(y, facets, count, side, limits):
                for k in range(count):
                    if _meets_one(y, facets, k, side, limits):
                        return False
    return True


@kernel
def _may_meet(x, facets, count, side, limits):
    """Return whether a node lacks the slack over one of the triangles (17, k) as if they were
    round."""
    beside, height, reach = limits
    met = 0
    for k in range(count):
        w0, w1, w2 = x[0] - facets[0, k], x[1] - facets[1, k], x[2] - facets[2, k]
        along = w0 * facets[3, k] + w1 * facets[4, k] + w2 * facets[5, k]
        square = w0 * w0 + w1 * w1 + w2 * w2
        far, wide = reach + facets[_SIZE, k], beside + facets[_WIDTH, k]
        low, near = side * along <= height, square <= far * far
        met |= int(low & near & (square - along * along <= wide * wide))
    return met != 0


@kernel
def _of_facet(facets, row, k):
    """Three numbers of triangle k, from a row on."""
    return facets[row, k], facets[row + 1, k], facets[row + 2, k]


@kernel
def _meets_one(x, facets, k, side, limits):
    """Return whether a node lacks the slack over triangle k; limits as of _may_meet."""
    beside, height, reach = limits
    normal, away = _of_facet(facets, _NORMAL, k), sub(x, _of_facet(facets, _MIDDLE, k))
    along, square = dot(normal, away), dot(away, away)
    far, wide = reach + facets[_SIZE, k], beside + facets[_WIDTH, k]
    if side * along > height or square > far * far or square - along * along > wide * wide:
        return False
    if facets[_WIDTH, k] == _WIDE:
        return True
    a, b = _of_facet(facets, _CORNER, k), _of_facet(facets, _CORNER + 3, k)
    c, below = _of_facet(facets, _CORNER + 6, k), sub(x, scale(along, normal))
    weight = closest_weights(below, a, b, c)
    y = add(add(scale(weight[0], a), scale(weight[1], b)), scale(weight[2], c))
    past = sub(below, y)
    return dot(past, past) <= beside * beside
