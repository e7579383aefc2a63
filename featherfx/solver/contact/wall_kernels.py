"""Nodes of vanes against the triangles of bodies whose motion is given (walls).

The closest triangle counts as it stands at the interval's start, when the node was still outside;
its plane is then carried along to the end. Triangles are found in a grid of cubes (CubeGrid), each
of which lists those that come within reach of it. Outside is where the triangle's normal points.

The skin under feathers: which triangle a point is over, and where vanes meet it.

Each point starts at the triangle that it is over at rest and walks over edges to where it is now,
so what faces it across a fold does not count, and a search costs the same however fine the skin is.
"""

from math import floor, sqrt

from featherfx.algebra.vector_kernels import add, cross, dot, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.clearance_kernels import BESIDE_RATIO, CREASE_RATIO, SLANT_RATIO
from featherfx.solver.contact.find_kernels import Node, set_gaps, slot, start_contact
from featherfx.solver.contact.search_kernels import (
    closest_weights,
    guest_place,
    guest_point,
    side_normal,
)


@kernel
def count_cells(points, triangles, grid, counts):
    """Count the triangles that each cube lists, added to counts (cubes,). points: (V, 3)."""
    _cells(points, triangles, grid, counts, counts, False)


@kernel
def fill_cells(points, triangles, grid, places, items):
    """Triangles of each cube, to items from places (cubes,) on, which are advanced."""
    _cells(points, triangles, grid, places, items, True)


@kernel
def _cells(points, triangles, grid, places, items, filling):
    for t in range(triangles.shape[0]):
        l0, h0 = _range(points, triangles[t], 0, grid)
        l1, h1 = _range(points, triangles[t], 1, grid)
        l2, h2 = _range(points, triangles[t], 2, grid)
        for i in range(l0, h0 + 1):
            for j in range(l1, h1 + 1):
                for k in range(l2, h2 + 1):
                    cube = (i * grid.cubes[1] + j) * grid.cubes[2] + k
                    if filling:
                        items[places[cube]] = t
                    places[cube] += 1


@kernel
def _range(points, corners, axis, grid):
    """First and last cube along an axis that a triangle comes within reach of."""
    a, b, c = points[corners[0], axis], points[corners[1], axis], points[corners[2], axis]
    low = floor((min(a, min(b, c)) - grid.reach - grid.origin[axis]) / grid.edge)
    high = floor((max(a, max(b, c)) + grid.reach - grid.origin[axis]) / grid.edge)
    return max(low, 0), min(high, grid.cubes[axis] - 1)


@kernel
def weighted(points, corners, weight):
    """Place on a triangle of points (V, 3)."""
    a, b = scale(weight[0], points[corners[0]]), scale(weight[1], points[corners[1]])
    return add(add(a, b), scale(weight[2], points[corners[2]]))


@kernel
def _normal(points, corners):
    return side_normal(1, points[corners[0]], points[corners[1]], points[corners[2]])


@kernel
def _closest_triangle(x, wall):
    """Triangle closest to x at the start of those its cube lists, or -1; square of its distance
    (m^2), weights of its corners.

    Of several that share the closest point the one seen most from the front or back counts.
    """
    grid, cube = wall.grid, 0
    found, best, facing, weight = -1, 1e300, 0.0, (0.0, 0.0, 0.0)
    for axis in range(3):
        place = floor((x[axis] - grid.origin[axis]) / grid.edge)
        if place < 0 or place >= grid.cubes[axis]:
            return found, best, weight
        cube = cube * grid.cubes[axis] + place
    for at in range(wall.first[cube], wall.first[cube + 1]):
        t = wall.items[at]
        corners = wall.triangles[t]
        a, b, c = wall.start[corners[0]], wall.start[corners[1]], wall.start[corners[2]]
        own = closest_weights(x, a, b, c)
        away = sub(x, weighted(wall.start, corners, own))
        square = dot(away, away)
        if square > best * (1.0 + 1e-9) + 1e-24:
            continue
        seen = abs(dot(side_normal(1, a, b, c), away))
        if found >= 0 and square >= best * (1.0 - 1e-9) - 1e-24 and seen <= facing:
            continue
        found, best, facing, weight = t, square, seen, own
    return found, best, weight


