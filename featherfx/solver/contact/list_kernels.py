"""The contacts of an interval: measured, handed to the feathers, and their forces.

A contact presses a node of one vane (the guest) against a point of a triangle of another (the
host). Its gap is counted along the host's normal n on the side s = 1 or -1 where the guest belongs:

    g = s n.(x - y) - t + a,     y = sum of w_i x_i over the corners

t sum of both half thicknesses; a what an interval that begins too deep is spared of its depth, so
that a feather that slipped through comes back at a limited speed instead of being shot out.

Points count as on the widest grid of all bodies (surfaces.Grids). touch: contacts found (types),
the first count of them.

Data of the contacts of one search that the next one needs.

Bodies that touch: in islands, and in colours, so that no two of a colour touch.
"""

from __future__ import annotations

from featherfx.algebra.vector_kernels import add, dot, scale, store, sub
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.joint_kernels import given_force
from featherfx.solver.contact.search_kernels import guest_place, side_normal

# least part of a contact that a corner carries: it needs a stiffness to divide by
_MIN_WEIGHT = 1e-6
# stiffness of a contact that presses with the force it had, over its own
_GENTLE = 1e-2
# part of a gap that one solve leaves of it where its spring gets stiffer, and by what factor
_SLOW, _STIFFER = 0.8, 1.5
# contacts that press from opposite sides: cosine between their normals, and how many rows they are
# apart, at most
_OPPOSED, _BESIDE = -0.5, 1


@kernel
def triangle_normal(points, contact):
    """Unit normal of a contact's triangle in a pose (n, 1 + 2 m, 3)."""
    corner = contact.corner
    a = points[corner[0, 0], corner[0, 1]]
    b = points[corner[1, 0], corner[1, 1]]
    c = points[corner[2, 0], corner[2, 1]]
    return side_normal(contact.mirror, a, b, c)


@kernel
def host_place(points, contact):
    """Place of a contact on its host in a pose (n, 1 + 2 m, 3)."""
    corner, weight = contact.corner, contact.weight
    a = scale(weight[0], points[corner[0, 0], corner[0, 1]])
    b = scale(weight[1], points[corner[1, 0], corner[1, 1]])
    c = scale(weight[2], points[corner[2, 0], corner[2, 1]])
    return add(add(a, b), c)


@kernel
def _guest(contact, poses):
    """Place of a contact's guest in poses (B, n, 1 + 2 m, 3)."""
    return guest_place(poses[contact.guest], contact.row, contact.point, contact.fraction)


@kernel
def _measure(contact, now):
    """Gap, normal and place of a contact in a pose now (B, n, 1 + 2 m, 3), kept with it."""
    if contact.host >= 0:
        host = now[contact.host]
        store(contact.normal, scale(contact.side, triangle_normal(host, contact)))
        store(contact.place_now, host_place(host, contact))
    store(contact.guest_now, _guest(contact, now))
    along = dot(contact.normal, sub(contact.guest_now, contact.place_now))
    contact.gap = along - contact.thickness + contact.spared


@kernel
def _gone(contact, way):
    """m, how far both bodies of a contact went, of ways (B,)."""
    return way[contact.guest] + (way[contact.host] if contact.host >= 0 else 0.0)


@kernel
def is_clear(contact, way):
    """Return whether a contact presses nothing, nor can it close until bodies go farther than their
    ways (B,) so far, m."""
    return contact.clear > _gone(contact, way)


@kernel
def _note_clear(contact, way):
    """Note for how long a contact that was just measured is clear (is_clear)."""
    pressed = contact.guest_force > 0.0 or contact.host_force > 0.0 or contact.spared > 0.0
    contact.clear = -1e300 if pressed else contact.gap - contact.leeway + _gone(contact, way)


@kernel
def measure(touch, low, high, now, way):
    """Gaps, normals and places of the contacts from low to high - 1 in a pose now.

    now: (B, n, 1 + 2 m, 3). way: (B,) m, of bodies so far. Those of a wall have been there since
    they were found.
    """
    for k in range(low, high):
        _measure(touch[k], now)
        _note_clear(touch[k], way)


@kernel
def list_by_body(touch, count, listed):
    """The contacts of each body, to listed (ByBody)."""
    first, items = listed
    first[:] = 0
    for k in range(count):
        first[touch[k].guest] += 1
        if touch[k].host >= 0:
            first[touch[k].host] += 1
    total = 0
    for b in range(first.shape[0]):
        total += first[b]
        first[b] = total
    for back in range(count):
        k = count - 1 - back
        for body in (touch[k].guest, touch[k].host):
            if body >= 0:
                first[body] -= 1
                items[first[body]] = k


