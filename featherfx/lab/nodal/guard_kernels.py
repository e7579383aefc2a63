"""Forces and stiffness of the vane's compression guard in the nodal kinematics.

Only triangles that have lost area take part. Their stiffness is that of J, d2W/dJ2 dJ dJ^T, and
the geometric stiffness along the normal of the guard's own stresses, as the membrane's.
"""

from featherfx.algebra.vec3_kernels import combined, store
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.energy_kernels import sections
from featherfx.lab.nodal.stencil_kernels import add_element, add_stress
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
                    _add_triangle(
                        nodes, rest, slope, curvature, (by_across, by_shear), signed, work
                    )


@kernel
def _add_triangle(nodes, rest, slope, curvature, by_strains, signed, work):
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
