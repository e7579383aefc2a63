"""The contacts of an interval: measured, handed to the feathers, and their forces.

A contact presses a node of one vane (the guest) against a point of a triangle of another (the
host). Its gap is counted along the host's normal n on the side s = 1 or -1 where the guest belongs:

    g = s n.(x - y) - t + a,     y = sum of w_i x_i over the corners

t sum of both half thicknesses; a what an interval that begins too deep is spared of its depth, so
that a feather that slipped through comes back at a limited speed instead of being shot out.
"""

from featherfx.compiled import kernel
from featherfx.solver.contact_search_kernels import guest_place, side_normal

# columns of a contact's numbers: index and value
PAIR, ROW, COLUMN, GUEST_POINT, GUEST, HOST, SIDE, MIRROR = 0, 1, 2, 3, 4, 5, 6, 7
INTEGERS = 8
START_GAP, GAP, THICKNESS, SPARED = 0, 1, 2, 3
GUEST_FORCE, HOST_FORCE, GUEST_STIFFNESS, HOST_STIFFNESS, SHARE = 4, 5, 6, 7, 8
VALUES = 9


@kernel
def triangle_normal(points, corner, mirror):
    """Unit normal of a contact's triangle in a pose (n, P, 3)."""
    a = points[corner[0, 0], corner[0, 1]]
    b = points[corner[1, 0], corner[1, 1]]
    c = points[corner[2, 0], corner[2, 1]]
    return side_normal(mirror, a, b, c)


@kernel
def host_place(points, corner, weight, place):
    """Place (3,) of a contact on its host in a pose (n, P, 3)."""
    a = points[corner[0, 0], corner[0, 1]]
    b = points[corner[1, 0], corner[1, 1]]
    c = points[corner[2, 0], corner[2, 1]]
    for k in range(3):
        place[k] = weight[0] * a[k] + weight[1] * b[k] + weight[2] * c[k]


@kernel
def measure(touch, count, now):
    """Gaps, normals and places of the contacts in a pose now (B, n, P, 3), written to touch.

    Those of a wall (HOST is -1) have been there since they were found.
    """
    for k in range(count):
        index, normal, value = touch.who[k], touch.normal[k], touch.value[k]
        y = touch.place_now[k]
        if index[HOST] >= 0:
            host, side = now[index[HOST]], index[SIDE]
            nx, ny, nz = triangle_normal(host, touch.corner[k], index[MIRROR])
            normal[0], normal[1], normal[2] = side * nx, side * ny, side * nz
            host_place(host, touch.corner[k], touch.weight[k], y)
        x = touch.guest
        guest_place(now[index[GUEST]], index[ROW], index[GUEST_POINT], value[SHARE], x)
        along = 0.0
        for a in range(3):
            along += normal[a] * (x[a] - y[a])
        value[GAP] = along - value[THICKNESS] + value[SPARED]


@kernel
def update_forces(touch, count, mine):
    """Forces of the contacts after the bodies mine (B,) were solved; gaps are up to date."""
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        wall = index[HOST] < 0
        if mine[index[GUEST]] != 0:
            push = value[HOST_FORCE] - value[GUEST_STIFFNESS] * value[GAP]
            value[GUEST_FORCE] = max(0.0, push)
            if wall:
                value[HOST_FORCE] = value[GUEST_FORCE]
        if not wall and mine[index[HOST]] != 0:
            push = value[GUEST_FORCE] - value[HOST_STIFFNESS] * value[GAP]
            value[HOST_FORCE] = max(0.0, push)


@kernel
def residuals(touch, count, worst):
    """Largest distance from contact's complementarity, per body, to worst (B,), m.

    A gap that is closed (g < 0) or held shut from both sides with a force counts by its size.
    """
    worst[:] = 0.0
    depth = 0.0
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        force = min(value[GUEST_FORCE], value[HOST_FORCE])
        stiffness = max(value[GUEST_STIFFNESS], value[HOST_STIFFNESS])
        wrong = abs(min(value[GAP], force / stiffness))
        mismatch = abs(value[GUEST_FORCE] - value[HOST_FORCE]) / stiffness
        wrong = max(wrong, mismatch)
        worst[index[GUEST]] = max(worst[index[GUEST]], wrong)
        if index[HOST] >= 0:
            worst[index[HOST]] = max(worst[index[HOST]], wrong)
        depth = max(depth, value[SPARED] - value[GAP])
    return depth


