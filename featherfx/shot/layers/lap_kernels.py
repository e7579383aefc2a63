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
from featherfx.solver.contact.ground_kernels import skin_under
from featherfx.solver.contact.search_kernels import (
    boxes_apart,
    closest_weights,
    corner_node,
    row_boxes,
    strip_point,
)

# thicknesses beside the other's edge over which a lack fades out
FADE = 3.0
# least cosine between a lift and the normal that it is to act along
LEAST_COSINE = 0.5
# parts into which the rim between two rows is divided
RIM_PARTS = 3
# fields along and across a vane of which the heights are known
FIELDS = 12, 8
# over a distance along a vane's normals, that along the third axis of the vane's own frame
LEAN = 1.5


@kernel
def lift_points(vanes, points, lift, pose, fresh, low, high):
    """Lift RowPoints of feathers from low to high - 1 along their rows' dorsal directors, to a
    pose, and fit its boxes and heights. fresh: whether the points are others than before; else
    only feathers with another lift are moved."""
    columns, out, thickest = vanes.exists.shape[3], pose.points, 0.0
    for f in range(vanes.half.shape[0]):
        thickest = max(thickest, vanes.half[f])
    for f in range(low, high):
        pose.moved[f] = 1 if fresh or _differ(lift[f], pose.lift[f]) else 0
        if pose.moved[f] == 0:
            continue
        for i in range(out.shape[1]):
            for k in range(3):
                pose.dorsal[f, i, k] = points.directors[f, i, 1, k]
            for c in range(2 * columns + 1):
                p, pose.lift[f, i, c] = strip_point(c, columns), lift[f, i, c]
                for k in range(3):
                    risen = lift[f, i, c] * pose.dorsal[f, i, k]
                    out[f, i, p, k] = points.nodes[f, i, p, k] + risen
        row_boxes(out[f], out[f], vanes.present[f], pose.boxes[f], pose.bounds[f])
        _fit_own(vanes.present[f], out[f], pose.dorsal[f], pose.frames[f], pose.own[f])
        own = pose.frames[f], pose.own[f]
        _fit_heights(vanes.exists[f], out[f], own, 2.0 * FADE * thickest, pose.heights[f])


