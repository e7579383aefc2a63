"""Where vanes lie over each other, and over the skin, and what they lack of being clear.

A point x of one feather and the point y beneath or above it on a triangle of the other, with the
triangle's dorsal normal N, lack  t - s N . (x - y),  s = 1 if x is of the upper feather, else -1,
t the sum of both half thicknesses. Every row is lifted along its dorsal director d, so a lift w of
a node moves it by (d . N) w along the normal. Points are the nodes, and some on the rims between
them, because rims cross between nodes.
"""

from featherfx.algebra.vec3_kernels import add, cross, dot, length, normal_of, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.row_kernels import node_index
from featherfx.solver.contact.search_kernels import (
    boxes_apart,
    closest_weights,
    corner_node,
    guest_place,
    row_boxes,
    strip_point,
)

# thicknesses beside the other's edge over which a lack fades out
FADE = 3.0
# least cosine between a lift and the normal that it is to act along
LEAST_COSINE = 0.3
# steps from triangle to triangle of a skin
MOST_STEPS = 12
# parts into which the rim between two rows is divided
RIM_PARTS = 3


@kernel
def lift_points(vanes, points, pose, low, high):
    """Lift RowPoints of feathers from low to high - 1 along their rows' dorsal directors, to a
    pose, and fit its boxes."""
    columns, lift, out = vanes.exists.shape[3], pose.lift, pose.points
    for f in range(low, high):
        for i in range(out.shape[1]):
            for k in range(3):
                d = points.directors[f, i, 1, k]
                pose.dorsal[f, i, k] = d
                for c in range(2 * columns + 1):
                    p = strip_point(c, columns)
                    out[f, i, p, k] = points.nodes[f, i, p, k] + lift[f, i, c] * d
        row_boxes(out[f], out[f], vanes.present[f], pose.boxes[f], pose.bounds[f])
        _fit_own(vanes.present[f], out[f], pose.dorsal[f], pose.frames[f], pose.own[f])


