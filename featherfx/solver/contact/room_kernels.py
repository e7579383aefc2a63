"""Early rejection of points of a guest that are too far from its host to meet it.

What is left out here meets nothing in the interval, by the conditions of clearance_kernels.
"""

from typing import NamedTuple

from featherfx.algebra.vector_kernels import add, dot, scale, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.clearance_kernels import OVER_RATIO, ROUNDING_RATIO
from featherfx.solver.contact.search_kernels import box_distance, corner_place, side_normal


class GuestBounds(NamedTuple):
    """Bounds within which the points of a guest meet a host. up: (3,), and top: m, along it, beyond
    which none does. margin: m, gap below which they are followed. way: m, what they go past the
    host in the interval, at most; thickness: m, sum of both half thicknesses, at most."""

    up: tuple[float, float, float]
    top: float
    margin: float
    way: float
    thickness: float


@kernel
def room_of(guest, host, side, margin, way, search, half):
    """The Room of a pair. half: (B,) m, largest half thickness.

    What meets the host (clearance_kernels) is along a normal of it no farther on its own side than
    margin and thickness, and beside that by OVER_RATIO thicknesses: so far above the slab at most.
    """
    slab, thickness = search.bodies.slab[host], half[guest] + half[host]
    if side == 0:
        return GuestBounds((0.0, 0.0, 0.0), 1e300, margin, way, thickness)
    top = (slab[4] if side > 0 else -slab[3]) + margin + (1.0 + OVER_RATIO) * thickness
    return GuestBounds(
        (side * slab[0], side * slab[1], side * slab[2]), top, margin, way, thickness
    )


@kernel
def is_above(box, room):
    """Return whether all of a box (6,) is beyond the top of the bounds."""
    lowest = 0.0
    for k in range(3):
        lowest += min(room.up[k] * box[k], room.up[k] * box[3 + k])
    return lowest > room.top


@kernel
def _on(points, corners, weight):
    """The point with weights of corners, rows and nodes, in a pose (n, 1 + 2 m, 3)."""
    a, b, c = corners
    first = add(scale(weight[0], points[a[0], a[1]]), scale(weight[1], points[b[0], b[1]]))
    return add(first, scale(weight[2], points[c[0], c[1]]))


@kernel
def is_off(x, closest, now, columns, side, room):
    """Return whether a point at x that nothing is known of is beside its closest place on a host,
    or so far above it that they do not meet in the interval. now: (n, 1 + 2 m, 3) m, nodes of the
    host where x was looked for. side: where the point belongs, or 0."""
    place, weight = closest
    a, b = corner_place(place, 0, columns), corner_place(place, 1, columns)
    c = corner_place(place, 2, columns)
    normal = side_normal(place[0], now[a[0], a[1]], now[b[0], b[1]], now[c[0], c[1]])
    away = sub(x, _on(now, (a, b, c), weight))
    along = dot(normal, away)
    beside, most = sub(away, scale(along, normal)), OVER_RATIO * room.thickness + ROUNDING_RATIO
    if dot(beside, beside) > most * most:
        return True
    return side != 0 and side * along > room.thickness + room.margin + ROUNDING_RATIO


@kernel
def is_near(x, is_known, bounds, room):
    """Return whether a point may meet a host with such bounds (6,)."""
    if not is_known and dot(room.up, x) > room.top:
        return False
    return box_distance(x, bounds) <= room.margin * room.margin
