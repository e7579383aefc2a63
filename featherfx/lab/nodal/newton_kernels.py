"""Minimise the energy of one implicit step in the nodal kinematics, with its gradient and Hessian.

Two methods. The improved one takes full Newton steps, because a line search on an energy with
stiff barbs accepts only steps that hardly stretch them. Points do not move along straight lines:
rachis and barbs are rebuilt from the root outwards with the directions of the increment but the
stretch of its linear part, so that turning stretches nothing and the iterations hardly depend on
the stiffness. What keeps it safe is that a step in time that does not converge is repeated in
halves. The textbook one is projected Newton: Hessian with
the geometric stiffness of the current stresses, its negative part left out, and a line search on
the whole energy; it is kept to measure the improved one against.

Inextensible barbs: the method of multipliers (Hestenes 1969, Powell 1969). Stretch keeps the
stiffness of its modulus, and whenever Newton has converged, every segment's multiplier p takes
over its stress, p += k e, until no strain is left; the result does not depend on k. A constraint
that is eliminated instead would couple all nodes of a barb: that is the barb-curvature kinematics.

Gradient and Hessian are a band. Of the compression guard only triangles that have lost area take
part. Their stiffness is that of J, d2W/dJ2 dJ dJ^T, and the geometric stiffness along the normal of
the guard's own stresses, as the membrane's.
"""

from math import isfinite, sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    copy_values,
    dot,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.lab.nodal.energy_kernels import (
    hinge_index,
    hinge_of,
    nodal_step_energy,
    nodal_strains,
    patch_hinge_gradient,
    patch_nodes,
    sections,
)
from featherfx.lab.nodal.stencil_kernels import (
    add_directors,
    add_element,
    add_nodes,
    add_rachis,
    add_stress,
    add_stretch,
    add_turns,
    agreed,
)
from featherfx.mechanics.barb_kernels import copy_points, node_index
from featherfx.mechanics.guard_kernels import guard_slopes
from featherfx.mechanics.node_kernels import add_dead_forces, add_grip_forces, node_forces
from featherfx.mechanics.rachis_kernels import rachis_gradient
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_normal_stiffness
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.newton_kernels import (
    MAX_LINE_SEARCH_TRIALS,
    UNKNOWN_CONVERGENCE,
    NewtonResult,
    largest_move,
)
from featherfx.solver.step.pose_kernels import chain, rotate_by, store_directors
from featherfx.solver.types import CONVERGED, NOT_CONVERGED, NOT_DEFINITE, NOT_FINITE
from featherfx.solver.vane.line_kernels import cell_nodes


@kernel
def add_guard(model, nodal, f, signed, work):
    """Guard of all triangles of feather f, to the band and the right-hand side.

    signed: whether the destabilising part of the geometric stiffness is included, too.
    """
    guard, slot, points = model.cell_guard[f], nodal.slot[f], work.now.points.nodes
    element, columns = work.element, guard.shape[2]
    _, _, at, _ = sections(points.shape[0], model.joints.shape[3])
    for side in range(2):
        for i in range(guard.shape[1]):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    strains = work.now.strains[at:]
                    at += 2
                    slope, curvature, by_across, by_shear = guard_slopes(
                        guard[side, i, j, half], strains[0], strains[1]
                    )
                    if slope == 0.0:
                        continue
                    row, other, _, tip = cell_nodes(i, half, j, near, far)
                    element.slots[0], element.slots[1] = slot[row, near], slot[row, far]
                    element.slots[2] = slot[other, tip]
                    nodes = points[row, near], points[row, far], points[other, tip]
                    rest = model.cell_rest[f, side, i, j, half]
                    _add_guarded(nodes, rest, slope, curvature, (by_across, by_shear), signed, work)


@kernel
def _add_guarded(nodes, rest, slope, curvature, by_strains, signed, work):
    """Guard of one triangle; slope, curvature, by_strains: what guard_slopes gives."""
    element, system = work.element, work.system
    gradient, lines, weight = element.membrane, element.lines, element.weight
    by_across, by_shear = by_strains
    start, end, tip = nodes
    membrane_gradient(start, end, tip, rest, gradient)
    for node in range(3):
        by_node = combined(by_across, gradient[0, node], by_shear, gradient[1, node])
        store(gradient[0, node], by_node)
    stresses = slope * by_across, slope * by_shear
    membrane_normal_stiffness(start, end, tip, rest, stresses, weight[1:], gradient[1:])
    weight[0] = curvature
    if not signed:
        weight[2] = 0.0
    for k in range(3):
        for node in range(3):
            store(lines[k, 3 * node :], gradient[k, node])
    add_stress(slope, lines[0], 3, element, system.right)
    add_element(3, 3, element, system)


