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
from featherfx.solver.contact.types import APART, FIXED
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

_SPARE = 1.5  # contacts chosen over those that are closed, at most
# gap that may stay for a change as large as the mean force of a body, over what rounds may leave;
# and part of the displacement by a force that it may be short of
_HELD, _LEAST_HELD = 10.0, 1e-5
# the same of what is led, over how far the force presses its spring: a few rounds at once
_LED_HELD = 0.25
_NO_FORCE = 1e-30  # N, that no force of an island is
# iterations at most; gaps that they may leave, over what rounds may leave and over what is off;
# change of a force for which a body is solved, over what rounds may leave
_MAX_ITERATIONS, _CLOSED, _CLOSED_RATIO, _CHANGED = 300, 0.1, 0.02, 0.1
# square of the gradient of forces that are 0 over that of the others, beyond which they grow
_PROPORTION = 1.0
# lines of scratch: in sizes of their own, gradient, direction and its image; these sizes, the
# compliance by which forces are held, and forces
_GRADIENT, _DIRECTION, _IMAGE, _SIZE, _HOLD, _FORCE = 0, 1, 2, 3, 4, 5


@kernel
def _owner(contact, island, marks):
    """Return whether guest or host stands for a contact, the guest where it is solved."""
    is_guest = marks.island[contact.guest] == island and marks.mine[contact.guest] != 0
    return contact.guest if is_guest else contact.host


@kernel
def _mean_force(contact, marks):
    """Return the mean of what both bodies felt last of a contact, N; of one with what is led in
    this interval, what the other felt."""
    if marks.mine[contact.guest] == 0:
        return contact.host_force
    if marks.mine[contact.host] == 0:
        return contact.guest_force
    return 0.5 * (contact.guest_force + contact.host_force)


@kernel
def _is_closed(contact):
    """Return whether a contact presses, or should."""
    return contact.guest_force > 0.0 or contact.host_force > 0.0 or contact.gap < 0.0


@kernel
def _serves(island, sweep):
    """Return whether the contacts chosen before are about those of an island that are closed."""
    islands, marks, listed = sweep.islands, sweep.marks, sweep.listed
    closed, chosen = 0, sweep.joint.last[island] - sweep.joint.first[island]
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        if marks.mine[body] == 0 and sweep.joint.counts[body] > 0:
            return False
        for k in range(listed.first[body], listed.first[body + 1]):
            contact = sweep.touch[listed.items[k]]
            if _owner(contact, island, marks) == body and _is_closed(contact):
                if contact.joint == APART:
                    return False
                closed += 1 if contact.joint >= 0 else 0
    return closed > 0 and chosen <= _SPARE * closed


@kernel
def choose_forces(island, sweep):
    """Choose the contacts of an island whose forces are solved together; returns whether there are
    any, and room for them."""
    islands, marks, joint = sweep.islands, sweep.marks, sweep.joint
    touch, listed, place = sweep.touch, sweep.listed, joint.first[island]
    joint.fresh[island] = 0
    if joint.last[island] > place and _serves(island, sweep):
        return True
    joint.fresh[island] = 1
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        for k in range(listed.first[body], listed.first[body + 1]):
            contact = touch[listed.items[k]]
            if _owner(contact, island, marks) != body:
                continue
            contact.joint = APART
            if _is_closed(contact):
                # where one side never gives way there may be no force
                gives = contact.host >= 0 and marks.fixed[contact.guest] == 0
                gives = gives and marks.fixed[contact.host] == 0
                contact.joint = place if gives else FIXED
            if contact.joint >= 0:
                joint.chosen[place] = listed.items[k]
                place += 1
    joint.last[island] = place
    if not _make_room(island, sweep):
        joint.last[island] = joint.first[island]
    return joint.last[island] > joint.first[island]


@kernel
def _make_room(island, sweep):
    """Lay out items and weights of the bodies of an island; returns whether there is room."""
    islands, joint, touch, listed = sweep.islands, sweep.joint, sweep.touch, sweep.listed
    item, weight = 2 * joint.first[island], joint.room[island]
    for at in range(islands.first[island], islands.first[island + 1]):
        body, first = islands.bodies[at], item
        own = 0 if sweep.marks.mine[body] == 0 else listed.first[body + 1] - listed.first[body]
        for k in range(listed.first[body], listed.first[body] + own):
            place = touch[listed.items[k]].joint
            if place >= 0:
                joint.items[item] = place
                item += 1
        joint.items_at[body], joint.weights_at[body] = first, weight
        joint.counts[body] = item - first
        weight += joint.counts[body] * joint.counts[body]
    return weight <= joint.room[island + 1]


