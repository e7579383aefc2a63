"""Forces of membrane, bending across barbs and twist on the nodes of a vane, and their stiffness.

A strain with stress s and stiffness k, whose gradient by node p is g_p, gives the force s g_p and,
for every pair of its nodes, the block k g_p g_q^T. Blocks are kept row by row and side by side: the
few kinds of pairs in line_kernels are all that triangles, hinges and twist couple.
"""

from featherfx.jit.compiled import kernel, loop_kernel, shared_kernel
from featherfx.mechanics.vane_guard_kernels import is_pressed
from featherfx.mechanics.vane_hook_kernels import all_hold, hinge_hold, row_of_gaps, twist_hold
from featherfx.solver.types import FORCES_ONLY
from featherfx.solver.vane.cell_kernels import Strip, fill_strip
from featherfx.solver.vane.hinge_kernels import Hinges, Twists, fill_hinges, fill_twists
from featherfx.solver.vane.line_kernels import add_lines_to_nodes, lanes, nodes_to_lines
from featherfx.solver.vane.sum_kernels import add_blocks, add_forces


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


@loop_kernel
def _fill_cells(model, place, damping, wanted, state, vane, cells):
    """The cells of a strip. place: feather, side and the row below them. state: strains, their
    reference, gaps, whether all hold and whether any triangle feels its guard."""
    (f, side, i), (strains, reference, gaps, held, pressed) = place, state
    strip = Strip(
        rest=model.cell_rest[f, side, i],
        stiffness=model.cell_stiffness[f, side, i],
        guard=model.cell_guard[f],
        pressed=pressed,
        strains=strains.cell[side, i],
        reference=reference.cell[side, i],
        held=held,
        gaps=row_of_gaps(model.hooks, f, side, i, gaps),
    )
    fill_strip(i, side, strip, damping, wanted, vane, cells)
    stiffness = model.twist_stiffness[f, side, i]
    twists = Twists(
        rest=model.twist_rest[f, side, i],
        stiffness=_left_twist(stiffness, gaps, side, i, held, vane.cells.left),
        twist=strains.twist[side, i],
        reference=reference.twist[side, i],
    )
    fill_twists(i, side, twists, damping, vane, cells)


@loop_kernel
def _fill_folds(model, place, damping, state, vane, cells):
    """As _fill_cells, the hinges on the row of a place."""
    (f, side, i), (strains, reference, gaps, held, _) = place, state
    hinges = Hinges(
        rest=model.hinge_rest[f, side, i],
        stiffness=_left(model.hinge_stiffness[f, side, i], gaps, side, i, held, vane.cells.left),
        angle=strains.hinge[side, i],
        openness=strains.openness[side, i],
        reference=reference.hinge[side, i],
    )
    fill_hinges(i, side, hinges, damping, vane, cells)


@shared_kernel(None)
def add_vane_forces(model, f, damping, wanted, pose, around, vane, force):
    """Membrane, hinges and twist of feather f: forces added to force (n, 1 + 2 m, 3), stiffness to
    vane.blocks.

    Row by row: first the cells above it and the hinges on the next one, then the sums at its own
    nodes, for which two strips and three rows of hinges are kept.

    around: StepEnvironment. wanted: FORCES_ONLY leaves the blocks as they are, STABILISING leaves
    out what of the geometric stiffness may be indefinite.
    """
    rows, strains, gaps = pose.rotation.shape[0], pose.strains, around.gaps
    held = all_hold(model, f, strains.cell, gaps)
    pressed = is_pressed(model.cell_guard[f], strains.cell)
    state = strains, around.reference, gaps, held, pressed
    nodes_to_lines(pose.points.nodes, vane.nodes)
    vane.pull[:] = 0.0
    strips, hinges, count = vane.cells.strips, vane.cells.hinges, lanes(strains.hinge.shape[2] + 1)
    for side in range(2):
        strips[1], hinges[:] = 0.0, 0.0
        if wanted != FORCES_ONLY:
            vane.blocks[0, side] = 0.0
        for i in range(rows):
            above, high = strips[i % 2], hinges[(i + 1) % 3]
            if i + 1 < rows:
                if wanted != FORCES_ONLY:
                    vane.blocks[i + 1, side] = 0.0
                _fill_cells(model, (f, side, i), damping, wanted, state, vane, above)
            else:
                above[:] = 0.0
            if i + 2 < rows:
                _fill_folds(model, (f, side, i + 1), damping, state, vane, high)
            else:
                high[:] = 0.0
            below, low, own = strips[(i + 1) % 2], hinges[(i + 2) % 3], hinges[i % 3]
            add_forces(count, below, above, low, own, high, vane.pull[i, side])
            if wanted != FORCES_ONLY:
                add_blocks(count, below, above, low, own, high, vane.blocks[i, side])
    add_lines_to_nodes(vane.pull, force)
