"""The contacts of an interval: measured, handed to the feathers, and their forces.

A contact presses a node of one vane (the guest) against a point of a triangle of another (the
host). Its gap is counted along the host's normal n on the side s = 1 or -1 where the guest belongs:

    g = s n.(x - y) - t + a,     y = sum of w_i x_i over the corners

t sum of both half thicknesses; a what an interval that begins too deep is spared of its depth, so
that a feather that slipped through comes back at a limited speed instead of being shot out.

Points count as on the widest grid of all bodies (grids.Grids).
"""

from featherfx.jit.compiled import kernel
from featherfx.solver.contact.search_kernels import guest_place, side_normal

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
def _measure(touch, k, now):
    """Gap, normal and place of contact k in a pose now (B, n, P, 3), written to touch."""
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
def measure(touch, count, now):
    """Gaps, normals and places of all contacts in a pose now (B, n, P, 3), written to touch.

    Those of a wall (HOST is -1) have been there since they were found.
    """
    for k in range(count):
        _measure(touch, k, now)


@kernel
def list_by_body(touch, count, first, items):
    """Contacts of each body: items[first[b]] to items[first[b + 1] - 1]; first (B + 1,)."""
    first[:] = 0
    for k in range(count):
        first[touch.who[k, GUEST]] += 1
        if touch.who[k, HOST] >= 0:
            first[touch.who[k, HOST]] += 1
    total = 0
    for b in range(first.shape[0]):
        total += first[b]
        first[b] = total
    for back in range(count):
        k = count - 1 - back
        for body in (touch.who[k, GUEST], touch.who[k, HOST]):
            if body >= 0:
                first[body] -= 1
                items[first[body]] = k


@kernel
def update(touch, first, items, mine, now):
    """Measure the contacts of the bodies mine (B,), which were just solved, and set the forces that
    those felt. first, items: of list_by_body."""
    for body in range(mine.shape[0]):
        if mine[body] == 0:
            continue
        for at in range(first[body], first[body + 1]):
            k = items[at]
            _measure(touch, k, now)
            index, value = touch.who[k], touch.value[k]
            if index[GUEST] == body:
                push = value[HOST_FORCE] - value[GUEST_STIFFNESS] * value[GAP]
                value[GUEST_FORCE] = max(0.0, push)
            else:
                push = value[GUEST_FORCE] - value[HOST_STIFFNESS] * value[GAP]
                value[HOST_FORCE] = max(0.0, push)


