"""Which contacts there are: points of vanes near the vanes of others (list_kernels)."""

from featherfx.algebra.copy_kernels import copy_values
from featherfx.algebra.vec3_kernels import cross
from featherfx.jit.compiled import kernel
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
    host_place,
    triangle_normal,
)
from featherfx.solver.contact.search_kernels import (
    barb_point,
    box_distance,
    boxes_apart,
    closest_point,
    guest_place,
    guest_point,
    nearest_node,
    triangle_corners,
)

# how far beside its closest point, along the host, a node still meets it: thicknesses beyond an
# edge, and a share of its height above a crease, up to so many thicknesses
BESIDE, BESIDE_SHARE, CREASE = 1.0, 0.1, 20.0
# share of a depth of up to so many thicknesses that a contact keeps in an interval: to close it at
# once, by a force that is carried on from interval to interval, would make it swing
KEPT, SMALL = 0.5, 0.1


@kernel
def _along(points, x, corner, weight, mirror):
    """Distance of a node along its host's normal, and beside it (m)."""
    nx, ny, nz = triangle_normal(points, corner, mirror)
    dx, dy, dz = x[0], x[1], x[2]
    for q in range(3):
        y = points[corner[q, 0], corner[q, 1]]
        dx, dy, dz = dx - weight[q] * y[0], dy - weight[q] * y[1], dz - weight[q] * y[2]
    along = nx * dx + ny * dy + nz * dz
    sx, sy, sz = cross((nx, ny, nz), (dx, dy, dz))
    return along, (sx * sx + sy * sy + sz * sz) ** 0.5


@kernel
def _closing(start, end, x, ahead, corner, weight, mirror):
    """How far a guest goes from x to ahead (3,) along the normal of its host, against it, m.

    start, end: host points (n, P, 3).
    """
    nx, ny, nz = triangle_normal(start, corner, mirror)
    dx, dy, dz = ahead[0] - x[0], ahead[1] - x[1], ahead[2] - x[2]
    for q in range(3):
        old, new = start[corner[q, 0], corner[q, 1]], end[corner[q, 0], corner[q, 1]]
        dx -= weight[q] * (new[0] - old[0])
        dy -= weight[q] * (new[1] - old[1])
        dz -= weight[q] * (new[2] - old[2])
    return abs(nx * dx + ny * dy + nz * dz)


@kernel
def _remembered(key, memory, at):
    """Place of a contact in the memory, or where it would be; at: of one before it."""
    while at < memory.key.shape[0] and memory.key[at] < key:
        at += 1
    return at


