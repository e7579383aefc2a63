"""Narrow phase: the nodes of one vane that meet the surface of another, and where.

A vane is a strip of n rows times 2 m + 1 nodes: the trailing barb's end is column 0, the rachis m,
the leading barb's end 2 m. The nearest node is found by boxes around rows, the closest point by
walking over the triangles around it (Ericson 2005, section 5.1.5). Nothing is built or allocated.

A triangle is told by its place: side, cell (i, j) and half, 0 or 1.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import add, dot, length, normal_of, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.barb_kernels import node_index
from featherfx.solver.contact.types import RIM_SAMPLES

# what the square of a guessed distance is rounded up by, of itself
_GUESSED = 1e-9


@kernel
def strip_point(column, columns):
    """Node of its row that a node of the strip is."""
    return column - columns if column >= columns else 2 * columns - column


@kernel
def guest_point(c, columns, own):
    """(node, fraction of the way to the next row) of column c of a row's guests.

    columns: of the widest grid, which the points are counted on; own: of the feather's.

    The first 2 m + 1 are the strip's nodes. The others lie on the trailing, then on the leading
    rim between this row's node and the next one's, because rims that cross touch between nodes.
    """
    extra = c - 2 * columns - 1
    if extra < 0:
        return strip_point(c, columns), 0.0
    between = RIM_SAMPLES - 1
    p = columns + own if extra < between else own
    return p, (extra % between + 1.0) / RIM_SAMPLES


@kernel
def guest_place(points, i, p, fraction):
    """Place of a guest's point in a pose (n, 1 + 2 m, 3): row i, node p, and how far it lies
    towards the next row."""
    x = add(points[i, p], (0.0, 0.0, 0.0))
    if fraction > 0.0:
        x = add(x, scale(fraction, sub(points[i + 1, p], points[i, p])))
    return x


@kernel
def row_boxes(start, ahead, present, boxes, bounds):
    """Boxes (n, 6) around the strip's rows in two poses, low then high, and of all, bounds (6,); m.

    start, ahead: (n, 1 + 2 m, 3). present: (n, 2 m + 1). An empty box has a low above its high.
    Returns the farthest that a node is in one from the other, m.
    """
    columns, farthest = (present.shape[1] - 1) // 2, 0.0
    for k in range(3):
        bounds[k], bounds[3 + k] = 1e300, -1e300
    for i in range(start.shape[0]):
        for k in range(3):
            boxes[i, k], boxes[i, 3 + k] = 1e300, -1e300
        for p in range(start.shape[1]):
            farthest = max(farthest, _square(ahead[i, p], start[i, p]))
        for c in range(present.shape[1]):
            if present[i, c] == 0:
                continue
            p = strip_point(c, columns)
            for k in range(3):
                boxes[i, k] = min(boxes[i, k], min(start[i, p, k], ahead[i, p, k]))
                boxes[i, 3 + k] = max(boxes[i, 3 + k], max(start[i, p, k], ahead[i, p, k]))
        for k in range(3):
            bounds[k] = min(bounds[k], boxes[i, k])
            bounds[3 + k] = max(bounds[3 + k], boxes[i, 3 + k])
    return sqrt(farthest)


@kernel
def swing_of(start, ahead):
    """The farthest, m, that a node goes from one pose (n, 1 + 2 m, 3) to another, without what its
    root goes."""
    led, farthest = sub(ahead[0, 0], start[0, 0]), 0.0
    for i in range(start.shape[0]):
        for p in range(start.shape[1]):
            farthest = max(farthest, _square(sub(ahead[i, p], start[i, p]), led))
    return sqrt(farthest)


@kernel
def fit_slab(points, present, exists, slab):
    """The slab (5,) of a pose (n, 1 + 2 m, 3) (types.MovingBodies)."""
    normal, turned = (0.0, 0.0, 0.0), False
    for again in range(2):
        for side in range(2):
            for i in range(exists.shape[1]):
                for j in range(exists.shape[2]):
                    for half in range(2):
                        if exists[side, i, j, half] == 0:
                            continue
                        own = _facing(points, (side, i, j, half), exists.shape[2])
                        if again == 0:
                            normal = add(normal, own)
                        elif dot(own, normal) < 0.0:
                            turned = True
    slab[3], slab[4] = 1e300, -1e300
    store(slab, normal)
    for i in range(points.shape[0]):
        for c in range(present.shape[1]):
            if present[i, c] != 0:
                height = dot(normal, points[i, strip_point(c, exists.shape[2])])
                slab[3], slab[4] = min(slab[3], height), max(slab[4], height)
    size = length(normal)
    for k in range(5):
        slab[k] = slab[k] / size if size > 0.0 else 0.0
    if turned or not size > 0.0:
        slab[3], slab[4] = -1e300, 1e300


@kernel
def _facing(points, place, columns):
    """Unit normal of a triangle, zero of one without area."""
    a, b = corner_of(points, place, 0, columns), corner_of(points, place, 1, columns)
    return side_normal(place[0], a, b, corner_of(points, place, 2, columns))


@kernel
def box_distance(x, box):
    """Square of the distance (m^2) of a point from a box (6,)."""
    square = 0.0
    for k in range(3):
        away = max(box[k] - x[k], max(0.0, x[k] - box[3 + k]))
        square += away * away
    return square


@kernel
def boxes_apart(first, second, margin):
    """Return whether two boxes (6,) are farther apart than a margin (m) along an axis."""
    for k in range(3):
        if first[k] > second[3 + k] + margin or second[k] > first[3 + k] + margin:
            return True
    return False


@kernel
def _square(a, b):
    away = sub(a, b)
    return dot(away, away)


@kernel
def nearest_node(x, points, present, boxes, guess, limit):
    """(row, column) of the strip's node nearest to a point, -1 if none is nearer than limit (m).

    guess: row and column, or -1.
    """
    columns = (present.shape[1] - 1) // 2
    best, found_row, found_column = limit * limit, -1, -1
    row, column = guess
    if row >= 0 and present[row, column] != 0:
        square = _square(points[row, strip_point(column, columns)], x)
        # a little more, so that which of several equally near ones is found does not go by it
        best = min(best, square + _GUESSED * square)
    for i in range(points.shape[0]):
        if box_distance(x, boxes[i]) >= best:
            continue
        for c in range(present.shape[1]):
            if present[i, c] == 0:
                continue
            square = _square(points[i, strip_point(c, columns)], x)
            if square < best:
                best, found_row, found_column = square, i, c
    return found_row, found_column


@kernel
def closest_weights(x, a, b, c):
    """Weights of corners a, b, c of the point of a triangle closest to x."""
    u, v, p = sub(b, a), sub(c, a), sub(x, a)
    d1, d2 = dot(u, p), dot(v, p)
    if d1 <= 0.0 and d2 <= 0.0:
        return 1.0, 0.0, 0.0
    p = sub(x, b)
    d3, d4 = dot(u, p), dot(v, p)
    if d3 >= 0.0 and d4 <= d3:
        return 0.0, 1.0, 0.0
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        return 1.0 - t, t, 0.0
    p = sub(x, c)
    d5, d6 = dot(u, p), dot(v, p)
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 0.0, 1.0
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        return 1.0 - t, 0.0, t
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 0.0, 1.0 - t, t
    total = va + vb + vc
    return va / total, vb / total, vc / total


@kernel
def side_normal(side, a, b, c):
    """Unit normal of a triangle, the same way on both vanes (dorsal unless mirrored)."""
    normal = scale(-1.0 if side == 0 else 1.0, normal_of(a, b, c))
    size = length(normal)
    return scale(1.0 / size if size > 0.0 else 0.0, normal)


@kernel
def corner_node(place, k):
    """(row, barb node) of corner k of a triangle, counted as in cell_stiffness.

    Seen from dorsal the corners run clockwise on the leading vane of a feather that is not
    mirrored; `side_normal` orients all alike.
    """
    _, i, j, half = place
    if k == 2:
        return i + 1, j
    if half == 0:
        return i, j + k
    return i + k, j + 1


@kernel
def corner_place(place, k, columns):
    """Row and node in it of corner k of a triangle."""
    row, node = corner_node(place, k)
    return row, node_index(place[0], node, columns)


@kernel
def corner_of(points, place, k, columns):
    """Return corner k of a triangle in a pose (n, 1 + 2 m, 3)."""
    row, node = corner_place(place, k, columns)
    x = points[row, node]
    return x[0], x[1], x[2]


@kernel
def _around_node(x, points, exists, near, best):
    """The best, or a closer point of the triangles around a node (row, column): square of its
    distance (m^2), place, weights of the corners."""
    columns = exists.shape[2]
    for di in range(2):
        i = near[0] - 1 + di
        if i < 0 or i >= exists.shape[1]:
            continue
        for dc in range(2):
            c = near[1] - 1 + dc
            if c < 0 or c >= 2 * columns:
                continue
            side = 0 if c >= columns else 1
            j = c - columns if c >= columns else columns - 1 - c
            for half in range(2):
                if exists[side, i, j, half] == 0:
                    continue
                place = side, i, j, half
                a, b = corner_of(points, place, 0, columns), corner_of(points, place, 1, columns)
                d = corner_of(points, place, 2, columns)
                weight = closest_weights(x, a, b, d)
                y = add(add(scale(weight[0], a), scale(weight[1], b)), scale(weight[2], d))
                square = _square(y, x)
                if square < best[0]:
                    best = square, place, weight
    return best


@kernel
def closest_point(x, points, exists, near):
    """Closest point of a strip, walking from a node (row, column): its triangle's place (side -1
    where the node has none) and the weights of its corners.

    points: (n, 1 + 2 m, 3). exists: (2, n - 1, m, 2).
    """
    columns = exists.shape[2]
    best = 1e300, (-1, 0, 0, 0), (0.0, 0.0, 0.0)
    for _ in range(points.shape[0] + columns):
        better = _around_node(x, points, exists, near, best)
        if better[0] >= best[0]:
            break
        best = better
        _, place, weight = best
        k = 0
        if weight[1] > weight[0] and weight[1] >= weight[2]:
            k = 1
        elif weight[2] > weight[0]:
            k = 2
        row, node = corner_node(place, k)
        column = columns + node if place[0] == 0 else columns - node
        if row == near[0] and column == near[1]:
            # the triangles around it have been seen
            break
        near = row, column
    return best[1], best[2]
