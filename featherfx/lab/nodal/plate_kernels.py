"""Bending of a triangle by the dihedral angles at its three edges.

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
from featherfx.jit.compiled import kernel
from featherfx.mechanics.row_kernels import node_index
from featherfx.mechanics.vane_bending_kernels import hinge_angle, hinge_gradient


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
