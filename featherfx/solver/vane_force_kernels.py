"""Forces of membrane and bending across barbs on the nodes of a vane."""

from featherfx.compiled import kernel
from featherfx.mechanics.vane_bending_kernels import hinge_gradient
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient
from featherfx.solver.energy_kernels import node_index


@kernel
def damped_stress(stiffness, strain, reference, damping):
    return stiffness * (strain + damping * (strain - reference))


@kernel
def cell_nodes(i, half, j, near, far):
    """(row of the edge, other row, other column, other node) of triangle A or B of a cell."""
    if half == 0:
        return i, i + 1, j, near
    return i + 1, i, j + 1, far


@kernel
def _cell_forces(i, side, points, rest, stiffness, strains, reference, damping, block, force):
    """Membrane forces of the cells between rows i and i + 1, added to force (n, P, 3).

    rest: (m, 2, 3), stiffness: (m, 2, 2) of these cells; strains, reference: (4 m,) theirs.
    """
    gradient = block.triangle
    columns = stiffness.shape[0]
    for j in range(columns):
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        for half in range(2):
            if stiffness[j, half, 0] == 0.0:
                continue
            row, other, _, opposite = cell_nodes(i, half, j, near, far)
            at = 4 * j + 2 * half
            across = damped_stress(stiffness[j, half, 0], strains[at], reference[at], damping)
            shear = damped_stress(
                stiffness[j, half, 1], strains[at + 1], reference[at + 1], damping
            )
            membrane_gradient(
                points[row, near],
                points[row, far],
                points[other, opposite],
                rest[j, half],
                gradient,
            )
            for k in range(3):
                force[row, near, k] += across * gradient[0, 0, k] + shear * gradient[1, 0, k]
                force[row, far, k] += across * gradient[0, 1, k] + shear * gradient[1, 1, k]
                force[other, opposite, k] += across * gradient[0, 2, k] + shear * gradient[1, 2, k]


@kernel
def _hinge_forces(i, side, points, stiffness, strains, reference, damping, block, force):
    """Forces of the hinges on row i's barb, added to force; stiffness to reference: (m,)."""
    gradient = block.hinge
    columns = stiffness.shape[0]
    for j in range(columns):
        if stiffness[j] == 0.0:
            continue
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        hinge_gradient(
            points[i, near], points[i, far], points[i + 1, near], points[i - 1, far], gradient
        )
        stress = damped_stress(stiffness[j], strains[j], reference[j], damping)
        for k in range(3):
            force[i, near, k] += stress * gradient[0, k]
            force[i, far, k] += stress * gradient[1, k]
            force[i + 1, near, k] += stress * gradient[2, k]
            force[i - 1, far, k] += stress * gradient[3, k]


@kernel
def add_vane_forces(model, f, damping, pose, reference, block, force):
    """Membrane and hinge forces of feather f on its nodes, added to force (n, P, 3)."""
    rows, columns = pose.turn.shape[0], model.joints.shape[3]
    cells_at = (rows - 1) * 6 + 2 * rows * pose.coefficient.shape[2]
    hinges_at = cells_at + 2 * (rows - 1) * columns * 4
    for side in range(2):
        for i in range(rows - 1):
            at = cells_at + (side * (rows - 1) + i) * columns * 4
            _cell_forces(
                i,
                side,
                pose.points,
                model.cell_rest[f, side, i],
                model.cell_stiffness[f, side, i],
                pose.strains[at:],
                reference[at:],
                damping,
                block,
                force,
            )
        for i in range(1, rows - 1):
            at = hinges_at + (side * rows + i) * columns
            _hinge_forces(
                i,
                side,
                pose.points,
                model.hinge_stiffness[f, side, i],
                pose.strains[at:],
                reference[at:],
                damping,
                block,
                force,
            )