@kernel
def _fit_own(present, points, dorsal, frame, own):
    """Origin and axes (4, 3) of a feather's own frame, along the shaft, across and dorsal, and the
    box (6,) around its vane in that."""
    rows, columns = points.shape[0], (present.shape[1] - 1) // 2
    along = sub(points[rows - 1, 0], points[0, 0])
    along = scale(1.0 / length(along), along)
    across = cross(dorsal[rows // 2], along)
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
def _corners(points, place):
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
def _is_there(place, exists):
    side, i, j, half = place
    inside = 0 <= i < exists.shape[1] and 0 <= j < exists.shape[2]
    return inside and exists[side, i, j, half] != 0


@kernel
def _first_place(x, own, exists):
    """A triangle to begin with, near a point (3,) as the feather sees it, at its shaft."""
    rows, part = exists.shape[1], (x[0] - own[0]) / (own[3] - own[0])
    side = 0 if x[1] >= 0.0 else 1
    guess = min(max(int(part * rows), 0), rows - 1)
    for step in range(rows):
        for way in range(2):
            i = guess + step if way == 0 else guess - step
            for half in range(2):
                if _is_there((side, i, 0, half), exists):
                    return side, i, 0, half
                if _is_there((1 - side, i, 0, half), exists):
                    return 1 - side, i, 0, half
    return -1, 0, 0, 0


@kernel
def _walk(x, points, exists, place):
    """The triangle that a point is over, walking from one; at the vane's edge, the nearest that is
    met. Returns it, the weights of its corners, and its normal, not of unit length."""
    weight, product = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    for _ in range(points.shape[0] + points.shape[1]):
        a, b, c = _corners(points, place)
        product, away = normal_of(a, b, c), sub(x, a)
        area = dot(product, product)
        if area <= 0.0:
            break
        second = dot(cross(away, sub(c, a)), product) / area
        third = dot(cross(sub(b, a), away), product) / area
        weight = 1.0 - second - third, second, third
        least = min(weight[0], min(second, third))
        if least >= 0.0:
            break
        k = 0 if least == weight[0] else (1 if least == second else 2)
        after = _beyond(place, k)
        if not _is_there(after, exists):
            # around the corner, if it is beyond another edge, too
            k = (k + 1) % 3 if weight[(k + 1) % 3] < weight[(k + 2) % 3] else (k + 2) % 3
            after = _beyond(place, k)
            if weight[k] >= 0.0 or not _is_there(after, exists):
                weight = closest_weights(x, a, b, c)
                break
        place = after
    return place, weight, product


@kernel
def _boxes_meet(pose, guest, host, low, high):
    """Whether a guest's own box meets a host's, which is from low to high across its vane."""
    frame, box, other, own = pose.frames[host], pose.own[host], pose.frames[guest], pose.own[guest]
    middle = sub(other[0], frame[0])
    for k in range(3):
        middle = add(middle, scale(0.5 * (own[k] + own[3 + k]), other[1 + k]))
    for k in range(3):
        at, reach = dot(frame[1 + k], middle), 0.0
        for j in range(3):
            reach += 0.5 * (own[3 + j] - own[j]) * abs(dot(frame[1 + k], other[1 + j]))
        least, most = (low, high) if k == 2 else (box[k], box[3 + k])
        if at + reach < least or at - reach > most:
            return False
    return True


@kernel
def _lap(vanes, pose, bodies, node, place, margin, lap):
    """The triangle of a host that a guest's node is over, walking from a place, and whether it
    lacks, or may come to lack; then lap is what."""
    columns, (guest, host, above), (i, c, part) = vanes.exists.shape[3], bodies, node
    points, lift, after = pose.points, pose.lift, min(i + 1, pose.points.shape[1] - 1)
    x = guest_place(points[guest], i, strip_point(c, columns), part)
    place, weight, normal = _walk(x, points[host], vanes.exists[host], place)
    first, second, third = _corners(points[host], place)
    y = add(scale(weight[0], first), add(scale(weight[1], second), scale(weight[2], third)))
    size = length(normal)
    if size <= 0.0:
        return place, False
    dorsal = dot(normal, pose.dorsal[host, place[1]]) >= 0.0
    normal, away = scale(1.0 / size if dorsal else -1.0 / size, normal), sub(x, y)
    along, thickness = dot(normal, away), vanes.half[guest] + vanes.half[host]
    gap = (along if above else -along) - thickness
    deepest = min(vanes.deepest[guest], vanes.deepest[host])
    if gap > margin or gap < -2.0 * deepest:
        return place, False
    lap.beside = length(cross(normal, away))
    fade = 1.0 - lap.beside / (FADE * thickness)
    side, lap.own = 1.0 if above else -1.0, dot(normal, pose.dorsal[guest, i])
    lifted = (1.0 - part) * lift[guest, i, c] + part * lift[guest, after, c]
    base, total = -gap + side * lap.own * lifted, 0.0
    for q in range(3):
        row, barb_node = corner_node(place, q)
        column = columns + barb_node if place[0] == 0 else columns - barb_node
        lap.corner[q, 0], lap.corner[q, 1] = row, column
        lap.weight[q] = weight[q] * dot(normal, pose.dorsal[host, row])
        total += lap.weight[q]
        base -= side * lap.weight[q] * lift[host, row, column]
    lap.upper, lap.lower = (guest, host) if above else (host, guest)
    # what would be too deep to be undone is left, little by little
    lap.share = fade * max(0.0, min(1.0, 2.0 - base / deepest))
    lap.above, lap.base = 1 if above else 0, base
    lap.node[0], lap.node[1], lap.part = i, c, part
    return place, fade > 0.0 and min(lap.own, total) >= LEAST_COSINE


@kernel
def _is_rim(present, i, c):
    """Whether the vane ends at a node of this row, and at that of the next row, too."""
    if i + 1 >= present.shape[0] or present[i + 1, c] == 0:
        return False
    return c == 0 or c == present.shape[1] - 1


@kernel
def _points_of(vanes, pose, bodies, margin, laps, count):
    """Laps of the points of a guest; returns how many there are then. bodies: guest, host, and
    whether the guest lies above."""
    guest, host, above = bodies
    frame, own, exists = pose.frames[host], pose.own[host], vanes.exists[host]
    columns, place = exists.shape[2], (-1, 0, 0, 0)
    deepest = 2.0 * min(vanes.deepest[guest], vanes.deepest[host])
    low = own[2] - (deepest if above else margin)
    high = own[5] + (margin if above else deepest)
    if not _boxes_meet(pose, guest, host, low, high):
        return count
    for i in range(pose.points.shape[1]):
        after = min(i + 1, pose.points.shape[1] - 1)
        if boxes_apart(pose.boxes[guest, i], pose.bounds[host], margin) and boxes_apart(
            pose.boxes[guest, after], pose.bounds[host], margin
        ):
            continue
        for c in range(vanes.present.shape[2]):
            if vanes.present[guest, i, c] == 0:
                continue
            for k in range(RIM_PARTS if _is_rim(vanes.present[guest], i, c) else 1):
                node = i, c, k / RIM_PARTS
                x = guest_place(pose.points[guest], i, strip_point(c, columns), node[2])
                away = sub(x, frame[0])
                x, y, z = dot(frame[1], away), dot(frame[2], away), dot(frame[3], away)
                if z < low or z > high or y < own[1] - margin or y > own[4] + margin:
                    continue
                if x < own[0] - margin or x > own[3] + margin:
                    continue
                if place[0] < 0:
                    place = _first_place((x, y, z), own, exists)
                    if place[0] < 0:
                        return count
                lap = laps[min(count, laps.shape[0] - 1)]
                place, found = _lap(vanes, pose, bodies, node, place, margin, lap)
                if found:
                    count += 1
    return count


@kernel
def find_laps(vanes, stack, pose, stale, margin, span, laps):
    """Laps of the pairs span[0] to span[1] - 1 of which a feather is stale; returns how many there
    are. Of those that laps has no room for, only that they are too many is right."""
    count = 0
    for pair in range(span[0], span[1]):
        upper, lower = stack.pairs[pair, 0], stack.pairs[pair, 1]
        if stale[upper] == 0 and stale[lower] == 0:
            continue
        if boxes_apart(pose.bounds[upper], pose.bounds[lower], margin):
            continue
        before = count
        count = _points_of(vanes, pose, (upper, lower, True), margin, laps, count)
        count = _points_of(vanes, pose, (lower, upper, False), margin, laps, count)
        for k in range(before, min(count, laps.shape[0])):
            laps[k].pair = pair
    return count


@kernel
def _corner(skin, ground, triangle, k):
    x = skin[ground.triangles[triangle, k]]
    return x[0], x[1], x[2]


@kernel
def skin_under(x, skin, ground, triangle):
    """Height of a point over a skin (V, 3) m, the normal there, and the triangle that it is over,
    walking from one."""
    normal, height = (0.0, 0.0, 1.0), 0.0
    for _ in range(MOST_STEPS):
        a, b = _corner(skin, ground, triangle, 0), _corner(skin, ground, triangle, 1)
        c = _corner(skin, ground, triangle, 2)
        product = cross(sub(b, a), sub(c, a))
        area = dot(product, product)
        if area <= 0.0:
            break
        normal = scale(area**-0.5, product)
        away = sub(x, a)
        height = dot(normal, away)
        second = dot(cross(away, sub(c, a)), product) / area
        third = dot(cross(sub(b, a), away), product) / area
        first = 1.0 - second - third
        least = min(first, min(second, third))
        if least >= 0.0:
            break
        k = 0 if least == first else (1 if least == second else 2)
        if ground.beside[triangle, k] < 0:
            break
        triangle = ground.beside[triangle, k]
    return height, normal, triangle


@kernel
def bind_nodes(nodes, skin, ground, triangle, height):
    """From the triangles (N,) near nodes (N, 3) m to those that they are over; height: (N,) m."""
    for k in range(nodes.shape[0]):
        height[k], _, triangle[k] = skin_under(nodes[k], skin, ground, triangle[k])


@kernel
def ground_lacks(vanes, pose, ground, skin, wanted, low, high):
    """Lifts (m) that a skin (V, 3) m asks of the nodes of feathers from low to high - 1."""
    columns, points, lift = vanes.exists.shape[3], pose.points, pose.lift
    for f in range(low, high):
        for i in range(points.shape[1]):
            for c in range(2 * columns + 1):
                triangle = ground.triangle[f, i, c]
                if triangle < 0:
                    continue
                x = points[f, i, strip_point(c, columns)]
                height, normal, _ = skin_under(x, skin, ground, triangle)
                own = dot(normal, pose.dorsal[f, i])
                if own < LEAST_COSINE:
                    continue
                lack = ground.clear[f, i, c] - height + own * lift[f, i, c]
                if lack < 2.0 * vanes.deepest[f]:
                    wanted[f, i, c] = max(wanted[f, i, c], lack / own)
