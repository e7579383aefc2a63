"""Sums at the nodes of one barb of what cells and hinges around it give.

Each sum is kept in registers and written once. Of the cells and hinges of column j, which lie
between nodes j and j + 1, a node is the first (_HERE); of those of the column before it is the
second. Triangle A has nodes 0 and 1 on the row below and 2 above node 0, B has 0 and 1 on the row
above and 2 below node 1; the twist's nodes are 0 and 1 below, 2 and 3 above them. A hinge on a barb
has nodes 0 and 1 on it, 2 and 3 above and below node 1.

below, above: cells of the strips on both sides of the barb. low, own, high: hinges on the barb
below, on it, and on the one above (line_kernels). Blocks are (3, 3 S), entry [m, k S + j] = K_km of
a pair of line_kernels.
"""

from featherfx.algebra.vector_kernels import add, scale
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import follow, load, put, spread
from featherfx.jit.compiled import loop_kernel
from featherfx.solver.types import (
    AXIS_SIZE,
    GEOMETRIC_PLACE,
    HALF_SIZE,
    HINGE_SIZE,
    HINGE_STRESS_PLACE,
    HINGE_WEIGHT_PLACE,
    NODE_SIZE,
    PAIR_SIZE,
    STRAIN_SIZE,
    STRESS_PLACE,
    STRIP_SIZE,
    TWIST_LANE,
    TWIST_PLACE,
    WEIGHT_PLACE,
)
from featherfx.solver.vane.line_kernels import (
    PAIR_ALONG,
    PAIR_BACK,
    PAIR_OWN,
    PAIR_SKIP,
    PAIR_SLANT,
    PAIR_UP,
    block_of,
    vectors,
)

# a place's cell or hinge; else how far before it the column before lies
_HERE = 0


@loop_kernel
def _one(cells, at, back):
    """A number of four cells, of the place's own column (_HERE) or of the column before."""
    if back == _HERE:
        return load(cells, at)
    return follow(load(cells, at - back), load(cells, at))


@loop_kernel
def _vectors(cells, at, back):
    return (
        _one(cells, at, back),
        _one(cells, at + AXIS_SIZE, back),
        _one(cells, at + 2 * AXIS_SIZE, back),
    )


@loop_kernel
def _force(total, cells, stress, gradient, back):
    """A stress times the gradient of its strain, added."""
    return add(total, scale(_one(cells, stress, back), _vectors(cells, gradient, back)))


@loop_kernel
def _forces_of_both(total, cells, at, half, node, back):
    """As _force, of both strains of triangles A or B (half)."""
    stress, gradient = (
        at + STRESS_PLACE + 2 * AXIS_SIZE * half,
        at + HALF_SIZE * half + NODE_SIZE * node,
    )
    total = _force(total, cells, stress, gradient, back)
    return _force(total, cells, stress + AXIS_SIZE, gradient + STRAIN_SIZE, back)


@loop_kernel
def add_forces(count, below, above, low, own, high, pull):
    """Forces on the nodes of a barb, added to pull (3, .)."""
    for j in range(0, count, LANES):
        at, to = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE)
        total = _forces_of_both(vectors(pull, j), above, at, 0, 0, _HERE)
        total = _forces_of_both(total, above, at, 0, 1, STRIP_SIZE)
        total = _forces_of_both(total, above, at, 1, 2, STRIP_SIZE)
        total = _force(total, above, at + STRESS_PLACE + TWIST_LANE, at + TWIST_PLACE, _HERE)
        total = _force(
            total, above, at + STRESS_PLACE + TWIST_LANE, at + TWIST_PLACE + NODE_SIZE, STRIP_SIZE
        )
        total = _forces_of_both(total, below, at, 0, 2, _HERE)
        total = _forces_of_both(total, below, at, 1, 0, _HERE)
        total = _forces_of_both(total, below, at, 1, 1, STRIP_SIZE)
        total = _force(
            total, below, at + STRESS_PLACE + TWIST_LANE, at + TWIST_PLACE + 2 * NODE_SIZE, _HERE
        )
        total = _force(
            total,
            below,
            at + STRESS_PLACE + TWIST_LANE,
            at + TWIST_PLACE + 3 * NODE_SIZE,
            STRIP_SIZE,
        )
        total = _force(total, own, to + HINGE_STRESS_PLACE, to, _HERE)
        total = _force(total, own, to + HINGE_STRESS_PLACE, to + NODE_SIZE, HINGE_SIZE)
        total = _force(total, low, to + HINGE_STRESS_PLACE, to + 2 * NODE_SIZE, HINGE_SIZE)
        total = _force(total, high, to + HINGE_STRESS_PLACE, to + 3 * NODE_SIZE, HINGE_SIZE)
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
    weight, gradient = (
        at + WEIGHT_PLACE + 2 * AXIS_SIZE * half,
        at + HALF_SIZE * half + NODE_SIZE * node,
    )
    sums = _squares(sums, cells, weight, gradient, back)
    return _squares(sums, cells, weight + AXIS_SIZE, gradient + STRAIN_SIZE, back)


