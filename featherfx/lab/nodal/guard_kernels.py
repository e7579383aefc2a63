"""Stiffness of the vane's compression guard in the nodal kinematics."""

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.guard_forces_kernels import guard_lines
from featherfx.lab.nodal.stencil_kernels import add_element
from featherfx.solver.step.strain_kernels import node_index
from featherfx.solver.vane.pairs_kernels import cell_nodes


@kernel
def add_guard_stencils(guard, rest, slot, points, strains, signed, element, system):
    """Guard stiffness of all triangles of a feather, added to the band.

    guard: (2, n-1, m, 2). rest: (2, n-1, m, 2, 3). slot: (n, P). strains: those of the cells.
    """
    columns, lines, gradient = guard.shape[2], element.lines, element.membrane
    at = -2
    for side in range(2):
        for i in range(guard.shape[1]):
            for j in range(columns):
                near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
                for half in range(2):
                    at += 2
                    row, other, _, opposite = cell_nodes(i, half, j, near, far)
                    if not guard_lines(
                        points[row, near],
                        points[row, far],
                        points[other, opposite],
                        rest[side, i, j, half],
                        guard[side, i, j, half],
                        strains[at],
                        strains[at + 1],
                        signed,
                        element.weight,
                        gradient,
                    ):
                        continue
                    element.slots[0], element.slots[1] = slot[row, near], slot[row, far]
                    element.slots[2] = slot[other, opposite]
                    for k in range(3):
                        for a in range(3):
                            for x in range(3):
                                lines[k, 3 * a + x] = gradient[k, a, x]
                    add_element(3, 3, element, system)
