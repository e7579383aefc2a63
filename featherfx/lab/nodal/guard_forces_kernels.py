"""Forces of the vane's compression guard, and the lines of its stiffness.

Only triangles that have lost area take part. Their stiffness is that of J, d2W/dJ2 dJ dJ^T, and
the geometric stiffness along the normal of the guard's own stresses, as the membrane's.
"""

from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_guard_kernels import guard_slopes
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_normal_stiffness
from featherfx.solver.step.strain_kernels import node_index
from featherfx.solver.vane.pairs_kernels import cell_nodes


@kernel
def add_guard_forces(guard, rest, points, strains, gradient, force):
    """Guard forces of all triangles of a feather, added to force (n, P, 3).

    guard: (2, n-1, m, 2) N m. rest: (2, n-1, m, 2, 3). strains: those of the cells. gradient:
    (4, 3, 3) scratch.
    """
    columns = guard.shape[2]
    at = -2
    for side in range(2):
        for i in range(guard.shape[1]):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    at += 2
                    slope, _, by_across, by_shear = guard_slopes(
                        guard[side, i, j, half], strains[at], strains[at + 1]
                    )
                    if slope == 0.0:
                        continue
                    row, other, _, opposite = cell_nodes(i, half, j, near, far)
                    start, end, tip = points[row, near], points[row, far], points[other, opposite]
                    membrane_gradient(start, end, tip, rest[side, i, j, half], gradient)
                    across, shear = slope * by_across, slope * by_shear
                    for k in range(3):
                        force[row, near, k] += (
                            across * gradient[0, 0, k] + shear * gradient[1, 0, k]
                        )
                        force[row, far, k] += across * gradient[0, 1, k] + shear * gradient[1, 1, k]
                        force[other, opposite, k] += (
                            across * gradient[0, 2, k] + shear * gradient[1, 2, k]
                        )


@kernel
def guard_lines(start, end, tip, rest, stiffness, across, shear, signed, weight, gradient):
    """Stiffness of one triangle's guard as three weighted lines; False if it has none.

    start, end, tip: (3,) nodes. rest: (3,). Written: weight (3,) and gradient (4, 3, 3), whose
    first three are the lines: dJ, and the two of the geometric stiffness, of which the
    destabilising one only if signed.
    """
    slope, curvature, by_across, by_shear = guard_slopes(stiffness, across, shear)
    if slope == 0.0:
        return False
    membrane_gradient(start, end, tip, rest, gradient)
    for node in range(3):
        for k in range(3):
            gradient[0, node, k] = (
                by_across * gradient[0, node, k] + by_shear * gradient[1, node, k]
            )
    stresses = slope * by_across, slope * by_shear
    membrane_normal_stiffness(start, end, tip, rest, stresses, weight[1:], gradient[1:])
    weight[0] = curvature
    if not signed:
        weight[2] = 0.0
    return True