@kernel
def _add_cells(model, nodal, f, damping, signed, work):
    """Membrane of all triangles."""
    pose, before, reference = work.now, work.before, work.around.reference
    element, system, points, slot = work.element, work.system, pose.points.nodes, nodal.slot[f]
    rows, columns = points.shape[0], model.joints.shape[3]
    lines, weight, gradient, stress = (
        element.lines,
        element.weight,
        element.membrane,
        element.stress,
    )
    _, _, at, _ = sections(rows, columns)
    for side in range(2):
        for i in range(rows - 1):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    stiffness = model.cell_stiffness[f, side, i, j, half]
                    if stiffness[0] == 0.0:
                        at += 2
                        continue
                    row, other, _, p = cell_nodes(i, half, j, near, far)
                    start, end, tip = points[row, near], points[row, far], points[other, p]
                    rest = model.cell_rest[f, side, i, j, half]
                    membrane_gradient(start, end, tip, rest, gradient)
                    element.slots[0], element.slots[1] = slot[row, near], slot[row, far]
                    element.slots[2] = slot[other, p]
                    for k in range(2):
                        strain = pose.strains[at]
                        rate = damping * (strain - reference[at])
                        stress[k] = stiffness[k] * (strain + rate)
                        stress[2 + k] = stiffness[k] * (agreed(strain, before[at]) + rate)
                        weight[k] = stiffness[k] * (1.0 + damping)
                        at += 1
                    stresses = stress[2], stress[3]
                    membrane_normal_stiffness(
                        start, end, tip, rest, stresses, weight[2:], gradient[2:]
                    )
                    for k in range(4):
                        for node in range(3):
                            store(lines[k, 3 * node :], gradient[k, node])
                    add_stress(stress[0], lines[0], 3, element, system.right)
                    add_stress(stress[1], lines[1], 3, element, system.right)
                    add_element(4 if signed else 3, 3, element, system)


@kernel
def _add_plate(nodal, f, damping, work):
    """Bending of all triangles by their dihedral angles."""
    rows, columns = work.now.rotation.shape[0], nodal.plate.shape[3]
    for side in range(2):
        for i in range(rows - 1):
            for j in range(columns):
                for half in range(2):
                    _add_triangle(nodal, f, (side, i, j, half), damping, work)


@kernel
def _add_triangle(nodal, f, place, damping, work):
    """Bending of one triangle; place: (side, row, column, half)."""
    side, i, j, half = place
    points, element, slot = work.now.points.nodes, work.element, nodal.slot[f]
    rows, columns = points.shape[0], nodal.plate.shape[3]
    _, _, _, start = sections(rows, columns)
    angles, reference = work.now.strains[start:], work.around.reference[start:]
    table, lines, nodes = nodal.plate[f, side, i, j, half], element.lines, element.nodes
    patch_nodes(side, i, j, half, columns, nodes)
    for a in range(3):
        at = slot[nodes[a, 0], nodes[a, 1]]
        element.slots[a], element.slots[3 + a] = at, -1
    stress, found = element.stress, False
    for k in range(3):
        stress[k] = 0.0
        element.weight[k] = 1.0 + damping
        for a in range(18):
            lines[k, a] = 0.0
    for edge in range(3):
        if table[0, edge] == 0.0 and table[1, edge] == 0.0 and table[2, edge] == 0.0:
            continue
        found = True
        kind, owner, row, column = hinge_of(side, i, j, half, edge)
        at = hinge_index(kind, owner, row, column, rows, columns)
        element.slots[3 + edge] = slot[nodes[3 + edge, 0], nodes[3 + edge, 1]]
        places = patch_hinge_gradient(points, side, j, half, edge, nodes, element.hinge)
        value = angles[at] + damping * (angles[at] - reference[at])
        for k in range(3):
            stress[k] += table[k, edge] * value
            for a in range(4):
                accumulate(lines[k, 3 * places[a] :], table[k, edge], element.hinge[a])
    if found:
        for k in range(3):
            if stress[k] != 0.0:
                add_stress(stress[k], lines[k], 6, element, work.system.right)
        add_element(3, 6, element, work.system)


