"""Strains and energy of a pose in the nodal kinematics.

The strains, in this order, all measured from rest: rachis (6 per element), barb stretch (1 per
segment), barb turns (2 per joint), membrane (e_ww, 2 e_vw per triangle), dihedral angles. Each has
the energy of solver/step/energy_kernels.py; the dihedral angles have it triangle by triangle
in the combinations described below. Barb segments that are
inextensible add p e with the multiplier p.

Raw barb turns and dihedral angles of a nodal pose, and the width of its band.

Bending of a triangle by the dihedral angles at its three edges.

    W = 1/2 sum_k (m_k.(t - t0))^2           per triangle

t = (t_barb, t_diagonal, t_row) dihedral angles at the edge along the barb, at the cell's diagonal
and at the edge that runs from row to row; m_k: the rows of a 3 x 3 table made once for the rest
shape (featherfx/lab/nodal/model.py). A diagonal table gives separate hinges; a full one
gives the plate whose curvature is constant in a triangle, as measured by its neighbours' normals.

Nodes of the patch of triangle A (i,j)(i,j+1)(i+1,j): 0, 1, 2 its own; 3 across the barb edge,
4 across the diagonal, 5 across the row edge. Triangle B (i+1,j)(i+1,j+1)(i,j+1) likewise.
Hinges: kind 0 at barb edge (i,j)-(i,j+1), 1 at diagonal (i,j+1)-(i+1,j), 2 at row edge
(i,j)-(i+1,j); at j = 0 the two vanes meet, and the hinge is the leading side's.
"""

from featherfx.algebra.vector_kernels import cross, dot, length, over, scale, sub
from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_kernels import (
    begin_barb,
    bend_strain,
    carried_turns,
    clamp_strain,
    stretch_strain,
)
from featherfx.mechanics.barb_kernels import couple_energy, director_energy, node_index
from featherfx.mechanics.guard_kernels import guard_total
from featherfx.mechanics.node_kernels import dead_energy, grip_energy, node_energy
from featherfx.mechanics.rachis_kernels import rachis_strain
from featherfx.mechanics.vane_bending_kernels import hinge_angle, hinge_gradient, wrapped
from featherfx.solver.step.strain_kernels import cell_strains


@kernel
def point_of(side, column, columns):
    """Place of a barb node in its row; column 0 is the rachis, -1 the other side's first node."""
    if column < 0:
        return 1 + (1 - side) * columns
    return node_index(side, column, columns)


@kernel
def patch_nodes(side, i, j, half, columns, nodes):
    """(row, node) of the six nodes of a triangle's patch to nodes (6, 2).

    Those beyond the grid are given as row -1.
    """
    low, high, step = (i, i + 1, -1) if half == 0 else (i + 1, i, 1)
    near, far = (j, j + 1) if half == 0 else (j + 1, j)
    nodes[0, 0], nodes[0, 1] = low, point_of(side, j, columns)
    nodes[1, 0], nodes[1, 1] = low, point_of(side, j + 1, columns)
    nodes[2, 0], nodes[2, 1] = high, point_of(side, near, columns)
    nodes[3, 0], nodes[3, 1] = low + step, point_of(side, far, columns)
    nodes[4, 0], nodes[4, 1] = high, point_of(side, far, columns)
    if half == 1 and j + 1 == columns:
        nodes[5, 0], nodes[5, 1] = -1, 0
    elif half == 1:
        nodes[5, 0], nodes[5, 1] = i, point_of(side, j + 2, columns)
    elif j > 0:
        nodes[5, 0], nodes[5, 1] = i + 1, point_of(side, j - 1, columns)
    else:
        nodes[5, 0], nodes[5, 1] = i, point_of(side, -1, columns)


@kernel
def patch_hinge(side, j, half, edge):
    """Places in the patch of a hinge's four nodes: edge start and end, above, below."""
    if half == 0:
        if edge == 0:
            return 0, 1, 2, 3
        if edge == 1:
            return 1, 2, 4, 0
        if j == 0 and side == 1:
            return 0, 2, 5, 1
        return 0, 2, 1, 5
    if edge == 0:
        return 0, 1, 3, 2
    if edge == 1:
        return 2, 0, 1, 4
    return 2, 1, 5, 0


@kernel
def hinge_turn(points, kind, side, i, j):
    """Dihedral angle of one hinge of the pose points (n, 1 + 2 m, 3), rad."""
    columns = points.shape[1] // 2
    near, far = point_of(side, j, columns), point_of(side, j + 1, columns)
    low, high = points[i], points[i + 1]
    if kind == 0:
        return hinge_angle(low[near], low[far], high[near], points[i - 1, far])
    if kind == 1:
        return hinge_angle(low[far], high[near], high[far], low[near])
    if j == 0:
        return hinge_angle(low[0], high[0], low[far], low[point_of(side, -1, columns)])
    return hinge_angle(low[near], high[near], low[far], high[point_of(side, j - 1, columns)])


