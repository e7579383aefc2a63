"""Contacts: points of vanes near the vanes of others."""

from typing import NamedTuple

import numpy as np

from featherfx.algebra.vector_kernels import cross, dot, length, store, sub
from featherfx.jit.compiled import kernel
from featherfx.mechanics.barb_kernels import node_index
from featherfx.solver.contact.clearance_kernels import (
    BESIDE_RATIO,
    CREASE_RATIO,
    SLANT_RATIO,
    clear,
    follow,
    is_clear,
    way_between,
)
from featherfx.solver.contact.list_kernels import host_place, triangle_normal
from featherfx.solver.contact.meeting_kernels import is_above, is_near, is_off, room_of
from featherfx.solver.contact.search_kernels import (
    boxes_apart,
    closest_point,
    corner_node,
    fit_slab,
    guest_place,
    guest_point,
    nearest_node,
    row_boxes,
    strip_point,
    swing_of,
)
from featherfx.solver.contact.types import FOR_GOOD, FOR_NOW

# part of a depth of up to so many thicknesses that a contact keeps in an interval: to close it at
# once, by a force that is carried on from interval to interval, would make it swing
_KEPT, _SMALL = 0.5, 0.1
# depth, in thicknesses, from which on a point that comes around its host's rim stays on the side
# where it comes
_AROUND = 1.0


class Node(NamedTuple):
    """A point of a guest's row that may touch a host. side: of the host where it belongs, or 0.
    known: place of its contact in the memory, or -1. depth: m, of Candidates."""

    pair: int
    guest: int
    host: int
    row: int
    column: int
    side: int
    known: int
    depth: float


@kernel
def margin_of(search, guest, host):
    """m, gap below which the nodes of a guest are followed over a host."""
    return 0.5 * (search.margin[guest] + search.margin[host])


@kernel
def _along(points, x, contact):
    """Distance of a node along its host's normal, and beside it (m)."""
    normal, away = triangle_normal(points, contact), sub(x, host_place(points, contact))
    return dot(normal, away), length(cross(normal, away))


@kernel
def _closing(bodies, x, ahead, contact):
    """Return how far a guest goes from x to ahead along the normal of its host, against it, m."""
    start, end = bodies.start[contact.host], bodies.ahead[contact.host]
    way = sub(sub(ahead, x), sub(host_place(end, contact), host_place(start, contact)))
    return abs(dot(triangle_normal(start, contact), way))


@kernel
def _remembered(key, known, at):
    """Place of a key among ascending ones that are known, or where it would be; at: of one before
    it."""
    while at < known.shape[0] and known[at] < key:
        at += 1
    return at


@kernel
def slot(touch, count):
    """Return where the next contact is written; where there is no room for it, over the last."""
    return touch[min(count, touch.shape[0] - 1)]


@kernel
def start_contact(contact, node, p, fraction):
    """Begin a contact at its node: node p, and how far it lies to the next row."""
    contact.pair, contact.row, contact.column, contact.point = node.pair, node.row, node.column, p
    contact.guest, contact.host, contact.fraction = node.guest, node.host, fraction


@kernel
def set_gaps(contact, thickness, along, recovery):
    """The gap at the interval's start, along the normal (m), and what it is spared of its depth."""
    depth = max(0.0, thickness - along)
    contact.thickness, contact.start_gap = thickness, along - thickness + depth
    contact.spared = max(0.0, _KEPT * min(depth, _SMALL * thickness), depth - recovery)


