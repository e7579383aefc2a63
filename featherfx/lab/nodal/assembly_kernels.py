"""Gradient and Hessian of nodal_step_energy, as a band: the vane's stencils, and all together."""

from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.lab.nodal.energy_kernels import hinge_index, sections
from featherfx.lab.nodal.guard_forces_kernels import add_guard_forces
from featherfx.lab.nodal.guard_kernels import add_guard_stencils
from featherfx.lab.nodal.plate_kernels import hinge_of, patch_hinge_gradient, patch_nodes
from featherfx.lab.nodal.stencil_kernels import (
    add_element,
    add_points,
    add_rachis,
    add_stress,
    add_stretch,
    add_turns,
    agreed,
)
from featherfx.mechanics.node_kernels import add_dead_forces, add_grip_forces, node_forces
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_normal_stiffness
from featherfx.solver.step.strain_kernels import node_index


@kernel
def _add_cells(model, nodal, f, pose, before, reference, damping, signed, element, system):
    """Membrane of all triangles."""
    rows, columns = pose.points.shape[0], model.joints.shape[3]
    points, lines, weight, slot = pose.points, element.lines, element.weight, nodal.slot[f]
    gradient, stress = element.membrane, element.stress
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
                    row, other, p = (i, i + 1, near) if half == 0 else (i + 1, i, far)
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
                    signs, lines_along = element.normal, gradient[2:]
                    stresses = stress[2], stress[3]
                    membrane_normal_stiffness(start, end, tip, rest, stresses, signs, lines_along)
                    for k in range(4):
                        for a in range(3):
                            for x in range(3):
                                lines[k, 3 * a + x] = gradient[k, a, x]
                    weight[2] = signs[0]
                    weight[3] = signs[1]
                    add_stress(stress[0], lines[0], 3, element, system.right)
                    add_stress(stress[1], lines[1], 3, element, system.right)
                    add_element(4 if signed else 3, 3, element, system)


@kernel
def _add_plate(nodal, f, pose, reference, damping, element, system):
    """Bending of all triangles by their dihedral angles; reference: (S,)."""
    plate, rows = nodal.plate[f], pose.points.shape[0]
    columns, slot = plate.shape[2], nodal.slot[f]
    _, _, _, start = sections(rows, columns)
    for side in range(2):
        for i in range(rows - 1):
            for j in range(columns):
                for half in range(2):
                    _add_triangle(
                        plate[side, i, j, half],
                        side,
                        i,
                        j,
                        half,
                        pose.points,
                        pose.strains[start:],
                        reference[start:],
                        damping,
                        slot,
                        element,
                        system,
                    )


@kernel
def _add_triangle(
    table, side, i, j, half, points, angles, reference, damping, slot, element, system
):
    """Bending of one triangle; table: (3, 3), angles, reference: (6 n m,)."""
    rows, columns = points.shape[0], (points.shape[1] - 3) // 2
    lines, nodes, stress = element.lines, element.nodes, element.stress
    patch_nodes(side, i, j, half, columns, nodes)
    for a in range(3):
        at = slot[nodes[a, 0], nodes[a, 1]]
        element.slots[a], element.slots[3 + a] = at, -1
    for k in range(3):
        stress[k] = 0.0
        element.weight[k] = 1.0 + damping
        for a in range(18):
            lines[k, a] = 0.0
    found = False
    for edge in range(3):
        first, second, third = table[0, edge], table[1, edge], table[2, edge]
        if first == 0.0 and second == 0.0 and third == 0.0:
            continue
        found = True
        kind, owner, row, column = hinge_of(side, i, j, half, edge)
        at = hinge_index(kind, owner, row, column, rows, columns)
        element.slots[3 + edge] = slot[nodes[3 + edge, 0], nodes[3 + edge, 1]]
        places = patch_hinge_gradient(points, side, j, half, edge, nodes, element.hinge)
        value = angles[at] + damping * (angles[at] - reference[at])
        stress[0] += first * value
        stress[1] += second * value
        stress[2] += third * value
        for a in range(4):
            c = 3 * places[a]
            for x in range(3):
                slope = element.hinge[a, x]
                lines[0, c + x] += first * slope
                lines[1, c + x] += second * slope
                lines[2, c + x] += third * slope
    if found:
        for k in range(3):
            if stress[k] != 0.0:
                add_stress(stress[k], lines[k], 6, element, system.right)
        add_element(3, 6, element, system)


@shared_kernel
def nodal_assemble(model, nodal, loads, f, fraction, factors, signed, before, work):
    """Hessian of nodal_step_energy at work.now to work.system.band, minus gradient to right.

    factors: of the integrator. signed: whether geometric stiffness of
    compression is included, too. before: (S,) strains of the iterate before, for what both agree
    on; pose.strains itself for the exact geometric stiffness.
    """
    pose, around, element, system = work.now, work.around, work.element, work.system
    reference = around.reference
    system.band[:] = 0.0
    system.right[:] = 0.0
    node_forces(model, loads, f, factors, pose.points, around, work.force, work.stiff)
    add_grip_forces(loads, f, fraction, pose.points, work.force, work.stiff)
    add_dead_forces(loads, f, fraction, work.force)
    _, _, cells_at, _ = sections(pose.points.shape[0], model.joints.shape[3])
    add_guard_forces(
        model.cell_guard[f],
        model.cell_rest[f],
        pose.points,
        pose.strains[cells_at:],
        element.membrane,
        work.force,
    )
    add_points(nodal.slot[f], pose.points, work.force, work.stiff, system)
    if nodal.shaft:
        damping = model.retardation[f, 0] * factors.strain_rate
        add_rachis(
            model, f, nodal.slot[f], pose, before, reference, damping, signed, element, system
        )
    damping = model.retardation[f, 1] * factors.strain_rate
    add_stretch(
        nodal, f, pose, before, reference, work.multiplier, damping, signed, element, system
    )
    add_turns(model, nodal, f, pose, reference, damping, element, system)
    _add_cells(model, nodal, f, pose, before, reference, damping, signed, element, system)
    _add_plate(nodal, f, pose, reference, damping, element, system)
    if model.cell_guard.shape[1] > 0:
        add_guard_stencils(
            model.cell_guard[f],
            model.cell_rest[f],
            nodal.slot[f],
            pose.points,
            pose.strains[cells_at:],
            signed,
            element,
            system,
        )
    # feathers of a batch may differ in the number of unknowns
    for a in range(nodal.size[f], system.right.shape[0]):
        system.band[a, 0] = 1.0