@kernel
def hinge_of(side, i, j, half, edge):
    """(kind, side, row, column) of the hinge at an edge of a triangle."""
    if edge == 0:
        return 0, side, i + half, j
    if edge == 1:
        return 1, side, i, j
    if half == 0 and j == 0:
        return 2, 0, i, 0
    return 2, side, i, j + half


@kernel
def patch_hinge_gradient(points, side, j, half, edge, nodes, gradient):
    """Gradient of one dihedral angle of a triangle; returns its four nodes' places in the patch.

    points: (n, 1 + 2 m, 3). nodes: (6, 2), of patch_nodes. Written: gradient (4, 3).
    """
    places = patch_hinge(side, j, half, edge)
    hinge_gradient(
        points[nodes[places[0], 0], nodes[places[0], 1]],
        points[nodes[places[1], 0], nodes[places[1], 1]],
        points[nodes[places[2], 0], nodes[places[2], 1]],
        points[nodes[places[3], 0], nodes[places[3], 1]],
        gradient,
    )
    return places


@kernel
def patch_gradient(points, side, j, half, edge, nodes, gradient, line):
    """The same, written to line (18,) of the patch; gradient: (4, 3) scratch."""
    places = patch_hinge_gradient(points, side, j, half, edge, nodes, gradient)
    for a in range(18):
        line[a] = 0.0
    for a in range(4):
        for k in range(3):
            line[3 * places[a] + k] = gradient[a, k]


@kernel
def angles_per_curvature(points, active, nodes, gradient, line, response):
    """Dihedral angles of every triangle for unit curvatures of its patch.

    points: (n, 1 + 2 m, 3) at rest. active: (3, 2, n, m) which hinges there are. Scratch: nodes
    (6, 2) int, gradient (4, 3), line (18,). Written: response (2, n-1, m, 2, 3, 3), angle by
    curvature (along the barb, across it, twist); rows of missing hinges stay as they are.
    """
    columns = active.shape[3]
    for side in range(2):
        for i in range(active.shape[2] - 1):
            for j in range(columns):
                for half in range(2):
                    patch_nodes(side, i, j, half, columns, nodes)
                    for edge in range(3):
                        kind, owner, row, column = hinge_of(side, i, j, half, edge)
                        if column >= columns or not active[kind, owner, row, column]:
                            continue
                        patch_gradient(points, side, j, half, edge, nodes, gradient, line)
                        _respond(points, nodes, line, response[side, i, j, half, edge])


@kernel
def _respond(points, nodes, line, response):
    """Change of an angle with gradient line for unit curvatures, to response (3,)."""
    o = points[nodes[0, 0], nodes[0, 1]]
    e, t = points[nodes[1, 0], nodes[1, 1]], points[nodes[2, 0], nodes[2, 1]]
    along, across = sub(e, o), sub(t, o)
    along = over(along, length(along))
    across = sub(across, scale(dot(along, across), along))
    across = over(across, length(across))
    normal = cross(along, across)
    response[:] = 0.0
    for a in range(6):
        slope = dot(line[3 * a :], normal)
        if slope == 0.0:
            continue
        offset = sub(points[nodes[a, 0], nodes[a, 1]], o)
        v, w = dot(offset, along), dot(offset, across)
        response[0] += 0.5 * slope * v * v
        response[1] += 0.5 * slope * w * w
        response[2] += slope * v * w


@kernel
def bend_nodes(side, i, j, rows, columns, nodes):
    """(row, node) of the five nodes of a barb's bend at node j >= 1, to nodes (6, 2).

    Before, node, after, above, below; the node itself stands in for a missing neighbour.
    """
    for a in range(3):
        nodes[a, 0], nodes[a, 1] = i, point_of(side, j - 1 + a, columns)
    nodes[3, 0], nodes[3, 1] = min(i + 1, rows - 1), nodes[1, 1]
    nodes[4, 0], nodes[4, 1] = max(i - 1, 0), nodes[1, 1]