@kernel
def _part(contact, is_guest, q):
    """Row, point and weight of part q of a contact on a body."""
    if is_guest:
        weight = contact.fraction if q == 1 else 1.0 - contact.fraction
        return contact.row + q, contact.point, weight
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
    """Have the matrix of a body's last solve, with springs towards what is fixed, factored; returns
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
        if contact.joint == FIXED:
            _spread(contact, body, contact.stiffness, model.held[f], grid, work)
    return factorise(work.system.band, work.system.panel)


@kernel
def find_weights(body, thread, sweep):
    """Find how far a body gives way at its contacts under unit forces; 0 where its matrix cannot
    tell."""
    batches, joint, touch = sweep.batches, sweep.joint, sweep.touch
    count, first, to = joint.counts[body], joint.items_at[body], joint.weights_at[body]
    g, f = batches.batch[body], batches.place[body]
    model = viewed(batches.model, g)
    weights = joint.weights[to : to + count * count]
    if count == 0 or (joint.fresh[sweep.marks.island[body]] == 0 and weights[0] > 0.0):
        return
    weights[:] = 0.0
    if sweep.marks.solves[body] == 0 or model.joints.shape[3] == 0:
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
    """Add the displacements at the places of an island under forces there to an image."""
    islands, joint = sweep.islands, sweep.joint
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.counts[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            total = 0.0
            for j in range(count):
                total += joint.weights[row + j] * forces[joint.items[first + j]]
            image[joint.items[first + k]] += total
            row += count


@kernel
def _opening(k, body, row, sweep):
    """Return by how much (m) a body opens a gap, its place k, with the forces found instead of
    those that it felt. row: where its weights begin."""
    joint, total, first = sweep.joint, 0.0, sweep.joint.items_at[body]
    for j in range(joint.counts[body]):
        place = joint.items[first + j]
        felt = _felt(sweep.touch[joint.chosen[place]], body)
        total += joint.weights[row + j] * (joint.force[place] - felt)
    return total


@kernel
def _begin(island, low, high, sweep):
    """Begin with the mean of what both bodies felt: the gaps to the gradient, and sizes with which
    each force alone opens its gap by as much."""
    islands, joint, touch = sweep.islands, sweep.joint, sweep.touch
    size, gradient, total = joint.lines[_SIZE], joint.lines[_GRADIENT], 0.0
    for k in range(low, high):
        contact = touch[joint.chosen[k]]
        joint.force[k] = _mean_force(contact, sweep.marks)
        gradient[k], size[k] = contact.gap, 0.0
        total += joint.force[k]
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.counts[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            size[joint.items[first + k]] += joint.weights[row + k]
            gradient[joint.items[first + k]] += _opening(k, body, row, sweep)
            row += count
    mean = max(total, _NO_FORCE) / (islands.first[island + 1] - islands.first[island])
    for k in range(low, high):
        contact = touch[joint.chosen[k]]
        held = _HELD * contact.leeway / mean + _LEAST_HELD * size[k]
        if sweep.marks.mine[contact.guest] * sweep.marks.mine[contact.host] == 0:
            # what two that are led pinch may have any force
            held = max(held, _LED_HELD / contact.stiffness)
        size[k] = 1.0 / sqrt(size[k] + held) if size[k] > 0.0 else 0.0
        joint.lines[_HOLD, k] = held * size[k] * size[k]
        gradient[k] *= size[k]


@kernel
def _bound(island, low, high, sweep):
    """Return an upper bound of the norm of the matrix."""
    islands, joint, bound = sweep.islands, sweep.joint, 0.0
    size, image = joint.lines[_SIZE], joint.lines[_IMAGE]
    for k in range(low, high):
        image[k] = joint.lines[_HOLD, k]
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        count, first, row = joint.counts[body], joint.items_at[body], joint.weights_at[body]
        for k in range(count):
            own = size[joint.items[first + k]]
            for j in range(count):
                more = own * joint.weights[row + j] * size[joint.items[first + j]]
                image[joint.items[first + k]] += abs(more)
            row += count
    for k in range(low, high):
        bound = max(bound, image[k])
    return bound


@kernel
def _apply(island, low, high, sweep):
    """Image of the direction."""
    lines = sweep.joint.lines
    direction, image, size, held = lines[_DIRECTION], lines[_IMAGE], lines[_SIZE], lines[_FORCE]
    for k in range(low, high):
        image[k], held[k] = 0.0, size[k] * direction[k]
    _multiply(island, held, image, sweep)
    for k in range(low, high):
        image[k] = size[k] * image[k] + lines[_HOLD, k] * direction[k]


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
    joint, lines = sweep.joint, sweep.joint.lines
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
    joint, lines = sweep.joint, sweep.joint.lines
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
    along = 0.0
    if slope / bend <= most:
        _go(low, high, slope / bend, sweep)
        for k in range(low, high):
            along += _free(k, joint) * lines[_IMAGE, k]
    else:
        _go(low, high, most, sweep)
        _expand(island, low, high, step, sweep)
    for k in range(low, high):
        lines[_DIRECTION, k] = _free(k, joint) - along / bend * lines[_DIRECTION, k]
    return True


@kernel
def _proportion(island, low, high, sweep):
    """Let forces of 0 grow that should be more."""
    lines, slope, bend = sweep.joint.lines, 0.0, 0.0
    for k in range(low, high):
        lines[_DIRECTION, k] = _chopped(k, sweep.joint)
    _apply(island, low, high, sweep)
    for k in range(low, high):
        slope += lines[_GRADIENT, k] * lines[_DIRECTION, k]
        bend += lines[_DIRECTION, k] * lines[_IMAGE, k]
    _go(low, high, slope / bend, sweep)
    for k in range(low, high):
        lines[_DIRECTION, k] = _free(k, sweep.joint)


@kernel
def solve_forces(island, sweep):
    """Find the forces of an island, which bodies are solved with them, and by how much each of
    these is to open its gaps."""
    joint = sweep.joint
    low, high = joint.first[island], joint.last[island]
    _begin(island, low, high, sweep)
    bound = _bound(island, low, high, sweep)
    for k in range(low, high):
        joint.lines[_DIRECTION, k] = _free(k, joint)
    goal = max(_CLOSED, _CLOSED_RATIO * sweep.islands.worst[island])
    for _ in range(_MAX_ITERATIONS if bound > 0.0 else 0):
        free, chopped, worst = _measure_gradient(low, high, 1.0 / bound, sweep)
        if worst < goal:
            break
        if chopped > _PROPORTION * free:
            _proportion(island, low, high, sweep)
        elif not _conjugate(island, low, high, 1.0 / bound, sweep):
            break
    _shorten(island, low, high, sweep)
    for at in range(sweep.islands.first[island], sweep.islands.first[island + 1]):
        _head(sweep.islands.bodies[at], bound, sweep)


@kernel
def _shorten(island, low, high, sweep):
    """Go towards the forces found only as far as no body opens a gap by more than a thickness."""
    islands, joint, touch, farthest = sweep.islands, sweep.joint, sweep.touch, 1.0
    for k in range(low, high):
        joint.ahead[k, 0] = joint.ahead[k, 1] = 0.0
    for at in range(islands.first[island], islands.first[island + 1]):
        body = islands.bodies[at]
        row = joint.weights_at[body]
        for k in range(joint.counts[body]):
            farthest = max(farthest, abs(_opening(k, body, row, sweep)) / sweep.rules.thickness)
            row += joint.counts[body]
    for k in range(low, high):
        contact = touch[joint.chosen[k]]
        mean = _mean_force(contact, sweep.marks)
        joint.force[k] = mean + (joint.force[k] - mean) / farthest


@kernel
def _head(body, bound, sweep):
    """Note whether a body is solved with the forces found, and by how much it is to open gaps."""
    joint, touch = sweep.joint, sweep.touch
    count, first, row = joint.counts[body], joint.items_at[body], joint.weights_at[body]
    joint.moves[body], moves = 0, False
    for k in range(count if sweep.marks.mine[body] != 0 and bound > 0.0 else 0):
        contact = touch[joint.chosen[joint.items[first + k]]]
        change = abs(joint.force[joint.items[first + k]] - _felt(contact, body))
        moves = moves or change > _CHANGED * contact.leeway * contact.stiffness
    if moves:
        joint.moves[body] = 1
        for k in range(count):
            place = joint.items[first + k]
            side = 0 if touch[joint.chosen[place]].guest == body else 1
            joint.ahead[place, side] = _opening(k, body, row, sweep)
            row += count


@kernel
def given_force(contact, is_guest, joint):
    """Return the force (N) that a contact is given in a round in which forces are solved together,
    and by how much (m) the other body opens its gap."""
    if contact.joint == FIXED:
        return contact.guest_force if is_guest else contact.host_force, 0.0
    if contact.joint == APART:
        return 0.0, 0.0
    return joint.force[contact.joint], joint.ahead[contact.joint, 1 if is_guest else 0]