@kernel
def _differ(first, second):
    for i in range(first.shape[0]):
        for c in range(first.shape[1]):
            if first[i, c] != second[i, c]:
                return True
    return False


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
def _field(x, own, k):
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
                        corners = _corners(points, (side, i, j, half))
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
    for p in range(_field(first, own, 0), _field(last, own, 0) + 1):
        for q in range(_field(left, own, 1), _field(right, own, 1) + 1):
            heights[p, q, 0] = min(heights[p, q, 0], low)
            heights[p, q, 1] = max(heights[p, q, 1], high)


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
    met. Returns it, the weights of its corners, its normal, not of unit length, and whether the
    point is over it, not beside."""
    weight, product, inside = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), False
    before = place
    for _ in range(points.shape[0] + points.shape[1]):
        a, b, c = _corners(points, place)
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
        if not _is_there(after, exists):
            # around the corner, if it is beyond another edge, too
            k = (k + 1) % 3 if weight[(k + 1) % 3] < weight[(k + 2) % 3] else (k + 2) % 3
            after = _beyond(place, k)
            if weight[k] >= 0.0 or not _is_there(after, exists):
                weight = closest_weights(x, a, b, c)
                break
        if after == before:
            # over the ridge between two triangles, beyond either along its normal
            weight, inside = closest_weights(x, a, b, c), True
            break
        before, place = place, after
    return place, weight, product, inside


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
def _on_edge(points, node, after, part, columns):
    """A part of the way from one node (row, column) of points (n, 1 + 2 m, 3) to another."""
    x = points[node[0], strip_point(node[1], columns)]
    y = points[after[0], strip_point(after[1], columns)]
    return add(scale(1.0 - part, x), scale(part, y))


@kernel
def _lap(vanes, pose, bodies, point, place, margin, lap):
    """The triangle of a host that a guest's point is over, walking from a place, whether it is
    beside it, and whether it lacks, or may come to lack; then lap is what.

    point: two nodes, and which part of the way from one to the other it lies."""
    columns, (guest, host, above), (node, after, part) = vanes.exists.shape[3], bodies, point
    lift, x = pose.lift, _on_edge(pose.points[guest], node, after, part, columns)
    place, weight, normal, inside = _walk(x, pose.points[host], vanes.exists[host], place)
    first, second, third = _corners(pose.points[host], place)
    y = add(scale(weight[0], first), add(scale(weight[1], second), scale(weight[2], third)))
    size = length(normal)
    if size <= 0.0:
        return place, inside, False
    dorsal = dot(normal, pose.dorsal[host, place[1]]) >= 0.0
    normal, away = scale(1.0 / size if dorsal else -1.0 / size, normal), sub(x, y)
    along, thickness = dot(normal, away), vanes.half[guest] + vanes.half[host]
    lap.clear = min(vanes.clear[guest], vanes.clear[host])
    gap = (along if above else -along) - thickness
    deepest = min(vanes.deepest[guest], vanes.deepest[host])
    if gap > margin or gap < -2.0 * deepest:
        return place, inside, False
    lap.beside = length(cross(normal, away))
    fade = 1.0 - lap.beside / (FADE * thickness)
    side = 1.0 if above else -1.0
    own = dot(normal, pose.dorsal[guest, node[0]])
    lap.own = (1.0 - part) * own + part * dot(normal, pose.dorsal[guest, after[0]])
    lifted = (1.0 - part) * lift[guest, node[0], node[1]] + part * lift[guest, after[0], after[1]]
    base, total = lap.clear - gap + side * lap.own * lifted, 0.0
    for q in range(3):
        row, barb_node = corner_node(place, q)
        column = columns + barb_node if place[0] == 0 else columns - barb_node
        lap.corner[q, 0], lap.corner[q, 1] = row, column
        lap.weight[q] = weight[q] * dot(normal, pose.dorsal[host, row])
        total += lap.weight[q]
        base -= side * lap.weight[q] * lift[host, row, column]
    lap.upper, lap.lower = (guest, host) if above else (host, guest)
    # what would need too much of a lift is left, little by little
    lap.share = fade * max(0.0, min(1.0, 2.0 - base / (deepest * (lap.own if above else total))))
    lap.above, lap.base = 1 if above else 0, base
    lap.node[0], lap.node[1], lap.after[0], lap.after[1] = node[0], node[1], after[0], after[1]
    lap.part = part
    return place, inside, fade > 0.0 and min(lap.own, total) >= LEAST_COSINE


@kernel
def _nodes_of(vanes, pose, bodies, margin, laps, count, seen):
    """Laps of the nodes of a guest; returns how many there are then, and whether any node is near.
    bodies: guest, host, and whether the guest lies above. seen: (n, 2 m + 1, 5) becomes 1 for nodes
    that are over the host, 2 beside it, and its triangle there; 0 for those that are not near."""
    guest, host, above = bodies
    frame, own, exists = pose.frames[host], pose.own[host], vanes.exists[host]
    columns, place, near = exists.shape[2], (-1, 0, 0, 0), False
    deepest = 2.0 * min(vanes.deepest[guest], vanes.deepest[host])
    followed = LEAN * (margin + vanes.half[guest] + vanes.half[host])
    under, over = (LEAN * deepest, followed) if above else (followed, LEAN * deepest)
    for i in range(pose.points.shape[1]):
        for c in range(vanes.present.shape[2]):
            seen[i, c, 0] = 0
        if boxes_apart(pose.boxes[guest, i], pose.bounds[host], margin):
            continue
        for c in range(vanes.present.shape[2]):
            if vanes.present[guest, i, c] == 0:
                continue
            node, p = (i, c), strip_point(c, columns)
            away = sub(pose.points[guest, i, p], frame[0])
            x, y, z = dot(frame[1], away), dot(frame[2], away), dot(frame[3], away)
            if y < own[1] - margin or y > own[4] + margin:
                continue
            if x < own[0] - margin or x > own[3] + margin:
                continue
            heights = pose.heights[host, _field(x, own, 0), _field(y, own, 1)]
            if z < heights[0] - under or z > heights[1] + over:
                continue
            if place[0] < 0:
                place = _first_place((x, y, z), own, exists)
                if place[0] < 0:
                    return count, near
            lap = laps[min(count, laps.shape[0] - 1)]
            point = node, node, 0.0
            place, inside, found = _lap(vanes, pose, bodies, point, place, margin, lap)
            if found:
                count += 1
            near = True
            seen[i, c, 0] = 1 if inside else 2
            seen[i, c, 1], seen[i, c, 2], seen[i, c, 3], seen[i, c, 4] = place
    return count, near


@kernel
def _edge_from(exists, i, c, way):
    """The node to which an edge leads from one, over to the next row, along the barb or across a
    cell, and whether a triangle has it."""
    columns = exists.shape[2]
    if way == 0:
        side, j = (0, c - columns) if c >= columns else (1, columns - c)
        there = j < columns and i < exists.shape[1] and exists[side, i, j, 0] != 0
        if not there and j > 0:
            there = i < exists.shape[1] and exists[side, i, j - 1, 1] != 0
        if not there and j == 0:
            there = i < exists.shape[1] and exists[1, i, 0, 0] != 0
        return i + 1, c, there
    side, j = (0, c - columns) if c >= columns else (1, columns - c - 1)
    if j >= columns or c + 1 > 2 * columns:
        return i, c, False
    first = i < exists.shape[1] and exists[side, i, j, 0] != 0
    before = i > 0 and exists[side, i - 1, j, 1] != 0
    if way == 1:
        return i, c + 1, first or before
    second = i < exists.shape[1] and exists[side, i, j, 1] != 0
    # across a cell, from the inner node of the upper row to the outer one of the row before
    if side == 0:
        before = i > 0 and (exists[side, i - 1, j, 0] != 0 or exists[side, i - 1, j, 1] != 0)
        return i - 1, c + 1, before
    return i + 1, c + 1, first or second


@kernel
def _edges_of(vanes, pose, bodies, margin, laps, count, seen):
    """As _nodes_of, of points where an edge of a guest leaves the host's outline, and of some on
    the guest's own rims."""
    exists = vanes.exists[bodies[0]]
    for i in range(seen.shape[0]):
        for c in range(seen.shape[1]):
            for way in range(3):
                row, column, there = _edge_from(exists, i, c, way)
                if not there or max(seen[i, c, 0], seen[row, column, 0]) == 0:
                    continue
                one, other = seen[i, c, 0] == 1, seen[row, column, 0] == 1
                rim = way == 0 and (c == 0 or c == seen.shape[1] - 1)
                if one != other:
                    edge = (i, c), (row, column)
                    count = _at_outline(vanes, pose, bodies, edge, margin, laps, count, seen)
                if rim:
                    near = seen[i, c] if seen[i, c, 0] != 0 else seen[row, column]
                    place = near[1], near[2], near[3], near[4]
                    edge = (i, c), (row, column)
                    if _leads_away(vanes, pose, bodies, edge, place, margin):
                        continue
                    for k in range(1, RIM_PARTS):
                        lap = laps[min(count, laps.shape[0] - 1)]
                        point = (i, c), (row, column), k / RIM_PARTS
                        place, _, found = _lap(vanes, pose, bodies, point, place, margin, lap)
                        if found:
                            count += 1
    return count