@kernel
def _find_node(x, node, near, closest, search, touch, count):
    """Add the contact of one guest's node, at x, with one host, if there is one.

    near: row and column of the node of the host that is nearest; closest: place and weights of the
    point of it that is. Returns the count.
    """
    surfaces, bodies, guest, host = search.surfaces, search.bodies, node.guest, node.host
    columns, side = surfaces.exists.shape[3], node.side
    p, fraction = guest_point(node.column, columns, surfaces.columns[guest])
    if node.known >= 0:
        side = search.memory.side[node.known]
    now, (place, weight) = bodies.ahead if side != 0 else bodies.start, closest
    contact = slot(touch, count)
    start_contact(contact, node, p, fraction)
    contact.side = side
    _put_on(contact, place, weight, columns)
    along, beside = _along(now[host], x, contact)
    contact.thickness = (
        _of_corners(surfaces.half[host], contact) + surfaces.half[guest, node.row, p]
    )
    if not _is_over(along, beside, contact.thickness):
        return count
    contact.thickness -= node.depth
    turns = search.turns and node.depth == 0.0
    if side == 0:
        contact.side = 1 if along >= 0.0 else -1
    elif node.side != 0 and turns:
        _choose_side(contact, along, node, near, search)
        _put_on(contact, place, weight, columns)
    if not _meets(contact, along, node, search):
        return count
    unbound = node.known >= 0 and node.side == 0
    if turns and contact.spared > _AROUND * contact.thickness and (node.known < 0 or unbound):
        # of planes that it only now is over it may have been on either side
        begin = guest_place(bodies.start[guest], node.row, p, fraction)
        over, found, height = _at_start(contact, begin, near, search)
        _put_on(contact, place, weight, columns)
        if unbound and not over:
            # around a rim, to where no order forbids it to be
            return count
        was = height if found else contact.thickness
        set_gaps(contact, contact.thickness, was, search.recovery)
    _press(contact, node.known, search)
    return count + 1


@kernel
def _put_on(contact, place, weight, columns):
    """Put a contact on a triangle of its host."""
    contact.mirror = place[0]
    store(contact.weight, weight)
    for q in range(3):
        row, barb_node = corner_node(place, q)
        contact.corner[q, 0] = row
        contact.corner[q, 1] = node_index(place[0], barb_node, columns)


@kernel
def _is_over(along, beside, thickness):
    """Return whether a point is over its closest triangle, not beyond an edge."""
    return beside <= BESIDE_RATIO * thickness + SLANT_RATIO * min(
        abs(along), CREASE_RATIO * thickness
    )


@kernel
def _choose_side(contact, along, node, near, search):
    """Put a point that comes around the rim of its host on the side where it comes, until it
    leaves the host or is drawn back with a neighbour.

    It comes around if it was beside the host at the start of the step, and on that side already.
    One that was over the host then, and less deep than steps leave anything, was pressed through;
    one that was deep and is not known was just over the rim when nobody looked. along: m, over the
    host. The contact is put on other triangles.
    """
    depth, turned = -contact.side * along, contact.side != node.side
    if not turned and depth < _AROUND * contact.thickness:
        return
    bodies, host = search.bodies, node.host
    x = guest_place(bodies.start[node.guest], contact.row, contact.point, contact.fraction)
    if turned and depth > 0.0:
        over, _, height = _at_start(contact, x, near, search)
        if over and height < 0.0:
            # pressed through to where it belongs
            contact.side = node.side
            return
    # deeper than it goes past the host in the step: not through it, but around
    ahead = guest_place(bodies.ahead[node.guest], contact.row, contact.point, contact.fraction)
    led = sub(host_place(bodies.ahead[host], contact), host_place(bodies.start[host], contact))
    leaps = depth > max(_AROUND * contact.thickness, length(sub(sub(ahead, x), led)))
    if not turned and node.known >= 0 and not leaps:
        return
    contact.side = node.side
    if turned and leaps:
        # back around the rim
        return
    if not turned:
        over, found, height = _at_start(contact, x, near, search)
        low = over and height < -_AROUND * contact.thickness
        if node.known >= 0 and low:
            # drawn back through the host
            return
        turned = leaps or low or not found or (not over and height < 0.0)
    if turned and not _belongs_to_order(contact, x, near, search):
        contact.side = -node.side


