"""Strains and energy of a pose in the nodal kinematics.

The strains, in this order, all measured from rest: rachis (6 per element), barb stretch (1 per
segment), barb turns (2 per joint), membrane (e_ww, 2 e_vw per triangle), dihedral angles. Each has
the energy of solver/step/energy_kernels.py; the dihedral angles have it triangle by triangle
in the combinations of featherfx/lab/nodal/plate_kernels.py. Barb segments that are
inextensible add p e with the multiplier p.

Raw barb turns and dihedral angles of a nodal pose, and the width of its band.
"""

from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_kernels import (
    begin_barb,
    bend_strain,
    carried_turns,
    clamp_strain,
    stretch_strain,
)
from featherfx.lab.nodal.plate_kernels import hinge_of, hinge_turn, patch_nodes, point_of
from featherfx.mechanics.node_kernels import dead_energy, grip_energy, node_energy
from featherfx.mechanics.rachis_kernels import rachis_strain
from featherfx.mechanics.row_kernels import couple_energy, director_energy, node_index
from featherfx.mechanics.vane_bending_kernels import wrapped
from featherfx.mechanics.vane_guard_kernels import guard_total
from featherfx.solver.step.strain_kernels import cell_strains


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
def nodal_elastic_energy(model, nodal, f, strains, reference, multiplier, strain_rate):
    """Elastic energy, with the dissipation of the step, of strains (S,) (J).

    reference: (S,). multiplier: (2, n, m). strain_rate: 1/s, 0 for the elastic energy alone.
    """
    rows, columns = model.mass.shape[1], model.joints.shape[3]
    vane = model.retardation[f, 1] * strain_rate
    at, at_turns, at_cells, at_hinges = sections(rows, columns)
    total = 0.0
    for i in range(rows - 1 if nodal.has_rachis else 0):
        for k in range(6):
            total += quadratic(
                strains[6 * i + k],
                reference[6 * i + k],
                model.rachis_stiffness[f, i, k],
                model.retardation[f, 0] * strain_rate,
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
            model, nodal, f, pose.strains, around.reference, work.multiplier, factors.strain_rate
        )
        + grip_energy(loads, f, fraction, nodes)
        + dead_energy(loads, f, fraction, nodes)
        + node_energy(model, loads, f, factors, nodes, around)
        + couple_energy(loads.couple[f], directors)
        + director_energy(
            model.rotary_inertia[f], factors.inertia, directors, around.target.directors
        )
    )