@kernel
def is_led(contact, body, mine):
    """Return whether what a body touches is not solved for: a wall, or a body that is not mine
    (B,)."""
    other = contact.host if contact.guest == body else contact.guest
    return other < 0 or mine[other] == 0


@kernel
def update(body, touch, listed, now, way):
    """Measure the contacts of a body that was just solved, and set the forces that it felt."""
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if is_clear(contact, way):
            continue
        _measure(contact, now)
        if contact.guest == body:
            push = contact.host_force - contact.stiffness * contact.gap
            contact.guest_force = max(0.0, push)
        else:
            push = contact.guest_force - contact.stiffness * contact.gap
            contact.host_force = max(0.0, push)
        _stiffen(contact)
        _note_clear(contact, way)


@kernel
def _stiffen(contact):
    """Make the spring of a contact stiffer whose gap hardly got smaller since the solve before."""
    gap, before = contact.gap, contact.before
    contact.before = gap
    if abs(gap) > contact.leeway and gap * before > _SLOW * before * before:
        contact.stiffness = min(_STIFFER * contact.stiffness, contact.stiffest)


@kernel
def residual(body, touch, listed, way):
    """Largest distance of a body's contacts from complementarity, m, the same over what rounds may
    leave, and deepest penetration, m.

    A gap that is closed (g < 0) or held shut from both sides with a force counts by its size, a
    misfit of forces by what it would move another round: the springs of what presses a body are
    together about as stiff as the body.
    """
    worst, open_by, depth = 0.0, 0.0, 0.0
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if is_clear(contact, way):
            continue
        depth = max(depth, contact.spared - contact.gap)
        force = min(contact.guest_force, contact.host_force)
        wrong = abs(min(contact.gap, force / contact.stiffness))
        mismatch = abs(contact.guest_force - contact.host_force) / contact.stiffness
        wrong = max(wrong, mismatch)
        worst, open_by = max(worst, wrong), max(open_by, wrong / contact.leeway)
    return worst, open_by, depth


@kernel
def _row_and_sign(contact, body):
    """The row at which a contact presses a body, and the sign of its normal there."""
    if contact.guest == body:
        return contact.row, 1.0
    return contact.corner[0, 0], -1.0


@kernel
def _is_opposed(contact, body, touch, listed, mine):
    """Return whether what is led presses a body about where a contact does, from the other side."""
    row, sign = _row_and_sign(contact, body)
    for at in range(listed.first[body], listed.first[body + 1]):
        other = touch[listed.items[at]]
        there, sense = _row_and_sign(other, body)
        if abs(there - row) > _BESIDE or other.gap > 0.0 or not is_led(other, body, mine):
            continue
        if sign * sense * dot(contact.normal, other.normal) < _OPPOSED:
            return True
    return False


@kernel
def share_pinch(body, touch, listed, mine):
    """Spare a body what it lacks of contacts with what is led (is_led) that pinch it: neither side
    gives way, so each keeps the depth at which their springs balance."""
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if contact.gap >= -contact.leeway or not is_led(contact, body, mine):
            continue
        if _is_opposed(contact, body, touch, listed, mine):
            contact.spared -= contact.gap
            contact.gap = 0.0


@kernel
def is_pressed(body, touch, listed, way):
    """Return whether anything presses a body, or is in it."""
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if is_clear(contact, way):
            continue
        if contact.guest_force > 0.0 or contact.host_force > 0.0 or contact.gap < 0.0:
            return True
    return False


@kernel
def is_shared(body, touch, listed, marks):
    """Return whether a body that is solved as well (Marks.mine) presses a body, or is in it."""
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if is_clear(contact, marks.way) or is_led(contact, body, marks.mine):
            continue
        if contact.guest_force > 0.0 or contact.host_force > 0.0 or contact.gap < 0.0:
            return True
    return False


@kernel
def closed_on_led(body, touch, listed, mine):
    """Return whether a contact of a body with what is led (is_led) closed in the last solve: it had
    no friction yet, for that goes by the force of the solve before."""
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if is_led(contact, body, mine):
            is_guest = contact.guest == body
            now = contact.guest_force if is_guest else contact.host_force
            before = contact.host_force if is_guest else contact.guest_force
            if before == 0.0 and now > 0.0:
                return True
    return False