@loop_kernel
def _outers(sums, cells, weight, left, right, back):
    """weight left_k right_m, added to three vectors over k, of m = 0, 1, 2."""
    g = _vectors(cells, left, back)
    x, y, z = scale(_one(cells, weight, back), _vectors(cells, right, back))
    return add(sums[0], scale(x, g)), add(sums[1], scale(y, g)), add(sums[2], scale(z, g))


@loop_kernel
def _outers_of_both(sums, cells, at, half, pair, back):
    """As _outers, of both strains of triangles A or B (half)."""
    weight, first = at + WEIGHT_PLACE + 2 * AXIS_SIZE * half, at + HALF_SIZE * half
    left, right = first + NODE_SIZE * pair[0], first + NODE_SIZE * pair[1]
    sums = _outers(sums, cells, weight, left, right, back)
    return _outers(sums, cells, weight + AXIS_SIZE, left + STRAIN_SIZE, right + STRAIN_SIZE, back)


@loop_kernel
def _geometric(cells, at, half, pair, back):
    return _one(cells, at + GEOMETRIC_PLACE + PAIR_SIZE * half + AXIS_SIZE * pair, back)


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
        at, to = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE)
        twist = at + WEIGHT_PLACE + TWIST_LANE
        sums = _squares_of_both((*_nothing(), *_nothing()), above, at, 0, 0, _HERE)
        sums = _squares_of_both(sums, above, at, 0, 1, STRIP_SIZE)
        sums = _squares_of_both(sums, above, at, 1, 2, STRIP_SIZE)
        sums = _squares(sums, above, twist, at + TWIST_PLACE, _HERE)
        sums = _squares(sums, above, twist, at + TWIST_PLACE + NODE_SIZE, STRIP_SIZE)
        sums = _squares_of_both(sums, below, at, 0, 2, _HERE)
        sums = _squares_of_both(sums, below, at, 1, 0, _HERE)
        sums = _squares_of_both(sums, below, at, 1, 1, STRIP_SIZE)
        sums = _squares(sums, below, twist, at + TWIST_PLACE + 2 * NODE_SIZE, _HERE)
        sums = _squares(sums, below, twist, at + TWIST_PLACE + 3 * NODE_SIZE, STRIP_SIZE)
        sums = _squares(sums, own, to + HINGE_WEIGHT_PLACE, to, _HERE)
        sums = _squares(sums, own, to + HINGE_WEIGHT_PLACE, to + NODE_SIZE, HINGE_SIZE)
        sums = _squares(sums, low, to + HINGE_WEIGHT_PLACE, to + 2 * NODE_SIZE, HINGE_SIZE)
        sums = _squares(sums, high, to + HINGE_WEIGHT_PLACE, to + 3 * NODE_SIZE, HINGE_SIZE)
        xx, yy, zz = scale(0.5, (sums[0], sums[1], sums[2]))
        xy, xz, yz = scale(0.5, (sums[3], sums[4], sums[5]))
        equal = _geometric(above, at, 0, 0, _HERE) + _geometric(above, at, 0, 1, STRIP_SIZE)
        equal = equal + _geometric(above, at, 1, 2, STRIP_SIZE) + _geometric(below, at, 0, 2, _HERE)
        equal = equal + _geometric(below, at, 1, 0, _HERE) + _geometric(below, at, 1, 1, STRIP_SIZE)
        _add_block(block, j, ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)), equal)


