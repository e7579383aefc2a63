"""Stiffness of the vane and its barbs in generalised coordinates, added to the band.

Row by row and side by side: all that touches the barb of row i (its nodes, the cells between rows
i and i + 1, the hinges on its edges) involves rows i - 1, i, i + 1 only, and of those only the
root (6) and this side's coefficients (2 C): w = 6 + 2 C increments a row. Every strain, node or
segment gives lines, its projected gradient J^T ds/dx. They are laid out increment by increment,
(w, lines), so that filling them runs along the barb and their weighted products are dot products
of contiguous arrays; the sums are added to the band once per row and side.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.barb_kernels import barb_tensions
from featherfx.mechanics.vane_bending_kernels import hinge_gradient
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_lift
from featherfx.solver.energy_kernels import node_index
from featherfx.solver.guard_kernels import add_guard_cells
from featherfx.solver.vane_force_kernels import cell_nodes, damped_stress


@kernel
def _add_products(matrix, row_at, column_at, left, right, lines):
    """matrix[row_at + a, column_at + b] += left[a] . right[b] over the first lines of both.

    left: (p, S), right: (q, S), p and q even. Two by two, so that each load serves twice; on the
    diagonal (row_at == column_at) the blocks above it are left out.
    """
    triangle = row_at == column_at
    for a in range(0, left.shape[0], 2):
        g, h = left[a], left[a + 1]
        for b in range(0, a + 2 if triangle else right.shape[0], 2):
            u, v = right[b], right[b + 1]
            gu, gv, hu, hv = 0.0, 0.0, 0.0, 0.0
            for s in range(lines):
                gu += g[s] * u[s]
                gv += g[s] * v[s]
                hu += h[s] * u[s]
                hv += h[s] * v[s]
            matrix[row_at + a, column_at + b] += gu
            matrix[row_at + a, column_at + b + 1] += gv
            matrix[row_at + a + 1, column_at + b] += hu
            matrix[row_at + a + 1, column_at + b + 1] += hv


@kernel
def _add_nodes(i, side, force, stiff, jacobian, block):
    """Forces on the barb nodes of one row and side, and inertia, air and grips' stiffness.

    jacobian: (w, 3, S) of this barb, whose first m + 1 nodes count.
    """
    wide, nodes = jacobian.shape[0], block.tension.shape[0] + 1
    weighted, lines = block.weighted[:wide], block.lines[:wide]
    first = node_index(side, 1, nodes - 1) - 1
    for a in range(wide):
        total = 0.0
        for j in range(1, nodes):
            x, y, z = jacobian[a, 0, j], jacobian[a, 1, j], jacobian[a, 2, j]
            g, s = force[i, first + j], stiff[i, first + j]
            total += x * g[0] + y * g[1] + z * g[2]
            at = 3 * j - 3
            lines[a, at], lines[a, at + 1], lines[a, at + 2] = x, y, z
            weighted[a, at] = s[0] * x + s[3] * y + s[4] * z
            weighted[a, at + 1] = s[3] * x + s[1] * y + s[5] * z
            weighted[a, at + 2] = s[4] * x + s[5] * y + s[2] * z
        block.right[wide + a] -= total
    _add_products(block.matrix, wide, wide, weighted, lines, 3 * nodes - 3)


@kernel
def _add_tension(i, side, points, force, segment, signed, jacobian, block):
    """Geometric stiffness of the barb's tension: T / l |turn of each segment|^2."""
    if not segment > 0.0:
        return
    wide, nodes = jacobian.shape[0], block.tension.shape[0] + 1
    weighted, lines = block.weighted[:wide], block.lines[:wide]
    start = 3 + side * (nodes - 1)
    tension = block.tension
    barb_tensions(
        points[i, 0],
        points[i, start : start + nodes - 1],
        force[i, start : start + nodes - 1],
        tension,
    )
    for j in range(nodes - 1):
        tension[j] /= segment
        if tension[j] < 0.0 and not signed:
            tension[j] = 0.0
    for a in range(wide):
        for k in range(3):
            at = k * (nodes - 1)
            for j in range(nodes - 1):
                turn = jacobian[a, k, j + 1] - jacobian[a, k, j]
                lines[a, at + j] = turn
                weighted[a, at + j] = tension[j] * turn
    _add_products(block.matrix, wide, wide, weighted, lines, 3 * nodes - 3)