@kernel
def barb_turns(rotation, points, clamp, stiffness, carried, frame, out):
    """Turns (s, b) at all joints of all barbs, joint 0 the clamp.

    rotation: (n, 4). points: (n, 1 + 2 m, 3). clamp: (2, n, 4). stiffness: (2, n, m, 2) tells which
    joints there are. carried: whether sections are carried along the barb, else they follow the
    vane. frame: (3, 3) scratch. Written: out (2 n m 2,), zero where there is no joint.
    """
    rows, columns = stiffness.shape[1], stiffness.shape[2]
    for side in range(2):
        for i in range(rows):
            up, down = min(i + 1, rows - 1), max(i - 1, 0)
            begin_barb(rotation[i], clamp[side, i], frame)
            for j in range(columns):
                s, b = 0.0, 0.0
                if stiffness[side, i, j, 0] > 0.0 or stiffness[side, i, j, 1] > 0.0:
                    before = points[i, point_of(side, j - 1 if j > 0 else 0, columns)]
                    p = point_of(side, j, columns)
                    after = points[i, point_of(side, j + 1, columns)]
                    if carried:
                        s, b = carried_turns(points[i, p], after, frame)
                    elif j == 0:
                        s, b = clamp_strain(rotation[i], clamp[side, i], before, after, frame)
                    else:
                        s, b = bend_strain(
                            before, points[i, p], after, points[up, p], points[down, p], frame
                        )
                at = 2 * ((side * rows + i) * columns + j)
                out[at], out[at + 1] = s, b


@kernel
def hinge_turns(points, active, out):
    """Dihedral angles of all hinges; active: (3, 2, n, m). Written: out (3 2 n m,)."""
    at = 0
    for kind in range(3):
        for side in range(2):
            for i in range(active.shape[2]):
                for j in range(active.shape[3]):
                    out[at] = 0.0
                    if active[kind, side, i, j]:
                        out[at] = hinge_turn(points, kind, side, i, j)
                    at += 1


@kernel
def half_bandwidth(slot, frame_slot, exists, nodes):
    """Largest distance of two unknowns that share an energy.

    slot: (n, 1 + 2 m) first unknown of each node, -1 none; frame_slot: (n,) of each frame. exists:
    (2, n-1, m, 2) which triangles there are. nodes: (6, 2) scratch.
    """
    rows, columns = slot.shape[0], exists.shape[2]
    widest = 5
    for i in range(rows - 1):
        low, high = slot[i, 0], slot[i + 1, 0]
        if frame_slot[i + 1] >= 0:
            high = frame_slot[i + 1]
        if low >= 0 and high >= 0:
            widest = max(widest, high + 2 - low)
    for side in range(2):
        for i in range(rows):
            for j in range(columns):
                if j > 0:
                    bend_nodes(side, i, j, rows, columns, nodes)
                    widest = max(widest, _spread(slot, nodes, 5))
                else:
                    first, frame = slot[i, point_of(side, 1, columns)], frame_slot[i]
                    if first >= 0 and frame >= 0:
                        widest = max(widest, abs(first - frame) + 2)
                for half in range(2 if i + 1 < rows else 0):
                    if exists[side, i, j, half]:
                        patch_nodes(side, i, j, half, columns, nodes)
                        widest = max(widest, _spread(slot, nodes, 6))
    return widest


@kernel
def _spread(slot, nodes, count):
    """Distance from the first to the last unknown of some nodes."""
    first, last = 1 << 60, -1
    for a in range(count):
        row = nodes[a, 0]
        if row < 0 or row >= slot.shape[0]:
            continue
        at = slot[row, nodes[a, 1]]
        if at >= 0:
            first, last = min(first, at), max(last, at + 2)
    return last - first if last >= 0 else 0


@kernel
def quadratic(strain, reference, stiffness, damping):
    """1/2 k (s^2 + q (s - s_r)^2)."""
    rate = strain - reference
    return 0.5 * stiffness * (strain * strain + damping * rate * rate)


@kernel
def sections(rows, columns):
    """Return the first indices of stretch, turns, membrane and hinges in a strain vector."""
    stretch = 6 * (rows - 1)
    turns = stretch + 2 * rows * columns
    cells = turns + 4 * rows * columns
    return stretch, turns, cells, cells + 8 * (rows - 1) * columns


