"""Gradient and Gauss-Newton Hessian of step_energy in generalised coordinates, as a band.

Row by row and side by side: all that touches the barb of row i (its nodes, the cells between rows
i and i + 1, the hinges on its edges) involves rows i - 1, i, i + 1 only, and of those only the
root (6) and this side's coefficients (2 C). It is summed in one small dense matrix of 3 w,
w = 6 + 2 C, as outer products of projected strain gradients J^T ds/dx, and added to the band once.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.node_kernels import node_forces
from featherfx.mechanics.rachis_kernels import rachis_gradient
from featherfx.mechanics.rotations_kernels import cross
from featherfx.mechanics.vane_bending_kernels import hinge_gradient
from featherfx.mechanics.vane_membrane_kernels import membrane_gradient
from featherfx.solver.energy_kernels import node_index


@kernel
def _project(line, at, root, point, jacobian, gradient):
    """Add J^T gradient of a barb node to line[at : at + w]; jacobian: (3, 2 C)."""
    gx, gy, gz = gradient[0], gradient[1], gradient[2]
    line[at] += gx
    line[at + 1] += gy
    line[at + 2] += gz
    mx, my, mz = cross(
        point[0] - root[0], point[1] - root[1], point[2] - root[2], gx, gy, gz
    )
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
def _add_outer(matrix, lines, first, last, k0, k1, k2, k3):
    """matrix += sum k lines lines^T (lower part) over the index range of four lines."""
    for a in range(first, last):
        c0, c1, c2, c3 = (
            k0 * lines[0, a],
            k1 * lines[1, a],
            k2 * lines[2, a],
            k3 * lines[3, a],
        )
        for b in range(first, a + 1):
            matrix[a, b] += (
                c0 * lines[0, b] + c1 * lines[1, b] + c2 * lines[2, b] + c3 * lines[3, b]
            )


@kernel
def _add_nodes(f, i, side, columns, points, work, wide):
    """Inertia, gravity, air and grips of the barb nodes of one row and side."""
    lines = work.lines
    first, last = wide, 2 * wide
    for j in range(1, columns + 1):
        p = node_index(side, j, columns)
        rx = points[i, p, 0] - points[i, 0, 0]
        ry = points[i, p, 1] - points[i, 0, 1]
        rz = points[i, p, 2] - points[i, 0, 2]
        jacobian = work.jacobian[i, side, j - 1]
        stiff = work.stiff[i, p]
        force = work.force[i, p]
        # rows of J (3, w), then of the node's stiffness times J
        for k in range(3):
            lines[k, first : first + 6] = 0.0
            lines[k, first + k] = 1.0
            for c in range(jacobian.shape[1]):
                lines[k, first + 6 + c] = jacobian[k, c]
        lines[0, first + 4], lines[0, first + 5] = rz, -ry
        lines[1, first + 3], lines[1, first + 5] = -rz, rx
        lines[2, first + 3], lines[2, first + 4] = ry, -rx
        for a in range(first, last):
            x, y, z = lines[0, a], lines[1, a], lines[2, a]
            work.local_right[a] -= x * force[0] + y * force[1] + z * force[2]
            sx = stiff[0] * x + stiff[3] * y + stiff[4] * z
            sy = stiff[3] * x + stiff[1] * y + stiff[5] * z
            sz = stiff[4] * x + stiff[5] * y + stiff[2] * z
            for b in range(first, a + 1):
                work.local[a, b] += sx * lines[0, b] + sy * lines[1, b] + sz * lines[2, b]


@kernel
def _add_cells(model, f, i, side, columns, points, damping, work, wide, at):
    """Membrane of the cells between rows i and i + 1; at: their place in the strain vector."""
    lines, right, strains, reference = work.lines, work.local_right, work.strains, work.reference
    first, last = wide, 3 * wide
    stiffness = model.cell_stiffness[f]
    weight = work.weight
    for j in range(columns):
        if stiffness[side, i, j, 0, 0] == 0.0 and stiffness[side, i, j, 1, 0] == 0.0:
            continue
        lines[:, first:last] = 0.0
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        for half in range(2):
            for k in range(2):
                weight[2 * half + k] = stiffness[side, i, j, half, k]
            if stiffness[side, i, j, half, 0] == 0.0:
                continue
            row, other = (i, i + 1) if half == 0 else (i + 1, i)
            edge_at = wide if half == 0 else 2 * wide
            other_at = 2 * wide if half == 0 else wide
            column = j if half == 0 else j + 1
            membrane_gradient(
                points[row, near],
                points[row, far],
                points[other, near if half == 0 else far],
                model.cell_rest[f, side, i, j, half],
                work.membrane,
            )
            for k in range(2):
                line, gradient = lines[2 * half + k], work.membrane[k]
                _project_column(line, edge_at, row, side, j, points, work.jacobian, gradient[0])
                _project_column(line, edge_at, row, side, j + 1, points, work.jacobian, gradient[1])
                _project_column(
                    line, other_at, other, side, column, points, work.jacobian, gradient[2]
                )
        place = at + 4 * j
        for k in range(4):
            strain = strains[place + k]
            stress = weight[k] * (strain + damping * (strain - reference[place + k]))
            weight[k] *= 1.0 + damping
            for a in range(first, last):
                right[a] -= stress * lines[k, a]
        _add_outer(work.local, lines, first, last, weight[0], weight[1], weight[2], weight[3])


@kernel
def _add_hinges(model, f, i, side, columns, points, damping, work, wide, at):
    """Bending across barbs at the edges of row i's barb; at: place in the strain vector."""
    lines, right, strains, reference = work.lines, work.local_right, work.strains, work.reference
    weight = work.weight
    filled = 0
    for j in range(columns):
        stiffness = model.hinge_stiffness[f, side, i, j]
        if stiffness == 0.0:
            continue
        line = lines[filled]
        line[:] = 0.0
        near, far = node_index(side, j, columns), node_index(side, j + 1, columns)
        hinge_gradient(
            points[i, near], points[i, far], points[i + 1, near], points[i - 1, far], work.hinge
        )
        _project_column(line, wide, i, side, j, points, work.jacobian, work.hinge[0])
        _project_column(line, wide, i, side, j + 1, points, work.jacobian, work.hinge[1])
        _project_column(line, 2 * wide, i + 1, side, j, points, work.jacobian, work.hinge[2])
        _project_column(line, 0, i - 1, side, j + 1, points, work.jacobian, work.hinge[3])
        strain = strains[at + j]
        stress = stiffness * (strain + damping * (strain - reference[at + j]))
        for a in range(3 * wide):
            right[a] -= stress * line[a]
        weight[filled] = stiffness * (1.0 + damping)
        filled += 1
        if filled == 4:
            _add_outer(
                work.local, lines, 0, 3 * wide, weight[0], weight[1], weight[2], weight[3]
            )
            filled = 0
    if filled > 0:
        weight[filled:] = 0.0
        lines[filled:] = 0.0
        _add_outer(work.local, lines, 0, 3 * wide, weight[0], weight[1], weight[2], weight[3])


