"""Gradient and Hessian of nodal_step_energy, as a band: the vane's stencils, and all together.

Forces and stiffness of the vane's compression guard in the nodal kinematics.

Only triangles that have lost area take part. Their stiffness is that of J, d2W/dJ2 dJ dJ^T, and
the geometric stiffness along the normal of the guard's own stresses, as the membrane's.
"""

from featherfx.algebra.vector_kernels import accumulate, combined, store
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.lab.nodal.energy_kernels import hinge_index, sections
from featherfx.lab.nodal.plate_kernels import hinge_of, patch_hinge_gradient, patch_nodes
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
from featherfx.mechanics.node_kernels import add_dead_forces, add_grip_forces, node_forces
from featherfx.mechanics.row_kernels import node_index
from featherfx.mechanics.vane_guard_kernels import guard_slopes
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_normal_stiffness
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
        damping = model.retardation[f, 0] * factors.strain_rate
        add_rachis(model, nodal, f, damping, signed, work)
    damping = model.retardation[f, 1] * factors.strain_rate
    add_stretch(nodal, f, damping, signed, work)
    add_turns(model, nodal, f, damping, work)
    _add_cells(model, nodal, f, damping, signed, work)
    _add_plate(nodal, f, damping, work)
    add_guard(model, nodal, f, signed, work)
    # feathers of a batch may differ in the number of unknowns
    for a in range(nodal.size[f], system.right.shape[0]):
        system.band[a, 0] = 1.0
