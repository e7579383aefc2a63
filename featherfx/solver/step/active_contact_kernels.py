"""Contacts that open or close within a Newton step.

A contact presses with <P>, P = L - r g, and the matrix K of a step takes it for linear: with P
where it is on, else not at all. Where many contacts are about to open or to close, as between vanes
that slide over each other, Newton's steps find out which by trying, with a new matrix each.
Instead, contacts are on at first that pressed in the step before, L > 0, and a step d is that to
the minimum of the model in which everything else is as K has it, but contacts press as they do.
From K d = f, with f minus the gradient with what is on, follows which P - r n.J d are positive.
These are on then, their r n n^T goes into what K was factored from, that of others out of it, and d
is solved for again, until nothing changes (the semi-smooth Newton method: Hintermueller, Ito and
Kunisch 2002). That takes a factorisation, a fraction of what a new matrix takes, however many
contacts change.

The model is convex and has the true gradient, so d leads downwards. Where it is far from what a
long step does, so that a part of d has to do, the next step is by a matrix with what presses then.
"""

from featherfx.algebra.vector_kernels import (
    add_scaled,
    conjugate,
    copy_values,
    multiply,
    rotate,
    store,
    store_rotation,
)
from featherfx.jit.compiled import kernel
from featherfx.mechanics.contact_kernels import (
    CONTACT_FORCE,
    CONTACT_STIFFNESS,
    add_contact_stiffness,
    press,
)
from featherfx.solver.types import MAX_FOLLOWED_CONTACTS

# m, by which a gap must be open or closed to be so
_GAP_CLEARANCE = 1e-8


@kernel
def followed_contacts(model, contacts, f):
    """The contacts of feather f that are followed: from one number to another."""
    first = contacts.first[f]
    if model.joints.shape[3] == 0:
        return first, first
    return first, min(contacts.first[f + 1], first + MAX_FOLLOWED_CONTACTS)


@kernel
def barb_place(row, p, columns):
    """Row, side and place on the barb of a node p of a row."""
    side = 1 if p > columns else 0
    return row, side, p - side * columns


@kernel
def _place_of(contacts, c, model):
    return barb_place(contacts.node[c, 0], contacts.node[c, 1], model.joints.shape[3])


@kernel
def _unknown(place, a, jacobian):
    """Number among all N of increment a of a row and side (barb_jacobians)."""
    i, side, _ = place
    count = jacobian.shape[2] - 6
    return i * (6 + 2 * count) + a + (side * count if a >= 6 else 0)


@kernel
def along_normal(normal, place, line):
    """Part along a normal of a node's vector in lines (3 S) of a barb's."""
    size, j = line.shape[0] // 3, place[2]
    return normal[0] * line[j] + normal[1] * line[size + j] + normal[2] * line[2 * size + j]


@kernel
def node_slopes(direction, place, held, work, slopes):
    """Compute how far a node goes in a direction with each increment of its row and side, in the
    matrix's coordinates (w,); not with those of a root that is held."""
    lines = work.jacobian[place[0], place[1]]
    for a in range(lines.shape[0]):
        slopes[a] = along_normal(direction, place, lines[a])
    turn = work.closing.turns[place[0]]
    for a in (0, 3):
        store(slopes[a:], rotate(turn, (slopes[a], slopes[a + 1], slopes[a + 2])))
    if held and place[0] == 0:
        for a in range(6):
            slopes[a] = 0.0


@kernel
def put_force(slopes, place, factor, jacobian, right):
    """Add a force along a direction with such slopes (w,), N, to forces (N,)."""
    for a in range(slopes.shape[0]):
        right[_unknown(place, a, jacobian)] += factor * slopes[a]


@kernel
def put_product(slopes, others, place, factor, jacobian, band):
    """Add to a band the symmetric matrix factor * slopes others^T, (w,) each."""
    for a in range(slopes.shape[0]):
        at = _unknown(place, a, jacobian)
        for b in range(a, slopes.shape[0]):
            band[at, _unknown(place, b, jacobian) - at] += factor * slopes[a] * others[b]


@kernel
def _put_node(stiff, place, held, work):
    """Add the stiffness (6,), N/m, of a node to the band."""
    closing, band, axes = work.closing, work.system.band, work.closing.slopes
    for k in range(3):
        unit = 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0
        node_slopes(unit, place, held, work, axes[k])
    x, y, z, pulled = axes[0], axes[1], axes[2], closing.pulled
    for a in range(x.shape[0]):
        pulled[0, a] = stiff[0] * x[a] + stiff[3] * y[a] + stiff[4] * z[a]
        pulled[1, a] = stiff[3] * x[a] + stiff[1] * y[a] + stiff[5] * z[a]
        pulled[2, a] = stiff[4] * x[a] + stiff[5] * y[a] + stiff[2] * z[a]
    for k in range(3):
        put_product(axes[k], pulled[k], place, 1.0, work.jacobian, band)