@kernel
def _leads_away(vanes, pose, bodies, edge, place, margin):
    """Whether an edge stays farther than a margin from where a triangle's plane goes on."""
    (guest, host, above), (node, after) = bodies, edge
    columns, points = vanes.exists.shape[3], pose.points[guest]
    a, b, c = _corners(pose.points[host], place)
    normal = normal_of(a, b, c)
    size = length(normal)
    if size <= 0.0:
        return True
    up = (dot(normal, pose.dorsal[host, place[1]]) >= 0.0) == above
    normal = scale(1.0 / size if up else -1.0 / size, normal)
    first = dot(normal, sub(points[node[0], strip_point(node[1], columns)], a))
    second = dot(normal, sub(points[after[0], strip_point(after[1], columns)], a))
    bent = min(vanes.clear[guest], vanes.clear[host])
    return min(first, second) > margin + bent + vanes.half[guest] + vanes.half[host]


@kernel
def _parted(x, corners, normal, area):
    """Weights of a triangle's corners at a point, seen along its normal."""
    a, b, c = corners
    away = sub(x, a)
    second = dot(cross(away, sub(c, a)), normal) / area
    third = dot(cross(sub(b, a), away), normal) / area
    return 1.0 - second - third, second, third


@kernel
def _way_out(start, end, points, exists, place):
    """Part of the way from a point over a triangle to another at which the vane ends, 1 where it
    does not, and the triangle there."""
    part = 0.0
    for _ in range(points.shape[0] + points.shape[1]):
        corners = _corners(points, place)
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
        if not _is_there(after, exists):
            break
        place = after
    return part, place


