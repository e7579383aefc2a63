"""Feathers as they are lifted, with boxes around them and heights of their vanes.

Each is lifted along its own dorsal side m, but for being turned towards the mean h of the headings
of those beneath it,

    way = m + WITH_LOWER (h - m),

of unit length, which is its heading; rows are turned as the whole is. Were all lifted along their
own dorsal sides, what lies askew on a lifted feather would rise more than that one, and go past
it to where it meets others: over many rows, without bound.
"""

from featherfx.algebra.vector_kernels import add, cross, dot, length, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.shot.layers.walk_kernels import corners_of
from featherfx.solver.contact.search_kernels import row_boxes, strip_point

# fields along and across a vane of which the heights are known
FIELDS = 12, 8
# how far a feather's way of being lifted is turned towards that of those beneath it, of all the way
WITH_LOWER = 0.7


@kernel
def lift_ways(stack, limb, directors, heading, ways):
    """Unit vectors along which rows are lifted, ways (F, n, 3): their dorsal directors, of
    (F, n, 2, 3), turned towards where those go that lie beneath and are of the same limb, (F,).
    heading: scratch (F, 3)."""
    rows = ways.shape[1]
    for k in range(stack.order.shape[0]):
        f, own, others = stack.order[k], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(rows):
            own = add(own, directors[f, i, 1])
        own = scale(1.0 / max(length(own), 1e-300), own)
        for pair in range(stack.first[k], stack.first[k + 1]):
            lower = stack.pairs[pair, 1]
            if limb[lower] == limb[f]:
                other = heading[lower]
                others = add(others, scale(max(0.0, dot(own, other)), other))
        size, turn = length(others), (0.0, 0.0, 0.0)
        if size > 0.0:
            turn = scale(WITH_LOWER, sub(scale(1.0 / size, others), own))
        way = add(own, turn)
        store(heading[f], scale(1.0 / length(way), way))
        for i in range(rows):
            way = add(directors[f, i, 1], turn)
            store(ways[f, i], scale(1.0 / length(way), way))


@kernel
def lift_points(vanes, points, lift, pose, f):
    """Lift RowPoints of a feather by (n, 2 m + 1) m along its ways, to a pose that has these, and
    fit its boxes and heights."""
    columns, out = vanes.exists.shape[3], pose.points[f]
    for i in range(out.shape[0]):
        for c in range(2 * columns + 1):
            p, pose.lift[f, i, c] = strip_point(c, columns), lift[i, c]
            for k in range(3):
                risen = lift[i, c] * pose.way[f, i, k]
                out[i, p, k] = points.nodes[f, i, p, k] + risen
    row_boxes(out, out, vanes.present[f], pose.boxes[f], pose.bounds[f])
    _fit_own(vanes.present[f], out, pose.way[f], pose.frames[f], pose.own[f])
    own = pose.frames[f], pose.own[f]
    _fit_heights(vanes.exists[f], out, own, vanes.reach[f], pose.heights[f])


@kernel
def lift_points_of_all(vanes, points, pose, span):
    """As lift_points, of the feathers span[0] to span[1] - 1, by the lifts that the pose has."""
    for f in range(span[0], span[1]):
        lift_points(vanes, points, pose.lift[f], pose, f)


@kernel
def _fit_own(present, points, way, frame, own):
    """Origin and axes (4, 3) of a feather's own frame, along the shaft, across and up, and the
    box (6,) around its vane in that."""
    rows, columns = points.shape[0], (present.shape[1] - 1) // 2
    along = sub(points[rows - 1, 0], points[0, 0])
    along = scale(1.0 / length(along), along)
    across = cross(way[rows // 2], along)
    across = scale(1.0 / length(across), across)
    store(frame[0], points[0, 0])
    store(frame[1], along)
    store(frame[2], across)
    store(frame[3], cross(along, across))
    for k in range(3):
        own[k], own[3 + k] = 1e300, -1e300
    for i in range(rows):
        for c in range(present.shape[1]):
            if present[i, c] != 0:
                away = sub(points[i, strip_point(c, columns)], frame[0])
                for k in range(3):
                    x = dot(frame[1 + k], away)
                    own[k], own[3 + k] = min(own[k], x), max(own[3 + k], x)


@kernel
def field_of(x, own, k):
    """Field that a place is in along axis k of a feather's own box (6,), the first or last for
    what lies before or after it."""
    size = max(own[3 + k] - own[k], 1e-300)
    return min(max(int((x - own[k]) / size * FIELDS[k]), 0), FIELDS[k] - 1)


@kernel
def _fit_heights(exists, points, fitted, reach, heights):
    """Least and greatest height (12, 8, 2) of the vane over each field of its own box, or beside it
    by no more than a reach; that of the box where no triangle is. fitted: frame and box."""
    frame, own = fitted
    for p in range(FIELDS[0]):
        for q in range(FIELDS[1]):
            heights[p, q, 0], heights[p, q, 1] = 1e300, -1e300
    for side in range(2):
        for i in range(exists.shape[1]):
            for j in range(exists.shape[2]):
                for half in range(2):
                    if exists[side, i, j, half] != 0:
                        corners = corners_of(points, (side, i, j, half))
                        _raise_heights(corners, frame, own, reach, heights)
    for p in range(FIELDS[0]):
        for q in range(FIELDS[1]):
            if heights[p, q, 0] > heights[p, q, 1]:
                heights[p, q, 0], heights[p, q, 1] = own[2], own[5]


@kernel
def _raise_heights(corners, frame, own, reach, heights):
    """Heights with one triangle more."""
    a, b, c = sub(corners[0], frame[0]), sub(corners[1], frame[0]), sub(corners[2], frame[0])
    x = dot(frame[1], a), dot(frame[1], b), dot(frame[1], c)
    y = dot(frame[2], a), dot(frame[2], b), dot(frame[2], c)
    z = dot(frame[3], a), dot(frame[3], b), dot(frame[3], c)
    low, high = min(z[0], min(z[1], z[2])), max(z[0], max(z[1], z[2]))
    first, last = min(x[0], min(x[1], x[2])) - reach, max(x[0], max(x[1], x[2])) + reach
    left, right = min(y[0], min(y[1], y[2])) - reach, max(y[0], max(y[1], y[2])) + reach
    for p in range(field_of(first, own, 0), field_of(last, own, 0) + 1):
        for q in range(field_of(left, own, 1), field_of(right, own, 1) + 1):
            heights[p, q, 0] = min(heights[p, q, 0], low)
            heights[p, q, 1] = max(heights[p, q, 1], high)
