"""Gradient and Gauss-Newton Hessian of step_energy in generalised coordinates, as a band.

Row by row and side by side: all that touches the barb of row i (its nodes, the cells between rows
i and i + 1, the hinges on its edges) involves rows i - 1, i, i + 1 only, and of those only the
root (6) and this side's coefficients (2 C). It is summed in one small dense matrix of 3 w,
w = 6 + 2 C, as outer products of projected strain gradients J^T ds/dx, and added to the band once.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.barb_kernels import barb_tensions
from featherfx.mechanics.node_kernels import node_forces
from featherfx.mechanics.rachis_kernels import rachis_geometric, rachis_gradient
from featherfx.mechanics.rotations_kernels import cross
from featherfx.mechanics.vane_bending_kernels import hinge_gradient
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient, membrane_lift
from featherfx.solver.energy_kernels import node_index


@kernel
def _project(line, at, root, point, jacobian, gradient):
    """Add J^T gradient of a barb node to line[at : at + w]; jacobian: (3, 2 C)."""
    gx, gy, gz = gradient[0], gradient[1], gradient[2]
    line[at] += gx
    line[at + 1] += gy
    line[at + 2] += gz
    mx, my, mz = cross(point[0] - root[0], point[1] - root[1], point[2] - root[2], gx, gy, gz)
    line[at + 3] += mx
    line[at + 4] += my
    line[at + 5] += mz
    for c in range(jacobian.shape[1]):
        line[at + 6 + c] += jacobian[0, c] * gx + jacobian[1, c] * gy + jacobian[2, c] * gz


@kernel
def _project_column(line, at, row, side, column, points, jacobian, gradient):
    """As _project, for column 0 (the rachis point itself) or a barb node of a row."""
    if column == 0:
        line[at] += gradient[0]
        line[at + 1] += gradient[1]
        line[at + 2] += gradient[2]
    else:
        columns = jacobian.shape[2]
        _project(
            line,
            at,
            points[row, 0],
            points[row, node_index(side, column, columns)],
            jacobian[row, side, column - 1],
            gradient,
        )


@kernel
def _add_outer(matrix, lines, first, last, weight):
    """matrix += sum weight lines lines^T (lower part) over an index range, for four lines."""
    for a in range(first, last):
        c0, c1 = weight[0] * lines[0, a], weight[1] * lines[1, a]
        c2, c3 = weight[2] * lines[2, a], weight[3] * lines[3, a]
        for b in range(first, a + 1):
            matrix[a, b] += (
                c0 * lines[0, b] + c1 * lines[1, b] + c2 * lines[2, b] + c3 * lines[3, b]
            )


@kernel
def _add_nodes(i, side, points, force, stiff, jacobian, block):
    """Forces on the barb nodes of one row and side, and inertia, air and grips' stiffness."""
    lines, matrix, right = block.lines, block.matrix, block.right
    columns = jacobian.shape[2]
    first = matrix.shape[0] // 3
    last = 2 * first
    for j in range(columns):
        p = node_index(side, j + 1, columns)
        s = stiff[i, p]
        g = force[i, p]
        _node_lines(i, side, j, points, jacobian, lines, first)
        for a in range(first, last):
            x, y, z = lines[0, a], lines[1, a], lines[2, a]
            right[a] -= x * g[0] + y * g[1] + z * g[2]
            sx = s[0] * x + s[3] * y + s[4] * z
            sy = s[3] * x + s[1] * y + s[5] * z
            sz = s[4] * x + s[5] * y + s[2] * z
            for b in range(first, a + 1):
                matrix[a, b] += sx * lines[0, b] + sy * lines[1, b] + sz * lines[2, b]


@kernel
def _node_lines(i, side, j, points, jacobian, lines, first):
    """Rows of J of barb node j (0: the first after the rachis) to lines[0:3, first:]."""
    p = node_index(side, j + 1, jacobian.shape[2])
    rx = points[i, p, 0] - points[i, 0, 0]
    ry = points[i, p, 1] - points[i, 0, 1]
    rz = points[i, p, 2] - points[i, 0, 2]
    for k in range(3):
        for a in range(6):
            lines[k, first + a] = 0.0
        lines[k, first + k] = 1.0
        for c in range(jacobian.shape[4]):
            lines[k, first + 6 + c] = jacobian[i, side, j, k, c]
    lines[0, first + 4], lines[0, first + 5] = rz, -ry
    lines[1, first + 3], lines[1, first + 5] = -rz, rx
    lines[2, first + 3], lines[2, first + 4] = ry, -rx


