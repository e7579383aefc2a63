"""Sums along barbs: each loop goes from node to node over lines of numbers that lie side by side.

A line holds one number for each node of a barb, the rachis point first, or for each cell or hinge
between two of them. Loops run over a multiple of LANES; what lies beyond the barb's end is zero and
stays so. A loop that is shifted by a node may end on the first number of the line that follows in
memory, to which it adds zero.
"""

from featherfx.algebra.vec3_kernels import sub
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.vane_bending_kernels import hinge_slopes
from featherfx.mechanics.vane_membrane_kernels import membrane_slopes
from featherfx.mechanics.vane_twist_kernels import twist_slopes

LANES = 4


@kernel
def lanes(columns):
    """Length of a loop over that many cells."""
    return (columns + LANES - 1) // LANES * LANES


@kernel
def nodes_to_lines(points, lines):
    """Nodes of both barbs of every row, points (n, 1 + 2 m, 3), to lines (n, 2, 3, .)."""
    columns = points.shape[1] // 2
    for i in range(points.shape[0]):
        for side in range(2):
            start = side * columns
            for k in range(3):
                line = lines[i, side, k]
                line[0] = points[i, 0, k]
                for j in range(1, columns + 1):
                    line[j] = points[i, start + j, k]


@kernel
def add_lines_to_nodes(lines, force):
    """Lines (n, 2, 3, .) of forces on the nodes of all barbs, added to force (n, 1 + 2 m, 3)."""
    columns = force.shape[1] // 2
    for i in range(force.shape[0]):
        for side in range(2):
            start = side * columns
            for k in range(3):
                line = lines[i, side, k]
                force[i, 0, k] += line[0]
                for j in range(1, columns + 1):
                    force[i, start + j, k] += line[j]


@kernel
def _three(lines, first):
    """The lines of an array (3, .), from one of their numbers on.

    Loops get such tuples and take their numbers themselves: measured, a function in between that
    takes or puts three numbers of a tuple makes a loop over hinges four times slower.
    """
    return lines[0, first:], lines[1, first:], lines[2, first:]


@loop_kernel
def _membrane_axis(count, start, end, opposite, rest, by_across, by_shear):
    """membrane_slopes of every cell by one axis; by_across, by_shear: lines, node by node."""
    for j in range(count):
        across, shear = membrane_slopes(
            start[j], end[j], opposite[j], (rest[0][j], rest[1][j], rest[2][j])
        )
        by_across[0][j], by_across[1][j], by_across[2][j] = across
        by_shear[0][j], by_shear[1][j], by_shear[2][j] = shear


@kernel
def membrane_gradients(count, own, other, shift, rest, gradient):
    """Gradients of both strains of a row of triangles, to gradient (2, nodes, 3, .).

    own: (3, .) nodes of the barb that holds their edge; other: of the other barb, whose node shift
    further on is opposite. rest: (3, .) of membrane_strain.
    """
    across, shear, known = gradient[0], gradient[1], _three(rest, 0)
    for k in range(3):
        by_across = across[0, k], across[1, k], across[2, k]
        by_shear = shear[0, k], shear[1, k], shear[2, k]
        _membrane_axis(count, own[k], own[k, 1:], other[k, shift:], known, by_across, by_shear)


@kernel
def _kept(weight, v):
    """The vector of a hinge that is there; what has no nodes may not be a number."""
    if weight == 0.0:
        return 0.0, 0.0, 0.0
    return v


@loop_kernel
def _hinges(count, weight, start, end, above, below, gradient):
    """hinge_slopes of every hinge with a weight; start to below: lines of x_0 to x_3."""
    by_start, by_end, by_above, by_below = gradient
    for j in range(count):
        x = start[0][j], start[1][j], start[2][j]
        a, b, c, d = hinge_slopes(
            sub((end[0][j], end[1][j], end[2][j]), x),
            sub((above[0][j], above[1][j], above[2][j]), x),
            sub((below[0][j], below[1][j], below[2][j]), x),
        )
        by_start[0][j], by_start[1][j], by_start[2][j] = _kept(weight[j], a)
        by_end[0][j], by_end[1][j], by_end[2][j] = _kept(weight[j], b)
        by_above[0][j], by_above[1][j], by_above[2][j] = _kept(weight[j], c)
        by_below[0][j], by_below[1][j], by_below[2][j] = _kept(weight[j], d)


@kernel
def hinge_gradients(count, own, above, below, weight, gradient):
    """Gradients of the dihedral angles at a barb, to gradient (4, 3, .); zero without a weight.

    own, above, below: (3, .) nodes of the barb and its neighbours.
    """
    g = gradient
    by_nodes = _three(g[0], 0), _three(g[1], 0), _three(g[2], 0), _three(g[3], 0)
    start, end, up, down = _three(own, 0), _three(own, 1), _three(above, 1), _three(below, 1)
    _hinges(count, weight, start, end, up, down, by_nodes)


