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

LANES = 4


@kernel
def lanes(columns):
    """Length of a loop over that many cells."""
    return (columns + LANES - 1) // LANES * LANES


@kernel
def nodes_to_lines(points, lines):
    """Nodes of both barbs of every row, points (n, P, 3), to lines (n, 2, 3, .)."""
    columns = (points.shape[1] - 3) // 2
    for i in range(points.shape[0]):
        for side in range(2):
            start = 2 + side * columns
            for k in range(3):
                line = lines[i, side, k]
                line[0] = points[i, 0, k]
                for j in range(1, columns + 1):
                    line[j] = points[i, start + j, k]


@kernel
def add_lines_to_nodes(lines, force):
    """Lines (n, 2, 3, .) of forces on the nodes of all barbs, added to force (n, P, 3)."""
    columns = (force.shape[1] - 3) // 2
    for i in range(force.shape[0]):
        for side in range(2):
            start = 2 + side * columns
            for k in range(3):
                line = lines[i, side, k]
                force[i, 0, k] += line[0]
                for j in range(1, columns + 1):
                    force[i, start + j, k] += line[j]


@loop_kernel
def _membrane_axis(count, start, end, opposite, edge, slant, reach, a, b, c, d, e, f):
    """membrane_slopes of every cell; a to f: what it returns."""
    for j in range(count):
        (a[j], b[j], c[j]), (d[j], e[j], f[j]) = membrane_slopes(
            start[j], end[j], opposite[j], (edge[j], slant[j], reach[j])
        )


@kernel
def membrane_gradients(count, own, other, shift, rest, gradient):
    """Gradients of both strains of a row of triangles, to gradient (2, nodes, 3, .).

    own: (3, .) nodes of the barb that holds their edge; other: of the other barb, whose node shift
    further on is opposite. rest: (3, .) of membrane_strain.
    """
    across, shear = gradient[0], gradient[1]
    for k in range(3):
        _membrane_axis(
            count,
            own[k],
            own[k, 1:],
            other[k, shift:],
            rest[0],
            rest[1],
            rest[2],
            across[0, k],
            across[1, k],
            across[2, k],
            shear[0, k],
            shear[1, k],
            shear[2, k],
        )


@kernel
def _kept(weight, v):
    """The vector of a hinge that is there; what has no nodes may not be a number."""
    if weight == 0.0:
        return 0.0, 0.0, 0.0
    return v


@loop_kernel
def _hinges(
    count, w, x, y, z, ex, ey, ez, ux, uy, uz, vx, vy, vz, a, b, c, d, e, f, g, h, i, k, m, n
):
    """hinge_slopes of every hinge with a weight w; (x, y, z), e, u, v: nodes x_0, x_1, x_2, x_3; a
    to n: what it returns."""
    for j in range(count):
        start = x[j], y[j], z[j]
        by_start, by_end, by_above, by_below = hinge_slopes(
            sub((ex[j], ey[j], ez[j]), start),
            sub((ux[j], uy[j], uz[j]), start),
            sub((vx[j], vy[j], vz[j]), start),
        )
        a[j], b[j], c[j] = _kept(w[j], by_start)
        d[j], e[j], f[j] = _kept(w[j], by_end)
        g[j], h[j], i[j] = _kept(w[j], by_above)
        k[j], m[j], n[j] = _kept(w[j], by_below)


@kernel
def hinge_gradients(count, own, above, below, weight, gradient):
    """Gradients of the dihedral angles at a barb, to gradient (4, 3, .); zero without a weight.

    own, above, below: (3, .) nodes of the barb and its neighbours.
    """
    start, end, up, down = gradient[0], gradient[1], gradient[2], gradient[3]
    _hinges(
        count,
        weight,
        own[0],
        own[1],
        own[2],
        own[0, 1:],
        own[1, 1:],
        own[2, 1:],
        above[0],
        above[1],
        above[2],
        below[0, 1:],
        below[1, 1:],
        below[2, 1:],
        start[0],
        start[1],
        start[2],
        end[0],
        end[1],
        end[2],
        up[0],
        up[1],
        up[2],
        down[0],
        down[1],
        down[2],
    )


@loop_kernel
def _forces(count, stress, gx, gy, gz, x, y, z):
    """(x, y, z) += stress g."""
    for j in range(count):
        x[j] += stress[j] * gx[j]
        y[j] += stress[j] * gy[j]
        z[j] += stress[j] * gz[j]


@kernel
def add_forces(count, stress, gradient, shift, force):
    """force (3, .) of the node shift further on += stress (.) times gradient (3, .)."""
    _forces(
        count,
        stress,
        gradient[0],
        gradient[1],
        gradient[2],
        force[0, shift:],
        force[1, shift:],
        force[2, shift:],
    )


@loop_kernel
def _outer(count, w, ax, ay, az, bx, by, bz, xx, xy, xz, yx, yy, yz, zx, zy, zz):
    """w a b^T, added: xy is b's x times a's y."""
    for j in range(count):
        x, y, z = w[j] * bx[j], w[j] * by[j], w[j] * bz[j]
        xx[j] += x * ax[j]
        xy[j] += x * ay[j]
        xz[j] += x * az[j]
        yx[j] += y * ax[j]
        yy[j] += y * ay[j]
        yz[j] += y * az[j]
        zx[j] += z * ax[j]
        zy[j] += z * ay[j]
        zz[j] += z * az[j]


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
        left[0],
        left[1],
        left[2],
        right[0],
        right[1],
        right[2],
        block[0, shift:],
        block[0, y:],
        block[0, z:],
        block[1, shift:],
        block[1, y:],
        block[1, z:],
        block[2, shift:],
        block[2, y:],
        block[2, z:],
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