@kernel
def _is_out_of_reach(contact, force, gap, reach):
    """Return whether a contact with a force (N) and a gap (m) is not handed to a body. reach: of
    HandoverRules."""
    return force == 0.0 and gap > _gone(contact, reach) + contact.leeway


@kernel
def add_forces(touch, count, total):
    """Sums of the forces (N) that each body feels, to total (B,)."""
    total[:] = 0.0
    for k in range(count):
        contact = touch[k]
        total[contact.guest] += contact.guest_force
        if contact.host >= 0:
            total[contact.host] += contact.host_force


@kernel
def hand_out(body, touch, listed, marks, start, now, rules, planes):
    """Write the plane contacts of a body to planes; returns how many there are.

    marks: of the sweep. start, now: (B, n, 1 + 2 m, 3) poses at the interval's
    start and at the last iterate. rules: HandoverRules.
    """
    to = 0
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        if _gone(contact, marks.way) + _gone(contact, rules.reach) < contact.clear:
            continue
        is_guest = contact.guest == body
        if rules.beginning:
            # gaps press each of a pair by itself, so that first accelerations would not belong
            # together, and make momentum
            own = contact.guest_force if is_guest else contact.host_force
            if own > 0.0:
                to = _hand_to(contact, body, (own, 0.0), start, now, rules, planes, to)
            continue
        if is_led(contact, body, marks.mine):
            # the force of what is led is what the feather felt last
            if is_guest:
                contact.host_force = contact.guest_force
            else:
                contact.guest_force = contact.host_force
        force = contact.host_force if is_guest else contact.guest_force
        if _is_out_of_reach(contact, force, contact.gap, rules.reach):
            continue
        to = _hand_to(contact, body, (force, 0.0), start, now, rules, planes, to)
    return to


@kernel
def hand_out_together(body, touch, listed, joint, start, now, rules, planes):
    """As hand_out, in a round in which forces are solved together."""
    to = 0
    for at in range(listed.first[body], listed.first[body + 1]):
        contact = touch[listed.items[at]]
        given = given_force(contact, contact.guest == body, joint)
        if not _is_out_of_reach(contact, given[0], contact.gap + given[1], rules.reach):
            to = _hand_to(contact, body, given, start, now, rules, planes, to)
    return to


@kernel
def take_felt(body, touch, listed, island, joint, now, rules, planes):
    """Set the forces that a body felt of the planes that hand_out_together wrote, after it was
    solved; those of what is led are what it was given. island: (B,) of each body, -1: led."""
    to = 0
    for at in range(listed.first[body], listed.first[body + 1]):
        contact, felt = touch[listed.items[at]], 0.0
        is_guest = contact.guest == body
        given = given_force(contact, is_guest, joint)
        if not _is_out_of_reach(contact, given[0], contact.gap + given[1], rules.reach):
            for _ in range((1 if contact.fraction == 0.0 else 2) if is_guest else 3):
                strength, p = planes.strength[to], planes.node[to, 1]
                p += rules.widest - rules.columns[body] if p > rules.columns[body] else 0
                gap = dot(planes.normal[to], now[body, planes.node[to, 0], p])
                felt += max(0.0, strength[1] - strength[0] * (gap - planes.offset[to, 1]))
                to += 1
        other = contact.host if is_guest else contact.guest
        if other < 0 or island[other] < 0:
            # no other thread solves that
            contact.guest_force = contact.host_force = given[0]
        if is_guest:
            contact.guest_force = felt
        else:
            contact.host_force = felt


@kernel
def _hand_to(contact, body, given, start, now, rules, planes, to):
    """Write the planes of one contact of a body, from the place to on; returns the place after.

    given: N, force, and m, by which the other body is to open the gap.
    """
    force, ahead = given
    slip = sub(
        sub(contact.guest_now, _guest(contact, start)), sub(contact.place_now, contact.place_start)
    )
    is_guest = contact.guest == body
    parts = (1 if contact.fraction == 0.0 else 2) if is_guest else 3
    stiffness = contact.stiffness * (_GENTLE if rules.beginning else 1.0)
    for q in range(parts):
        if is_guest:
            row, p = contact.row + q, contact.point
            weight = contact.fraction if q == 1 else 1.0 - contact.fraction
        else:
            row, p = contact.corner[q, 0], contact.corner[q, 1]
            weight = contact.weight[q]
        weight = max(weight, _MIN_WEIGHT)
        strength = planes.strength[to]
        strength[0] = weight * stiffness
        strength[1] = weight * force
        strength[2] = weight * rules.friction * force
        strength[3] = rules.smoothing
        planes.node[to, 0] = row
        planes.node[to, 1] = p - (rules.widest - rules.columns[body] if p > rules.widest else 0)
        sign = 1.0 if is_guest else -1.0
        _plane(contact, sign, ahead, now[body, row, p], start[body, row, p], slip, planes, to)
        if rules.beginning:
            planes.offset[to, 0] = dot(planes.normal[to], start[body, row, p])
        to += 1
    return to