@kernel
def _find_node(pair, i, c, guest, host, order, known, skin, scene, memory, limits, touch, count):
    """Add the contact of one guest's node with one host, if there is one; returns the count.

    known: place of the contact in the memory, -1 if it is not there.
    """
    margin = limits[0]
    columns = skin.exists.shape[3]
    p, part = guest_point(c, columns, skin.columns[guest])
    side = order
    if side == 0 and known >= 0:
        side = memory.side[known]
    # once the side is known the pose ahead can be searched, however deep
    now = scene.ahead if side != 0 else scene.start
    x = touch.guest
    guest_place(now[guest], i, p, part, x)
    bounds = scene.bounds[host]
    if box_distance(x[0], x[1], x[2], bounds) > margin * margin:
        return count
    place = touch.place
    limit = skin.far[host] + margin + scene.way[guest] + scene.way[host]
    present, boxes = skin.present[host], scene.boxes[host]
    row, column = nearest_node(
        x[0], x[1], x[2], now[host], present, boxes, place[4], place[5], limit
    )
    if row < 0 or count >= touch.who.shape[0]:
        return count + (1 if row >= 0 else 0)
    place[4], place[5] = row, column
    weight, corner = touch.weight[count], touch.corner[count]
    closest_point(x[0], x[1], x[2], now[host], skin.exists[host], row, column, place, weight)
    if place[0] < 0:
        return count
    ia, na, ib, nb, ic, nc = triangle_corners(place[0], place[1], place[2], place[3])
    corner[0, 0], corner[0, 1] = ia, barb_point(place[0], na, columns)
    corner[1, 0], corner[1, 1] = ib, barb_point(place[0], nb, columns)
    corner[2, 0], corner[2, 1] = ic, barb_point(place[0], nc, columns)
    along, beside = _along(now[host], x, corner, weight, place[0])
    half = 0.0
    for q in range(3):
        half += weight[q] * skin.half[host, corner[q, 0], corner[q, 1]]
    thickness = half + skin.half[guest, i, p]
    height = min(abs(along), CREASE * thickness)
    if beside > BESIDE * thickness + BESIDE_SHARE * height:
        return count
    if side == 0:
        side = 1 if along >= 0.0 else -1
    # bodies that collide do not go where they are headed, so their way counts as well
    guest_place(scene.start[guest], i, p, part, x)
    guest_place(scene.ahead[guest], i, p, part, touch.guest_ahead)
    reach = margin + _closing(
        scene.start[host], scene.ahead[host], x, touch.guest_ahead, corner, weight, place[0]
    )
    if side * along - thickness > reach:
        return count
    begin, _ = _along(scene.start[host], x, corner, weight, place[0])
    host_place(scene.start[host], corner, weight, touch.place_start[count])
    index, value = touch.who[count], touch.value[count]
    index[PAIR], index[ROW], index[COLUMN], index[GUEST_POINT] = pair, i, c, p
    index[GUEST], index[HOST], index[SIDE], index[MIRROR] = guest, host, side, place[0]
    depth = max(0.0, thickness - side * begin)
    value[START_GAP] = side * begin - thickness + depth
    value[THICKNESS] = thickness
    value[SPARED] = max(KEPT * min(depth, SMALL * thickness), depth - limits[1])
    value[GUEST_FORCE] = memory.force[known, 0] if known >= 0 else 0.0
    value[HOST_FORCE] = memory.force[known, 1] if known >= 0 else 0.0
    stiff = 0.0
    for q in range(3):
        stiff += weight[q] * scene.impedance[host, corner[q, 0], corner[q, 1]]
    value[GUEST_STIFFNESS] = stiff
    value[HOST_STIFFNESS] = scene.impedance[guest, i, p]
    value[SHARE] = part
    return count + 1


@kernel
def find_contacts(pairs, order, skin, scene, memory, limits, before, kept, stale, touch):
    """Contacts of all pairs (N, 2) guest and host, written to touch; returns how many there are.

    order: (N,) side of the host where the guest belongs, 0 for where it is. limits: (2,) m, gap
    below which a node is followed, and way that a depth may be reduced by. before: the contacts
    found last, kept of them, which hold on for pairs of bodies that are not stale (B,). More than
    touch has room for: only their number is right.
    """
    count, at, old = 0, 0, 0
    margin = limits[0]
    _, rows, width = skin.guests.shape
    for pair in range(pairs.shape[0]):
        guest, host = pairs[pair, 0], pairs[pair, 1]
        if stale[guest] == 0 and stale[host] == 0:
            while old < kept and 0 <= before.who[old, PAIR] < pair:
                old += 1
            while old < kept and before.who[old, PAIR] == pair:
                if count < touch.who.shape[0]:
                    _copy_contact(before, old, touch, count)
                count, old = count + 1, old + 1
            continue
        if boxes_apart(scene.bounds[guest], scene.bounds[host], margin):
            continue
        # neighbours on the guest are near neighbours on the host
        touch.place[4], touch.place[5] = -1, -1
        for i in range(rows):
            after = min(i + 1, rows - 1)
            if boxes_apart(scene.boxes[guest, i], scene.bounds[host], margin) and boxes_apart(
                scene.boxes[guest, after], scene.bounds[host], margin
            ):
                continue
            for c in range(width):
                if skin.guests[guest, i, c] == 0:
                    continue
                key = (pair * rows + i) * width + c
                at = _remembered(key, memory, at)
                known = at if at < memory.key.shape[0] and memory.key[at] == key else -1
                count = _find_node(
                    pair,
                    i,
                    c,
                    guest,
                    host,
                    order[pair],
                    known,
                    skin,
                    scene,
                    memory,
                    limits,
                    touch,
                    count,
                )
    return count


@kernel
def _copy_contact(source, k, target, to):
    copy_values(source.who[k], target.who[to])
    copy_values(source.corner[k], target.corner[to])
    copy_values(source.weight[k], target.weight[to])
    copy_values(source.value[k], target.value[to])
    copy_values(source.place_start[k], target.place_start[to])
