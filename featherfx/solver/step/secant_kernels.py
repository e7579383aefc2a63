"""Solve with the factor of an earlier matrix, corrected by what the steps since then have shown.

A step s after which the gradient has changed by y tells the true matrix H along s: H s = y. The
inverse of the earlier matrix A, corrected so that it agrees with all steps since, is that of BFGS.
It is applied by two loops over the pairs (s, y), with A^-1 between them:

    a_i = s_i.x / s_i.y_i,    x := x - a_i y_i                  newest pair first
    x := A^-1 x
    x := x + (a_i - y_i.x / s_i.y_i) s_i                        oldest pair first

Source: Nocedal 1980. Every s.y must be positive; then the corrected matrix is definite if A is.

secants: (MAX_SECANT_PAIRS, 3, N), of each pair s, y, and in the third row a and s.y.
"""

from featherfx.algebra.array_kernels import add_scaled, copy_values, product
from featherfx.jit.compiled import kernel
from featherfx.solver.step.banded_kernels import solve_factored

MAX_SECANT_PAIRS = 6
_STEP, _CHANGE, _SUMS = 0, 1, 2


@kernel
def begin_pair(pair, right, secants):
    """Keep minus the gradient (N,) where a step begins."""
    copy_values(right, secants[pair, _CHANGE])


@kernel
def store_step(pair, step, secants):
    """Keep the step (N,) itself."""
    copy_values(step, secants[pair, _STEP])


@kernel
def end_pair(pair, right, secants):
    """Complete a pair by minus the gradient (N,) where the step has led; returns s.y > 0."""
    change = secants[pair, _CHANGE]
    for k in range(right.shape[0]):
        change[k] -= right[k]
    work = product(secants[pair, _STEP], change)
    secants[pair, _SUMS, 1] = work
    return work > 0.0


@kernel
def solve_corrected(band, count, secants, x):
    """As banded_kernels.solve_factored, corrected by the first count pairs."""
    for back in range(count):
        pair = secants[count - 1 - back]
        pair[_SUMS, 0] = product(pair[_STEP], x) / pair[_SUMS, 1]
        add_scaled(-pair[_SUMS, 0], pair[_CHANGE], x)
    solve_factored(band, x)
    for i in range(count):
        pair = secants[i]
        factor = pair[_SUMS, 0] - product(pair[_CHANGE], x) / pair[_SUMS, 1]
        add_scaled(factor, pair[_STEP], x)