@kernel
def _scatter(i, rows, side, count, work, wide):
    """Add the local matrix and right side of row i and one side to the band."""
    row_size = 6 + 2 * count
    skip = side * count
    for block in range(3):
        row = i - 1 + block
        if row < 0 or row >= rows:
            continue
        for a in range(wide):
            to = row * row_size + a + (skip if a >= 6 else 0)
            la = block * wide + a
            work.right[to] += work.local_right[la]
            for other in range(block + 1):
                column_row = i - 1 + other
                if column_row < 0:
                    continue
                last = a + 1 if other == block else wide
                for b in range(last):
                    column = column_row * row_size + b + (skip if b >= 6 else 0)
                    work.band[column, to - column] += work.local[la, other * wide + b]


@kernel
def _add_barb(model, f, i, side, damping, work, wide, at):
    """Bending of one barb: its coefficients are its strains."""
    count = model.barb_stiffness.shape[3]
    for c in range(count):
        strain = work.strains[at + c]
        stiffness = model.barb_stiffness[f, side, i, c]
        stress = stiffness * (strain + damping * (strain - work.reference[at + c]))
        work.local[wide + 6 + c, wide + 6 + c] += stiffness * (1.0 + damping)
        work.local_right[wide + 6 + c] -= stress


@kernel
def _add_rachis_nodes(i, points, work, row_size):
    """Inertia, gravity, air and grips of row i's rachis point and directors."""
    at = i * row_size
    for k in range(3):
        work.right[at + k] -= work.force[i, 0, k]
        work.band[at + k, 0] += work.stiff[i, 0, k]
    work.band[at, 1] += work.stiff[i, 0, 3]
    work.band[at, 2] += work.stiff[i, 0, 4]
    work.band[at + 1, 1] += work.stiff[i, 0, 5]
    for p in range(1, 3):
        x, y, z = points[i, p, 0], points[i, p, 1], points[i, p, 2]
        force = work.force[i, p]
        mx, my, mz = cross(x, y, z, force[0], force[1], force[2])
        inertia = work.stiff[i, p, 0]
        work.right[at + 3] -= mx
        work.right[at + 4] -= my
        work.right[at + 5] -= mz
        work.band[at + 3, 0] += inertia * (y * y + z * z)
        work.band[at + 4, 0] += inertia * (x * x + z * z)
        work.band[at + 5, 0] += inertia * (x * x + y * y)
        work.band[at + 3, 1] -= inertia * x * y
        work.band[at + 3, 2] -= inertia * x * z
        work.band[at + 4, 1] -= inertia * y * z