@shared_kernel(None)
def nodal_assemble(model, nodal, loads, f, fraction, factors, signed, work):
    """Hessian of nodal_step_energy at work.now to work.system.band, minus gradient to right.

    factors: of the integrator. signed: whether geometric stiffness of compression is included, too.
    work.before: (S,) strains of the iterate before, for what both agree on; those of the pose
    itself for the exact geometric stiffness.
    """
    points, around, system = work.now.points.nodes, work.around, work.system
    system.band[:] = 0.0
    system.right[:] = 0.0
    node_forces(model, loads, f, factors, points, around, work.force, work.stiff)
    add_grip_forces(loads, f, fraction, points, work.force, work.stiff)
    add_dead_forces(loads, f, fraction, work.force)
    add_nodes(nodal.slot[f], work)
    add_directors(
        model.rotary_inertia[f], factors.inertia, loads.couple[f], nodal.frame_slot[f], work
    )
    if nodal.has_rachis:
        add_rachis(model, nodal, f, factors.rachis_damping, signed, work)
    damping = factors.vane_damping
    add_stretch(nodal, f, damping, signed, work)
    add_turns(model, nodal, f, damping, work)
    _add_cells(model, nodal, f, damping, signed, work)
    _add_plate(nodal, f, damping, work)
    add_guard(model, nodal, f, signed, work)
    # feathers of a batch may differ in the number of unknowns
    for a in range(nodal.size[f], system.right.shape[0]):
        system.band[a, 0] = 1.0


class Minimiser(NamedTuple):
    """Options of a solve: tolerance (m), the move of a Newton step that counts as converged; most
    iterations; textbook: which method."""

    tolerance: float
    iterations: int
    textbook: bool


# largest strain of an inextensible segment
_INEXTENSIBLE = 1e-10
# of the diagonal, where the stiffness is singular
_SHIFT = 1e-8


@kernel
def set_directors(pose):
    """Directors of all rows from their frames."""
    for i in range(pose.rotation.shape[0]):
        store_directors(pose.rotation[i], pose.points.directors[i])


@kernel
def gather(present, nodes):
    """Nodes (n, 1 + 2 m, 3) of absent barbs to their rachis points; present: (2, n)."""
    columns = nodes.shape[1] // 2
    for side in range(2):
        for i in range(nodes.shape[0]):
            if not present[side, i]:
                for p in range(1 + side * columns, 1 + (side + 1) * columns):
                    for k in range(3):
                        nodes[i, p, k] = nodes[i, 0, k]


@kernel
def _rebuild_rachis(length, slot, frame_slot, factor, work):
    """Rachis points rebuilt from the first one, so that stretch and shear change linearly."""
    now, trial, step = work.now, work.trial, work.system.right
    beam, stretch = work.element.beam, work.element.stress
    for i in range(slot.shape[0] - 1):
        if slot[i + 1, 0] < 0 or frame_slot[i + 1] < 0:
            continue
        a, b = now.points.nodes[i, 0], now.points.nodes[i + 1, 0]
        rachis_gradient(a, b, length[i], now.halfway[i], now.rachis[i], beam)
        for k in range(3):
            change = 0.0
            for node in range(4):
                row = i + node // 2
                at = slot[row, 0] if node % 2 == 0 else frame_slot[row]
                for x in range(3 if at >= 0 else 0):
                    change += beam[k, 3 * node + x] * step[at + x]
            stretch[k] = now.rachis[i, k] + factor * change
        chain(
            trial.rotation[i],
            trial.rotation[i + 1],
            stretch,
            length[i],
            trial.points.nodes[i, 0],
            trial.points.nodes[i + 1, 0],
        )


@kernel
def _barb(first, slot, now, step, factor, trial):
    """Nodes of one barb rebuilt from the rachis, so that every stretch e changes linearly.

    first: of its nodes. slot: (1 + 2 m,), now, trial: (1 + 2 m, 3) of the row.
    """
    columns = slot.shape[0] // 2
    # what the straight move of the node before and its rebuilt place are
    before, q = (0.0, 0.0, 0.0), 0
    if slot[0] >= 0:
        before = scale(factor, step[slot[0] :])
    for p in range(first, first + columns):
        at = slot[p]
        if at < 0:
            return
        move, span = scale(factor, step[at:]), sub(now[p], now[q])
        change = sub(move, before)
        wanted = dot(span, span) + 2.0 * dot(span, change)
        span = add(span, change)
        square = dot(span, span)
        # a segment that would vanish keeps the straight move
        stretch = sqrt(wanted / square) if wanted > 0.0625 * square else 1.0
        store(trial[p], add(trial[q], scale(stretch, span)))
        before, q = move, p


