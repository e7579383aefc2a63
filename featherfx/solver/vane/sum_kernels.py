"""Sums at the nodes of one barb of what cells and hinges around it give.

Each sum is kept in registers and written once. Of the cells and hinges of column j, which lie
between nodes j and j + 1, a node is the first (HERE); of those of the column before it is the
second. Triangle A has nodes 0 and 1 on the row below and 2 above node 0, B has 0 and 1 on the row
above and 2 below node 1; the twist's nodes are 0 and 1 below, 2 and 3 above them. A hinge on a barb
has nodes 0 and 1 on it, 2 and 3 above and below node 1.

below, above: cells of the strips on both sides of the barb. low, own, high: hinges on the barb
below, on it, and on the one above (line_kernels). Blocks are (3, 3 S), entry [m, k S + j] = K_km of
a pair of pairs_kernels.
"""

from featherfx.algebra.lanes import COUNT as LANES
from featherfx.algebra.lanes import follow, load, put, spread
from featherfx.algebra.vec3_kernels import add, scale
from featherfx.jit.compiled import loop_kernel
from featherfx.solver.vane.line_kernels import (
    AXIS,
    FOLD,
    GEOMETRIC,
    HALF,
    HINGE_STRESS,
    HINGE_WEIGHT,
    NODE,
    PAIRS,
    STRAIN,
    STRESS,
    STRIP,
    TWIST,
    TWISTED,
    WEIGHT,
    block_of,
    vectors,
)
from featherfx.solver.vane.pairs_kernels import ALONG, BACK, OWN, SKIP, SLANT, UP

# a place's cell or hinge; else how far before it the column before lies
HERE = 0


@loop_kernel
def _one(cells, at, back):
    """A number of four cells, of the place's own column (HERE) or of the column before."""
    if back == HERE:
        return load(cells, at)
    return follow(load(cells, at - back), load(cells, at))


@loop_kernel
def _vectors(cells, at, back):
    return (
        _one(cells, at, back),
        _one(cells, at + AXIS, back),
        _one(cells, at + 2 * AXIS, back),
    )


@loop_kernel
def _force(total, cells, stress, gradient, back):
    """A stress times the gradient of its strain, added."""
    return add(total, scale(_one(cells, stress, back), _vectors(cells, gradient, back)))


@loop_kernel
def _forces_of_both(total, cells, at, half, node, back):
    """As _force, of both strains of triangles A or B (half)."""
    stress, gradient = at + STRESS + 2 * AXIS * half, at + HALF * half + NODE * node
    total = _force(total, cells, stress, gradient, back)
    return _force(total, cells, stress + AXIS, gradient + STRAIN, back)


@loop_kernel
def add_forces(count, below, above, low, own, high, pull):
    """Forces on the nodes of a barb, added to pull (3, .)."""
    for j in range(0, count, LANES):
        at, to = block_of(j, STRIP), block_of(j, FOLD)
        total = _forces_of_both(vectors(pull, j), above, at, 0, 0, HERE)
        total = _forces_of_both(total, above, at, 0, 1, STRIP)
        total = _forces_of_both(total, above, at, 1, 2, STRIP)
        total = _force(total, above, at + STRESS + TWISTED, at + TWIST, HERE)
        total = _force(total, above, at + STRESS + TWISTED, at + TWIST + NODE, STRIP)
        total = _forces_of_both(total, below, at, 0, 2, HERE)
        total = _forces_of_both(total, below, at, 1, 0, HERE)
        total = _forces_of_both(total, below, at, 1, 1, STRIP)
        total = _force(total, below, at + STRESS + TWISTED, at + TWIST + 2 * NODE, HERE)
        total = _force(total, below, at + STRESS + TWISTED, at + TWIST + 3 * NODE, STRIP)
        total = _force(total, own, to + HINGE_STRESS, to, HERE)
        total = _force(total, own, to + HINGE_STRESS, to + NODE, FOLD)
        total = _force(total, low, to + HINGE_STRESS, to + 2 * NODE, FOLD)
        total = _force(total, high, to + HINGE_STRESS, to + 3 * NODE, FOLD)
        put(pull[0], j, total[0])
        put(pull[1], j, total[1])
        put(pull[2], j, total[2])