@kernel
def _cell_lines(i, side, points, rest, stiffness, strains, reference, damping, signed, block):
    """Weights (2, 4, m + 1) and nodal gradients (2, 3, 3, 4, m + 1) of the lines of a strip.

    Triangle A or B; node (edge start, edge end, opposite), axis; line: e_ww, 2 e_vw, and the two of
    the geometric stiffness, of which the destabilising one only if signed; cell, of which the last
    is always zero. Other arguments as _cell_forces.
    """
    weight, gradients, triangle = block.weight, block.membrane, block.triangle
    columns = stiffness.shape[0]
    for j in range(columns):
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        for half in range(2):
            if stiffness[j, half, 0] == 0.0:
                weight[half, :, j] = 0.0
                gradients[half, :, :, :, j] = 0.0
                continue
            row, other, _, opposite = cell_nodes(i, half, j, near, far)
            start, end, tip = points[row, near], points[row, far], points[other, opposite]
            at = 4 * j + 2 * half
            across = damped_stress(stiffness[j, half, 0], strains[at], reference[at], damping)
            shear = damped_stress(
                stiffness[j, half, 1], strains[at + 1], reference[at + 1], damping
            )
            membrane_gradient(start, end, tip, rest[j, half], triangle)
            membrane_lift(
                start, end, tip, rest[j, half], across, shear, weight[half, 2:, j], triangle[2:]
            )
            for line in range(4):
                for node in range(3):
                    for k in range(3):
                        gradients[half, node, k, line, j] = triangle[line, node, k]
            weight[half, 0, j] = stiffness[j, half, 0] * (1.0 + damping)
            weight[half, 1, j] = stiffness[j, half, 1] * (1.0 + damping)
            if not signed:
                weight[half, 3, j] = 0.0


@kernel
def _fill_edge(weight, gradients, edge, lines, weighted, row_at, at):
    """Project the gradients at both ends of barb edges and weigh them.

    weight: (S,). gradients: (3, 3, S). edge: (w, 3, S + 1) Jacobian of the barb. Written: w rows
    from row_at, S columns from at, of lines and weighted.
    """
    count = weight.shape[0]
    s0, s1, s2 = gradients[0, 0], gradients[0, 1], gradients[0, 2]
    e0, e1, e2 = gradients[1, 0], gradients[1, 1], gradients[1, 2]
    for a in range(edge.shape[0]):
        x, y, z = edge[a, 0], edge[a, 1], edge[a, 2]
        line = lines[row_at + a, at : at + count]
        for s in range(count):
            line[s] = (
                x[s] * s0[s]
                + y[s] * s1[s]
                + z[s] * s2[s]
                + x[s + 1] * e0[s]
                + y[s + 1] * e1[s]
                + z[s + 1] * e2[s]
            )
        product = weighted[row_at + a, at : at + count]
        for s in range(count):
            product[s] = weight[s] * line[s]


@kernel
def _fill_tip(weight, gradient, shift, other, lines, weighted, row_at, at):
    """As _fill_edge, for the opposite nodes; gradient: (3, S), shift: their column beyond j."""
    count = weight.shape[0]
    g0, g1, g2 = gradient[0], gradient[1], gradient[2]
    for a in range(other.shape[0]):
        x, y, z = other[a, 0, shift:], other[a, 1, shift:], other[a, 2, shift:]
        line = lines[row_at + a, at : at + count]
        for s in range(count):
            line[s] = x[s] * g0[s] + y[s] * g1[s] + z[s] * g2[s]
        product = weighted[row_at + a, at : at + count]
        for s in range(count):
            product[s] = weight[s] * line[s]


@kernel
def _add_cells(
    i, side, points, rest, stiffness, strains, reference, damping, signed, jacobian, block
):
    """Membrane stiffness of the cells between rows i and i + 1; arguments as _cell_lines."""
    wide = jacobian.shape[2]
    count = 4 * (stiffness.shape[0] + 1)
    low, high = jacobian[i, side], jacobian[i + 1, side]
    _cell_lines(i, side, points, rest, stiffness, strains, reference, damping, signed, block)
    lines, weighted = block.lines, block.weighted
    weight = block.weight.reshape((2, count))
    gradients = block.membrane.reshape((2, 3, 3, count))
    _fill_edge(weight[0], gradients[0], low, lines, weighted, 0, 0)
    _fill_tip(weight[0], gradients[0, 2], 0, high, lines, weighted, wide, 0)
    _fill_edge(weight[1], gradients[1], high, lines, weighted, wide, count)
    _fill_tip(weight[1], gradients[1, 2], 1, low, lines, weighted, 0, count)
    _add_products(block.matrix, wide, wide, weighted[: 2 * wide], lines[: 2 * wide], 2 * count)