@kernel
def turn_contact_axes(made, rotations, closing):
    """Have contacts in the coordinates of a matrix that was made where the rows had other
    rotations (n, 4) than where the Jacobian is."""
    for i in range(made.shape[0]):
        turn = multiply(made[i], conjugate(rotations[i]))
        store_rotation(closing.turns[i], turn)


@kernel
def add_contacts_to_matrix(model, contacts, f, fraction, points, before, work):
    """Put the contacts of feather f at points (n, 1 + 2 m, 3) into a matrix without them, those on
    that press, or did in the step before; note which, and keep the matrix."""
    closing, held = work.closing, model.held[f]
    first, last = followed_contacts(model, contacts, f)
    if last == first:
        return
    closing.stiff[:] = 0.0
    for c in range(first, last):
        if before:
            is_on = contacts.strength[c, CONTACT_FORCE] > 0.0
        else:
            is_on = press(contacts, c, fraction, points) > 0.0
        closing.on[c - first] = 1 if is_on else 0
        add_contact_stiffness(contacts, c, is_on, fraction, points, closing.stiff)
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            stiff = closing.stiff[i, p]
            if stiff[0] + stiff[1] + stiff[2] > 0.0:
                _put_node(stiff, barb_place(i, p, model.joints.shape[3]), held, work)
    copy_values(work.system.band, closing.band)


@kernel
def linearise_contacts(model, contacts, f, fraction, points, work):
    """Note what the contacts of feather f press, and have minus the gradient, work.system.right,
    with the forces that they have as the matrix has them."""
    closing, right, slopes = work.closing, work.system.right, work.closing.slopes[0]
    first, last = followed_contacts(model, contacts, f)
    for c in range(first, last):
        push, is_on = press(contacts, c, fraction, points), closing.on[c - first] != 0
        closing.push[c - first] = push
        if (push > 0.0) != is_on:
            place = _place_of(contacts, c, model)
            node_slopes(contacts.normal[c], place, model.held[f], work, slopes)
            put_force(slopes, place, push if is_on else -push, work.jacobian, right)


@kernel
def move_nodes(step, jacobian, closing):
    """Compute how far a step (N,) moves the nodes of all barbs, m: to closing.nodes (n, 2, 3 S)."""
    nodes, own = closing.nodes, closing.slopes[0]
    nodes[:] = 0.0
    for i in range(jacobian.shape[0]):
        turn = conjugate(closing.turns[i])
        for side in range(2):
            for a in range(jacobian.shape[2]):
                own[a] = step[_unknown((i, side, 0), a, jacobian)]
            for a in (0, 3):
                store(own[a:], rotate(turn, (own[a], own[a + 1], own[a + 2])))
            for a in range(jacobian.shape[2]):
                add_scaled(own[a], jacobian[i, side, a], nodes[i, side])


@kernel
def switch_contacts(model, contacts, f, step, back, work):
    """Have on what presses after a step (N,), or, to go back, what did in the step before, in the
    matrix and the right-hand side that were kept; returns how many have changed."""
    closing, jacobian, slopes = work.closing, work.jacobian, work.closing.slopes[0]
    first, last = followed_contacts(model, contacts, f)
    changed = 0
    if last > first:
        move_nodes(step, jacobian, closing)
    for c in range(first, last):
        k, place = c - first, _place_of(contacts, c, model)
        stiffness, sign = (
            contacts.strength[c, CONTACT_STIFFNESS],
            -1.0 if closing.on[k] != 0 else 1.0,
        )
        opened = along_normal(contacts.normal[c], place, closing.nodes[place[0], place[1]])
        depth = closing.push[k] / stiffness - opened
        if back:
            depth = 1.0 if contacts.strength[c, CONTACT_FORCE] > 0.0 else -1.0
        if sign * depth > _GAP_CLEARANCE:
            closing.on[k] = 1 - closing.on[k]
            node_slopes(contacts.normal[c], place, model.held[f], work, slopes)
            put_product(slopes, slopes, place, sign * stiffness, jacobian, closing.band)
            put_force(slopes, place, sign * closing.push[k], jacobian, closing.right)
            changed += 1
    return changed
