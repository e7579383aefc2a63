"""Forces of membrane, bending across barbs and twist on the nodes of a vane, and their stiffness.

A strain with stress s and stiffness k, whose gradient by node p is g_p, gives the force s g_p and,
for every pair of its nodes, the block k g_p g_q^T. Blocks are kept row by row and side by side: the
few kinds of pairs in pairs_kernels are all that triangles, hinges and twist couple.
"""

from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_guard_kernels import is_pressed
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold, row_of_gaps, twist_hold
from featherfx.solver.vane.cell_kernels import Strip, add_strip
from featherfx.solver.vane.hinge_kernels import Hinges, Twists, add_hinges, add_twists
from featherfx.solver.vane.line_kernels import add_lines_to_nodes, nodes_to_lines
from featherfx.solver.vane.pairs_kernels import FORCES_ONLY


@kernel
def _left(stiffness, gaps, side, i, held, left):
    """(m,) stiffness of the hinges on row i's barb that open gaps leave: to left, or as it is where
    all gaps hold (held)."""
    if held:
        return stiffness
    for j in range(stiffness.shape[0]):
        left[j] = stiffness[j] * hinge_hold(gaps, side, i, j)
    return left


@kernel
def _left_twist(stiffness, gaps, side, i, held, left):
    """As _left, of the cells between rows i and i + 1."""
    if held:
        return stiffness
    for j in range(stiffness.shape[0]):
        left[j] = stiffness[j] * twist_hold(gaps, side, i, j)
    return left


@kernel
def add_vane_forces(model, f, damping, wanted, pose, around, vane, force):
    """Membrane, hinges and twist of feather f: forces added to force (n, 1 + 2 m, 3), stiffness to
    vane.blocks.

    around: Surroundings. wanted: FORCES_ONLY leaves the blocks as they are, STABILISING leaves out
    what of the geometric stiffness may be indefinite.
    """
    rows = pose.rotation.shape[0]
    strains, reference, gaps = pose.strains, around.reference, around.gaps
    held = all_hold(model, f, strains.cell, gaps)
    pressed = is_pressed(model.cell_guard[f], strains.cell)
    nodes_to_lines(pose.points.nodes, vane.nodes)
    vane.pull[:] = 0.0
    if wanted != FORCES_ONLY:
        vane.blocks[:] = 0.0
    for side in range(2):
        rest, hinge = model.cell_rest[f, side], model.hinge_stiffness[f, side]
        for i in range(rows - 1):
            strip = Strip(
                rest=rest[i],
                stiffness=model.cell_stiffness[f, side, i],
                guard=model.cell_guard[f],
                pressed=pressed,
                strains=strains.cell[side, i],
                reference=reference.cell[side, i],
                held=held,
                gaps=row_of_gaps(model.hooks, f, side, i, gaps),
            )
            for half in range(2):
                add_strip(i, side, half, strip, damping, wanted, vane)
            stiffness = model.twist_stiffness[f, side, i]
            twists = Twists(
                rest=model.twist_rest[f, side, i],
                stiffness=_left_twist(stiffness, gaps, side, i, held, vane.cells.left),
                twist=strains.twist[side, i],
                reference=reference.twist[side, i],
            )
            add_twists(i, side, twists, damping, wanted, vane)
        for i in range(1, rows - 1):
            hinges = Hinges(
                rest=model.hinge_rest[f, side, i],
                stiffness=_left(hinge[i], gaps, side, i, held, vane.cells.left),
                angle=strains.hinge[side, i],
                openness=strains.openness[side, i],
                reference=reference.hinge[side, i],
            )
            add_hinges(i, side, hinges, damping, wanted, vane)
    add_lines_to_nodes(vane.pull, force)
