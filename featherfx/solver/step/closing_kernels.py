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

from featherfx.algebra.array_kernels import add_scaled, copy_values
from featherfx.jit.compiled import kernel
from featherfx.mechanics.contact_kernels import FORCE, STIFFNESS, press

# contacts of a feather that are followed, at most; others are as they are where K is made
FOLLOWED = 16384
# m, by which a gap must be open or closed to be so
CLEAR = 1e-8


@kernel
def followed(model, contacts, f):
    """The contacts of feather f that are followed: from one number to another."""
    first = contacts.first[f]
    if model.joints.shape[3] == 0:
        return first, first
    return first, min(contacts.first[f + 1], first + FOLLOWED)


@kernel
def _place(contacts, c, columns):
    """Row, side and place on the barb of a contact's node."""
    i, p = contacts.node[c, 0], contacts.node[c, 1]
    side = 1 if p > columns else 0
    return i, side, p - side * columns


@kernel
def _unknown(place, a, jacobian):
    """Number among all N of increment a of a row and side (barb_jacobians)."""
    i, side, _ = place
    count = jacobian.shape[2] - 6
    return i * (6 + 2 * count) + a + (side * count if a >= 6 else 0)


@kernel
def _along(normal, place, line):
    """Part along a normal of a node's vector in lines (3 S) of a barb's."""
    size, j = line.shape[0] // 3, place[2]
    return normal[0] * line[j] + normal[1] * line[size + j] + normal[2] * line[2 * size + j]


@kernel
def _put(contacts, c, place, factor, jacobian, right):
    """Add a force of a contact's node along its normal, N, to forces (N,)."""
    for a in range(jacobian.shape[2]):
        slope = _along(contacts.normal[c], place, jacobian[place[0], place[1], a])
        right[_unknown(place, a, jacobian)] += factor * slope


@kernel
def _put_stiffness(contacts, c, place, factor, jacobian, band):
    """Add a stiffness of a contact's node along its normal, N/m, to a band."""
    for a in range(jacobian.shape[2]):
        slope = _along(contacts.normal[c], place, jacobian[place[0], place[1], a])
        at = _unknown(place, a, jacobian)
        for b in range(a, jacobian.shape[2]):
            other = _along(contacts.normal[c], place, jacobian[place[0], place[1], b])
            band[at, _unknown(place, b, jacobian) - at] += factor * slope * other


@kernel
def begin_contacts(model, contacts, f, fraction, points, before, work):
    """Note which contacts of feather f are on in the matrix that was made at points
    (n, 1 + 2 m, 3), or put them into it as they were in the step before; and keep it."""
    jacobian, band, closing = work.jacobian, work.system.band, work.closing
    first, last = followed(model, contacts, f)
    columns = points.shape[1] // 2
    for c in range(first, last):
        is_on = presses = press(contacts, c, fraction, points) > 0.0
        place = _place(contacts, c, columns)
        if before and not (model.held[f] and place[0] == 0):
            is_on = contacts.strength[c, FORCE] > 0.0
        closing.on[c - first] = 1 if is_on else 0
        if presses != is_on:
            stiffness = contacts.strength[c, STIFFNESS] * (1.0 if is_on else -1.0)
            _put_stiffness(contacts, c, place, stiffness, jacobian, band)
    if last > first:
        copy_values(band, closing.band)


@kernel
def take_for_linear(model, contacts, f, fraction, points, jacobian, closing, right):
    """Note what the contacts of feather f press, and have minus the gradient, right (N,), with the
    forces that they have as the matrix has them."""
    first, last = followed(model, contacts, f)
    columns = points.shape[1] // 2
    for c in range(first, last):
        push, is_on = press(contacts, c, fraction, points), closing.on[c - first] != 0
        closing.push[c - first] = push
        if (push > 0.0) != is_on:
            place = _place(contacts, c, columns)
            if not (model.held[f] and place[0] == 0):
                _put(contacts, c, place, push if is_on else -push, jacobian, right)


@kernel
def _go(step, jacobian, nodes):
    """How far a step (N,) moves the nodes of all barbs, m: nodes (n, 2, 3 S)."""
    nodes[:] = 0.0
    for i in range(jacobian.shape[0]):
        for side in range(2):
            for a in range(jacobian.shape[2]):
                factor = step[_unknown((i, side, 0), a, jacobian)]
                add_scaled(factor, jacobian[i, side, a], nodes[i, side])


@kernel
def turn_contacts(model, contacts, f, step, back, jacobian, closing):
    """Have on what presses after a step (N,), or, to go back, what did in the step before, in the
    matrix and the right-hand side that were kept; returns how many have changed."""
    first, last = followed(model, contacts, f)
    changed, columns = 0, model.joints.shape[3]
    if last > first:
        _go(step, jacobian, closing.nodes)
    for c in range(first, last):
        k, place = c - first, _place(contacts, c, columns)
        if model.held[f] and place[0] == 0:
            continue
        stiffness, sign = contacts.strength[c, STIFFNESS], -1.0 if closing.on[k] != 0 else 1.0
        opened = _along(contacts.normal[c], place, closing.nodes[place[0], place[1]])
        depth = closing.push[k] / stiffness - opened
        if back:
            depth = 1.0 if contacts.strength[c, FORCE] > 0.0 else -1.0
        if sign * depth > CLEAR:
            closing.on[k] = 1 - closing.on[k]
            _put_stiffness(contacts, c, place, sign * stiffness, jacobian, closing.band)
            _put(contacts, c, place, sign * closing.push[k], jacobian, closing.right)
            changed += 1
    return changed
