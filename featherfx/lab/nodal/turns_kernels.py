"""Raw barb turns and dihedral angles of a nodal pose, and the width of its band."""

from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.barb_bending_kernels import bend_strain, clamp_strain
from featherfx.lab.nodal.barb_carried_kernels import begin_barb, carried_turns
from featherfx.lab.nodal.plate_kernels import hinge_turn, patch_nodes, point_of


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
