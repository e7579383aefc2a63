"""Contact forces of an island solved together, by how far each body gives way under them.

Rounds hand forces from body to body, so what many contacts share takes many of them. Here all
bodies of an island are taken as linear about where they are: a body with the stiffness K of its
last solve moves at its contacts, along their normals n, by W = J K^-1 J^T for a unit force on each,
J the displacement of a contact by the body's coordinates. The gaps g after other forces L are

    g = g_0 + sum of W_b (L - L_b) over the bodies,     g >= 0,  L >= 0,  g L = 0

L_b the forces that body b felt last. This minimises a convex function of L; a part of the distance
from the last forces is added, since contacts that lie side by side could share a force in any way.
Each body is then solved with its L against planes that have moved as the others are to move.
Sources: Dostal and Schoeberl 2005 (modified proportioning with reduced gradient projections).
"""

from math import sqrt

from featherfx.algebra.vector_kernels import copy_values, scale
from featherfx.algebra.views import viewed
from featherfx.jit.compiled import kernel
from featherfx.solver.contact.types import APART, LED
from featherfx.solver.step.active_contact_kernels import (
    along_normal,
    barb_place,
    move_nodes,
    node_slopes,
    put_force,
    put_product,
    turn_contact_axes,
)
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.pose_kernels import barb_jacobians, joint_axes, load_pose, place_points

# gaps up to which open contacts are among the forces, over the largest that should be closed
_NEAR = 1.0
# part of a contact's own compliance by which forces are held where they were
_HELD = 1e-3
# iterations at most; part of what rounds may leave to which gaps are closed, and forces change
_MAX_ITERATIONS, _CLOSED, _CHANGED = 300, 0.1, 0.25
# what is left of all gaps on forces over what lies on those that should be zero (Gamma^2)
_PROPORTION = 1.0
# lines of scratch: gradient, direction, image, sizes of the forces, their last values
_GRADIENT, _DIRECTION, _IMAGE, _SIZE, _LAST, _HOLD = 0, 1, 2, 3, 4, 5


@kernel
def _owner(contact, island, marks):
    """Return whether guest or host stands for a contact, the guest where it is of the island."""
    return contact.guest if marks.island[contact.guest] == island else contact.host


@kernel
def choose_forces(island, sweep):
    """Choose the contacts of an island whose forces are solved together; returns whether there are
    any, and room for them."""
    islands, marks, joint = sweep.islands, sweep.marks, sweep.joint
    low, high = islands.first[island], islands.first[island + 1]
    reach = 0.0
    for at in range(low, high):
        body = islands.bodies[at]
        if marks.soft[body] != 0:
            return False
        reach = max(reach, _NEAR * marks.worst[body])
    place, (touch, listed) = joint.first[island], (sweep.touch, sweep.listed)
    for at in range(low, high):
        body = islands.bodies[at]
        for k in range(listed.first[body], listed.first[body + 1]):
            contact = touch[listed.items[k]]
            if _owner(contact, island, marks) != body:
                continue
            pressed = contact.guest_force > 0.0 or contact.host_force > 0.0
            contact.joint = APART
            if contact.host < 0 or marks.mine[contact.guest] == 0 or marks.mine[contact.host] == 0:
                contact.joint = LED if pressed else APART
            elif pressed or contact.gap < reach:
                contact.joint = place
                joint.chosen[place] = listed.items[k]
                place += 1
    joint.last[island] = place
    return _make_room(island, sweep) and place > joint.first[island]


@kernel
def _make_room(island, sweep):
    """Lay out items and weights of the bodies of an island; returns whether there is room."""
    islands, joint, touch, listed = sweep.islands, sweep.joint, sweep.touch, sweep.listed
    item, weight = 2 * joint.first[island], joint.room[island]
    for at in range(islands.first[island], islands.first[island + 1]):
        body, first = islands.bodies[at], item
        for k in range(listed.first[body], listed.first[body + 1]):
            place = touch[listed.items[k]].joint
            if place >= 0:
                joint.items[item] = place
                item += 1
        joint.items_at[body], joint.weights_at[body] = first, weight
        joint.count[body] = item - first
        weight += joint.count[body] * joint.count[body]
    return weight <= joint.room[island + 1]


