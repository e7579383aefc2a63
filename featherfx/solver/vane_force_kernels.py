"""Forces of membrane and bending across barbs on the nodes of a vane, and their stiffness there.

Stiffness is kept as 3 by 3 blocks between neighbouring nodes of the grid, row by row and side by
side: the few kinds of pairs below are all that triangles and hinges couple. A strain e with stress
s and stiffness k, whose gradient by node p is g_p, gives the force s g_p and the block k g_p g_q^T.
What is left of a triangle's second variation (vane_membrane_kernels), with f and g its stresses, is

    f |dc|^2 + 2 g da.dc,      a = e / s,   c = d / h - t e,   t = p / (s h)

e = x_1 - x_0 lies along the barb, d = x_2 - x_0. Compression and shear make it indefinite. Its
stabilising part, used where the whole matrix is indefinite, is the lift of membrane_lift that has
a positive stiffness. A compression guard (vane_guard_kernels) adds to the stresses, and J as one
more strain.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.vane_bending_kernels import crush_gradient, opening
from featherfx.mechanics.vane_guard_kernels import guard_slopes
from featherfx.mechanics.vane_membrane_kernels import membrane_lift
from featherfx.solver.barb_lines_kernels import (
    add_diagonal,
    add_forces,
    add_lines_to_nodes,
    add_outer,
    hinge_gradients,
    lanes,
    membrane_gradients,
    nodes_to_lines,
)

# blocks K(p, q) of row i and column j: p, q =
# (i, j), (i, j), halved; (i, j), (i, j+1); (i+1, j), (i, j); (i+1, j), (i, j+1);
# (i+1, j), (i-1, j+1)
OWN, ALONG, UP, SLANT, SKIP = 0, 1, 2, 3, 4
PAIRS = 5
# which second derivatives are wanted: none, those without what may be indefinite, all
FORCES_ONLY, STABILISING, WHOLE = 0, 1, 2
# strains of a triangle: e_ww, 2 e_vw, the guard's J and the stabilising lift
GUARD, LIFT = 2, 3


@kernel
def cell_nodes(i, half, j, near, far):
    """(row of the edge, other row, other column, other node) of triangle A or B of a cell."""
    if half == 0:
        return i, i + 1, j, near
    return i + 1, i, j + 1, far


@kernel
def damped_stress(stiffness, strain, reference, damping):
    return stiffness * (strain + damping * (strain - reference))


@kernel
def _load_cells(half, rest, stiffness, strains, reference, damping, cells):
    """Rest values, stresses and stiffnesses of triangles A or B (half) of a strip, to lines.

    rest: (m, 2, 3), stiffness: (m, 2, 2), strains, reference: (4 m,). Triangles without stiffness
    are not there: all their values are zero.
    """
    for j in range(stiffness.shape[0]):
        at = 4 * j + 2 * half
        there = stiffness[j, half, 0] != 0.0
        for k in range(3):
            cells.rest[k, j] = rest[j, half, k] if there else 0.0
        for k in range(2):
            value = stiffness[j, half, k] if there else 0.0
            cells.weight[k, 0, j] = value * (1.0 + damping)
            cells.weight[k, 1, j] = 0.5 * value * (1.0 + damping)
            cells.stress[k, j] = damped_stress(value, strains[at + k], reference[at + k], damping)


@kernel
def _add_guard(half, guard, strains, cells):
    """The guard's stresses, and its J as the strain GUARD; guard: (m, 2), strains: (4 m,)."""
    gradient = cells.gradient
    for j in range(guard.shape[0]):
        at = 4 * j + 2 * half
        slope, curvature, by_across, by_shear = guard_slopes(
            guard[j, half], strains[at], strains[at + 1]
        )
        cells.stress[0, j] += slope * by_across
        cells.stress[1, j] += slope * by_shear
        cells.weight[GUARD, 0, j], cells.weight[GUARD, 1, j] = curvature, 0.5 * curvature
        for node in range(3):
            for k in range(3):
                gradient[GUARD, node, k, j] = (
                    by_across * gradient[0, node, k, j] + by_shear * gradient[1, node, k, j]
                )


@kernel
def _find_lift(columns, own, other, shift, cells):
    """The stabilising geometric stiffness of a row of triangles, as the strain LIFT."""
    for j in range(columns):
        membrane_lift(
            own[:, j],
            own[:, j + 1],
            other[:, j + shift],
            cells.rest[:, j],
            cells.stress[0, j],
            cells.stress[1, j],
            cells.single[2, 0],
            cells.single,
        )
        value = cells.single[2, 0, 0]
        cells.weight[LIFT, 0, j], cells.weight[LIFT, 1, j] = value, 0.5 * value
        for node in range(3):
            for k in range(3):
                cells.gradient[LIFT, node, k, j] = cells.single[0, node, k]