@loop_kernel
def _squares(sums, cells, weight, gradient, back):
    """weight g g^T, added to xx, yy, zz, xy, xz, yz."""
    g = _vectors(cells, gradient, back)
    x, y, z = scale(_one(cells, weight, back), g)
    return (
        sums[0] + x * g[0],
        sums[1] + y * g[1],
        sums[2] + z * g[2],
        sums[3] + x * g[1],
        sums[4] + x * g[2],
        sums[5] + y * g[2],
    )


@loop_kernel
def _squares_of_both(sums, cells, at, half, node, back):
    """As _squares, of both strains of triangles A or B (half)."""
    weight, gradient = at + WEIGHT + 2 * AXIS * half, at + HALF * half + NODE * node
    sums = _squares(sums, cells, weight, gradient, back)
    return _squares(sums, cells, weight + AXIS, gradient + STRAIN, back)


@loop_kernel
def _outers(sums, cells, weight, left, right, back):
    """weight left_k right_m, added to three vectors over k, of m = 0, 1, 2."""
    g = _vectors(cells, left, back)
    x, y, z = scale(_one(cells, weight, back), _vectors(cells, right, back))
    return add(sums[0], scale(x, g)), add(sums[1], scale(y, g)), add(sums[2], scale(z, g))


@loop_kernel
def _outers_of_both(sums, cells, at, half, pair, back):
    """As _outers, of both strains of triangles A or B (half)."""
    weight, first = at + WEIGHT + 2 * AXIS * half, at + HALF * half
    left, right = first + NODE * pair[0], first + NODE * pair[1]
    sums = _outers(sums, cells, weight, left, right, back)
    return _outers(sums, cells, weight + AXIS, left + STRAIN, right + STRAIN, back)


@loop_kernel
def _geometric(cells, at, half, pair, back):
    return _one(cells, at + GEOMETRIC + PAIRS * half + AXIS * pair, back)


@loop_kernel
def _more(line, j, value):
    put(line, j, load(line, j) + value)


@loop_kernel
def _add_block(block, j, sums, equal):
    """Sums, three vectors over k, and equal ones on the diagonal, to a block."""
    size = block.shape[1] // 3
    y, z = size + j, 2 * size + j
    (xx, yx, zx), (xy, yy, zy), (xz, yz, zz) = sums
    _more(block[0], j, xx + equal)
    _more(block[0], y, yx)
    _more(block[0], z, zx)
    _more(block[1], j, xy)
    _more(block[1], y, yy + equal)
    _more(block[1], z, zy)
    _more(block[2], j, xz)
    _more(block[2], y, yz)
    _more(block[2], z, zz + equal)


@loop_kernel
def _nothing():
    zero = spread(0.0)
    return zero, zero, zero


@loop_kernel
def _add_own(count, below, above, low, own, high, block):
    """A barb's nodes with themselves, halved."""
    for j in range(0, count, LANES):
        at, to = block_of(j, STRIP), block_of(j, FOLD)
        twist = at + WEIGHT + TWISTED
        sums = _squares_of_both((*_nothing(), *_nothing()), above, at, 0, 0, HERE)
        sums = _squares_of_both(sums, above, at, 0, 1, STRIP)
        sums = _squares_of_both(sums, above, at, 1, 2, STRIP)
        sums = _squares(sums, above, twist, at + TWIST, HERE)
        sums = _squares(sums, above, twist, at + TWIST + NODE, STRIP)
        sums = _squares_of_both(sums, below, at, 0, 2, HERE)
        sums = _squares_of_both(sums, below, at, 1, 0, HERE)
        sums = _squares_of_both(sums, below, at, 1, 1, STRIP)
        sums = _squares(sums, below, twist, at + TWIST + 2 * NODE, HERE)
        sums = _squares(sums, below, twist, at + TWIST + 3 * NODE, STRIP)
        sums = _squares(sums, own, to + HINGE_WEIGHT, to, HERE)
        sums = _squares(sums, own, to + HINGE_WEIGHT, to + NODE, FOLD)
        sums = _squares(sums, low, to + HINGE_WEIGHT, to + 2 * NODE, FOLD)
        sums = _squares(sums, high, to + HINGE_WEIGHT, to + 3 * NODE, FOLD)
        xx, yy, zz = scale(0.5, (sums[0], sums[1], sums[2]))
        xy, xz, yz = scale(0.5, (sums[3], sums[4], sums[5]))
        equal = _geometric(above, at, 0, 0, HERE) + _geometric(above, at, 0, 1, STRIP)
        equal = equal + _geometric(above, at, 1, 2, STRIP) + _geometric(below, at, 0, 2, HERE)
        equal = equal + _geometric(below, at, 1, 0, HERE) + _geometric(below, at, 1, 1, STRIP)
        _add_block(block, j, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), equal)


