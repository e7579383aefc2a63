"""Barbs as long as they are at rest, along the way that they were carried to.

A barb is a chain of pieces e from its root on. Each keeps its direction and gets its length at
rest, L:

    f e,    f = L / |e|,    a = e . e' / e . e,    b = (e' . e' + e . e'') / e . e
    (f e)'  = f (e' - a e)
    (f e)'' = f (e'' - 2 a e' + (3 a^2 - b) e)

so that positions and rates belong together. Pieces that are off by more than _MAX_STRETCH times, as
of barbs that lie against each other, are scaled by that alone.
"""

from math import sqrt

from featherfx.algebra.vec3_kernels import add, combined, dot, scale, store, sub
from featherfx.jit.compiled import kernel

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
