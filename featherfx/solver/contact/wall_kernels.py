"""Nodes of vanes against the triangles of bodies whose motion is given (walls).

The closest triangle counts as it stands at the interval's start, when the node was still outside;
its plane is then carried along to the end. Triangles are found in a grid of cubes, each of which
lists those that come within reach of it. Outside is where the triangle's normal points.
"""

from math import floor, sqrt

from featherfx.jit.compiled import kernel
from featherfx.solver.contact.find_kernels import BESIDE, BESIDE_SHARE, CREASE, KEPT, SMALL
from featherfx.solver.contact.list_kernels import (
    COLUMN,
    GUEST,
    GUEST_FORCE,
    GUEST_POINT,
    GUEST_STIFFNESS,
    HOST,
    HOST_FORCE,
    HOST_STIFFNESS,
    MIRROR,
    PAIR,
    ROW,
    SHARE,
    SIDE,
    SPARED,
    START_GAP,
    THICKNESS,
)
from featherfx.solver.contact.search_kernels import (
    closest_weights,
    guest_place,
    guest_point,
    side_normal,
)


@kernel
def count_cells(points, triangles, grid, counts):
    """How many triangles each cube lists, added to counts (cubes,).

    points: (V, 3). grid: (8,) origin, edge of a cube, reach (m), cubes along the axes.
    """
    _cells(points, triangles, grid, counts, counts, False)


@kernel
def fill_cells(points, triangles, grid, places, items):
    """Triangles of each cube, to items from places (cubes,) on, which are advanced."""
    _cells(points, triangles, grid, places, items, True)


@kernel
def _cells(points, triangles, grid, places, items, filling):
    edge, reach = grid[3], grid[4]
    for t in range(triangles.shape[0]):
        l0, h0 = _range(points, triangles[t], 0, grid[0], edge, reach, int(grid[5]))
        l1, h1 = _range(points, triangles[t], 1, grid[1], edge, reach, int(grid[6]))
        l2, h2 = _range(points, triangles[t], 2, grid[2], edge, reach, int(grid[7]))
        for i in range(l0, h0 + 1):
            for j in range(l1, h1 + 1):
                for k in range(l2, h2 + 1):
                    cube = (i * int(grid[6]) + j) * int(grid[7]) + k
                    if filling:
                        items[places[cube]] = t
                    places[cube] += 1


@kernel
def _range(points, corners, axis, origin, edge, reach, cubes):
    """First and last cube along an axis that a triangle comes within reach of."""
    a, b, c = points[corners[0], axis], points[corners[1], axis], points[corners[2], axis]
    low = floor((min(a, min(b, c)) - reach - origin) / edge)
    high = floor((max(a, max(b, c)) + reach - origin) / edge)
    return max(low, 0), min(high, cubes - 1)


@kernel
def _closest_triangle(x, points, triangles, first, items, grid, weight):
    """(triangle, square of its distance) closest to x (3,) of those its cube lists, or -1.

    Of several that share the closest point the one seen most from the front or back counts.
    """
    cube = 0
    for axis in range(3):
        place = floor((x[axis] - grid[axis]) / grid[3])
        if place < 0 or place >= int(grid[5 + axis]):
            return -1, 0.0
        cube = cube * int(grid[5 + axis]) + place
    found, best, facing = -1, 1e300, 0.0
    for at in range(first[cube], first[cube + 1]):
        t = items[at]
        a, b, c = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        wa, wb, wc = closest_weights(x[0], x[1], x[2], a, b, c)
        dx = x[0] - wa * a[0] - wb * b[0] - wc * c[0]
        dy = x[1] - wa * a[1] - wb * b[1] - wc * c[1]
        dz = x[2] - wa * a[2] - wb * b[2] - wc * c[2]
        square = dx * dx + dy * dy + dz * dz
        if square > best * (1.0 + 1e-9) + 1e-24:
            continue
        nx, ny, nz = side_normal(1, a, b, c)
        seen = abs(nx * dx + ny * dy + nz * dz)
        if found >= 0 and square >= best * (1.0 - 1e-9) - 1e-24 and seen <= facing:
            continue
        found, best, facing = t, square, seen
        weight[0], weight[1], weight[2] = wa, wb, wc
    return found, best