@kernel
def _add_tension(i, side, points, force, segment, signed, jacobian, block):
    """Geometric stiffness of the barb's tension: T / l |turn of each segment|^2."""
    lines, matrix = block.lines, block.matrix
    columns = jacobian.shape[2]
    first = matrix.shape[0] // 3
    start = 3 + side * columns
    if not segment > 0.0:
        return
    barb_tensions(
        points[i, 0],
        points[i, start : start + columns],
        force[i, start : start + columns],
        block.tension,
    )
    for k in range(3):
        for a in range(3):
            lines[k, first + a] = 0.0
    for j in range(columns):
        tension = block.tension[j] / segment
        if tension == 0.0 or (tension < 0.0 and not signed):
            continue
        p = node_index(side, j + 1, columns)
        q = node_index(side, j, columns)
        dx = points[i, p, 0] - points[i, q, 0]
        dy = points[i, p, 1] - points[i, q, 1]
        dz = points[i, p, 2] - points[i, q, 2]
        lines[0, first + 3], lines[0, first + 4], lines[0, first + 5] = 0.0, dz, -dy
        lines[1, first + 3], lines[1, first + 4], lines[1, first + 5] = -dz, 0.0, dx
        lines[2, first + 3], lines[2, first + 4], lines[2, first + 5] = dy, -dx, 0.0
        for k in range(3):
            for c in range(jacobian.shape[4]):
                inner = jacobian[i, side, j - 1, k, c] if j > 0 else 0.0
                lines[k, first + 6 + c] = jacobian[i, side, j, k, c] - inner
        for a in range(first + 3, 2 * first):
            x, y, z = tension * lines[0, a], tension * lines[1, a], tension * lines[2, a]
            for b in range(first + 3, a + 1):
                matrix[a, b] += x * lines[0, b] + y * lines[1, b] + z * lines[2, b]


@kernel
def _stress(stiffness, strain, reference, damping):
    return stiffness * (strain + damping * (strain - reference))


@kernel
def _cell_nodes(i, half, j, near, far):
    """(row of the edge, other row, other column, other node) of triangle A or B of a cell."""
    if half == 0:
        return i, i + 1, j, near
    return i + 1, i, j + 1, far


@kernel
def _cell_forces(i, side, points, rest, stiffness, strains, reference, damping, block, force):
    """Membrane forces of the cells between rows i and i + 1, added to force (n, P, 3).

    rest: (m, 2, 3), stiffness: (m, 2, 2) of these cells; strains, reference: (4 m,) theirs.
    """
    gradient = block.membrane
    columns = stiffness.shape[0]
    for j in range(columns):
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        for half in range(2):
            if stiffness[j, half, 0] == 0.0:
                continue
            row, other, _, opposite = _cell_nodes(i, half, j, near, far)
            at = 4 * j + 2 * half
            across = _stress(stiffness[j, half, 0], strains[at], reference[at], damping)
            shear = _stress(stiffness[j, half, 1], strains[at + 1], reference[at + 1], damping)
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
def _add_cells(
    i, side, points, rest, stiffness, strains, reference, damping, signed, jacobian, block
):
    """Membrane stiffness of the cells between rows i and i + 1; arguments as _cell_forces.

    signed: whether the destabilising part of the geometric stiffness is included.
    """
    lines, weight, gradient = block.lines, block.weight, block.membrane
    columns = jacobian.shape[2]
    wide = block.matrix.shape[0] // 3
    last = 3 * wide
    for j in range(columns):
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        for half in range(2):
            if stiffness[j, half, 0] == 0.0:
                continue
            row, other, column, opposite = _cell_nodes(i, half, j, near, far)
            edge_at = wide + (row - i) * wide
            other_at = wide + (other - i) * wide
            start, end, tip = points[row, near], points[row, far], points[other, opposite]
            at = 4 * j + 2 * half
            across = _stress(stiffness[j, half, 0], strains[at], reference[at], damping)
            shear = _stress(stiffness[j, half, 1], strains[at + 1], reference[at + 1], damping)
            membrane_gradient(start, end, tip, rest[j, half], gradient)
            membrane_lift(
                start, end, tip, rest[j, half], across, shear, weight[2:], gradient[2:]
            )
            weight[0] = stiffness[j, half, 0] * (1.0 + damping)
            weight[1] = stiffness[j, half, 1] * (1.0 + damping)
            if not signed:
                weight[3] = 0.0
            for k in range(4):
                line = lines[k]
                for a in range(wide, last):
                    line[a] = 0.0
                _project_column(line, edge_at, row, side, j, points, jacobian, gradient[k, 0])
                _project_column(line, edge_at, row, side, j + 1, points, jacobian, gradient[k, 1])
                _project_column(
                    line, other_at, other, side, column, points, jacobian, gradient[k, 2]
                )
            _add_outer(block.matrix, lines, wide, last, weight)


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
        stress = _stress(stiffness[j], strains[j], reference[j], damping)
        for k in range(3):
            force[i, near, k] += stress * gradient[0, k]
            force[i, far, k] += stress * gradient[1, k]
            force[i + 1, near, k] += stress * gradient[2, k]
            force[i - 1, far, k] += stress * gradient[3, k]


