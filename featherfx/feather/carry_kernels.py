"""Points of a grid and their rates carried to another one, its barbs as long as at rest.

A barb is a chain of pieces e from its root on. Each keeps its direction and gets its length at
rest, L:

    f e,    f = L / |e|,    a = e . e' / e . e,    b = (e' . e' + e . e'') / e . e
    (f e)'  = f (e' - a e)
    (f e)'' = f (e'' - 2 a e' + (3 a^2 - b) e)

so that positions and rates belong together. Pieces that are off by more than _MAX_STRETCH times, as
of barbs that lie against each other, are scaled by that alone.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    combined,
    cross,
    dot,
    scale,
    store,
    sub,
)
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import lane, load, shaped, spread, viewed
from featherfx.feather.types import MovingPoints, RowPoints
from featherfx.jit.compiled import kernel, loop_kernel

_MAX_STRETCH = 4.0


@kernel
def keep_lengths(pieces, nodes, rates, seconds):
    """Give the barbs of a feather their lengths, in place.

    pieces: (n, 2 m) m, at rest. nodes: (n, 1 + 2 m, 3) m, rates, seconds: of them, per second and
    per second squared.
    """
    columns = pieces.shape[1] // 2
    for i in range(pieces.shape[0]):
        for side in range(2):
            before = after = nodes[i, 0, 0], nodes[i, 0, 1], nodes[i, 0, 2]
            before1 = after1 = rates[i, 0, 0], rates[i, 0, 1], rates[i, 0, 2]
            before2 = after2 = seconds[i, 0, 0], seconds[i, 0, 1], seconds[i, 0, 2]
            for j in range(1 + side * columns, 1 + (side + 1) * columns):
                now = nodes[i, j, 0], nodes[i, j, 1], nodes[i, j, 2]
                now1 = rates[i, j, 0], rates[i, j, 1], rates[i, j, 2]
                now2 = seconds[i, j, 0], seconds[i, j, 1], seconds[i, j, 2]
                e, e1, e2 = sub(now, before), sub(now1, before1), sub(now2, before2)
                before, before1, before2 = now, now1, now2
                length, square = pieces[i, j - 1], dot(e, e)
                if length > 0.0 and square > 0.0:
                    f = length / sqrt(square)
                    if f < _MAX_STRETCH and f > 1.0 / _MAX_STRETCH:
                        a, b = dot(e, e1) / square, (dot(e1, e1) + dot(e, e2)) / square
                        e2 = combined(1.0, combined(1.0, e2, -2.0 * a, e1), 3.0 * a * a - b, e)
                        e1 = combined(1.0, e1, -a, e)
                    f = min(max(f, 1.0 / _MAX_STRETCH), _MAX_STRETCH)
                    e, e1, e2 = scale(f, e), scale(f, e1), scale(f, e2)
                after, after1, after2 = add(after, e), add(after1, e1), add(after2, e2)
                store(nodes[i, j], after)
                store(rates[i, j], after1)
                store(seconds[i, j], after2)


@kernel
def _put_in_lines(values, part, first, lines):
    """Vectors values (n, p, 3) as a part of lines (K, LINE_WIDTH) from first on."""
    count = values.shape[1]
    for i in range(values.shape[0]):
        for p in range(count):
            for k in range(3):
                lines[first + i * count + p, part * LANES + k] = values[i, p, k]


@kernel
def _put_points(nodes, directors, part, lines):
    _put_in_lines(nodes, part, 0, lines)
    _put_in_lines(directors, part, nodes.shape[0] * nodes.shape[1], lines)


@loop_kernel
def _multiply(weights, columns, first, lines, points, velocities, accelerations):
    """Rows of a map times lines (K, LINE_WIDTH), to flat arrays of vectors."""
    for r in range(first.shape[0] - 1):
        x, v, a = spread(0.0), spread(0.0), spread(0.0)
        for k in range(first[r], first[r + 1]):
            weight, line = weights[k], lines[columns[k]]
            x = x + weight * load(line, 0)
            v = v + weight * load(line, LANES)
            a = a + weight * load(line, 2 * LANES)
        for k in range(3):
            points[3 * r + k] = lane(x, k)
            velocities[3 * r + k] = lane(v, k)
            accelerations[3 * r + k] = lane(a, k)


@kernel
def _carry_part(rows, lines, points, velocities, accelerations):
    size = (points.size,)
    flat = shaped(points, size), shaped(velocities, size), shaped(accelerations, size)
    _multiply(rows.weights, rows.columns, rows.first, lines, flat[0], flat[1], flat[2])


@kernel
def _row_frame(directors, i):
    """Directors d2 and d3 of a row as tuples."""
    b, c = directors[i, 0], directors[i, 1]
    return (b[0], b[1], b[2]), (c[0], c[1], c[2])


@kernel
def _put_detail(array, parts, d1, d2, d3):
    """Add parts of three axes to a vector, in place."""
    accumulate(array, parts[0], d1)
    accumulate(array, parts[1], d2)
    accumulate(array, parts[2], d3)


@kernel
def _put_on(parts, i, points, d1, d2, d3):
    """Add a row's detail to its nodes and directors, or to their rates."""
    _put_detail(points.nodes[i, 0], parts[0], d1, d2, d3)
    _put_detail(points.directors[i, 0], parts[1], d1, d2, d3)
    _put_detail(points.directors[i, 1], parts[2], d1, d2, d3)
    for k in range(1, points.nodes.shape[1]):
        _put_detail(points.nodes[i, k], parts[2 + k], d1, d2, d3)