@kernel
def _add_rachis_element(model, f, i, centre, damping, work, row_size):
    """Stretch, shear, twist and bending between rows i and i + 1."""
    beam = work.beam
    rachis_gradient(
        centre[i], centre[i + 1], model.length[f, i], work.halfway[i], work.rachis[i], beam
    )
    matrix = work.beam_matrix
    matrix[:] = 0.0
    for k in range(6):
        stiffness = model.rachis_stiffness[f, i, k]
        strain = work.strains[6 * i + k]
        stress = stiffness * (strain + damping * (strain - work.reference[6 * i + k]))
        weight = stiffness * (1.0 + damping)
        for a in range(12):
            to = i * row_size + a if a < 6 else (i + 1) * row_size + a - 6
            work.right[to] -= stress * beam[k, a]
            scaled = weight * beam[k, a]
            for b in range(a + 1):
                matrix[a, b] += scaled * beam[k, b]
    for a in range(12):
        to = i * row_size + a if a < 6 else (i + 1) * row_size + a - 6
        for b in range(a + 1):
            column = i * row_size + b if b < 6 else (i + 1) * row_size + b - 6
            work.band[column, to - column] += matrix[a, b]


@kernel
def _add_grips(loads, f, share, points, work):
    """Grips, added to the node forces and stiffnesses."""
    for g in range(loads.grip_stiffness.shape[1]):
        row, p = loads.grip_node[f, g, 0], loads.grip_node[f, g, 1]
        if row < 0:
            continue
        for k in range(3):
            start, end = loads.grip_start[f, g, k], loads.grip_end[f, g, k]
            gap = points[row, p, k] - start - share * (end - start)
            work.force[row, p, k] += loads.grip_stiffness[f, g] * gap
            work.stiff[row, p, k] += loads.grip_stiffness[f, g]


@kernel
def _hold_root(work, width):
    """Take the six coordinates of row 0 out of the system: their increment is zero."""
    for a in range(6):
        work.right[a] = 0.0
        work.band[a, :] = 0.0
        work.band[a, 0] = 1.0
        for b in range(a):
            work.band[b, a - b] = 0.0


@kernel
def assemble(model, loads, f, share, inertia, rate, strain_rate, centre, points, work):
    """Hessian to work.band, minus the gradient to work.right.

    work.strains, work.jacobian, work.halfway and work.rachis must belong to the pose. share: of
    the step, for the grips. inertia, rate, strain_rate: of the integrator.
    """
    rows, columns = model.mass.shape[1], model.joints.shape[3]
    count = 2 * model.shapes.shape[0]
    wide, row_size = 6 + count, 6 + 2 * count
    shaft = model.retardation[f, 0] * strain_rate
    vane = model.retardation[f, 1] * strain_rate
    work.band[:] = 0.0
    work.right[:] = 0.0
    node_forces(
        points,
        work.target,
        inertia,
        work.past,
        rate,
        model.mass[f],
        loads.gravity,
        loads.air,
        work.wind,
        work.area,
        work.speed,
        model.shaft_area[f],
        work.force,
        work.stiff,
    )
    _add_grips(loads, f, share, points, work)
    barbs_at = (rows - 1) * 6
    cells_at = barbs_at + 2 * rows * count
    hinges_at = cells_at + 2 * (rows - 1) * columns * 4
    for i in range(rows):
        _add_rachis_nodes(i, points, work, row_size)
        if i + 1 < rows:
            _add_rachis_element(model, f, i, centre, shaft, work, row_size)
        for side in range(2 if columns > 0 else 0):
            work.local[:] = 0.0
            work.local_right[:] = 0.0
            _add_nodes(f, i, side, columns, points, work, wide)
            _add_barb(model, f, i, side, vane, work, wide, barbs_at + (side * rows + i) * count)
            if i + 1 < rows:
                at = cells_at + (side * (rows - 1) + i) * columns * 4
                _add_cells(model, f, i, side, columns, points, vane, work, wide, at)
                if i > 0:
                    at = hinges_at + (side * rows + i) * columns
                    _add_hinges(model, f, i, side, columns, points, vane, work, wide, at)
            _scatter(i, rows, side, count, work, wide)
    if model.held[f]:
        _hold_root(work, row_size)