@kernel
def _part(contact, is_guest, q):
    """Row, point and weight of part q of a contact on a body."""
    if is_guest:
        return contact.row + q, contact.point, contact.fraction if q == 1 else 1.0 - contact.fraction
    return contact.corner[q, 0], contact.corner[q, 1], contact.weight[q]


@kernel
def _place_of(row, p, grid):
    """Place on a barb of a point of the widest grid. grid: its columns, and those of the body."""
    widest, columns = grid
    return barb_place(row, p - (widest - columns if p > widest else 0), columns)


@kernel
def _spread(contact, body, factor, held, grid, work):
    """Add the force along a contact's normal on a body to work.system.right, or, where a factor
    (N/m) is given, the stiffness of its spring to the band."""
    is_guest, slopes, jacobian = contact.guest == body, work.closing.slopes[0], work.jacobian
    normal = scale(1.0 if is_guest else -1.0, contact.normal)
    for q in range(2 if is_guest else 3):
        row, p, weight = _part(contact, is_guest, q)
        if weight > 0.0:
            place = _place_of(row, p, grid)
            node_slopes(normal, place, held, work, slopes)
            if factor == 0.0:
                put_force(slopes, place, weight, jacobian, work.system.right)
            else:
                put_product(slopes, slopes, place, weight * factor, jacobian, work.system.band)


@kernel
def _opens(contact, body, grid, nodes):
    """Return by how much a body opens the gap of a contact with the displacements (n, 2, 3 S) m of
    its nodes."""
    is_guest, total = contact.guest == body, 0.0
    normal = scale(1.0 if is_guest else -1.0, contact.normal)
    for q in range(2 if is_guest else 3):
        row, p, weight = _part(contact, is_guest, q)
        if weight > 0.0:
            place = _place_of(row, p, grid)
            total += weight * along_normal(normal, place, nodes[row, place[1]])
    return total


@kernel
def _factorise_last(body, g, f, work, sweep):
    """Have the matrix of a body's last solve, with springs towards what is led, factored; returns
    whether it can be. g, f: its batch and place."""
    batches, now = sweep.batches, work.now
    model, kept = viewed(batches.model, g), viewed(batches.kept, g)
    load_pose(model, f, viewed(batches.new, g), now)
    place_points(model, f, now)
    joint_axes(model.shapes, now, work.axes)
    barb_jacobians(model.shapes, now, work.axes, work.jacobian)
    turn_contact_axes(kept.matrices.made[f], now.rotation, work.closing)
    copy_values(kept.matrices.plain[f], work.system.band)
    grid = sweep.handing.widest, model.joints.shape[3]
    for k in range(sweep.listed.first[body], sweep.listed.first[body + 1]):
        contact = sweep.touch[sweep.listed.items[k]]
        if contact.joint == LED:
            _spread(contact, body, contact.stiffness, model.held[f], grid, work)
    return factorise(work.system.band, work.system.panel)


@kernel
def find_weights(body, thread, sweep):
    """Find how far a body gives way at its contacts under unit forces; 0 where its matrix cannot
    tell."""
    batches, joint, touch = sweep.batches, sweep.joint, sweep.touch
    count, first, to = joint.count[body], joint.items_at[body], joint.weights_at[body]
    g, f = batches.batch[body], batches.place[body]
    model = viewed(batches.model, g)
    weights = joint.weights[to : to + count * count]
    weights[:] = 0.0
    if count == 0 or sweep.marks.solves[body] == 0 or model.joints.shape[3] == 0:
        return
    work = viewed(batches.work, thread * batches.model.words.shape[0] + g)
    if not _factorise_last(body, g, f, work, sweep):
        return
    right, grid = work.system.right, (sweep.handing.widest, model.joints.shape[3])
    for k in range(count):
        right[:] = 0.0
        contact = touch[joint.chosen[joint.items[first + k]]]
        _spread(contact, body, 0.0, model.held[f], grid, work)
        solve_factored(work.system.band, right)
        move_nodes(right, work.jacobian, work.closing)
        for j in range(count):
            other = touch[joint.chosen[joint.items[first + j]]]
            weights[k * count + j] = _opens(other, body, grid, work.closing.nodes)