@kernel
def _at_start(contact, x, near, search):
    """Return whether a place is over a contact's host at the start, whether it is near it at all,
    and how far it is along the host's normal, m, on the contact's side. The contact is put on the
    closest triangle."""
    surfaces, bodies, host = search.surfaces, search.bodies, contact.host
    margin = margin_of(search, contact.guest, host)
    limit = surfaces.far[host] + margin + bodies.way[contact.guest] + bodies.way[host]
    start, present, boxes = bodies.start[host], surfaces.present[host], bodies.boxes[host]
    near = nearest_node(x, start, present, boxes, near, limit)
    if near[0] < 0:
        return False, False, 0.0
    place, weight = closest_point(x, start, surfaces.exists[host], near)
    if place[0] < 0:
        return False, False, 0.0
    _put_on(contact, place, weight, surfaces.exists.shape[3])
    along, beside = _along(start, x, contact)
    return _is_over(along, beside, contact.thickness), True, contact.side * along


@kernel
def _belongs_to_order(contact, x, near, search):
    """Return whether a point that is on the wrong side of its host, at x at the start, hangs
    together with a neighbour on its vane that is drawn back through the host from about as deep."""
    row, p, guests = contact.row, contact.point, search.surfaces.guests[contact.guest]
    columns, points = search.surfaces.exists.shape[3], search.bodies.start[contact.guest]
    known, side = search.memory.key, search.memory.side
    _, _, low = _at_start(contact, x, near, search)
    margin = margin_of(search, contact.guest, contact.host)
    own = columns + p if p <= columns else 2 * columns - p
    for k in range(4):
        # of a point of the rim the nodes at its ends
        i, c = row + k % 2, own
        if contact.fraction == 0.0:
            i, c = (row + 2 * k - 1, own) if k < 2 else (row, own + 2 * k - 5)
        inside = 0 <= i < guests.shape[0] and 0 <= c <= 2 * columns
        if not inside or guests[i, c] == 0:
            continue
        y = guest_place(points, i, strip_point(c, columns), 0.0)
        over, _, height = _at_start(contact, y, near, search)
        if not over:
            continue
        if height > -_AROUND * contact.thickness or abs(height - low) > margin:
            continue
        key = (contact.pair * guests.shape[0] + i) * guests.shape[1] + c
        at = _first_key(known, key)
        if at < known.shape[0] and known[at] == key and side[at] == contact.side:
            return True
    return False


@kernel
def _of_corners(values, contact):
    """Mean of a host's values (n, 1 + 2 m) at a contact's corners, by their weights."""
    total = 0.0
    for q in range(3):
        total += contact.weight[q] * values[contact.corner[q, 0], contact.corner[q, 1]]
    return total


@kernel
def _meets(contact, along, node, search):
    """Return whether a point over its host is near it or on its way there, or on the side where no
    order has it, which has to be remembered; sets its gap at the start. along: m, over the host."""
    bodies, guest, host = search.bodies, contact.guest, contact.host
    begin = guest_place(bodies.start[guest], contact.row, contact.point, contact.fraction)
    gap = contact.side * along - contact.thickness
    kept = node.side != 0 and contact.side != node.side
    if node.known >= 0 and search.again:
        # where it pressed in another search of the interval it goes on, or poses would alternate
        kept = kept or search.memory.force[node.known, 0] > 0.0
    margin = margin_of(search, guest, host)
    if node.side == 0 and node.known < 0:
        # its gap is that at the start
        ahead = guest_place(bodies.ahead[guest], contact.row, contact.point, contact.fraction)
        margin += _closing(bodies, begin, ahead, contact)
    if not kept and gap > margin:
        return False
    start, _ = _along(bodies.start[host], begin, contact)
    # depth waits for a step in which both give way, or forces would grow from step to step
    recovery = 0.0 if FOR_NOW in (bodies.led[guest], bodies.led[host]) else search.recovery
    set_gaps(contact, contact.thickness, contact.side * start, recovery)
    store(contact.place_start, host_place(bodies.start[host], contact))
    return True