@kernel
def _at_outline(vanes, pose, bodies, edge, margin, laps, count, seen):
    """The lap where the edge between two nodes, of which one is over the host, leaves it, or at the
    other node, where it does not."""
    (guest, host, _), (node, after) = bodies, edge
    columns, exists = vanes.exists.shape[3], vanes.exists[host]
    if seen[node[0], node[1], 0] != 1:
        node, after = after, node
    start = seen[node[0], node[1]]
    place = start[1], start[2], start[3], start[4]
    if _leads_away(vanes, pose, bodies, (node, after), place, margin):
        return count
    x = _on_edge(pose.points[guest], node, after, 0.0, columns)
    y = _on_edge(pose.points[guest], node, after, 1.0, columns)
    part, place = _way_out(x, y, pose.points[host], exists, place)
    if part <= 0.0:
        return count
    lap = laps[min(count, laps.shape[0] - 1)]
    place, _, found = _lap(vanes, pose, bodies, (node, after, part), place, margin, lap)
    return count + 1 if found else count


@kernel
def _may_lap(vanes, pose, upper, lower, margin):
    """Whether the own boxes of two feathers meet, each in the other's frame."""
    if boxes_apart(pose.bounds[upper], pose.bounds[lower], margin):
        return False
    deepest = 2.0 * min(vanes.deepest[upper], vanes.deepest[lower])
    own = pose.own[lower]
    if not _boxes_meet(pose, upper, lower, own[2] - deepest, own[5] + margin):
        return False
    own = pose.own[upper]
    return _boxes_meet(pose, lower, upper, own[2] - margin, own[5] + deepest)


@kernel
def find_laps(vanes, stack, pose, stale, follow, span, before, laps, seen):
    """Laps of the pairs span[0] to span[1] - 1, in their order; returns how many there are. Of
    those that laps has no room for, only that they are too many is right. before: those of the same
    pairs, which hold where neither feather is stale. follow: gap up to which points count, in
    thicknesses. seen: scratch, (n, 2 m + 1, 5)."""
    count, known = 0, 0
    for pair in range(span[0], span[1]):
        upper, lower = stack.pairs[pair, 0], stack.pairs[pair, 1]
        holds, start = stale[upper] == 0 and stale[lower] == 0, count
        while known < before.shape[0] and before[known].pair == pair:
            if holds:
                laps[min(count, laps.shape[0] - 1)] = before[known]
                count += 1
            known += 1
        if holds:
            continue
        margin = follow * (vanes.half[upper] + vanes.half[lower])
        margin += min(vanes.clear[upper], vanes.clear[lower])
        if not _may_lap(vanes, pose, upper, lower, margin):
            continue
        for role in range(2):
            bodies = (upper, lower, True) if role == 0 else (lower, upper, False)
            count, near = _nodes_of(vanes, pose, bodies, margin, laps, count, seen)
            if near:
                count = _edges_of(vanes, pose, bodies, margin, laps, count, seen)
        for k in range(start, min(count, laps.shape[0])):
            laps[k].pair = pair
    return count


@kernel
def ground_lacks(vanes, pose, ground, skin, asked, low, high):
    """Lifts (m) that a skin (V, 3) m asks of the nodes of feathers from low to high - 1 that have
    moved in the pose."""
    columns, points, lift = vanes.exists.shape[3], pose.points, pose.lift
    for f in range(low, high):
        if pose.moved[f] == 0:
            continue
        for i in range(points.shape[1]):
            for c in range(2 * columns + 1):
                triangle = ground.triangle[f, i, c]
                if triangle < 0:
                    continue
                x = points[f, i, strip_point(c, columns)]
                height, normal, _ = skin_under(x, skin, ground, triangle)
                own = dot(normal, pose.dorsal[f, i])
                lack = ground.clear[f, i, c] - height + own * lift[f, i, c]
                facing = own >= LEAST_COSINE and lack < 2.0 * vanes.deepest[f]
                asked[f, i, c] = max(lack / own, 0.0) if facing else 0.0