@kernel
def _add_hinges(i, side, points, stiffness, damping, jacobian, block):
    """Stiffness of bending across barbs at the edges of row i's barb; stiffness: (m,)."""
    lines, weight, gradient = block.lines, block.weight, block.hinge
    columns = jacobian.shape[2]
    wide = block.matrix.shape[0] // 3
    last = 3 * wide
    filled = 0
    for j in range(columns):
        if stiffness[j] != 0.0:
            line = lines[filled]
            for a in range(last):
                line[a] = 0.0
            near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
            hinge_gradient(
                points[i, near], points[i, far], points[i + 1, near], points[i - 1, far], gradient
            )
            _project_column(line, wide, i, side, j, points, jacobian, gradient[0])
            _project_column(line, wide, i, side, j + 1, points, jacobian, gradient[1])
            _project_column(line, 2 * wide, i + 1, side, j, points, jacobian, gradient[2])
            _project_column(line, 0, i - 1, side, j + 1, points, jacobian, gradient[3])
            weight[filled] = stiffness[j] * (1.0 + damping)
            filled += 1
        if filled == 4 or (filled > 0 and j == columns - 1):
            for k in range(filled, 4):
                weight[k] = 0.0
            _add_outer(block.matrix, lines, 0, last, weight)
            filled = 0


@kernel
def _add_barb(stiffness, strains, reference, damping, block):
    """Bending of one barb, whose coefficients are its strains; all arrays (2 C,)."""
    at = block.matrix.shape[0] // 3 + 6
    for c in range(stiffness.shape[0]):
        block.matrix[at + c, at + c] += stiffness[c] * (1.0 + damping)
        block.right[at + c] -= _stress(stiffness[c], strains[c], reference[c], damping)


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
def _add_rachis_nodes(i, points, force, stiff, row_size, system):
    """Inertia, gravity, air and grips of row i's rachis point and directors."""
    band, right = system.band, system.right
    at = i * row_size
    for k in range(3):
        right[at + k] -= force[i, 0, k]
        band[at + k, 0] += stiff[i, 0, k]
    band[at, 1] += stiff[i, 0, 3]
    band[at, 2] += stiff[i, 0, 4]
    band[at + 1, 1] += stiff[i, 0, 5]
    for p in range(1, 3):
        x, y, z = points[i, p, 0], points[i, p, 1], points[i, p, 2]
        mx, my, mz = cross(x, y, z, force[i, p, 0], force[i, p, 1], force[i, p, 2])
        inertia = stiff[i, p, 0]
        right[at + 3] -= mx
        right[at + 4] -= my
        right[at + 5] -= mz
        band[at + 3, 0] += inertia * (y * y + z * z)
        band[at + 4, 0] += inertia * (x * x + z * z)
        band[at + 5, 0] += inertia * (x * x + y * y)
        band[at + 3, 1] -= inertia * x * y
        band[at + 3, 2] -= inertia * x * z
        band[at + 4, 1] -= inertia * y * z


@kernel
def _add_rachis_element(i, pose, length, stiffness, reference, damping, signed, beam, system):
    """Stretch, shear, twist and bending between rows i and i + 1.

    stiffness: (6,); reference: (6,) of this element; beam: scratch; signed: as in assemble.
    """
    row_size = system.band.shape[1] // 3
    at = i * row_size
    gradient, matrix, stress = beam.gradient, beam.matrix, beam.stress
    start, end, halfway = pose.centre[i], pose.centre[i + 1], pose.halfway[i]
    rachis_gradient(start, end, length, halfway, pose.rachis[i], gradient)
    matrix[:] = 0.0
    for k in range(6):
        stress[k] = _stress(stiffness[k], pose.strains[6 * i + k], reference[k], damping)
        weight = stiffness[k] * (1.0 + damping)
        for a in range(12):
            to = at + a if a < 6 else at + row_size + a - 6
            system.right[to] -= stress[k] * gradient[k, a]
            scaled = weight * gradient[k, a]
            for b in range(a + 1):
                matrix[a, b] += scaled * gradient[k, b]
    rachis_geometric(start, end, length, halfway, stress, signed, matrix)
    for a in range(12):
        to = at + a if a < 6 else at + row_size + a - 6
        for b in range(a + 1):
            column = at + b if b < 6 else at + row_size + b - 6
            system.band[column, to - column] += matrix[a, b]