@loop_kernel
def _add_along(count, below, above, own, block):
    """A barb's nodes with their next ones."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP), block_of(j, FOLD), _nothing()
        twist = at + WEIGHT + TWISTED
        sums = _outers_of_both((none, none, none), above, at, 0, (0, 1), HERE)
        sums = _outers_of_both(sums, below, at, 1, (0, 1), HERE)
        sums = _outers(sums, above, twist, at + TWIST, at + TWIST + NODE, HERE)
        sums = _outers(sums, below, twist, at + TWIST + 2 * NODE, at + TWIST + 3 * NODE, HERE)
        sums = _outers(sums, own, to + HINGE_WEIGHT, to, to + NODE, HERE)
        equal = _geometric(above, at, 0, 3, HERE) + _geometric(below, at, 1, 3, HERE)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_up(count, above, own, high, block):
    """The nodes above a barb's with these."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP), block_of(j, FOLD), _nothing()
        twist = at + WEIGHT + TWISTED
        sums = _outers_of_both((none, none, none), above, at, 0, (2, 0), HERE)
        sums = _outers_of_both(sums, above, at, 1, (1, 2), STRIP)
        sums = _outers(sums, above, twist, at + TWIST + 2 * NODE, at + TWIST, HERE)
        sums = _outers(sums, above, twist, at + TWIST + 3 * NODE, at + TWIST + NODE, STRIP)
        sums = _outers(sums, own, to + HINGE_WEIGHT, to + 2 * NODE, to + NODE, FOLD)
        sums = _outers(sums, high, to + HINGE_WEIGHT, to + NODE, to + 3 * NODE, FOLD)
        equal = _geometric(above, at, 0, 4, HERE) + _geometric(above, at, 1, 5, STRIP)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_slant(count, above, high, block):
    """The nodes above a barb's with the next of these."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP), block_of(j, FOLD), _nothing()
        twist = at + WEIGHT + TWISTED
        sums = _outers_of_both((none, none, none), above, at, 0, (2, 1), HERE)
        sums = _outers_of_both(sums, above, at, 1, (0, 2), HERE)
        sums = _outers(sums, above, twist, at + TWIST + 2 * NODE, at + TWIST + NODE, HERE)
        sums = _outers(sums, high, to + HINGE_WEIGHT, to, to + 3 * NODE, HERE)
        equal = _geometric(above, at, 0, 5, HERE) + _geometric(above, at, 1, 4, HERE)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_others(count, above, own, back, skip):
    """The nodes above a barb's with the ones before these, and with those below it."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP), block_of(j, FOLD), _nothing()
        twist, nothing = at + WEIGHT + TWISTED, (none, none, none)
        sums = _outers(nothing, above, twist, at + TWIST + 3 * NODE, at + TWIST, STRIP)
        sums = _outers(sums, own, to + HINGE_WEIGHT, to + 2 * NODE, to, FOLD)
        _add_block(back, j, sums, none[0])
        sums = _outers(nothing, own, to + HINGE_WEIGHT, to + 2 * NODE, to + 3 * NODE, FOLD)
        _add_block(skip, j, sums, none[0])


@loop_kernel
def add_blocks(count, below, above, low, own, high, blocks):
    """Stiffness of all pairs of a barb, added to blocks (6, 3, 3 S)."""
    _add_own(count, below, above, low, own, high, blocks[OWN])
    _add_along(count, below, above, own, blocks[ALONG])
    _add_up(count, above, own, high, blocks[UP])
    _add_slant(count, above, high, blocks[SLANT])
    _add_others(count, above, own, blocks[BACK], blocks[SKIP])