@shared_kernel(None)
def move_by(model, nodal, f, factor, straight, work):
    """Pose work.now plus factor times the increment work.system.right, to work.trial.

    straight: points move along straight lines. Otherwise, where there is a rachis, rachis and barbs
    are rebuilt so that their stretch changes by exactly its linear increment.
    """
    now, trial, step, slot = work.now, work.trial, work.system.right, nodal.slot[f]
    before, after, frame_slot = now.points.nodes, trial.points.nodes, nodal.frame_slot[f]
    for i in range(slot.shape[0]):
        at = frame_slot[i]
        if at >= 0:
            rotate_by(now.rotation[i], step[at : at + 3], factor, trial.rotation[i])
        else:
            for k in range(4):
                trial.rotation[i, k] = now.rotation[i, k]
        for p in range(slot.shape[1]):
            at = slot[i, p]
            for k in range(3):
                move = factor * step[at + k] if at >= 0 else 0.0
                after[i, p, k] = before[i, p, k] + move
    if nodal.has_rachis and not straight:
        _rebuild_rachis(model.length[f], slot, frame_slot, factor, work)
        columns = model.joints.shape[3]
        for i in range(slot.shape[0]):
            for side in range(2):
                if nodal.present[f, side, i]:
                    start = 1 + side * columns
                    _barb(start, slot[i], before[i], step, factor, after[i])
    gather(nodal.present[f], after)
    set_directors(trial)


@shared_kernel(float)
def evaluate(model, nodal, loads, f, fraction, factors, pose, work):
    """Strains of a pose from its points and frames, and its energy (J)."""
    nodal_strains(model, nodal, f, pose, work.element.frame)
    return nodal_step_energy(model, nodal, loads, f, fraction, factors, pose, work)


@kernel
def _copy_pose(source, target):
    copy_values(source.rotation, target.rotation)
    copy_points(source.points, target.points)
    copy_values(source.halfway, target.halfway)
    copy_values(source.rachis, target.rachis)
    copy_values(source.strains, target.strains)


@kernel
def _raise_multipliers(nodal, f, strains, multiplier):
    """Multipliers take over the stress of stretch; returns the largest strain."""
    at, end, _, _ = sections(multiplier.shape[1], multiplier.shape[2])
    stiffness, price = nodal.stretch_stiffness[f].flat, multiplier.flat
    worst = 0.0
    for a in range(end - at):
        price[a] += stiffness[a] * strains[at + a]
        if stiffness[a] > 0.0:
            worst = max(worst, abs(strains[at + a]))
    return worst


@kernel
def _solve(model, nodal, loads, f, fraction, factors, textbook, work):
    """Increment of the unknowns to work.system.right; returns whether it could be had."""
    system = work.system
    if textbook:
        copy_values(work.now.strains, work.before)
    for attempt in range(1 if textbook else 0, 3):
        nodal_assemble(model, nodal, loads, f, fraction, factors, attempt == 0, work)
        if attempt == 2:
            # what nothing holds, such as a strip turning about its pinned end, is rounding error
            for a in range(system.right.shape[0]):
                system.band[a, 0] *= 1.0 + _SHIFT
        if factorise(system.band, system.panel):
            solve_factored(system.band, system.right)
            return True
    return False


@shared_kernel(NewtonResult)
def nodal_minimise(model, nodal, loads, f, fraction, factors, method, work):
    """Bring the pose work.now to the minimum of nodal_step_energy.

    work.before: strains of the last converged pose. fraction: of the frame. method: Minimiser.
    Returns Solved; each iteration has a matrix of its own, and no pace is kept.
    """
    now, trial, textbook, tolerance = work.now, work.trial, method.textbook, method.tolerance
    energy = evaluate(model, nodal, loads, f, fraction, factors, now, work)
    move = 0.0
    for iteration in range(1, method.iterations + 1):
        if not isfinite(energy):
            return NewtonResult(NOT_FINITE, iteration, iteration, move, UNKNOWN_CONVERGENCE)
        if not _solve(model, nodal, loads, f, fraction, factors, textbook, work):
            return NewtonResult(NOT_DEFINITE, iteration, iteration, move, UNKNOWN_CONVERGENCE)
        factor = 1.0
        for _ in range(MAX_LINE_SEARCH_TRIALS if textbook else 1):
            move_by(model, nodal, f, factor, textbook, work)
            new = evaluate(model, nodal, loads, f, fraction, factors, trial, work)
            move = largest_move(now.points, trial.points, model.length[f, 0]) / factor
            slack = 1e-9 * (abs(energy) + abs(new))
            if isfinite(new) and (new <= energy + slack or move < tolerance):
                break
            factor *= 0.5
        copy_values(now.strains, work.before)
        _copy_pose(trial, now)
        energy = new
        if move < tolerance:
            if not nodal.inextensible:
                return NewtonResult(CONVERGED, iteration, iteration, move, UNKNOWN_CONVERGENCE)
            if _raise_multipliers(nodal, f, now.strains, work.multiplier) < _INEXTENSIBLE:
                return NewtonResult(CONVERGED, iteration, iteration, move, UNKNOWN_CONVERGENCE)
    return NewtonResult(
        NOT_CONVERGED, method.iterations, method.iterations, move, UNKNOWN_CONVERGENCE
    )