@kernel
def _add_grips(node, start, end, stiffness, share, points, force, stiff):
    """A feather's grips, added to the node forces and stiffnesses."""
    for g in range(stiffness.shape[0]):
        row, p = node[g, 0], node[g, 1]
        if row < 0:
            continue
        for k in range(3):
            gap = points[row, p, k] - start[g, k] - share * (end[g, k] - start[g, k])
            force[row, p, k] += stiffness[g] * gap
            stiff[row, p, k] += stiffness[g]


@kernel
def _hold_root(row_size, system):
    """Take the six coordinates of row 0 out of the system: their increment is zero."""
    band = system.band
    for a in range(6):
        system.right[a] = 0.0
        for d in range(band.shape[1]):
            band[a, d] = 0.0
        band[a, 0] = 1.0


@kernel
def _add_vane_forces(model, f, damping, pose, reference, block, force):
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


@kernel
def _add_rows(
    model, f, damping, signed, pose, reference, force, stiff, jacobian, block, system
):
    """Vane of feather f: row by row and side by side. force: (n, P, 3), of all that acts."""
    rows, columns = pose.turn.shape[0], model.joints.shape[3]
    count = pose.coefficient.shape[2]
    cells_at = (rows - 1) * 6 + 2 * rows * count
    points, strains = pose.points, pose.strains
    for i in range(rows):
        for side in range(2):
            block.matrix[:] = 0.0
            block.right[:] = 0.0
            _add_nodes(i, side, points, force, stiff, jacobian, block)
            _add_tension(
                i, side, points, force, model.segment[f, side, i], signed, jacobian, block
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
            if 0 < i < rows - 1:
                _add_hinges(
                    i, side, points, model.hinge_stiffness[f, side, i], damping, jacobian, block
                )
            _scatter(i, rows, side, block.matrix, block.right, system)


@kernel
def assemble(model, loads, f, share, factors, signed, work):
    """Hessian of step_energy at the pose work.now to work.system.band, minus gradient to right.

    work.jacobian must belong to the pose. share: of the frame, for the grips. factors: (inertia,
    rate, strain rate) of the integrator. signed: whether geometric stiffness of compression is
    included, too: then the Hessian may be indefinite, but Newton converges where a vane wrinkles.
    """
    pose, around, system = work.now, work.around, work.system
    rows, row_size = pose.turn.shape[0], system.band.shape[1] // 3
    system.band[:] = 0.0
    system.right[:] = 0.0
    node_forces(
        pose.points,
        around.target,
        factors[0],
        around.past,
        factors[1],
        model.mass[f],
        loads.gravity,
        loads.air,
        around.wind,
        around.area,
        around.speed,
        model.shaft_area[f],
        work.force,
        work.stiff,
    )
    _add_grips(
        loads.grip_node[f],
        loads.grip_start[f],
        loads.grip_end[f],
        loads.grip_stiffness[f],
        share,
        pose.points,
        work.force,
        work.stiff,
    )
    vane = model.retardation[f, 1] * factors[2]
    if model.joints.shape[3] > 0:
        _add_vane_forces(model, f, vane, pose, around.reference, work.block, work.force)
    for i in range(rows):
        _add_rachis_nodes(i, pose.points, work.force, work.stiff, row_size, system)
    for i in range(rows - 1):
        _add_rachis_element(
            i,
            pose,
            model.length[f, i],
            model.rachis_stiffness[f, i],
            around.reference[6 * i :],
            model.retardation[f, 0] * factors[2],
            signed,
            work.beam,
            system,
        )
    if model.joints.shape[3] > 0:
        _add_rows(
            model,
            f,
            vane,
            signed,
            pose,
            around.reference,
            work.force,
            work.stiff,
            work.jacobian,
            work.block,
            system,
        )
    if model.held[f]:
        _hold_root(row_size, system)