@kernel
def _add_pairs(count, half, weight, gradient, low, high):
    """One strain of triangles A or B (half) to the blocks of the rows below and above them.

    weight: (2, .) stiffness and half of it. gradient: (nodes, 3, .). low, high: (5, 3, 3 S).
    """
    k, h, a, b, c = weight[0], weight[1], gradient[0], gradient[1], gradient[2]
    if half == 0:
        add_outer(count, h, a, a, 0, low[OWN])
        add_outer(count, h, b, b, 1, low[OWN])
        add_outer(count, h, c, c, 0, high[OWN])
        add_outer(count, k, a, b, 0, low[ALONG])
        add_outer(count, k, c, a, 0, low[UP])
        add_outer(count, k, c, b, 0, low[SLANT])
    else:
        add_outer(count, h, a, a, 0, high[OWN])
        add_outer(count, h, b, b, 1, high[OWN])
        add_outer(count, h, c, c, 1, low[OWN])
        add_outer(count, k, a, b, 0, high[ALONG])
        add_outer(count, k, b, c, 1, low[UP])
        add_outer(count, k, a, c, 0, low[SLANT])


@kernel
def _find_turning(columns, cells):
    """The whole geometric stiffness: times the unit matrix, of each pair of a triangle's nodes.

    Written: turning (6, .), of x_0, x_1, x_2 with themselves, halved, and of (x_0, x_1),
    (x_0, x_2), (x_1, x_2).
    """
    rest, stress, turning = cells.rest, cells.stress, cells.turning
    for j in range(columns):
        edge, reach = rest[0, j], rest[2, j]
        turn, across, shear = reach * rest[1, j] * edge, stress[0, j], stress[1, j]
        dd = across * reach * reach
        de = reach * (shear * edge - across * turn)
        ee = turn * (across * turn - 2.0 * shear * edge)
        turning[0, j], turning[1, j], turning[2, j] = 0.5 * (dd + ee) + de, 0.5 * ee, 0.5 * dd
        turning[3, j], turning[4, j], turning[5, j] = -de - ee, -dd - de, de


@kernel
def _add_turning(count, half, turning, low, high):
    """As _add_pairs, of _find_turning."""
    if half == 0:
        add_diagonal(count, turning[0], 0, low[OWN])
        add_diagonal(count, turning[1], 1, low[OWN])
        add_diagonal(count, turning[2], 0, high[OWN])
        add_diagonal(count, turning[3], 0, low[ALONG])
        add_diagonal(count, turning[4], 0, low[UP])
        add_diagonal(count, turning[5], 0, low[SLANT])
    else:
        add_diagonal(count, turning[0], 0, high[OWN])
        add_diagonal(count, turning[1], 1, high[OWN])
        add_diagonal(count, turning[2], 1, low[OWN])
        add_diagonal(count, turning[3], 0, high[ALONG])
        add_diagonal(count, turning[5], 1, low[UP])
        add_diagonal(count, turning[4], 0, low[SLANT])


@kernel
def _add_strip(i, side, half, rest, stiffness, guard, strains, reference, damping, wanted, vane):
    """Triangles A or B (half) between rows i and i + 1.

    rest: (m, 2, 3), stiffness: (m, 2, 2), guard: (2, n-1, m, 2) or of size 0, strains: (4 m,).
    """
    columns, cells = stiffness.shape[0], vane.cells
    count, gradient, stress = lanes(columns), cells.gradient, cells.stress
    own, other = vane.nodes[i + half, side], vane.nodes[i + 1 - half, side]
    on_own, on_other = vane.pull[i + half, side], vane.pull[i + 1 - half, side]
    _load_cells(half, rest, stiffness, strains, reference, damping, cells)
    membrane_gradients(count, own, other, half, cells.rest, gradient)
    if guard.shape[0] > 0:
        _add_guard(half, guard[side, i], strains, cells)
    for strain in range(2):
        add_forces(count, stress[strain], gradient[strain, 0], 0, on_own)
        add_forces(count, stress[strain], gradient[strain, 1], 1, on_own)
        add_forces(count, stress[strain], gradient[strain, 2], half, on_other)
    if wanted == FORCES_ONLY:
        return
    if wanted == STABILISING:
        _find_lift(columns, own, other, half, cells)
    low, high = vane.blocks[i, side], vane.blocks[i + 1, side]
    for strain in range(4):
        if (strain == GUARD and guard.shape[0] == 0) or (strain == LIFT and wanted == WHOLE):
            continue
        _add_pairs(count, half, cells.weight[strain], gradient[strain], low, high)
    if wanted == WHOLE:
        _find_turning(columns, cells)
        _add_turning(count, half, cells.turning, low, high)