@loop_kernel
def _twists(count, start, end, above, beyond, gradient):
    """twist_slopes of every cell; start to beyond: lines of x_0 to x_3."""
    by_start, by_end, by_above, by_beyond = gradient
    for j in range(count):
        x = start[0][j], start[1][j], start[2][j]
        a, b, c, d = twist_slopes(
            sub((end[0][j], end[1][j], end[2][j]), x),
            sub((above[0][j], above[1][j], above[2][j]), x),
            sub((beyond[0][j], beyond[1][j], beyond[2][j]), x),
        )
        by_start[0][j], by_start[1][j], by_start[2][j] = a
        by_end[0][j], by_end[1][j], by_end[2][j] = b
        by_above[0][j], by_above[1][j], by_above[2][j] = c
        by_beyond[0][j], by_beyond[1][j], by_beyond[2][j] = d


@kernel
def twist_gradients(count, own, above, gradient):
    """Gradients of 6 V of a row of cells, to gradient (4, 3, .); own, above: (3, .) nodes of the
    barbs below and above them."""
    g = gradient
    by_nodes = _three(g[0], 0), _three(g[1], 0), _three(g[2], 0), _three(g[3], 0)
    _twists(count, _three(own, 0), _three(own, 1), _three(above, 0), _three(above, 1), by_nodes)


@loop_kernel
def _forces(count, stress, gradient, force):
    """force += stress gradient."""
    for j in range(count):
        force[0][j] += stress[j] * gradient[0][j]
        force[1][j] += stress[j] * gradient[1][j]
        force[2][j] += stress[j] * gradient[2][j]


@kernel
def add_forces(count, stress, gradient, shift, force):
    """force (3, .) of the node shift further on += stress (.) times gradient (3, .)."""
    _forces(count, stress, _three(gradient, 0), _three(force, shift))


@loop_kernel
def _outer(count, weight, left, right, x, y, z):
    """weight left right^T, added to rows x, y, z of right: y[0] is right's y times left's x."""
    for j in range(count):
        rx, ry, rz = weight[j] * right[0][j], weight[j] * right[1][j], weight[j] * right[2][j]
        x[0][j] += rx * left[0][j]
        x[1][j] += rx * left[1][j]
        x[2][j] += rx * left[2][j]
        y[0][j] += ry * left[0][j]
        y[1][j] += ry * left[1][j]
        y[2][j] += ry * left[2][j]
        z[0][j] += rz * left[0][j]
        z[1][j] += rz * left[1][j]
        z[2][j] += rz * left[2][j]


@kernel
def add_outer(count, weight, left, right, shift, block):
    """K_km += weight left_k right_m of every cell, at the node shift further on.

    weight: (.). left, right: (3, .). block: (3, 3 S), entry [m, k S + node] = K_km.
    """
    size = block.shape[1] // 3
    y, z = size + shift, 2 * size + shift
    _outer(
        count,
        weight,
        _three(left, 0),
        _three(right, 0),
        (block[0, shift:], block[0, y:], block[0, z:]),
        (block[1, shift:], block[1, y:], block[1, z:]),
        (block[2, shift:], block[2, y:], block[2, z:]),
    )


@loop_kernel
def _two_outers(count, weight, left, right, x, y, z):
    """As _outer, of two strains at once: weight: 2 lines, left, right: 6 of them."""
    for j in range(count):
        v, w = weight[0][j], weight[1][j]
        ax, ay, az = v * right[0][j], v * right[1][j], v * right[2][j]
        bx, by, bz = w * right[3][j], w * right[4][j], w * right[5][j]
        x[0][j] += ax * left[0][j] + bx * left[3][j]
        x[1][j] += ax * left[1][j] + bx * left[4][j]
        x[2][j] += ax * left[2][j] + bx * left[5][j]
        y[0][j] += ay * left[0][j] + by * left[3][j]
        y[1][j] += ay * left[1][j] + by * left[4][j]
        y[2][j] += ay * left[2][j] + by * left[5][j]
        z[0][j] += az * left[0][j] + bz * left[3][j]
        z[1][j] += az * left[1][j] + bz * left[4][j]
        z[2][j] += az * left[2][j] + bz * left[5][j]


@kernel
def add_strains_outer(count, weight, gradient, pair, shift, block):
    """add_outer of the nodes of a pair, for all strains at once.

    weight: (1 or 2 strains, .). gradient: (strains, nodes, 3, .).
    """
    left, right, size = gradient[0, pair[0]], gradient[0, pair[1]], block.shape[1] // 3
    if weight.shape[0] == 1:
        add_outer(count, weight[0], left, right, shift, block)
        return
    more_left, more_right = gradient[1, pair[0]], gradient[1, pair[1]]
    y, z = size + shift, 2 * size + shift
    _two_outers(
        count,
        (weight[0], weight[1]),
        (left[0], left[1], left[2], more_left[0], more_left[1], more_left[2]),
        (right[0], right[1], right[2], more_right[0], more_right[1], more_right[2]),
        (block[0, shift:], block[0, y:], block[0, z:]),
        (block[1, shift:], block[1, y:], block[1, z:]),
        (block[2, shift:], block[2, y:], block[2, z:]),
    )


@loop_kernel
def _diagonal(count, value, x, y, z):
    """value, added to the entries x, y, z of the diagonal."""
    for j in range(count):
        x[j] += value[j]
        y[j] += value[j]
        z[j] += value[j]


@kernel
def add_diagonal(count, value, shift, block):
    """As add_outer, of value (.) times the unit matrix."""
    size = block.shape[1] // 3
    _diagonal(
        count, value, block[0, shift:], block[1, size + shift :], block[2, 2 * size + shift :]
    )
