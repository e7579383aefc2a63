"""Triangles of different meshes that pass through each other.

Two triangles cross where each has corners strictly on both sides of the other's plane and an edge
of one whose ends are so meets the other, its rim included. What only touches, with a corner, an
edge or in a plane, does not cross. The side of a plane on which a point lies is the sign of

    orient(a, b, c, d) = (b - a) x (c - a) . (d - a),

0 where the determinant is within the rounding of its own evaluation (Shewchuk 1997, bound A): then
the point counts as in the plane.
"""

from featherfx.algebra.vector_kernels import sub
from featherfx.jit.compiled import kernel

# over the sum of the moduli of a determinant's terms
_FLAT_TOLERANCE = 1e-15


@kernel
def orient(a, b, c, d):
    """1 where d is on the side of (b - a) x (c - a), -1 on the other, 0 in the plane of a, b, c."""
    u, v, w = sub(b, a), sub(c, a), sub(d, a)
    first, second = u[1] * v[2], u[2] * v[1]
    third, fourth = u[2] * v[0], u[0] * v[2]
    fifth, sixth = u[0] * v[1], u[1] * v[0]
    value = (first - second) * w[0] + (third - fourth) * w[1] + (fifth - sixth) * w[2]
    size = (abs(first) + abs(second)) * abs(w[0]) + (abs(third) + abs(fourth)) * abs(w[1])
    size += (abs(fifth) + abs(sixth)) * abs(w[2])
    if abs(value) <= _FLAT_TOLERANCE * size:
        return 0
    return 1 if value > 0.0 else -1


@kernel
def _pierces(p, q, a, b, c):
    """Return whether a line through p and q, on either side of a triangle's plane, meets the
    triangle."""
    first, second, third = orient(p, q, a, b), orient(p, q, b, c), orient(p, q, c, a)
    above = first >= 0 and second >= 0 and third >= 0
    return above or (first <= 0 and second <= 0 and third <= 0)


@kernel
def _any_edge(p, sides, q):
    """Return whether an edge of triangle p pierces triangle q. sides: of q's plane, of p's
    corners."""
    for k in range(3):
        after = (k + 1) % 3
        if sides[k] * sides[after] < 0 and _pierces(p[k], p[after], q[0], q[1], q[2]):
            return True
    return False


@kernel
def triangles_cross(p, q):
    """Return whether two triangles, three points each, intersect."""
    a, b, c = orient(*q, p[0]), orient(*q, p[1]), orient(*q, p[2])
    if min(a, min(b, c)) >= 0 or max(a, max(b, c)) <= 0:
        return False
    d, e, f = orient(*p, q[0]), orient(*p, q[1]), orient(*p, q[2])
    if min(d, min(e, f)) >= 0 or max(d, max(e, f)) <= 0:
        return False
    return _any_edge(p, (a, b, c), q) or _any_edge(q, (d, e, f), p)


@kernel
def _corners(points, triangle):
    a, b, c = points[triangle[0]], points[triangle[1]], points[triangle[2]]
    return (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])


@kernel
def fit_boxes(points, patches, boxes, bounds, low, high):
    """Boxes (T, 6) of the triangles, and bounds (P, 6) of the patches from low to high - 1."""
    for patch in range(low, high):
        for k in range(3):
            bounds[patch, k], bounds[patch, 3 + k] = 1e300, -1e300
        for t in range(patches.first[patch], patches.first[patch + 1]):
            p, q, r = _corners(points, patches.triangles[t])
            for k in range(3):
                boxes[t, k] = min(p[k], min(q[k], r[k]))
                boxes[t, 3 + k] = max(p[k], max(q[k], r[k]))
                bounds[patch, k] = min(bounds[patch, k], boxes[t, k])
                bounds[patch, 3 + k] = max(bounds[patch, 3 + k], boxes[t, 3 + k])


@kernel
def _meet(first, second):
    """Return whether two boxes (6,) have a point in common."""
    for k in range(3):
        least, greatest = max(first[k], second[k]), min(first[3 + k], second[3 + k])
        if least > greatest:
            return False
    return True


@kernel
def near_patches(order, axis, clusters, bounds, low, high, found):
    """Pairs of patches of different owners whose bounds meet; returns how many there are.

    order: (C,) clusters by the least coordinate along an axis; those from low to high - 1 are
    paired with all behind them. found: (K, 2), written as far as there is room.
    """
    count, around, starts = 0, clusters.around, clusters.first
    for place in range(low, high):
        first = order[place]
        for other in range(place + 1, order.shape[0]):
            second = order[other]
            if around[second, axis] > around[first, 3 + axis]:
                break
            if clusters.owner[first] == clusters.owner[second]:
                continue
            asked = clusters.asked[first] or clusters.asked[second]
            if not asked or not _meet(around[first], around[second]):
                continue
            for p in range(starts[first], starts[first + 1]):
                if not _meet(bounds[p], around[second]):
                    continue
                for q in range(starts[second], starts[second + 1]):
                    if _meet(bounds[p], bounds[q]):
                        if count < found.shape[0]:
                            found[count, 0], found[count, 1] = p, q
                        count += 1
    return count


@kernel
def _common(first, second, low, high):
    """Corners low and high (3,) of what two boxes (6,) have in common."""
    for k in range(3):
        low[k], high[k] = max(first[k], second[k]), min(first[3 + k], second[3 + k])


@kernel
def _chosen(boxes, start, end, low, high):
    """Bits, from 0, of the boxes from start to end - 1 that meet the one from low to high."""
    bits = 0
    for t in range(start, end):
        apart = False
        for k in range(3):
            apart = apart or boxes[t, k] > high[k] or boxes[t, 3 + k] < low[k]
        if not apart:
            bits |= 1 << (t - start)
    return bits


@kernel
def crossings_between(points, patches, boxes, bounds, pairs, span, corners, counts):
    """Triangles that cross, of the pairs of patches in a span (first, last + 1).

    boxes, bounds: of fit_boxes. corners: (2, 3), overwritten. counts: (K, 2), by pair: those
    between vanes, and those of which one at least is of a rachis. A patch has 63 triangles at most.
    """
    for k in range(span[0], span[1]):
        first, second = pairs[k, 0], pairs[k, 1]
        counts[k, 0] = counts[k, 1] = 0
        # only triangles where both patches are may meet
        _common(bounds[first], bounds[second], corners[0], corners[1])
        start, end = patches.first[first], patches.first[first + 1]
        other = patches.first[second], patches.first[second + 1]
        mine = _chosen(boxes, start, end, corners[0], corners[1])
        others = _chosen(boxes, other[0], other[1], corners[0], corners[1])
        if mine == 0 or others == 0:
            continue
        for t in range(start, end):
            if not mine >> (t - start) & 1:
                continue
            p = _corners(points, patches.triangles[t])
            for s in range(other[0], other[1]):
                if not others >> (s - other[0]) & 1 or not _meet(boxes[t], boxes[s]):
                    continue
                if triangles_cross(p, _corners(points, patches.triangles[s])):
                    rachis = patches.rachis[t] or patches.rachis[s]
                    counts[k, 1 if rachis else 0] += 1