@kernel
def _press(contact, known, search):
    """The forces of the interval before, if the contact is known, and the spring's stiffness.

    It is the softer body's (what is led is rigid, and towards an obstacle the other one is firm),
    and the same for both: with springs that differ, of which each fits the other body, rounds need
    not end where several contacts share a body (Lions 1990 has the proof for springs that are
    alike).
    """
    contact.guest_force, contact.host_force = 0.0, 0.0
    if known >= 0:
        contact.guest_force = search.memory.force[known, 0]
        contact.host_force = search.memory.force[known, 1]
    bodies, guest, host = search.bodies, contact.guest, contact.host
    row, p = contact.row, contact.point
    softer = min(_of_corners(bodies.impedance[host], contact), bodies.impedance[guest, row, p])
    left = min(_of_corners(bodies.leeway[host], contact), bodies.leeway[guest, row, p])
    contact.stiffness, contact.leeway, contact.before = softer, left / softer, 0.0
    if bodies.led[host] == FOR_GOOD:
        contact.stiffness = bodies.firm[guest, row, p]
    elif bodies.led[guest] == FOR_GOOD:
        contact.stiffness = _of_corners(bodies.firm[host], contact)
    contact.stiffest = contact.stiffness
    if bodies.led[host] == 0 and bodies.led[guest] == 0:
        whole = min(_of_corners(bodies.whole[host], contact), bodies.whole[guest, row, p])
        contact.stiffest = max(whole, softer)


@kernel
def _spare_crossed(touch, low, high, search):
    """Let all contacts, from low to high - 1, of a guest that is on both sides of its host, as
    where their rims cross, keep the depth that they begin with.

    Points on either side of where vanes cross are nearer to the host than it is thick, however it
    lies: what would bring one out presses the other in.
    """
    both = False
    for k in range(low + 1, high):
        both = both or touch[k].side != touch[low].side
    if not both:
        return
    for k in range(low, high):
        contact = touch[k]
        begin = guest_place(
            search.bodies.start[contact.guest], contact.row, contact.point, contact.fraction
        )
        along, beside = _along(search.bodies.start[contact.host], begin, contact)
        depth = contact.thickness - contact.side * along
        if _is_over(along, beside, contact.thickness):
            contact.spared = max(contact.spared, depth)
        elif depth > 0.0:
            # beside a triangle its plane tells no depth, but how much nearer it may be
            contact.thickness, contact.spared = contact.thickness - depth, 0.0


@kernel
def _find_pair(pair, candidates, room, search, touch, state):
    """Contacts of all nodes of a pair of candidates. room: Room. state: how many contacts there
    are, and the place in the memory that was reached; returns both as they are then."""
    guest, host = candidates.pairs[pair, 0], candidates.pairs[pair, 1]
    side, depth, (count, at) = candidates.order[pair], candidates.depth[pair], state
    surfaces, bodies, known = search.surfaces, search.bodies, search.memory.key
    guests, boxes, bounds = surfaces.guests[guest], bodies.boxes[guest], bodies.bounds[host]
    rows, width = guests.shape
    margin, columns, own = room.margin, surfaces.exists.shape[3], surfaces.columns[guest]
    present, exists, host_boxes = surfaces.present[host], surfaces.exists[host], bodies.boxes[host]
    limit = surfaces.far[host] + margin + room.way
    begin, host_begin = bodies.start[guest], bodies.start[host]
    end, host_end = bodies.ahead[guest], bodies.ahead[host]
    # neighbours on the guest are near neighbours on the host
    near, already = (-1, -1), count
    for i in range(rows):
        after = min(i + 1, rows - 1)
        if boxes_apart(boxes[i], bounds, margin) and boxes_apart(boxes[after], bounds, margin):
            continue
        key = (pair * rows + i) * width
        at = _remembered(key, known, at)
        is_known = at < known.shape[0] and known[at] < key + width
        above = is_above(boxes[i], room) and is_above(boxes[after], room)
        if above and not is_known:
            continue
        for c in range(width):
            if guests[i, c] == 0:
                continue
            key = (pair * rows + i) * width + c
            at = _remembered(key, known, at)
            is_known = at < known.shape[0] and known[at] == key
            # once the side is known the pose ahead can be searched, however deep
            is_ahead = (search.memory.side[at] if is_known else side) != 0
            now, host_now = (end, host_end) if is_ahead else (begin, host_begin)
            p, fraction = guest_point(c, columns, own)
            x = guest_place(now, i, p, fraction)
            if not is_near(x, is_known, bounds, room):
                continue
            found = nearest_node(x, host_now, present, host_boxes, near, limit)
            if found[0] < 0:
                continue
            near, closest = found, closest_point(x, host_now, exists, found)
            if closest[0][0] < 0:
                continue
            if not is_known and is_off(x, closest, host_now, columns, side, room):
                continue
            node = Node(pair, guest, host, i, c, side, at if is_known else -1, depth)
            count = _find_node(x, node, near, closest, search, touch, count)
    if search.turns:
        _spare_crossed(touch, already, min(count, touch.shape[0]), search)
    return count, at


