"""Gradient and Hessian of nodal_step_energy, as a band.

Every stencil gives the gradients of its strains (lines), the stiffnesses that weigh their outer
products and the stresses that weigh their sum; they go straight to the band, block by block.

Geometric stiffness of the barbs' stretch, the membrane and the rachis is that of the stress on
which the last two iterates agree (the smaller one, or none where they differ in sign). That of an
iterate alone may be thousands of times the true one, because straight moves stretch stiff barbs,
and Newton then stalls; left out, it converges slowly or not at all where tension carries load.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.barb_bending_kernels import bend_gradient
from featherfx.mechanics.barb_clamp_kernels import clamp_gradient
from featherfx.mechanics.barb_stretch_kernels import stretch_gradient
from featherfx.mechanics.nodal_kernels import bend_nodes
from featherfx.mechanics.node_kernels import add_dead_forces, node_forces
from featherfx.mechanics.rachis_kernels import rachis_geometric, rachis_gradient
from featherfx.mechanics.rotations_kernels import cross
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_lift
from featherfx.mechanics.vane_plate_kernels import hinge_of, patch_gradient, patch_nodes
from featherfx.solver.assembly_kernels import _add_grips
from featherfx.solver.energy_kernels import node_index
from featherfx.solver.nodal_energy_kernels import hinge_index, sections


@kernel
def agreed(now, before):
    """The smaller of two stresses of one sign, else 0."""
    if now > 0.0 and before > 0.0:
        return min(now, before)
    if now < 0.0 and before < 0.0:
        return max(now, before)
    return 0.0


@kernel
def _add_element(count, nodes, element, system):
    """band += sum of weight lines lines^T over count lines of a stencil of some nodes."""
    lines, weight, slots, band = element.lines, element.weight, element.slots, system.band
    for a in range(nodes):
        row = slots[a]
        if row < 0:
            continue
        for b in range(nodes):
            column = slots[b]
            if column < 0 or column > row:
                continue
            for x in range(3):
                for y in range(3 if column < row else x + 1):
                    value = 0.0
                    for k in range(count):
                        value += weight[k] * lines[k, 3 * a + x] * lines[k, 3 * b + y]
                    band[column + y, row + x - column - y] += value


@kernel
def _add_stress(stress, line, nodes, element, right):
    """right -= stress line."""
    for a in range(nodes):
        at = element.slots[a]
        if at >= 0:
            for x in range(3):
                right[at + x] -= stress * line[3 * a + x]


@kernel
def _add_isotropic(first, second, stiffness, band):
    """Stiffness times |dx_2 - dx_1|^2 / 2 of the points with these slots."""
    for x in range(3):
        if first >= 0:
            band[first + x, 0] += stiffness
        if second >= 0:
            band[second + x, 0] += stiffness
        if first >= 0 and second >= 0:
            if first == second:
                band[first + x, 0] -= 2.0 * stiffness
            else:
                band[min(first, second) + x, abs(first - second)] -= stiffness


@kernel
def _add_points(slot, points, force, stiff, system):
    """Inertia, gravity, air and grips."""
    band, right = system.band, system.right
    for i in range(points.shape[0]):
        for p in range(points.shape[1]):
            at = slot[i, p]
            if at < 0 or p == 1 or p == 2:
                continue
            for k in range(3):
                right[at + k] -= force[i, p, k]
                band[at + k, 0] += stiff[i, p, k]
            band[at, 1] += stiff[i, p, 3]
            band[at, 2] += stiff[i, p, 4]
            band[at + 1, 1] += stiff[i, p, 5]
        at = slot[i, 1]
        for p in range(1, 3 if at >= 0 else 1):
            x, y, z = points[i, p, 0], points[i, p, 1], points[i, p, 2]
            mx, my, mz = cross(x, y, z, force[i, p, 0], force[i, p, 1], force[i, p, 2])
            inertia = stiff[i, p, 0]
            right[at] -= mx
            right[at + 1] -= my
            right[at + 2] -= mz
            band[at, 0] += inertia * (y * y + z * z)
            band[at + 1, 0] += inertia * (x * x + z * z)
            band[at + 2, 0] += inertia * (x * x + y * y)
            band[at, 1] -= inertia * x * y
            band[at, 2] -= inertia * x * z
            band[at + 1, 1] -= inertia * y * z


@kernel
def _add_rachis(model, f, slot, pose, before, reference, damping, signed, element, system):
    """Stretch, shear, twist and bending of the shaft."""
    beam, matrix, slots = element.beam, element.matrix, element.slots
    for i in range(pose.halfway.shape[0]):
        for a in range(2):
            slots[a], slots[2 + a] = slot[i, a], slot[i + 1, a]
        start, end, length = pose.points[i, 0], pose.points[i + 1, 0], model.length[f, i]
        rachis_gradient(start, end, length, pose.halfway[i], pose.rachis[i], beam)
        for k in range(6):
            at = 6 * i + k
            stiffness = model.rachis_stiffness[f, i, k]
            strain = pose.strains[at]
            stress = stiffness * (strain + damping * (strain - reference[at]))
            element.stress[k] = stiffness * agreed(strain, before[at])
            element.weight[k] = stiffness * (1.0 + damping)
            for a in range(12):
                element.lines[k, a] = beam[k, a]
            _add_stress(stress, beam[k], 4, element, system.right)
        _add_element(6, 4, element, system)
        for a in range(12):
            for b in range(12):
                matrix[a, b] = 0.0
        rachis_geometric(start, end, length, pose.halfway[i], element.stress, signed, matrix)
        for a in range(12):
            for b in range(a + 1):
                row, column = slots[a // 3], slots[b // 3]
                if row >= 0 and column >= 0:
                    row, column = row + a % 3, column + b % 3
                    system.band[min(row, column), abs(row - column)] += matrix[a, b]


@kernel
def _add_stretch(nodal, f, pose, before, reference, price, damping, signed, element, system):
    """Stretch of all barb segments; before, reference: (2 n m,), price: (2, n, m)."""
    columns = price.shape[2]
    at, _, _, _ = sections(price.shape[1], columns)
    for side in range(2):
        for i in range(price.shape[1]):
            for j in range(columns):
                stiffness = nodal.stretch_stiffness[f, side, i, j]
                if stiffness > 0.0:
                    p, q = node_index(side, j, columns), node_index(side, j + 1, columns)
                    inverse = nodal.stretch_inverse[f, side, i, j]
                    element.slots[0], element.slots[1] = nodal.slot[f, i, p], nodal.slot[f, i, q]
                    stretch_gradient(
                        pose.points[i, p], pose.points[i, q], inverse, element.lines[0]
                    )
                    strain, extra = pose.strains[at], price[side, i, j]
                    rate = damping * (strain - reference[at])
                    element.weight[0] = stiffness * (1.0 + damping)
                    _add_element(1, 2, element, system)
                    _add_stress(
                        stiffness * (strain + rate) + extra,
                        element.lines[0],
                        2,
                        element,
                        system.right,
                    )
                    tension = agreed(stiffness * strain + extra, stiffness * before[at] + extra)
                    if tension > 0.0 or signed:
                        _add_isotropic(
                            element.slots[0],
                            element.slots[1],
                            tension * inverse * inverse,
                            system.band,
                        )
                at += 1


@kernel
def _add_turns(model, nodal, f, pose, reference, damping, element, system):
    """Bending of all barbs, and their clamps."""
    rows, columns = pose.points.shape[0], model.joints.shape[3]
    points, lines, nodes, slot = pose.points, element.lines, element.nodes, nodal.slot[f]
    _, at, _, _ = sections(rows, columns)
    for side in range(2):
        for i in range(rows):
            for j in range(columns):
                stiffness = nodal.bend_stiffness[f, side, i, j]
                if stiffness[0] == 0.0 and stiffness[1] == 0.0:
                    at += 2
                    continue
                count = 5
                if j == 0:
                    count, p = 3, node_index(side, 1, columns)
                    clamp_gradient(
                        pose.turn[i],
                        model.clamp[f, side, i],
                        points[i, 0],
                        points[i, p],
                        element.frame,
                        element.turns,
                        lines,
                    )
                    element.slots[0], element.slots[1] = slot[i, 0], slot[i, 1]
                    element.slots[2] = slot[i, p]
                else:
                    bend_nodes(side, i, j, rows, columns, nodes)
                    for a in range(5):
                        element.slots[a] = slot[nodes[a, 0], nodes[a, 1]]
                    bend_gradient(
                        points[nodes[0, 0], nodes[0, 1]],
                        points[nodes[1, 0], nodes[1, 1]],
                        points[nodes[2, 0], nodes[2, 1]],
                        points[nodes[3, 0], nodes[3, 1]],
                        points[nodes[4, 0], nodes[4, 1]],
                        element.frame,
                        element.turns,
                        lines,
                    )
                for d in range(2):
                    strain = pose.strains[at]
                    stress = stiffness[d] * (strain + damping * (strain - reference[at]))
                    element.weight[d] = stiffness[d] * (1.0 + damping)
                    _add_stress(stress, lines[d], count, element, system.right)
                    at += 1
                _add_element(2, count, element, system)


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
                    membrane_lift(
                        start, end, tip, rest, stress[2], stress[3], element.lift, gradient[2:]
                    )
                    for k in range(4):
                        for a in range(3):
                            for x in range(3):
                                lines[k, 3 * a + x] = gradient[k, a, x]
                    weight[2] = element.lift[0]
                    weight[3] = element.lift[1]
                    _add_stress(stress[0], lines[0], 3, element, system.right)
                    _add_stress(stress[1], lines[1], 3, element, system.right)
                    _add_element(4 if signed else 3, 3, element, system)


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
        if table[0, edge] == 0.0 and table[1, edge] == 0.0 and table[2, edge] == 0.0:
            continue
        found = True
        kind, owner, row, column = hinge_of(side, i, j, half, edge)
        at = hinge_index(kind, owner, row, column, rows, columns)
        element.slots[3 + edge] = slot[nodes[3 + edge, 0], nodes[3 + edge, 1]]
        patch_gradient(points, side, j, half, edge, nodes, element.hinge, lines[3])
        value = angles[at] + damping * (angles[at] - reference[at])
        for k in range(3):
            if table[k, edge] != 0.0:
                stress[k] += table[k, edge] * value
                for a in range(18):
                    lines[k, a] += table[k, edge] * lines[3, a]
    if found:
        for k in range(3):
            if stress[k] != 0.0:
                _add_stress(stress[k], lines[k], 6, element, system.right)
        _add_element(3, 6, element, system)


@kernel
def nodal_assemble(model, nodal, loads, f, share, factors, signed, before, work):
    """Hessian of nodal_step_energy at work.now to work.system.band, minus gradient to right.

    factors: (inertia, rate, strain rate) of the integrator. signed: whether geometric stiffness of
    compression is included, too. before: (S,) strains of the iterate before, for what both agree
    on; pose.strains itself for the exact geometric stiffness.
    """
    pose, around, element, system = work.now, work.around, work.element, work.system
    reference = around.reference
    system.band[:] = 0.0
    system.right[:] = 0.0
    node_forces(
        pose.points,
        around.target,
        factors[0],
        around.past,
        factors[1],
        model.mass[f],
        loads.gravity,
        loads.air,
        around.wind,
        around.area,
        around.speed,
        model.shaft_area[f],
        work.force,
        work.stiff,
    )
    _add_grips(
        loads.grip_node[f],
        loads.grip_start[f],
        loads.grip_end[f],
        loads.grip_stiffness[f],
        share,
        pose.points,
        work.force,
        work.stiff,
    )
    add_dead_forces(loads.force[f], work.force)
    _add_points(nodal.slot[f], pose.points, work.force, work.stiff, system)
    if nodal.shaft:
        damping = model.retardation[f, 0] * factors[2]
        _add_rachis(
            model, f, nodal.slot[f], pose, before, reference, damping, signed, element, system
        )
    damping = model.retardation[f, 1] * factors[2]
    _add_stretch(
        nodal, f, pose, before, reference, work.multiplier, damping, signed, element, system
    )
    _add_turns(model, nodal, f, pose, reference, damping, element, system)
    _add_cells(model, nodal, f, pose, before, reference, damping, signed, element, system)
    _add_plate(nodal, f, pose, reference, damping, element, system)
    # feathers of a batch may differ in the number of unknowns
    for a in range(nodal.size[f], system.right.shape[0]):
        system.band[a, 0] = 1.0