@kernel
def nodal_strains(model, nodal, f, pose, frame):
    """All strains of feather f's pose from its points and frames, in place; frame: scratch."""
    points, strains = pose.points.nodes, pose.strains
    rows, columns = points.shape[0], model.joints.shape[3]
    at_stretch, at_turns, at_cells, at_hinges = sections(rows, columns)
    for i in range(rows - 1 if nodal.has_rachis else 0):
        rachis_strain(
            pose.rotation[i],
            pose.rotation[i + 1],
            points[i, 0],
            points[i + 1, 0],
            model.length[f, i],
            pose.halfway[i],
            pose.rachis[i],
        )
        for k in range(6):
            strains[6 * i + k] = pose.rachis[i, k] - model.rachis_rest[f, i, k]
    at = at_stretch
    for side in range(2):
        for i in range(rows):
            for j in range(columns):
                strains[at] = 0.0
                if nodal.stretch_stiffness[f, side, i, j] > 0.0:
                    strains[at] = stretch_strain(
                        points[i, node_index(side, j, columns)],
                        points[i, node_index(side, j + 1, columns)],
                        nodal.stretch_inverse[f, side, i, j],
                    )
                at += 1
    barb_turns(
        pose.rotation,
        points,
        model.clamp[f],
        nodal.bend_stiffness[f],
        nodal.carried,
        frame,
        strains[at_turns:at_cells],
    )
    rest = nodal.bend_rest[f].flat
    for a in range(at_cells - at_turns):
        strains[at_turns + a] -= rest[a]
    cells = shaped(strains[at_cells:at_hinges], (2, rows - 1, columns, 2, 2))
    cell_strains(model, f, points, cells)
    hinge_turns(points, nodal.hinge_active[f], strains[at_hinges:])
    rest = nodal.hinge_rest[f].flat
    for a in range(strains.shape[0] - at_hinges):
        strains[at_hinges + a] = wrapped(strains[at_hinges + a] - rest[a])


@kernel
def hinge_index(kind, side, i, j, rows, columns):
    """Place of a hinge among the dihedral angles."""
    return ((kind * 2 + side) * rows + i) * columns + j


@kernel
def _plate_energy(plate, angles, reference, rows, damping):
    """Energy of the dihedral angles; plate: (2, n-1, m, 2, 3, 3), angles, reference: (6 n m,)."""
    columns = plate.shape[2]
    total = 0.0
    for side in range(2):
        for i in range(plate.shape[1]):
            for j in range(columns):
                for half in range(2):
                    table = plate[side, i, j, half]
                    for k in range(3):
                        value, before = 0.0, 0.0
                        for edge in range(3):
                            if table[k, edge] != 0.0:
                                kind, owner, row, column = hinge_of(side, i, j, half, edge)
                                at = hinge_index(kind, owner, row, column, rows, columns)
                                value += table[k, edge] * angles[at]
                                before += table[k, edge] * reference[at]
                        total += quadratic(value, before, 1.0, damping)
    return total


@kernel
def nodal_elastic_energy(model, nodal, f, strains, reference, multiplier, damping):
    """Elastic energy, with the dissipation of the step, of strains (S,) (J).

    reference: (S,). multiplier: (2, n, m). damping: of rachis and vane.
    """
    rows, columns = model.mass.shape[1], model.joints.shape[3]
    rachis, vane = damping
    at, at_turns, at_cells, at_hinges = sections(rows, columns)
    total = 0.0
    for i in range(rows - 1 if nodal.has_rachis else 0):
        for k in range(6):
            total += quadratic(
                strains[6 * i + k], reference[6 * i + k], model.rachis_stiffness[f, i, k], rachis
            )
    stretch, price = nodal.stretch_stiffness[f].flat, multiplier.flat
    for a in range(at_turns - at):
        total += quadratic(strains[at + a], reference[at + a], stretch[a], vane)
        total += price[a] * strains[at + a]
    bend = nodal.bend_stiffness[f].flat
    for a in range(at_cells - at_turns):
        total += quadratic(strains[at_turns + a], reference[at_turns + a], bend[a], vane)
    cells = model.cell_stiffness[f].flat
    for a in range(at_hinges - at_cells):
        total += quadratic(strains[at_cells + a], reference[at_cells + a], cells[a], vane)
    total += guard_total(model.cell_guard[f], strains[at_cells:])
    return total + _plate_energy(
        nodal.plate[f], strains[at_hinges:], reference[at_hinges:], rows, vane
    )


@kernel
def nodal_step_energy(model, nodal, loads, f, fraction, factors, pose, work):
    """Energy that an implicit step minimises, of a pose whose strains are known (J).

    factors: of the integrator. fraction: of the frame, for the grips.
    """
    around, nodes, directors = work.around, pose.points.nodes, pose.points.directors
    return (
        nodal_elastic_energy(
            model,
            nodal,
            f,
            pose.strains,
            around.reference,
            work.multiplier,
            (factors.rachis_damping, factors.vane_damping),
        )
        + grip_energy(loads, f, fraction, nodes)
        + dead_energy(loads, f, fraction, nodes)
        + node_energy(model, loads, f, factors, nodes, around)
        + couple_energy(loads.couple[f], directors)
        + director_energy(
            model.rotary_inertia[f], factors.inertia, directors, around.target.directors
        )
    )