@kernel
def _meet(body, i, c, wall, skin, scene, memory, limits, touch, count):
    """Add the contact of a node with a wall, if there is one; returns the count."""
    columns = skin.exists.shape[3]
    p, part = guest_point(c, columns, skin.columns[body])
    x, weight, ahead = touch.guest, touch.weight[count], touch.guest_ahead
    guest_place(scene.start[body], i, p, part, x)
    guest_place(scene.ahead[body], i, p, part, ahead)
    t, square = _closest_triangle(
        x, wall.start, wall.triangles, wall.first, wall.items, wall.grid, weight
    )
    if t < 0:
        memory.inside[body, i, c] = 0
        return count
    corner = wall.triangles[t]
    a, b, d = wall.start[corner[0]], wall.start[corner[1]], wall.start[corner[2]]
    nx, ny, nz = side_normal(1, a, b, d)
    a, b, d = wall.end[corner[0]], wall.end[corner[1]], wall.end[corner[2]]
    ex, ey, ez = side_normal(1, a, b, d)
    normal = touch.normal[count]
    normal[0], normal[1], normal[2] = ex, ey, ez
    old, new = touch.place_start[count], touch.place_now[count]
    for k in range(3):
        old[k], new[k] = 0.0, 0.0
        for q in range(3):
            old[k] += weight[q] * wall.start[corner[q], k]
            new[k] += weight[q] * wall.end[corner[q], k]
    along = nx * (x[0] - old[0]) + ny * (x[1] - old[1]) + nz * (x[2] - old[2])
    thickness = 2.0 * skin.half[body, i, p]
    beside = sqrt(max(0.0, square - along * along))
    # both ways count: a node that a wall drives on in the last try does not near it
    own, walls = 0.0, 0.0
    for k in range(3):
        own += normal[k] * (ahead[k] - x[k])
        walls += normal[k] * (new[k] - old[k])
    closing = abs(own) + abs(walls)
    outside = along >= 0.0
    if wall.beginning != 0 and not outside:
        memory.inside[body, i, c] = 1
    if outside:
        memory.inside[body, i, c] = 0
    height = min(abs(along), CREASE * thickness)
    if beside > BESIDE * thickness + BESIDE_SHARE * height + closing:
        return count
    if along - thickness > limits[0] + closing or memory.inside[body, i, c] != 0:
        return count
    index, value = touch.who[count], touch.value[count]
    index[PAIR], index[ROW], index[COLUMN], index[GUEST_POINT] = -1, i, c, p
    index[GUEST], index[HOST], index[SIDE], index[MIRROR] = body, -1, 1, 0
    depth = max(0.0, thickness - along)
    value[START_GAP] = along - thickness + depth
    value[THICKNESS] = thickness
    value[SPARED] = max(KEPT * min(depth, SMALL * thickness), depth - limits[1])
    value[GUEST_FORCE] = memory.wall[body, i, c]
    value[HOST_FORCE] = memory.wall[body, i, c]
    value[GUEST_STIFFNESS] = limits[2] * scene.impedance[body, i, p]
    value[HOST_STIFFNESS] = value[GUEST_STIFFNESS]
    value[SHARE] = part
    return count + 1


@kernel
def find_wall_contacts(wall, skin, scene, memory, limits, touch, count):
    """Contacts of all bodies with a wall, written to touch behind the first count; their number.

    limits: (3,) gap below which a node is followed, way that a depth may be reduced by (m), and
    stiffness of the contact over that of the node.
    """
    grid = wall.grid
    for body in range(scene.start.shape[0]):
        bounds = scene.bounds[body]
        away = False
        for k in range(3):
            if bounds[3 + k] < grid[k] or bounds[k] > grid[k] + grid[3] * grid[5 + k]:
                away = True
        if away:
            continue
        for i in range(skin.present.shape[1]):
            for c in range(skin.guests.shape[2]):
                if skin.guests[body, i, c] == 0:
                    continue
                if count >= touch.who.shape[0]:
                    return count + 1
                count = _meet(body, i, c, wall, skin, scene, memory, limits, touch, count)
    return count
