"""Forces of membrane and bending across barbs on the nodes of a vane, and their stiffness there.

A strain with stress s and stiffness k, whose gradient by node p is g_p, gives the force s g_p and,
for every pair of its nodes, the block k g_p g_q^T. Blocks are kept row by row and side by side: the
few kinds of pairs in pairs_kernels are all that triangles and hinges couple.
"""

from featherfx.jit.compiled import kernel
from featherfx.solver.vane.cell_kernels import add_strip
from featherfx.solver.vane.hinge_kernels import add_hinges
from featherfx.solver.vane.line_kernels import add_lines_to_nodes, nodes_to_lines
from featherfx.solver.vane.pairs_kernels import FORCES_ONLY


@kernel
def add_vane_forces(model, f, damping, wanted, pose, reference, vane, force):
    """Membrane and hinges of feather f: forces added to force (n, P, 3), stiffness to vane.blocks.

    wanted: FORCES_ONLY leaves the blocks as they are, STABILISING leaves out what of the geometric
    stiffness may be indefinite.
    """
    rows, columns = pose.turn.shape[0], model.joints.shape[3]
    cells_at = (rows - 1) * 6 + 2 * rows * pose.coefficient.shape[2]
    hinges_at = cells_at + 2 * (rows - 1) * columns * 4
    nodes_to_lines(pose.points, vane.nodes)
    vane.pull[:] = 0.0
    if wanted != FORCES_ONLY:
        vane.blocks[:] = 0.0
    for side in range(2):
        for i in range(rows - 1):
            at = cells_at + (side * (rows - 1) + i) * columns * 4
            for half in range(2):
                add_strip(
                    i,
                    side,
                    half,
                    model.cell_rest[f, side, i],
                    model.cell_stiffness[f, side, i],
                    model.cell_guard[f],
                    pose.strains[at:],
                    reference[at:],
                    damping,
                    wanted,
                    vane,
                )
        for i in range(1, rows - 1):
            at = hinges_at + (side * rows + i) * columns
            add_hinges(
                i,
                side,
                model.cell_rest[f, side, i],
                model.cell_rest[f, side, i - 1],
                model.hinge_stiffness[f, side, i],
                pose.strains[at:],
                pose.strains[at + 2 * rows * columns :],
                reference[at:],
                damping,
                wanted,
                vane,
            )
    add_lines_to_nodes(vane.pull, force)
