"""Pairs of nodes that a vane couples, and kinds of their stiffness.

Lines along barbs, and what cells and hinges write to them: four neighbours at a time (lanes).

A line holds one number for each node of a barb, the rachis point first, or for each cell or hinge
between two of them. Loops run over a multiple of LANES; what lies beyond the barb's end is zero and
stays so. All that is found of LANES cells or hinges lies together, number by number, and so do the
next ones after it, so that every place is known when kernels are compiled.
"""

from featherfx.algebra.vector_kernels import sub
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import load, put, where_there
from featherfx.jit.compiled import kernel, loop_kernel
from featherfx.mechanics.vane_bending_kernels import hinge_slopes, twist_slopes
from featherfx.mechanics.vane_membrane_kernels import membrane_slopes
from featherfx.solver.types import (
    AXIS_SIZE,
    HALF_SIZE,
    HINGE_SIZE,
    HINGE_WEIGHT_PLACE,
    NODE_SIZE,
    STRAIN_SIZE,
    STRIP_SIZE,
    TWIST_PLACE,
)

# blocks K(p, q) of row i and column j: p, q =
# (i, j), (i, j), halved; (i, j), (i, j+1); (i+1, j), (i, j); (i+1, j), (i, j+1);
# (i+1, j), (i, j-1); (i+1, j), (i-1, j)
PAIR_OWN, PAIR_ALONG, PAIR_UP, PAIR_SLANT, PAIR_BACK, PAIR_SKIP = 0, 1, 2, 3, 4, 5


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
def block_of(j, size):
    """Return where the block of cell j begins, of blocks of so many numbers; one of zeros comes
    first."""
    return (j // LANES + 1) * size


@kernel
def place_of(j, size):
    """As block_of, of the first number of cell j itself."""
    return block_of(j, size) + j % LANES


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


@loop_kernel
def vectors(lines, j):
    """The vectors of four nodes from j on, of lines (3, .)."""
    return load(lines[0], j), load(lines[1], j), load(lines[2], j)


@loop_kernel
def _put_vectors(cells, at, value):
    put(cells, at, value[0])
    put(cells, at + AXIS_SIZE, value[1])
    put(cells, at + 2 * AXIS_SIZE, value[2])


@loop_kernel
def _membrane_axis(count, start, end, opposite, rest, first, cells):
    """membrane_slopes of every cell by one axis, to the cells of a strip, from place first on."""
    for j in range(0, count, LANES):
        across, shear = membrane_slopes(
            load(start, j), load(end, j), load(opposite, j), vectors(rest, j)
        )
        at = block_of(j, STRIP_SIZE) + first
        put(cells, at, across[0])
        put(cells, at + NODE_SIZE, across[1])
        put(cells, at + 2 * NODE_SIZE, across[2])
        put(cells, at + STRAIN_SIZE, shear[0])
        put(cells, at + STRAIN_SIZE + NODE_SIZE, shear[1])
        put(cells, at + STRAIN_SIZE + 2 * NODE_SIZE, shear[2])


@loop_kernel
def membrane_gradients(count, own, other, half, rest, cells):
    """Gradients of both strains of a row of triangles A or B (half), to the cells of a strip.

    own: (3, .) nodes of the barb that holds their edge; other: of the other barb, whose node half
    further on is opposite. rest: (3, .) of membrane_strain.
    """
    for k in range(3):
        first = HALF_SIZE * half + AXIS_SIZE * k
        _membrane_axis(count, own[k], own[k, 1:], other[k, half:], rest, first, cells)


@kernel
def _kept(weight, v):
    """The vectors of hinges that are there; what has no nodes may not be a number."""
    return where_there(weight, v[0]), where_there(weight, v[1]), where_there(weight, v[2])


@loop_kernel
def hinge_gradients(count, own, above, below, hinges):
    """Gradients of the dihedral angles at a barb, to its hinges; zero without a stiffness.

    own, above, below: (3, .) nodes of the barb and its neighbours.
    """
    for j in range(0, count, LANES):
        x, at = vectors(own, j), block_of(j, HINGE_SIZE)
        there = load(hinges, at + HINGE_WEIGHT_PLACE)
        a, b, c, d = hinge_slopes(
            sub(vectors(own, j + 1), x),
            sub(vectors(above, j + 1), x),
            sub(vectors(below, j + 1), x),
        )
        _put_vectors(hinges, at, _kept(there, a))
        _put_vectors(hinges, at + NODE_SIZE, _kept(there, b))
        _put_vectors(hinges, at + 2 * NODE_SIZE, _kept(there, c))
        _put_vectors(hinges, at + 3 * NODE_SIZE, _kept(there, d))


@loop_kernel
def twist_gradients(count, own, above, cells):
    """Gradients of 6 V of a row of cells, to the cells of a strip; own, above: (3, .) nodes of the
    barbs below and above them."""
    for j in range(0, count, LANES):
        x, at = vectors(own, j), block_of(j, STRIP_SIZE) + TWIST_PLACE
        a, b, c, d = twist_slopes(
            sub(vectors(own, j + 1), x), sub(vectors(above, j), x), sub(vectors(above, j + 1), x)
        )
        _put_vectors(cells, at, a)
        _put_vectors(cells, at + NODE_SIZE, b)
        _put_vectors(cells, at + 2 * NODE_SIZE, c)
        _put_vectors(cells, at + 3 * NODE_SIZE, d)


@loop_kernel
def add_outer(count, weight, left, right, shift, block):
    """K_km += weight left_k right_m of every cell, at the node shift further on.

    weight: (.). left, right: (3, .). block: (3, 3 S), entry [m, k S + node] = K_km.
    """
    size = block.shape[1] // 3
    for j in range(0, count, LANES):
        w, x = load(weight, j), vectors(left, j)
        for m in range(3):
            scaled, line = w * load(right[m], j), block[m, shift:]
            for k in range(3):
                put(line, k * size + j, load(line, k * size + j) + scaled * x[k])
