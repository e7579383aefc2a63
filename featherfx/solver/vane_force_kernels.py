"""Forces of membrane and bending across barbs on the nodes of a vane, and their stiffness there.

Stiffness is kept as 3 by 3 blocks between neighbouring nodes of the grid, row by row and side by
side: the few kinds of pairs below are all that triangles and hinges couple. A triangle is a matter
of e = x_1 - x_0 along the barb and d = x_2 - x_0 (vane_membrane_kernels, from which p, s and h):

    a = e / s,      c = d / h - t e,      t = p / (s h)

and its second variation, with k_w, k_s the stiffnesses of e_ww and 2 e_vw, f and g their stresses,

    k_w (c.dc)^2 + k_s (a.dc + c.da)^2 + f |dc|^2 + 2 g da.dc

Compression and shear make the last two terms indefinite. Their stabilising part, used where the
whole is indefinite, is that along the triangle's normal n alone and there the positive eigenvalue
l of [[0, g], [g, f]]: l (n.(p da + q dc))^2 with its unit eigenvector (p, q). A compression guard
(vane_guard_kernels) adds to the stresses, and the square of its dJ.
"""

from math import sqrt

from featherfx.compiled import kernel
from featherfx.mechanics.rotations_kernels import cross
from featherfx.mechanics.vane_bending_kernels import crush_gradient, hinge_gradient, opening
from featherfx.mechanics.vane_guard_kernels import guard_slopes
from featherfx.solver.energy_kernels import node_index

# blocks K(p, q) of row i and column j: p, q =
# (i, j), (i, j), halved; (i, j), (i, j+1); (i+1, j), (i, j); (i+1, j), (i, j+1);
# (i+1, j), (i-1, j+1)
OWN, ALONG, UP, SLANT, SKIP = 0, 1, 2, 3, 4
PAIRS = 5
# which second derivatives are wanted: none, those without what may be indefinite, all
FORCES_ONLY, STABILISING, WHOLE = 0, 1, 2


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
def _add_stable_part(a, c, across, shear, by_edge, by_reach, turn, dd, de, ee):
    """Add the stabilising geometric stiffness; a, c: (3,), the factors those of _fill_blocks."""
    nx, ny, nz = cross(a[0], a[1], a[2], c[0], c[1], c[2])
    square = nx * nx + ny * ny + nz * nz
    value = 0.5 * (across + sqrt(across * across + 4.0 * shear * shear))
    size = (value * value + shear * shear) * square
    if not size > 0.0:
        return
    normal = (nx, ny, nz)
    on_e, on_d = shear * by_edge - value * turn, value * by_reach
    for k in range(3):
        for m in range(3):
            lift = value * normal[k] * normal[m] / size
            dd[k, m] += lift * on_d * on_d
            de[k, m] += lift * on_d * on_e
            ee[k, m] += lift * on_e * on_e


@kernel
def _add_guard(a, c, v, by_reach, turn, guard, dd, de, ee):
    """Add d2W/dJ2 dJ dJ^T; guard: (3,), v: derivative of 2 e_vw by e."""
    curvature, by_across, by_shear = guard[0], guard[1], guard[2]
    for k in range(3):
        dk = by_reach * (by_across * c[k] + by_shear * a[k])
        ek = by_shear * v[k] - by_across * turn * c[k]
        for m in range(3):
            dm = by_reach * (by_across * c[m] + by_shear * a[m])
            em = by_shear * v[m] - by_across * turn * c[m]
            dd[k, m] += curvature * dk * dm
            de[k, m] += curvature * dk * em
            ee[k, m] += curvature * ek * em


@kernel
def _fill_blocks(triangle, rest, terms, wanted):
    """Second derivatives by (d, d), (d, e) and (e, e) of one triangle, to triangle[1:4].

    triangle: (4, 3, 3), of which [0, 0] is a and [0, 1] is c. rest: (1/s, p, 1/h). terms: (3, 3)
    stiffnesses k_w, k_s; stresses f, g; and of the guard d2W/dJ2 and dJ by both strains.
    """
    stiffness, across, shear = terms[0], terms[1, 0], terms[1, 1]
    a, c, v = triangle[0, 0], triangle[0, 1], triangle[0, 2]
    dd, de, ee = triangle[1], triangle[2], triangle[3]
    by_edge, by_reach = rest[0], rest[2]
    turn = rest[2] * rest[1] * rest[0]
    for k in range(3):
        v[k] = by_edge * c[k] - turn * a[k]
    wide, tall = stiffness[0] * by_reach, stiffness[1] * by_reach
    for k in range(3):
        for m in range(3):
            cc = c[k] * c[m]
            dd[k, m] = by_reach * (wide * cc + tall * a[k] * a[m])
            de[k, m] = tall * a[k] * v[m] - wide * turn * cc
            ee[k, m] = stiffness[0] * turn * turn * cc + stiffness[1] * v[k] * v[m]
    if terms[2, 0] > 0.0:
        _add_guard(a, c, v, by_reach, turn, terms[2], dd, de, ee)
    if wanted == STABILISING:
        _add_stable_part(a, c, across, shear, by_edge, by_reach, turn, dd, de, ee)
        return
    for k in range(3):
        dd[k, k] += across * by_reach * by_reach
        de[k, k] += by_reach * (shear * by_edge - across * turn)
        ee[k, k] += turn * (across * turn - 2.0 * shear * by_edge)