@kernel
def residuals(touch, count, worst):
    """Largest distance from contact's complementarity, per body, to worst (B,), m.

    A gap that is closed (g < 0) or held shut from both sides with a force counts by its size.
    Returns the deepest penetration (m).
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
def closed_on_walls(touch, count, closed):
    """Mark bodies (B,) one of whose contacts with a wall closed in the last solve: it had no
    friction yet, for that goes by the force of the solve before."""
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        if index[HOST] < 0 and value[HOST_FORCE] == 0.0 and value[GUEST_FORCE] > 0.0:
            closed[index[GUEST]] = True


@kernel
def soften(touch, count, bodies, share):
    """Take from all contacts of some bodies (B,) their forces, and all but a share of stiffness."""
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        if bodies[index[GUEST]] == 0 and (index[HOST] < 0 or bodies[index[HOST]] == 0):
            continue
        value[GUEST_FORCE], value[HOST_FORCE] = 0.0, 0.0
        value[GUEST_STIFFNESS] *= share
        value[HOST_STIFFNESS] *= share


@kernel
def add_forces(touch, count, total):
    """Sums of the forces (N) that each body feels, to total (B,)."""
    total[:] = 0.0
    for k in range(count):
        index, value = touch.who[k], touch.value[k]
        total[index[GUEST]] += value[GUEST_FORCE]
        if index[HOST] >= 0:
            total[index[HOST]] += value[HOST_FORCE]


@kernel
def hand_out(
    touch, first, items, mine, start, now, friction, smoothing, reach, widest, columns, contacts
):
    """Write the plane contacts of the bodies mine (B,) to contacts; returns how many there are.

    first, items: of list_by_body. start, now: (B, n, P, 3) poses at the interval's start and at the
    last iterate. friction: coefficient. smoothing: m. reach: m, gap beyond which contacts without a
    force are left out. widest: columns of the widest grid; columns: (B,) of the bodies' own. One
    more than contacts has room for: too many.
    """
    to = 0
    for body in range(mine.shape[0]):
        contacts.first[body] = to
        if mine[body] == 0:
            continue
        for at in range(first[body], first[body + 1]):
            k = items[at]
            index, corner, weight = touch.who[k], touch.corner[k], touch.weight[k]
            value = touch.value[k]
            is_guest = index[GUEST] == body
            if index[HOST] < 0:
                # a wall's force is what the feather felt last
                value[HOST_FORCE] = value[GUEST_FORCE]
            force = value[HOST_FORCE] if is_guest else value[GUEST_FORCE]
            if force == 0.0 and value[GAP] > reach:
                continue
            if to + 3 > contacts.node.shape[0]:
                return contacts.node.shape[0] + 1
            slip = _slip_since(touch, k, start, now)
            parts = (1 if value[SHARE] == 0.0 else 2) if is_guest else 3
            stiffness = value[GUEST_STIFFNESS] if is_guest else value[HOST_STIFFNESS]
            for q in range(parts):
                if is_guest:
                    row, p = index[ROW] + q, index[GUEST_POINT]
                    share = value[SHARE] if q == 1 else 1.0 - value[SHARE]
                else:
                    row, p = corner[q, 0], corner[q, 1]
                    share = weight[q]
                # a corner that hardly carries still needs a stiffness to divide by
                share = max(share, 1e-6)
                strength = contacts.strength[to]
                strength[0] = share * stiffness
                strength[1] = share * force
                strength[2] = share * friction * force
                strength[3] = smoothing
                contacts.node[to, 0] = row
                contacts.node[to, 1] = p - (widest - columns[body] if p > 2 + widest else 0)
                _plane(
                    contacts,
                    to,
                    1.0 if is_guest else -1.0,
                    touch.normal[k],
                    now[body, row, p],
                    start[body, row, p],
                    value,
                    slip,
                )
                to += 1
    contacts.first[mine.shape[0]] = to
    return to


@kernel
def _slip_since(touch, k, start, now):
    """(3,) m, how far a contact's guest went, less how far its host did."""
    index, part = touch.who[k], touch.value[k, SHARE]
    x, begin = touch.guest_ahead, touch.guest
    guest_place(now[index[GUEST]], index[ROW], index[GUEST_POINT], part, x)
    guest_place(start[index[GUEST]], index[ROW], index[GUEST_POINT], part, begin)
    old, new = touch.place_start[k], touch.place_now[k]
    return (
        x[0] - begin[0] - new[0] + old[0],
        x[1] - begin[1] - new[1] + old[1],
        x[2] - begin[2] - new[2] + old[2],
    )


@kernel
def _plane(contacts, to, sign, normal, x, begin, value, slip):
    """The plane of one contact: at the point x the gap is the contact's gap and the slip its slip.

    sign: 1 for the guest, -1 for the host.
    """
    level, first = -value[GAP], -value[START_GAP]
    for k in range(3):
        n = sign * normal[k]
        contacts.normal[to, k] = n
        level += n * x[k]
        first += n * begin[k]
        contacts.target[to, 0, k] = begin[k]
    contacts.target[to, 1, 0] = x[0] - sign * slip[0]
    contacts.target[to, 1, 1] = x[1] - sign * slip[1]
    contacts.target[to, 1, 2] = x[2] - sign * slip[2]
    contacts.offset[to, 0], contacts.offset[to, 1] = first, level
