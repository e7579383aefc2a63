"""Laps of vanes over each other and over the skin, and the gaps that they lack.

A point x of one feather and the point y beneath or above it on a triangle of the other, with the
triangle's dorsal normal N, lack  t - s N . (x - y),  s = 1 if x is of the upper feather, else -1,
t the sum of both half thicknesses. Every row is lifted along its way d, so a lift w of a node
moves it by (d . N) w along the normal. Points are the nodes, and some on the rims between
them, because rims cross between nodes.
"""

from featherfx.algebra.vector_kernels import add, cross, dot, length, normal_of, scale, sub
from featherfx.jit.compiled import kernel
from featherfx.shot.layers.pose_kernels import field_of
from featherfx.shot.layers.walk_kernels import corners_of, first_place, walk, way_out
from featherfx.solver.contact.ground_kernels import skin_under
from featherfx.solver.contact.search_kernels import (
    boxes_apart,
    closest_weights,
    corner_node,
    strip_point,
)
from featherfx.solver.contact.wall_kernels import weighted

# thicknesses beside the other's edge up to which a point touches it, and at which a lack has faded
BESIDE, FADE = 1.0, 3.0
# least cosine between a lift and the normal that it is to act along
_MIN_COSINE = 0.5
# of the depth that is undone, lift up to which all is given that is asked for; none at twice it
WHOLE = 1.5
# of the depth that is undone, up to which feathers keep their order of which a limb carries one
CARRIED_BY = 0.1
# parts into which the rim between two rows is divided
RIM_PARTS = 3
# over a distance along a vane's normals, that along the third axis of the vane's own frame
LEAN = 1.5
# what a lift changes within a sample, over a feather's length, with which pairs that were apart may
# come to lap
YIELD = 0.05


def most_laps(rows, nodes):
    """Bound the laps of a pair of vanes with so many nodes in each row: from the nodes, the edges
    of three ways and the rims of both, and what leads from the base of either."""
    return 2 * (4 * rows * nodes + (2 * (rows - 1) + nodes) * (RIM_PARTS - 1))


@kernel
def _deepest(vanes, one, other):
    """m, depth of a pair that is undone."""
    return min(vanes.deepest[one], vanes.deepest[other])


@kernel
def _has_left(vanes, upper, lower, laps, start, count):
    """Return whether laps from start to count are of a pair that a limb has brought so far through
    each other that its order says nothing any more: it has left where it lay, and comes by
    again."""
    if vanes.limb[upper] == vanes.limb[lower]:
        return False
    depth = 0.0
    for k in range(start, count):
        depth = max(depth, laps[k].base - laps[k].clear)
    return depth > CARRIED_BY * _deepest(vanes, upper, lower)


@kernel
def _boxes_meet(pose, guest, host, low, high):
    """Return whether a guest's own box meets a host's, which is from low to high across its
    vane."""
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
    place, weight, normal, inside = walk(x, pose.points[host], vanes.exists[host], place)
    first, second, third = corners_of(pose.points[host], place)
    y = add(scale(weight[0], first), add(scale(weight[1], second), scale(weight[2], third)))
    size = length(normal)
    if size <= 0.0:
        return place, inside, False
    dorsal = dot(normal, pose.way[host, place[1]]) >= 0.0
    normal, away = scale(1.0 / size if dorsal else -1.0 / size, normal), sub(x, y)
    along, thickness = dot(normal, away), vanes.half[guest] + vanes.half[host]
    lap.clear = min(vanes.clear[guest], vanes.clear[host])
    gap = (along if above else -along) - thickness
    deepest = _deepest(vanes, guest, host)
    if gap > margin or gap < -2.0 * deepest:
        return place, inside, False
    lap.beside = length(cross(normal, away))
    fade = min(1.0, (FADE - lap.beside / thickness) / (FADE - BESIDE))
    side = 1.0 if above else -1.0
    own = dot(normal, pose.way[guest, node[0]])
    lap.own = (1.0 - part) * own + part * dot(normal, pose.way[guest, after[0]])
    lifted = (1.0 - part) * lift[guest, node[0], node[1]] + part * lift[guest, after[0], after[1]]
    base, total = lap.clear - gap + side * lap.own * lifted, 0.0
    for q in range(3):
        row, barb_node = corner_node(place, q)
        column = columns + barb_node if place[0] == 0 else columns - barb_node
        lap.corner[q, 0], lap.corner[q, 1] = row, column
        lap.weight[q] = weight[q] * dot(normal, pose.way[host, row])
        total += lap.weight[q]
        base -= side * lap.weight[q] * lift[host, row, column]
    lap.upper, lap.lower = (guest, host) if above else (host, guest)
    # what would need too much of a lift is left, little by little
    lifts = base / (deepest * (lap.own if above else total))
    lap.share = fade * max(0.0, min(1.0, (2.0 - lifts) / (2.0 - WHOLE)))
    lap.above, lap.base = 1 if above else 0, base
    lap.node[0], lap.node[1], lap.after[0], lap.after[1] = node[0], node[1], after[0], after[1]
    lap.part = part
    return place, inside, fade > 0.0 and min(lap.own, total) >= _MIN_COSINE