@kernel
def _add_blocks(triangle, half, j, own, along, other, up, slant):
    """Blocks of triangle A or B (half) of column j, added to (3, 3 S) of each kind of pair.

    own, along: of its edge's row. other: OWN of its opposite node's row. up, slant: of the cell.
    """
    dd, de, ee = triangle[1], triangle[2], triangle[3]
    count = own.shape[1] // 3
    for m in range(3):
        for k in range(3):
            at = k * count + j
            reach, edge, mixed, turned = dd[k, m], ee[k, m], de[k, m], de[m, k]
            own[m, at] += 0.5 * (reach + edge + mixed + turned)
            own[m, at + 1] += 0.5 * edge
            along[m, at] -= edge + mixed
            if half == 0:
                other[m, at] += 0.5 * reach
                up[m, at] -= reach + mixed
                slant[m, at] += mixed
            else:
                other[m, at + 1] += 0.5 * reach
                up[m, at + 1] += turned
                slant[m, at] -= reach + turned


@kernel
def _add_cell(i, j, half, side, points, rest, wanted, vane, force):
    """Force and stiffness of triangle A or B (half) of cell (i, j).

    rest: (3,). vane: scratch and blocks; its pair holds the terms of _fill_blocks.
    """
    columns = (points.shape[1] - 3) // 2
    near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
    row, other, _, opposite = cell_nodes(i, half, j, near, far)
    triangle, low, high = vane.triangle, vane.blocks[i, side], vane.blocks[i + 1, side]
    a, c = triangle[0, 0], triangle[0, 1]
    x0, x1, x2 = points[row, near], points[row, far], points[other, opposite]
    f0, f1, f2 = force[row, near], force[row, far], force[other, opposite]
    turn = rest[2] * rest[1] * rest[0]
    across, shear = vane.pair[1, 0], vane.pair[1, 1]
    for k in range(3):
        a[k] = rest[0] * (x1[k] - x0[k])
        c[k] = rest[2] * (x2[k] - x0[k] - rest[1] * a[k])
        by_c, by_a = across * c[k] + shear * a[k], shear * c[k]
        on_d, on_e = rest[2] * by_c, rest[0] * by_a - turn * by_c
        f0[k] -= on_d + on_e
        f1[k] += on_e
        f2[k] += on_d
    if wanted == FORCES_ONLY:
        return
    _fill_blocks(triangle, rest, vane.pair, wanted)
    if half == 0:
        _add_blocks(triangle, 0, j, low[OWN], low[ALONG], high[OWN], low[UP], low[SLANT])
    else:
        _add_blocks(triangle, 1, j, high[OWN], high[ALONG], low[OWN], low[UP], low[SLANT])


@kernel
def _add_strip(
    i, side, points, rest, stiffness, guard, strains, reference, damping, wanted, vane, force
):
    """Cells between rows i and i + 1.

    rest: (m, 2, 3), stiffness: (m, 2, 2), guard: (2, n-1, m, 2) or of size 0, strains: (4 m,).
    """
    scaled, stress, extra = vane.pair[0], vane.pair[1], vane.pair[2]
    for j in range(stiffness.shape[0]):
        for half in range(2):
            if stiffness[j, half, 0] == 0.0:
                continue
            at = 4 * j + 2 * half
            for k in range(2):
                scaled[k] = stiffness[j, half, k] * (1.0 + damping)
                stress[k] = damped_stress(
                    stiffness[j, half, k], strains[at + k], reference[at + k], damping
                )
            extra[0] = 0.0
            if guard.shape[0] > 0:
                slope, extra[0], extra[1], extra[2] = guard_slopes(
                    guard[side, i, j, half], strains[at], strains[at + 1]
                )
                stress[0] += slope * extra[1]
                stress[1] += slope * extra[2]
            _add_cell(i, j, half, side, points, rest[j, half], wanted, vane, force)