@kernel
def _add_detail(detail, found):
    """Add what a rest shape has besides, carried by the frames of the rows: d2, d3 and d2 x d3."""
    for i in range(detail.shape[0]):
        b, c = _row_frame(found.points.directors, i)
        b1, c1 = _row_frame(found.velocities.directors, i)
        b2, c2 = _row_frame(found.accelerations.directors, i)
        a1 = add(cross(b1, c), cross(b, c1))
        a2 = add(combined(1.0, cross(b2, c), 2.0, cross(b1, c1)), cross(b, c2))
        _put_on(detail[i], i, found.points, cross(b, c), b, c)
        _put_on(detail[i], i, found.velocities, a1, b1, c1)
        _put_on(detail[i], i, found.accelerations, a2, b2, c2)


@kernel
def carry_feather(way, moving, lines, found):
    """Carry points and rates of a feather to another grid, its barbs as long as at rest.

    way: RowMapArrays. lines: (K, LINE_WIDTH) scratch, zero, K nodes and directors. found:
    MovingPoints, written.
    """
    at, rate, second = moving.points, moving.velocities, moving.accelerations
    _put_points(at.nodes, at.directors, 0, lines)
    _put_points(rate.nodes, rate.directors, 1, lines)
    _put_points(second.nodes, second.directors, 2, lines)
    at, rate, second = found.points, found.velocities, found.accelerations
    _carry_part(way.nodes, lines, at.nodes, rate.nodes, second.nodes)
    _carry_part(way.directors, lines, at.directors, rate.directors, second.directors)
    _add_detail(way.detail, found)
    keep_lengths(way.pieces, at.nodes, rate.nodes, second.nodes)


@kernel
def _one_of(points, f):
    return RowPoints(points.nodes[f], points.directors[f])


@kernel
def _moving_of(moving, f):
    return MovingPoints(
        _one_of(moving.points, f), _one_of(moving.velocities, f), _one_of(moving.accelerations, f)
    )


@kernel
def carry_feathers(ways, feathers, moving, lines, found):
    """As carry, of some feathers (K,) of a batch: each its own way of ways (Views), and to place
    after place of found."""
    for k in range(feathers.shape[0]):
        f = feathers[k]
        carry_feather(viewed(ways, f), _moving_of(moving, f), lines, _moving_of(found, k))