@kernel
def meet_triangle(node, found, wall_and_open, bit, search, touch, count):
    """Add the contact of a node with what it is closest to of a wall at the start, if they meet;
    returns the count. found: triangle, square of its distance (m^2), weights of its corners.
    wall_and_open: it, and whether it is a sheet. bit: the wall's first of ContactMemory.inside."""
    wall, is_open = wall_and_open
    surfaces, bodies, body, i = search.surfaces, search.bodies, node.guest, node.row
    inside, (t, square, weight) = search.memory.inside[body, i], found
    p, fraction = guest_point(node.column, surfaces.exists.shape[3], surfaces.columns[body])
    x = guest_place(bodies.start[body], i, p, fraction)
    ahead = guest_place(bodies.ahead[body], i, p, fraction)
    corners = wall.triangles[t]
    old, new = weighted(wall.start, corners, weight), weighted(wall.end, corners, weight)
    along = dot(_normal(wall.start, corners), sub(x, old))
    thickness = 2.0 * surfaces.half[body, i, p]
    beside = sqrt(max(0.0, square - along * along))
    normal = _normal(wall.end, corners)
    nearest = min(along, dot(normal, sub(ahead, new)))
    closing = abs(dot(normal, sub(ahead, x))) + abs(dot(normal, sub(new, old)))
    slant = SLANT_RATIO * min(abs(along), CREASE_RATIO * thickness)
    rim = beside - BESIDE_RATIO * thickness - slant
    if is_open != 0:
        before, behind = bit << 1, bit << 2
        # beside a sheet a node goes around its rim
        if rim > 0.0 or inside[node.column] & (before | behind) == 0:
            inside[node.column] &= ~(before | behind)
            inside[node.column] |= before if along >= 0.0 else behind
        if inside[node.column] & behind != 0:
            along, normal = -along, scale(-1.0, normal)
            nearest = min(along, dot(normal, sub(ahead, new)))
    elif along >= 0.0:
        inside[node.column] &= ~bit
    elif wall.beginning != 0:
        inside[node.column] |= bit
    if rim > closing:
        return count
    if nearest - thickness > search.margin[body] or inside[node.column] & bit != 0:
        return count
    contact = slot(touch, count)
    start_contact(contact, node, p, fraction)
    contact.side, contact.mirror = 1, 0
    store(contact.normal, normal)
    store(contact.place_start, old)
    store(contact.place_now, new)
    set_gaps(contact, thickness, along, search.recovery)
    contact.guest_force = contact.host_force = search.memory.wall[body, i, node.column]
    contact.stiffness = search.wall_fit * bodies.whole[body, i, p]
    contact.leeway = bodies.leeway[body, i, p] / bodies.impedance[body, i, p]
    contact.stiffest, contact.before = contact.stiffness, 0.0
    return count + 1


@kernel
def _meet(node, wall, bit, search, touch, count):
    """Add the contact of a node with a wall, if there is one; returns the count. bit: as of
    meet_triangle."""
    surfaces, body, i = search.surfaces, node.guest, node.row
    p, fraction = guest_point(node.column, surfaces.exists.shape[3], surfaces.columns[body])
    found = _closest_triangle(guest_place(search.bodies.start[body], i, p, fraction), wall)
    if found[0] < 0:
        search.memory.inside[body, i, node.column] &= ~(7 * bit)
        return count
    return meet_triangle(node, found, (wall, wall.open), bit, search, touch, count)


@kernel
def _is_away(bounds, grid):
    """Return whether a box (6,) is outside of all cubes."""
    for k in range(3):
        end = grid.origin[k] + grid.edge * grid.cubes[k]
        if bounds[3 + k] < grid.origin[k] or bounds[k] > end:
            return True
    return False


@kernel
def find_wall_contacts(wall, bit, search, free, low, high, touch):
    """Contacts of bodies from low to high - 1 that are free (B,) with a wall, written to touch;
    their number. More than touch has room for: only that they are too many is right. bit: as of
    meet_triangle."""
    surfaces, count = search.surfaces, 0
    for body in range(low, high):
        away = _is_away(search.bodies.bounds[body], wall.grid)
        if free[body] == 0 or (away and wall.open == 0):
            continue
        for i in range(surfaces.present.shape[1]):
            for c in range(surfaces.guests.shape[2]):
                if away:
                    search.memory.inside[body, i, c] &= ~(7 * bit)
                elif surfaces.guests[body, i, c] != 0:
                    node = Node(-1, body, -1, i, c, 0, -1, 0.0)
                    count = _meet(node, wall, bit, search, touch, count)
    return count


# steps from triangle to triangle of a skin
_MAX_STEPS = 12


@kernel
def _corner(skin, ground, triangle, k):
    x = skin[ground.triangles[triangle, k]]
    return x[0], x[1], x[2]


@kernel
def skin_under(x, skin, ground, triangle):
    """Height of a point over a skin (V, 3) m, the normal there, and the triangle that it is over,
    walking from one."""
    normal, height = (0.0, 0.0, 1.0), 0.0
    for _ in range(_MAX_STEPS):
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
def _meet_vane(node, ground, bit, search, touch, count):
    """Add the contact of a node with the skin, if there is one; returns the count. bit: as of
    meet_triangle."""
    surfaces, bodies, body, i = search.surfaces, search.bodies, node.guest, node.row
    p, fraction = guest_point(node.column, surfaces.exists.shape[3], surfaces.columns[body])
    if ground.under[body, i, p] < 0:
        return count
    x = guest_place(bodies.start[body], i, p, fraction)
    height, _, t = skin_under(x, ground.start, ground, ground.under[body, i, p])
    # no skin beneath, or deeper than what is pushed out
    if height < -ground.deepest:
        return count
    a, b = _corner(ground.start, ground, t, 0), _corner(ground.start, ground, t, 1)
    weight = closest_weights(x, a, b, _corner(ground.start, ground, t, 2))
    away = sub(x, weighted(ground.start, ground.triangles[t], weight))
    found = t, dot(away, away), weight
    return meet_triangle(node, found, (ground, 0), bit, search, touch, count)


@kernel
def find_ground_contacts(ground, bit, search, free, low, high, touch):
    """Contacts of bodies from low to high - 1 that are free (B,) with the skin under them, written
    to touch; their number. More than touch has room for: only that they are too many is right. bit:
    as of meet_triangle."""
    surfaces, count = search.surfaces, 0
    for body in range(low, high):
        if free[body] == 0:
            continue
        for i in range(surfaces.present.shape[1]):
            for c in range(surfaces.guests.shape[2]):
                if surfaces.guests[body, i, c] != 0:
                    node = Node(-1, body, -1, i, c, 0, -1, 0.0)
                    count = _meet_vane(node, ground, bit, search, touch, count)
    return count