@kernel
def remember(touch, count, memory):
    """Forces of the contacts kept for the next interval; those of all others are gone."""
    memory.force[:] = 0.0
    memory.wall[:] = 0.0
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        if index[HOST] < 0:
            memory.wall[index[GUEST], index[ROW], index[COLUMN]] = value[GUEST_FORCE]
            continue
        kept = memory.force[index[PAIR], index[ROW], index[COLUMN]]
        kept[0], kept[1] = value[GUEST_FORCE], value[HOST_FORCE]


@kernel
def count_contacts(touch, count, mine, per_body):
    """How many plane contacts each of the bodies mine (B,) gets, to per_body (B,)."""
    per_body[:] = 0
    for k in range(count):
        index = touch.who[k]
        if mine[index[GUEST]] != 0:
            per_body[index[GUEST]] += 1 if touch.value[k, SHARE] == 0.0 else 2
        if index[HOST] >= 0 and mine[index[HOST]] != 0:
            per_body[index[HOST]] += 3


@kernel
def hand_out(touch, count, mine, at, start, now, friction, smoothing, contacts):
    """Write the plane contacts of the bodies mine (B,) to contacts, from places at (B,) on.

    start, now: (B, n, P, 3) poses at the interval's start and at the last iterate. friction:
    coefficient. smoothing: m. at is advanced.
    """
    for k in range(count):
        index, corner, weight = touch.who[k], touch.corner[k], touch.weight[k]
        normal, value = touch.normal[k], touch.value[k]
        guest, host = index[GUEST], index[HOST]
        row, p = index[ROW], index[GUEST_POINT]
        part = value[SHARE]
        x, begin = touch.guest_ahead, touch.guest
        guest_place(now[guest], row, p, part, x)
        guest_place(start[guest], row, p, part, begin)
        old, new = touch.place_start[k], touch.place_now[k]
        ux = x[0] - begin[0] - new[0] + old[0]
        uy = x[1] - begin[1] - new[1] + old[1]
        uz = x[2] - begin[2] - new[2] + old[2]
        if mine[guest] != 0:
            for q in range(1 if part == 0.0 else 2):
                r = row + q
                x, begin = now[guest, r, p], start[guest, r, p]
                to = at[guest]
                at[guest] += 1
                share = part if q == 1 else 1.0 - part
                _write(
                    contacts,
                    to,
                    r,
                    p,
                    1.0,
                    normal,
                    x,
                    begin,
                    value,
                    ux,
                    uy,
                    uz,
                    value[HOST_FORCE],
                    value[GUEST_STIFFNESS],
                    share,
                    friction,
                    smoothing,
                )
        if host >= 0 and mine[host] != 0:
            for q in range(3):
                r, m = corner[q, 0], corner[q, 1]
                x, begin = now[host, r, m], start[host, r, m]
                to = at[host]
                at[host] += 1
                _write(
                    contacts,
                    to,
                    r,
                    m,
                    -1.0,
                    normal,
                    x,
                    begin,
                    value,
                    -ux,
                    -uy,
                    -uz,
                    value[GUEST_FORCE],
                    value[HOST_STIFFNESS],
                    weight[q],
                    friction,
                    smoothing,
                )


@kernel
def _write(
    contacts,
    to,
    row,
    p,
    sign,
    normal,
    x,
    begin,
    value,
    ux,
    uy,
    uz,
    force,
    stiffness,
    weight,
    friction,
    smoothing,
):
    """One plane contact: at the point x the gap is the contact's gap and the slip its slip."""
    contacts.node[to, 0], contacts.node[to, 1] = row, p
    level, first = -value[GAP], -value[START_GAP]
    for k in range(3):
        n = sign * normal[k]
        contacts.normal[to, k] = n
        level += n * x[k]
        first += n * begin[k]
        contacts.target[to, 0, k] = begin[k]
    contacts.target[to, 1, 0] = x[0] - ux
    contacts.target[to, 1, 1] = x[1] - uy
    contacts.target[to, 1, 2] = x[2] - uz
    contacts.offset[to, 0], contacts.offset[to, 1] = first, level
    # a corner that hardly carries still needs a stiffness to divide by
    share = max(weight, 1e-6)
    contacts.strength[to, 0] = share * stiffness
    contacts.strength[to, 1] = share * force
    contacts.strength[to, 2] = share * friction * force
    contacts.strength[to, 3] = smoothing