@kernel
def _add_square(weight, left, right, j, blocks):
    """weight left right^T of two gradients (3,), added to column j of blocks (3, 3 S)."""
    count = blocks.shape[1] // 3
    for m in range(3):
        for k in range(3):
            blocks[m, k * count + j] += weight * left[k] * right[m]


@kernel
def _crush(share, angle, reference, stiffness, damping, hinge):
    """Gradients of a hinge of which a triangle is crushed.

    hinge: (3, 4, 3); in: gradients of angle and share, out: [0] that of share times angle, whose
    stiffness is the hinge's, and [2] the force.
    """
    lag = angle - reference
    by_angle = stiffness * share * share * (angle + damping * lag)
    by_share = stiffness * share * (angle * angle + damping * lag * lag)
    for point in range(4):
        for k in range(3):
            turn, shrink = hinge[0, point, k], hinge[1, point, k]
            hinge[2, point, k] = by_angle * turn + by_share * shrink
            hinge[0, point, k] = share * turn + angle * shrink


@kernel
def _add_hinges(
    i, side, points, above, below, stiffness, strains, reference, damping, wanted, vane, force
):
    """Hinges on row i's barb; stiffness to reference: (m,).

    above, below: (m, 2, 3) rest values of the cells on either side of the barb.
    """
    g, blocks = vane.hinge[0], vane.blocks
    columns, shares = stiffness.shape[0], 2 * points.shape[0] * stiffness.shape[0]
    for j in range(columns):
        if stiffness[j] == 0.0:
            continue
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        x0, x1, x2, x3 = points[i, near], points[i, far], points[i + 1, near], points[i - 1, far]
        hinge_gradient(x0, x1, x2, x3, g)
        stress = damped_stress(stiffness[j], strains[j], reference[j], damping)
        weight = stiffness[j] * (1.0 + damping)
        total, share = g, strains[shares + j]
        if share < 1.0:
            total, stress = vane.hinge[2], 1.0
            crush_gradient(
                x0, x1, x2, x3, opening(above[j, 0]), opening(below[j, 1]), vane.hinge[1]
            )
            _crush(share, strains[j], reference[j], stiffness[j], damping, vane.hinge)
        for k in range(3):
            force[i, near, k] += stress * total[0, k]
            force[i, far, k] += stress * total[1, k]
            force[i + 1, near, k] += stress * total[2, k]
            force[i - 1, far, k] += stress * total[3, k]
        if wanted == FORCES_ONLY:
            continue
        _add_square(0.5 * weight, g[0], g[0], j, blocks[i, side, OWN])
        _add_square(0.5 * weight, g[1], g[1], j + 1, blocks[i, side, OWN])
        _add_square(0.5 * weight, g[2], g[2], j, blocks[i + 1, side, OWN])
        _add_square(0.5 * weight, g[3], g[3], j + 1, blocks[i - 1, side, OWN])
        _add_square(weight, g[0], g[1], j, blocks[i, side, ALONG])
        _add_square(weight, g[2], g[0], j, blocks[i, side, UP])
        _add_square(weight, g[2], g[1], j, blocks[i, side, SLANT])
        _add_square(weight, g[0], g[3], j, blocks[i - 1, side, SLANT])
        _add_square(weight, g[1], g[3], j + 1, blocks[i - 1, side, UP])
        _add_square(weight, g[2], g[3], j, blocks[i, side, SKIP])


@kernel
def add_vane_forces(model, f, damping, wanted, pose, reference, vane, force):
    """Membrane and hinges of feather f: forces added to force (n, P, 3), stiffness to vane.blocks.

    wanted: FORCES_ONLY leaves the blocks as they are, STABILISING leaves out what of the geometric
    stiffness may be indefinite.
    """
    rows, columns = pose.turn.shape[0], model.joints.shape[3]
    cells_at = (rows - 1) * 6 + 2 * rows * pose.coefficient.shape[2]
    hinges_at = cells_at + 2 * (rows - 1) * columns * 4
    if wanted != FORCES_ONLY:
        vane.blocks[:] = 0.0
    for side in range(2):
        for i in range(rows - 1):
            at = cells_at + (side * (rows - 1) + i) * columns * 4
            _add_strip(
                i,
                side,
                pose.points,
                model.cell_rest[f, side, i],
                model.cell_stiffness[f, side, i],
                model.cell_guard[f],
                pose.strains[at:],
                reference[at:],
                damping,
                wanted,
                vane,
                force,
            )
        for i in range(1, rows - 1):
            at = hinges_at + (side * rows + i) * columns
            _add_hinges(
                i,
                side,
                pose.points,
                model.cell_rest[f, side, i],
                model.cell_rest[f, side, i - 1],
                model.hinge_stiffness[f, side, i],
                pose.strains[at:],
                reference[at:],
                damping,
                wanted,
                vane,
                force,
            )
