"""Rotations between knots (interpolation.py)."""

from featherfx.algebra.vector_kernels import (
    accumulate,
    conjugate,
    exponential,
    logarithm,
    matrix_into,
    multiply,
    scale,
)
from featherfx.jit.compiled import kernel


@kernel
def blend_turns(turns, weights, fraction, away, out):
    """Fill rotations (K, 3, 3) between two knots. turns: KnotTurns of K joints. weights: (2, n).
    fraction: of the second knot. away: (2, 3), scratch."""
    ends, ways = turns
    for k in range(out.shape[0]):
        away[:] = 0.0
        for end in range(2):
            for n in range(weights.shape[1]):
                accumulate(away[end], weights[end, n], ways[end, n, k])
        before = multiply(ends[0, k], exponential(away[0]))
        after = multiply(ends[1, k], exponential(away[1]))
        way = multiply(conjugate(before), after)
        if way[0] < 0.0:
            way = -way[0], -way[1], -way[2], -way[3]
        matrix_into(multiply(before, exponential(scale(fraction, logarithm(way)))), out[k])