@kernel
def _nodes_of(vanes, pose, bodies, margin, laps, count, seen):
    """Laps of the nodes of a guest; returns how many there are then, and whether any node is near.
    bodies: guest, host, and whether the guest lies above. seen: (n, 2 m + 1, 5) becomes 1 for nodes
    that are over the host, 2 beside it, and its triangle there; 0 for those that are not near."""
    guest, host, above = bodies
    frame, own, exists = pose.frames[host], pose.own[host], vanes.exists[host]
    columns, place, near = exists.shape[2], (-1, 0, 0, 0), False
    deepest = 2.0 * _deepest(vanes, guest, host)
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
            heights = pose.heights[host, field_of(x, own, 0), field_of(y, own, 1)]
            if z < heights[0] - under or z > heights[1] + over:
                continue
            if place[0] < 0:
                place = first_place((x, y, z), own, exists)
                if place[0] < 0:
                    return count, near
            lap = laps[count]
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
    the guest's own rims and on the long edges that lead from its vane's base."""
    exists = vanes.exists[bodies[0]]
    for i in range(seen.shape[0]):
        for c in range(seen.shape[1]):
            for way in range(3):
                row, column, there = _edge_from(exists, i, c, way)
                if not there or max(seen[i, c, 0], seen[row, column, 0]) == 0:
                    continue
                one, other = seen[i, c, 0] == 1, seen[row, column, 0] == 1
                base = i <= vanes.first[bodies[0]]
                rim = way == 0 and (base or c == 0 or c == seen.shape[1] - 1)
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
                        lap = laps[count]
                        point = (i, c), (row, column), k / RIM_PARTS
                        place, _, found = _lap(vanes, pose, bodies, point, place, margin, lap)
                        if found:
                            count += 1
    return count


@kernel
def _leads_away(vanes, pose, bodies, edge, place, margin):
    """Return whether an edge stays farther than a margin from where a triangle's plane goes on."""
    (guest, host, above), (node, after) = bodies, edge
    columns, points = vanes.exists.shape[3], pose.points[guest]
    a, b, c = corners_of(pose.points[host], place)
    normal = normal_of(a, b, c)
    size = length(normal)
    if size <= 0.0:
        return True
    up = (dot(normal, pose.way[host, place[1]]) >= 0.0) == above
    normal = scale(1.0 / size if up else -1.0 / size, normal)
    first = dot(normal, sub(points[node[0], strip_point(node[1], columns)], a))
    second = dot(normal, sub(points[after[0], strip_point(after[1], columns)], a))
    bent = min(vanes.clear[guest], vanes.clear[host])
    return min(first, second) > margin + bent + vanes.half[guest] + vanes.half[host]


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
    part, place = way_out(x, y, pose.points[host], exists, place)
    if part <= 0.0:
        return count
    lap = laps[count]
    place, _, found = _lap(vanes, pose, bodies, (node, after, part), place, margin, lap)
    return count + 1 if found else count