@kernel
def _plane(contact, sign, ahead, x, begin, slip, planes, to):
    """The plane of one contact: at the point x the gap is the contact's gap and the slip its slip.

    sign: 1 for the guest, -1 for the host.
    """
    normal = scale(sign, contact.normal)
    store(planes.normal[to], normal)
    store(planes.target[to, 0], begin)
    store(planes.target[to, 1], sub(x, scale(sign, slip)))
    planes.offset[to, 0] = dot(normal, begin) - contact.start_gap
    planes.offset[to, 1] = dot(normal, x) - contact.gap - ahead


@kernel
def remember(touch, count, order, goes_on, key, force, side, wall):
    """Write what the next search needs of contacts (ContactSearch.remembered); returns how many of
    bodies are kept.

    order: (N,) of Candidates. goes_on: whether an interval goes on, so that only forces tell sides.
    Written: key, force and side of those kept, and wall, as of ContactMemory.
    """
    rows, columns = wall.shape[1], wall.shape[2]
    kept = 0
    for at in range(count):
        contact = touch[at]
        if contact.host < 0:
            wall[contact.guest, contact.row, contact.column] = contact.guest_force
            continue
        held = contact.guest_force > 0.0 or contact.host_force > 0.0
        if not goes_on:
            # what is deep belongs on its side, whether it is pressed or not
            deep = contact.gap < contact.spared
            held = held or deep or contact.side != order[contact.pair]
        if held:
            key[kept] = (contact.pair * rows + contact.row) * columns + contact.column
            force[kept, 0], force[kept, 1] = contact.guest_force, contact.host_force
            side[kept] = contact.side
            kept += 1
    return kept


@kernel
def _give_colour(body, low, touching, active, colours):
    """Give an active body the first colour that no active one before it has which it touches;
    returns it. low: where its part of the scratch begins."""
    first, near = touching
    colour, taken_by = colours.colour, colours.taken_by
    for at in range(first[body], first[body + 1]):
        if near[at] < body and active[near[at]] != 0:
            taken_by[low + colour[near[at]]] = body
    own = 0
    while taken_by[low + own] == body:
        own += 1
    colour[body] = own
    return own


@kernel
def colour_island(island, touching, marks, islands, colours):
    """Give the active bodies of an island (sweep_kernels.Marks, Islands) colours, the others -1;
    returns how many colours there are."""
    low, high, most = islands.first[island], islands.first[island + 1], 0
    for at in range(low, high):
        colours.taken_by[at] = -1
    for at in range(low, high):
        body = islands.bodies[at]
        colours.colour[body] = -1
        if marks.active[body] != 0:
            most = max(most, _give_colour(body, low, touching, marks.active, colours) + 1)
    return most


@kernel
def colour_some(touching, marks, islands, colours):
    """Put the active bodies of open islands (sweep_kernels.Marks, Islands) into colours
    (Colours)."""
    bodies, most = colours.colour.shape[0], 0
    for c in range(bodies + 1):
        colours.taken_by[c], colours.first[c] = -1, 0
    colours.first[bodies + 1] = 0
    for body in range(bodies):
        colours.colour[body], colours.done[body] = -1, 0
        if marks.active[body] == 0 or islands.open[marks.island[body]] == 0:
            continue
        own = _give_colour(body, 0, touching, marks.active, colours)
        colours.first[own + 2] += 1
        most = max(most, own + 1)
    for c in range(most):
        colours.first[c + 2] += colours.first[c + 1]
    for body in range(bodies):
        own = colours.colour[body]
        if own >= 0:
            colours.bodies[colours.first[own + 1]] = body
            colours.first[own + 1] += 1
    colours.number[0] = most