@kernel
def _add_hinges(i, side, points, stiffness, damping, jacobian, block):
    """Stiffness of bending across barbs at the edges of row i's barb; stiffness: (m,)."""
    columns = stiffness.shape[0]
    wide = jacobian.shape[2]
    gradients, weight = block.membrane[0, :, :, 0], block.weight[0, 0, :columns]
    below = block.membrane[1, 0, :, 0]
    for j in range(columns):
        weight[j] = stiffness[j] * (1.0 + damping)
        if stiffness[j] == 0.0:
            gradients[:, :, j] = 0.0
            below[:, j] = 0.0
            continue
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        hinge_gradient(
            points[i, near], points[i, far], points[i + 1, near], points[i - 1, far], block.hinge
        )
        for k in range(3):
            gradients[0, k, j] = block.hinge[0, k]
            gradients[1, k, j] = block.hinge[1, k]
            gradients[2, k, j] = block.hinge[2, k]
            below[k, j] = block.hinge[3, k]
    lines, weighted = block.lines, block.weighted
    _fill_edge(weight, gradients, jacobian[i, side], lines, weighted, wide, 0)
    _fill_tip(weight, gradients[2], 0, jacobian[i + 1, side], lines, weighted, 2 * wide, 0)
    _fill_tip(weight, below, 1, jacobian[i - 1, side], lines, weighted, 0, 0)
    _add_products(block.matrix, 0, 0, weighted, lines, columns)


@kernel
def _add_barb(stiffness, strains, reference, damping, block):
    """Bending of one barb, whose coefficients are its strains; all arrays (2 C,)."""
    at = block.matrix.shape[0] // 3 + 6
    for c in range(stiffness.shape[0]):
        block.matrix[at + c, at + c] += stiffness[c] * (1.0 + damping)
        block.right[at + c] -= damped_stress(stiffness[c], strains[c], reference[c], damping)


@kernel
def _scatter(i, rows, side, matrix, right, system):
    """Add the local matrix and right side of row i and one side to the band."""
    wide = matrix.shape[0] // 3
    skip = side * (wide - 6)
    row_size = 2 * wide - 6
    for block in range(3):
        row = i - 1 + block
        if row < 0 or row >= rows:
            continue
        for a in range(wide):
            to = row * row_size + a + (skip if a >= 6 else 0)
            la = block * wide + a
            system.right[to] += right[la]
            for other in range(block + 1):
                column_row = i - 1 + other
                if column_row < 0:
                    continue
                last = a + 1 if other == block else wide
                for b in range(last):
                    column = column_row * row_size + b + (skip if b >= 6 else 0)
                    system.band[column, to - column] += matrix[la, other * wide + b]


@kernel
def add_rows(model, f, damping, signed, pose, reference, force, stiff, jacobian, block, system):
    """Vane of feather f: row by row and side by side. force: (n, P, 3), of all that acts."""
    rows, columns = pose.turn.shape[0], model.joints.shape[3]
    count = pose.coefficient.shape[2]
    cells_at = (rows - 1) * 6 + 2 * rows * count
    points, strains = pose.points, pose.strains
    for i in range(rows):
        for side in range(2):
            block.matrix[:] = 0.0
            block.right[:] = 0.0
            _add_nodes(i, side, force, stiff, jacobian[i, side], block)
            _add_tension(
                i,
                side,
                points,
                force,
                model.segment[f, side, i],
                signed,
                jacobian[i, side],
                block,
            )
            at = (rows - 1) * 6 + (side * rows + i) * count
            _add_barb(
                model.barb_stiffness[f, side, i], strains[at:], reference[at:], damping, block
            )
            if i + 1 < rows:
                at = cells_at + (side * (rows - 1) + i) * columns * 4
                _add_cells(
                    i,
                    side,
                    points,
                    model.cell_rest[f, side, i],
                    model.cell_stiffness[f, side, i],
                    strains[at:],
                    reference[at:],
                    damping,
                    signed,
                    jacobian,
                    block,
                )
                if model.cell_guard.shape[1] > 0:
                    add_guard_cells(
                        i,
                        side,
                        points,
                        model.cell_guard[f, side, i],
                        model.cell_rest[f, side, i],
                        strains[at:],
                        signed,
                        jacobian,
                        block,
                    )
            if 0 < i < rows - 1:
                _add_hinges(
                    i, side, points, model.hinge_stiffness[f, side, i], damping, jacobian, block
                )
            _scatter(i, rows, side, block.matrix, block.right, system)