@loop_kernel
def _add_along(count, below, above, own, block):
    """A barb's nodes with their next ones."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE), _nothing()
        twist = at + WEIGHT_PLACE + TWIST_LANE
        sums = _outers_of_both((none, none, none), above, at, 0, (0, 1), _HERE)
        sums = _outers_of_both(sums, below, at, 1, (0, 1), _HERE)
        sums = _outers(sums, above, twist, at + TWIST_PLACE, at + TWIST_PLACE + NODE_SIZE, _HERE)
        sums = _outers(
            sums,
            below,
            twist,
            at + TWIST_PLACE + 2 * NODE_SIZE,
            at + TWIST_PLACE + 3 * NODE_SIZE,
            _HERE,
        )
        sums = _outers(sums, own, to + HINGE_WEIGHT_PLACE, to, to + NODE_SIZE, _HERE)
        equal = _geometric(above, at, 0, 3, _HERE) + _geometric(below, at, 1, 3, _HERE)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_up(count, above, own, high, block):
    """The nodes above a barb's with these."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE), _nothing()
        twist = at + WEIGHT_PLACE + TWIST_LANE
        sums = _outers_of_both((none, none, none), above, at, 0, (2, 0), _HERE)
        sums = _outers_of_both(sums, above, at, 1, (1, 2), STRIP_SIZE)
        sums = _outers(
            sums, above, twist, at + TWIST_PLACE + 2 * NODE_SIZE, at + TWIST_PLACE, _HERE
        )
        sums = _outers(
            sums,
            above,
            twist,
            at + TWIST_PLACE + 3 * NODE_SIZE,
            at + TWIST_PLACE + NODE_SIZE,
            STRIP_SIZE,
        )
        sums = _outers(
            sums, own, to + HINGE_WEIGHT_PLACE, to + 2 * NODE_SIZE, to + NODE_SIZE, HINGE_SIZE
        )
        sums = _outers(
            sums, high, to + HINGE_WEIGHT_PLACE, to + NODE_SIZE, to + 3 * NODE_SIZE, HINGE_SIZE
        )
        equal = _geometric(above, at, 0, 4, _HERE) + _geometric(above, at, 1, 5, STRIP_SIZE)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_slant(count, above, high, block):
    """The nodes above a barb's with the next of these."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE), _nothing()
        twist = at + WEIGHT_PLACE + TWIST_LANE
        sums = _outers_of_both((none, none, none), above, at, 0, (2, 1), _HERE)
        sums = _outers_of_both(sums, above, at, 1, (0, 2), _HERE)
        sums = _outers(
            sums,
            above,
            twist,
            at + TWIST_PLACE + 2 * NODE_SIZE,
            at + TWIST_PLACE + NODE_SIZE,
            _HERE,
        )
        sums = _outers(sums, high, to + HINGE_WEIGHT_PLACE, to, to + 3 * NODE_SIZE, _HERE)
        equal = _geometric(above, at, 0, 5, _HERE) + _geometric(above, at, 1, 4, _HERE)
        _add_block(block, j, sums, equal)


@loop_kernel
def _add_others(count, above, own, back, skip):
    """The nodes above a barb's with the ones before these, and with those below it."""
    for j in range(0, count, LANES):
        at, to, none = block_of(j, STRIP_SIZE), block_of(j, HINGE_SIZE), _nothing()
        twist, nothing = at + WEIGHT_PLACE + TWIST_LANE, (none, none, none)
        sums = _outers(
            nothing, above, twist, at + TWIST_PLACE + 3 * NODE_SIZE, at + TWIST_PLACE, STRIP_SIZE
        )
        sums = _outers(sums, own, to + HINGE_WEIGHT_PLACE, to + 2 * NODE_SIZE, to, HINGE_SIZE)
        _add_block(back, j, sums, none[0])
        sums = _outers(
            nothing,
            own,
            to + HINGE_WEIGHT_PLACE,
            to + 2 * NODE_SIZE,
            to + 3 * NODE_SIZE,
            HINGE_SIZE,
        )
        _add_block(skip, j, sums, none[0])


@loop_kernel
def add_blocks(count, below, above, low, own, high, blocks):
    """Stiffness of all pairs of a barb, added to blocks (6, 3, 3 S)."""
    _add_own(count, below, above, low, own, high, blocks[PAIR_OWN])
    _add_along(count, below, above, own, blocks[PAIR_ALONG])
    _add_up(count, above, own, high, blocks[PAIR_UP])
    _add_slant(count, above, high, blocks[PAIR_SLANT])
    _add_others(count, above, own, blocks[PAIR_BACK], blocks[PAIR_SKIP])