@kernel
def _may_lap(vanes, pose, upper, lower, margin):
    """Return whether the own boxes of two feathers meet, each in the other's frame."""
    if boxes_apart(pose.bounds[upper], pose.bounds[lower], margin):
        return False
    deepest = 2.0 * _deepest(vanes, upper, lower)
    own = pose.own[lower]
    if not _boxes_meet(pose, upper, lower, own[2] - deepest, own[5] + margin):
        return False
    own = pose.own[upper]
    return _boxes_meet(pose, lower, upper, own[2] - margin, own[5] + deepest)


@kernel
def _margin(vanes, upper, lower, follow):
    """Gap of a pair up to which points count."""
    between = min(vanes.clear[upper], vanes.clear[lower])
    return follow * (vanes.half[upper] + vanes.half[lower]) + between


@kernel
def meeting_pairs(vanes, stack, pose, follow, meets, height):
    """Find the pairs that may come to lap where feathers are lifted otherwise than in a pose by no
    more than YIELD over the length of the upper one, meets (K,); and how many feathers, at most,
    lie on each other under each, height (F,). follow: as of find_laps."""
    for k in range(stack.order.shape[0]):
        f, highest = stack.order[k], 0
        size = pose.own[f, 3] - pose.own[f, 0]
        for pair in range(stack.first[k], stack.first[k + 1]):
            lower = stack.pairs[pair, 1]
            margin = YIELD * size + _margin(vanes, f, lower, follow)
            meets[pair] = 1 if _may_lap(vanes, pose, f, lower, margin) else 0
            if meets[pair] != 0:
                highest = max(highest, height[lower] + 1)
        height[f] = highest


@kernel
def find_laps(vanes, stack, pose, follow, sought, laps, seen):
    """Laps of pairs, in their order; returns how many there are. follow: gap up to which points
    count, in thicknesses. sought: the first pair and the one after the last, and (K,) which of them
    to look at. laps: room for most_laps of each, and one more. seen: scratch, (n, 2 m + 1, 5)."""
    count, (span, meets) = 0, sought
    for pair in range(span[0], span[1]):
        if meets[pair] == 0:
            continue
        upper, lower, start = stack.pairs[pair, 0], stack.pairs[pair, 1], count
        margin = _margin(vanes, upper, lower, follow)
        if not _may_lap(vanes, pose, upper, lower, margin):
            continue
        for role in range(2):
            bodies = (upper, lower, True) if role == 0 else (lower, upper, False)
            count, near = _nodes_of(vanes, pose, bodies, margin, laps, count, seen)
            if near:
                count = _edges_of(vanes, pose, bodies, margin, laps, count, seen)
        if _has_left(vanes, upper, lower, laps, start, count):
            count = start
        for k in range(start, count):
            laps[k].pair = pair
    return count


@kernel
def ground_lacks(vanes, pose, ground, skin, f, asked):
    """Lifts (n, 2 m + 1) m that a skin (V, 3) m asks of the nodes of a feather."""
    points, lift = pose.points, pose.lift
    for i in range(points.shape[1]):
        for c in range(asked.shape[1]):
            asked[i, c] = 0.0
            triangle = ground.triangle[f, i, c]
            if triangle < 0:
                continue
            x = points[f, i, strip_point(c, vanes.exists.shape[3])]
            height, normal, triangle = skin_under(x, skin, ground, triangle)
            own = dot(normal, pose.way[f, i])
            lack = ground.clear[f, i, c] - height + own * lift[f, i, c]
            if own >= _MIN_COSINE and 0.0 < lack < 2.0 * vanes.deepest[f]:
                near = abs(height) + vanes.half[f] + vanes.clear[f]
                asked[i, c] = _over(x, (height, normal), skin, ground, triangle, near) * lack / own


@kernel
def _over(x, seen, skin, ground, triangle, near):
    """Measure how far a point is over the triangle of a skin that it has come to, not beside it as
    what has left the skin is: 1 where it is beside it by no more than near (m), 0 from twice that
    on. seen: its height over the triangle's plane, and the normal."""
    (height, normal), corners = seen, ground.triangles[triangle]
    a, b, c = skin[corners[0]], skin[corners[1]], skin[corners[2]]
    weight = closest_weights(x, (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2]))
    away = sub(x, weighted(skin, corners, weight))
    beside = length(sub(away, scale(height, normal)))
    return max(0.0, min(1.0, 2.0 - beside / near))
