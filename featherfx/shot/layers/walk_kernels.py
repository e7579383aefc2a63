"""Walks over a vane: its triangles, and the way over them from one to the next."""

from featherfx.algebra.vector_kernels import cross, dot, normal_of, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.row_kernels import node_index
from featherfx.solver.contact.search_kernels import closest_weights, corner_node


@kernel
def corners_of(points, place):
    """Corners of a triangle."""
    columns = (points.shape[1] - 1) // 2
    row, node = corner_node(place, 0)
    a = points[row, node_index(place[0], node, columns)]
    row, node = corner_node(place, 1)
    b = points[row, node_index(place[0], node, columns)]
    row, node = corner_node(place, 2)
    c = points[row, node_index(place[0], node, columns)]
    return (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])


@kernel
def _beyond(place, k):
    """The triangle across the edge opposite corner k, whether there is one or not."""
    side, i, j, half = place
    if half == 0:
        if k == 0:
            return side, i, j, 1
        if k == 2:
            return side, i - 1, j, 1
        return (side, i, j - 1, 1) if j > 0 else (1 - side, i, 0, 0)
    if k == 1:
        return side, i, j, 0
    return (side, i + 1, j, 0) if k == 0 else (side, i, j + 1, 0)


@kernel
def is_there(place, exists):
    side, i, j, half = place
    inside = 0 <= i < exists.shape[1] and 0 <= j < exists.shape[2]
    return inside and exists[side, i, j, half] != 0


@kernel
def first_place(x, own, exists):
    """A triangle to begin with, near a point (3,) as the feather sees it, at its shaft."""
    rows, part = exists.shape[1], (x[0] - own[0]) / (own[3] - own[0])
    side = 0 if x[1] >= 0.0 else 1
    guess = min(max(int(part * rows), 0), rows - 1)
    for step in range(rows):
        for way in range(2):
            i = guess + step if way == 0 else guess - step
            for half in range(2):
                if is_there((side, i, 0, half), exists):
                    return side, i, 0, half
                if is_there((1 - side, i, 0, half), exists):
                    return 1 - side, i, 0, half
    return -1, 0, 0, 0


@kernel
def walk(x, points, exists, place):
    """The triangle that a point is over, walking from one; at the vane's edge, the nearest that is
    met. Returns it, the weights of its corners, its normal, not of unit length, and whether the
    point is over it, not beside."""
    weight, product, inside = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), False
    before = place
    for _ in range(points.shape[0] + points.shape[1]):
        a, b, c = corners_of(points, place)
        product = normal_of(a, b, c)
        area = dot(product, product)
        if area <= 0.0:
            break
        weight = _parted(x, (a, b, c), product, area)
        least = min(weight[0], min(weight[1], weight[2]))
        if least >= 0.0:
            inside = True
            break
        k = 0 if least == weight[0] else (1 if least == weight[1] else 2)
        after = _beyond(place, k)
        if not is_there(after, exists):
            # around the corner, if it is beyond another edge, too
            k = (k + 1) % 3 if weight[(k + 1) % 3] < weight[(k + 2) % 3] else (k + 2) % 3
            after = _beyond(place, k)
            if weight[k] >= 0.0 or not is_there(after, exists):
                weight = closest_weights(x, a, b, c)
                break
        if after == before:
            # over the ridge between two triangles, beyond either along its normal
            weight, inside = closest_weights(x, a, b, c), True
            break
        before, place = place, after
    return place, weight, product, inside


@kernel
def _parted(x, corners, normal, area):
    """Weights of a triangle's corners at a point, seen along its normal."""
    a, b, c = corners
    away = sub(x, a)
    second = dot(cross(away, sub(c, a)), normal) / area
    third = dot(cross(sub(b, a), away), normal) / area
    return 1.0 - second - third, second, third


@kernel
def way_out(start, end, points, exists, place):
    """Part of the way from a point over a triangle to another at which the vane ends, 1 where it
    does not, and the triangle there."""
    part = 0.0
    for _ in range(points.shape[0] + points.shape[1]):
        corners = corners_of(points, place)
        normal = normal_of(corners[0], corners[1], corners[2])
        area = dot(normal, normal)
        if area <= 0.0:
            break
        now = _parted(start, corners, normal, area)
        then = _parted(end, corners, normal, area)
        first, out = 1.0, -1
        for k in range(3):
            if then[k] < 0.0 and now[k] - then[k] > 0.0 and now[k] < first * (now[k] - then[k]):
                first, out = now[k] / (now[k] - then[k]), k
        if out < 0:
            return 1.0, place
        part = max(part, first)
        after = _beyond(place, out)
        if not is_there(after, exists):
            break
        place = after
    return part, place