@kernel
def _felt(contact, body):
    """Return the force that a body felt last of a contact, N."""
    return contact.guest_force if contact.guest == body else contact.host_force


@kernel
def _multiply(island, forces, image, sweep):
    """Displacements at the places of an island under forces there, added to image."""
    islands, joint = sweep.islands, sweep.joint
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.count[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            total = 0.0
            for j in range(count):
                total += joint.weights[row + j] * forces[joint.items[first + j]]
            image[joint.items[first + k]] += total
            row += count


@kernel
def _begin(island, low, high, sweep):
    """Sizes of the forces, their first values, and the gradient there; returns a bound of the
    matrix's norm."""
    islands, joint, touch = sweep.islands, sweep.joint, sweep.touch
    size, gradient, image = joint.lines[_SIZE], joint.lines[_GRADIENT], joint.lines[_IMAGE]
    for k in range(low, high):
        contact = touch[joint.chosen[k]]
        joint.force[k] = 0.5 * (contact.guest_force + contact.host_force)
        joint.lines[_LAST, k], gradient[k] = joint.force[k], contact.gap
        size[k] = image[k] = 0.0
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.count[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            size[joint.items[first + k]] += joint.weights[row + k]
            for j in range(count):
                place = joint.items[first + j]
                more = joint.force[place] - _felt(touch[joint.chosen[place]], body)
                gradient[joint.items[first + k]] += joint.weights[row + j] * more
            row += count
    for k in range(low, high):
        size[k] = 1.0 / sqrt((1.0 + _HELD) * size[k]) if size[k] > 0.0 else 0.0
        gradient[k] *= size[k]
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.count[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            own = size[joint.items[first + k]]
            for j in range(count):
                image[joint.items[first + k]] += abs(
                    own * joint.weights[row + j] * size[joint.items[first + j]]
                )
            row += count
    bound = 0.0
    for k in range(low, high):
        bound = max(bound, image[k])
    return bound + _HELD


@kernel
def _apply(island, low, high, sweep):
    """Image of the direction."""
    lines = sweep.joint.lines
    direction, image, size, held = lines[_DIRECTION], lines[_IMAGE], lines[_SIZE], lines[_HOLD]
    for k in range(low, high):
        image[k], held[k] = 0.0, size[k] * direction[k]
    _multiply(island, held, image, sweep)
    for k in range(low, high):
        image[k] = size[k] * image[k] + _HELD / (1.0 + _HELD) * direction[k]


@kernel
def _free(k, joint):
    """Gradient of a force that is free, else 0."""
    return joint.lines[_GRADIENT, k] if joint.force[k] > 0.0 else 0.0


@kernel
def _chopped(k, joint):
    """Gradient of a force of 0 that should be more, else 0."""
    return min(joint.lines[_GRADIENT, k], 0.0) if joint.force[k] <= 0.0 else 0.0


@kernel
def _measure_gradient(low, high, step, sweep):
    """Sums of squares of the reduced free and of the chopped gradient, and the largest gap that is
    to be closed, over what rounds may leave."""
    joint, touch = sweep.joint, sweep.touch
    free, chopped, worst = 0.0, 0.0, 0.0
    for k in range(low, high):
        size = joint.lines[_SIZE, k]
        if size == 0.0:
            continue
        own, other = _free(k, joint), _chopped(k, joint)
        free += min(joint.force[k] / size / step, own) * own if own > 0.0 else own * own
        chopped += other * other
        left = max(abs(own), -other) / size
        worst = max(worst, left / touch[joint.chosen[k]].leeway)
    return free, chopped, worst


@kernel
def _go(low, high, factor, sweep):
    """Go along the direction, and its image, as often as a factor says."""
    joint = sweep.joint
    for k in range(low, high):
        joint.force[k] -= factor * joint.lines[_SIZE, k] * joint.lines[_DIRECTION, k]
        joint.lines[_GRADIENT, k] -= factor * joint.lines[_IMAGE, k]
        joint.force[k] = max(joint.force[k], 0.0)


@kernel
def _expand(island, low, high, step, sweep):
    """Go down the free gradient, as far as no force falls below 0."""
    joint = sweep.joint
    lines = joint.lines
    for k in range(low, high):
        size, change = lines[_SIZE, k], step * _free(k, joint)
        if size > 0.0:
            change = min(change, joint.force[k] / size)
        lines[_DIRECTION, k] = change
    _apply(island, low, high, sweep)
    _go(low, high, 1.0, sweep)


@kernel
def _conjugate(island, low, high, step, sweep):
    """One step of conjugate gradients on the free forces, or as far as they are."""
    joint = sweep.joint
    lines = joint.lines
    _apply(island, low, high, sweep)
    slope, bend, most = 0.0, 0.0, 1e300
    for k in range(low, high):
        p, size = lines[_DIRECTION, k], lines[_SIZE, k]
        slope += lines[_GRADIENT, k] * p
        bend += p * lines[_IMAGE, k]
        if p > 0.0 and size > 0.0:
            most = min(most, joint.force[k] / (size * p))
    if not bend > 0.0:
        return False
    if slope / bend <= most:
        _go(low, high, slope / bend, sweep)
        along = 0.0
        for k in range(low, high):
            along += _free(k, joint) * lines[_IMAGE, k]
        for k in range(low, high):
            lines[_DIRECTION, k] = _free(k, joint) - along / bend * lines[_DIRECTION, k]
        return True
    _go(low, high, most, sweep)
    _expand(island, low, high, step, sweep)
    _point_down(low, high, sweep)
    return True


@kernel
def _point_down(low, high, sweep):
    """Direction of the free gradient."""
    for k in range(low, high):
        sweep.joint.lines[_DIRECTION, k] = _free(k, sweep.joint)


@kernel
def solve_forces(island, sweep):
    """Find the forces of an island; returns iterations."""
    joint = sweep.joint
    low, high = joint.first[island], joint.last[island]
    step = 1.0 / _begin(island, low, high, sweep)
    _point_down(low, high, sweep)
    number = 0
    for number in range(_MAX_ITERATIONS):
        free, chopped, worst = _measure_gradient(low, high, step, sweep)
        if worst < _CLOSED:
            break
        if chopped <= _PROPORTION * free:
            if not _conjugate(island, low, high, step, sweep):
                break
            continue
        for k in range(low, high):
            joint.lines[_DIRECTION, k] = _chopped(k, joint)
        _apply(island, low, high, sweep)
        slope, bend = 0.0, 0.0
        for k in range(low, high):
            slope += joint.lines[_GRADIENT, k] * joint.lines[_DIRECTION, k]
            bend += joint.lines[_DIRECTION, k] * joint.lines[_IMAGE, k]
        _go(low, high, slope / bend, sweep)
        _point_down(low, high, sweep)
    _head(island, low, high, sweep)
    return number


@kernel
def _head(island, low, high, sweep):
    """Tell which bodies of an island are solved with the forces found, and by how much they are to
    open their gaps."""
    islands, joint, touch = sweep.islands, sweep.joint, sweep.touch
    for k in range(low, high):
        joint.ahead[k, 0] = joint.ahead[k, 1] = 0.0
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.count[body], joint.items_at[body], joint.weights_at[body]
        joint.moves[body] = 0
        if sweep.marks.mine[body] == 0:
            continue
        for k in range(count):
            place = joint.items[first + k]
            contact = touch[joint.chosen[place]]
            more = abs(joint.force[place] - _felt(contact, body)) / contact.stiffness
            if more > _CHANGED * contact.leeway:
                joint.moves[body] = 1
        if joint.moves[body] == 0:
            continue
        for k in range(count):
            total, own = 0.0, joint.items[first + k]
            for j in range(count):
                place = joint.items[first + j]
                more = joint.force[place] - _felt(touch[joint.chosen[place]], body)
                total += joint.weights[row + j] * more
            joint.ahead[own, 0 if touch[joint.chosen[own]].guest == body else 1] = total
            row += count


@kernel
def given_force(contact, is_guest, joint):
    """Return the force (N) that a contact is given in a round in which forces are solved together,
    and by how much (m) the other body opens its gap."""
    if contact.joint == LED:
        return contact.guest_force if is_guest else contact.host_force, 0.0
    if contact.joint == APART:
        return 0.0, 0.0
    return joint.force[contact.joint], joint.ahead[contact.joint, 1 if is_guest else 0]
