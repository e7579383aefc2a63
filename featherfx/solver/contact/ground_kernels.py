"""The skin under feathers: which triangle a point is over, and where vanes meet it.

Each point starts at the triangle that it is over at rest and walks over edges to where it is now,
so what faces it across a fold does not count, and a search costs the same however fine the skin is.
"""

from featherfx.algebra.vector_kernels import cross, dot, scale, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.find_kernels import Node
from featherfx.solver.contact.search_kernels import closest_weights, guest_place, guest_point
from featherfx.solver.contact.wall_kernels import meet_triangle, weighted

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
def _meet(node, ground, bit, search, touch, count):
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
                    count = _meet(node, ground, bit, search, touch, count)
    return count