@kernel
def _load_hinges(stiffness, strains, reference, damping, cells):
    """Stresses and stiffnesses of a row of hinges, to lines; stiffness to reference: (m,)."""
    for j in range(stiffness.shape[0]):
        value = stiffness[j]
        cells.weight[0, 0, j] = value * (1.0 + damping)
        cells.weight[0, 1, j] = 0.5 * value * (1.0 + damping)
        cells.stress[0, j] = damped_stress(value, strains[j], reference[j], damping)


@kernel
def _crush(j, share, angle, lag, stiffness, damping, gradient, shrink, pull, above, below):
    """Hinge j, of which a triangle is crushed: its strain is the angle times its share.

    lag: angle less its reference. gradient: (4, 3, .) of the angle, in, and of the strain, out.
    shrink: (4, 3) gradient of the share. pull, above, below: (3, .) forces on the nodes of its
    barb and of those around it, to which its own are added.
    """
    by_angle = stiffness * share * share * (angle + damping * lag)
    by_share = stiffness * share * (angle * angle + damping * lag * lag)
    for k in range(3):
        for node in range(4):
            force = by_angle * gradient[node, k, j] + by_share * shrink[node, k]
            gradient[node, k, j] = share * gradient[node, k, j] + angle * shrink[node, k]
            if node < 2:
                pull[k, j + node] += force
            elif node == 2:
                above[k, j] += force
            else:
                below[k, j + 1] += force


@kernel
def _crush_hinges(i, side, above, below, stiffness, strains, shares, reference, damping, vane):
    """Hinges of row i of which a triangle is crushed; their stress is left zero.

    above, below: (m, 2, 3) rest values. strains, shares, reference: (m,).
    """
    cells, pull, gradient = vane.cells, vane.pull, vane.cells.gradient[0]
    own, up, down = vane.nodes[i, side], vane.nodes[i + 1, side], vane.nodes[i - 1, side]
    for j in range(stiffness.shape[0]):
        if stiffness[j] == 0.0 or shares[j] >= 1.0:
            continue
        shrink, lag = cells.single[0], strains[j] - reference[j]
        opens = opening(above[j, 0]), opening(below[j, 1])
        crush_gradient(
            own[:, j], own[:, j + 1], up[:, j], down[:, j + 1], opens[0], opens[1], shrink
        )
        _crush(
            j,
            shares[j],
            strains[j],
            lag,
            stiffness[j],
            damping,
            gradient,
            shrink,
            pull[i, side],
            pull[i + 1, side],
            pull[i - 1, side],
        )
        cells.stress[0, j] = 0.0


@kernel
def _add_hinge_pairs(count, weight, gradient, low, own, high):
    """Hinges of a row to the blocks of the rows below them, their own and above.

    weight: (2, .) stiffness and half of it. gradient: (4, 3, .). low, own, high: (5, 3, 3 S).
    """
    k, h = weight[0], weight[1]
    a, b, c, d = gradient[0], gradient[1], gradient[2], gradient[3]
    add_outer(count, h, a, a, 0, own[OWN])
    add_outer(count, h, b, b, 1, own[OWN])
    add_outer(count, h, c, c, 0, high[OWN])
    add_outer(count, h, d, d, 1, low[OWN])
    add_outer(count, k, a, b, 0, own[ALONG])
    add_outer(count, k, c, a, 0, own[UP])
    add_outer(count, k, c, b, 0, own[SLANT])
    add_outer(count, k, a, d, 0, low[SLANT])
    add_outer(count, k, b, d, 1, low[UP])
    add_outer(count, k, c, d, 0, own[SKIP])


@kernel
def _add_hinges(
    i, side, above, below, stiffness, strains, shares, reference, damping, wanted, vane
):
    """Hinges on row i's barb; stiffness to reference: (m,).

    above, below: (m, 2, 3) rest values of the cells on either side of the barb.
    """
    cells, nodes, pull = vane.cells, vane.nodes, vane.pull
    count, weight, gradient = lanes(stiffness.shape[0]), cells.weight[0], cells.gradient[0]
    _load_hinges(stiffness, strains, reference, damping, cells)
    hinge_gradients(
        count, nodes[i, side], nodes[i + 1, side], nodes[i - 1, side], weight[0], gradient
    )
    _crush_hinges(i, side, above, below, stiffness, strains, shares, reference, damping, vane)
    stress = cells.stress[0]
    add_forces(count, stress, gradient[0], 0, pull[i, side])
    add_forces(count, stress, gradient[1], 1, pull[i, side])
    add_forces(count, stress, gradient[2], 0, pull[i + 1, side])
    add_forces(count, stress, gradient[3], 1, pull[i - 1, side])
    if wanted != FORCES_ONLY:
        blocks = vane.blocks
        _add_hinge_pairs(
            count, weight, gradient, blocks[i - 1, side], blocks[i, side], blocks[i + 1, side]
        )


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
                _add_strip(
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
            _add_hinges(
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