@kernel
def refit(search, clearance, near, low, high):
    """Boxes around the bodies from low to high - 1 that are near (B,) at both ends of the interval;
    how far each goes in it, and has gone since the search that it was in before."""
    bodies, present = search.bodies, search.surfaces.present
    for body in range(low, high):
        if near[body] == 0:
            continue
        bodies.way[body] = row_boxes(
            bodies.start[body],
            bodies.ahead[body],
            present[body],
            bodies.boxes[body],
            bodies.bounds[body],
        )
        bodies.swing[body] = swing_of(bodies.start[body], bodies.ahead[body])
        exists = search.surfaces.exists[body]
        fit_slab(bodies.ahead[body], present[body], exists, bodies.slab[body])
        follow(body, search, clearance)


@kernel
def _first_key(key, least):
    """Place of the first of ascending keys that is not less than the least."""
    low, high = 0, key.shape[0]
    while low < high:
        middle = (low + high) // 2
        if key[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def _first_contact(touch, number, pair):
    """Place of the first of the number of contacts that is of the pair, of one behind it or of a
    wall."""
    low, high = 0, number
    while low < high:
        middle = (low + high) // 2
        if 0 <= touch[middle].pair < pair:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def find_contacts(candidates, search, earlier, clearance, low, high, touch):
    """Contacts of the candidates from low to high - 1, written to touch; returns how many there
    are, and how many pairs were looked at closely.

    More than touch has room for: only that they are too many is right.
    """
    _, rows, width = search.surfaces.guests.shape
    bodies, (before, kept, stale) = search.bodies, earlier
    count, looked_at, old = 0, 0, _first_contact(before, kept, low)
    at = _first_key(search.memory.key, low * rows * width)
    for pair in range(low, high):
        guest, host = candidates.pairs[pair, 0], candidates.pairs[pair, 1]
        if candidates.depth[pair] == np.inf:
            continue
        if stale[guest] == 0 and stale[host] == 0:
            while old < kept and 0 <= before[old].pair < pair:
                old += 1
            while old < kept and before[old].pair == pair:
                if count < touch.shape[0]:
                    touch[count] = before[old]
                count, old = count + 1, old + 1
            continue
        margin = margin_of(search, guest, host)
        if boxes_apart(bodies.bounds[guest], bodies.bounds[host], margin):
            continue
        way = way_between(bodies, guest, host)
        if is_clear(pair, guest, host, margin + way, clearance):
            continue
        side, already = candidates.order[pair], count
        looked_at += 1
        room = room_of(guest, host, side, margin, way, search, clearance.half)
        count, at = _find_pair(pair, candidates, room, search, touch, (count, at))
        if count == already and side != 0:
            clear(pair, (guest, host), side, (margin, way), search, clearance)
    return count, looked_at
