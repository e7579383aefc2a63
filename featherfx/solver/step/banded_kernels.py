"""Symmetric banded systems: Cholesky factor, secant corrections, and lowest mode.

Storage: band (N, B + 1), band[j, d] = A[j + d, j], so that the column below the diagonal is
contiguous; entries beyond the last row are zero. Columns are eliminated in blocks: a block is
copied to a panel that lines its columns up row by row, factored there, copied back, and taken from
every later column in one pass, two columns at a time, so that an entry is read and written once for
the whole block. Rows are taken four by four (lanes); what lies beyond a column's end gets zeros
subtracted.

A step s after which the gradient has changed by y tells the true matrix H along s: H s = y. The
inverse of the earlier matrix A, corrected so that it agrees with all steps since, is that of BFGS.
It is applied by two loops over the pairs (s, y), with A^-1 between them:

    a_i = s_i.x / s_i.y_i,    x := x - a_i y_i                  newest pair first
    x := A^-1 x
    x := x + (a_i - y_i.x / s_i.y_i) s_i                        oldest pair first

Source: Nocedal 1980. Every s.y must be positive; then the corrected matrix is definite if A is.

secants: (MAX_SECANT_PAIRS, 3, N), of each pair s, y, and in the third row a and s.y.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import add_scaled, copy_values, product
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import load, put, shaped, spread
from featherfx.jit.compiled import kernel, loop_kernel, shared_kernel
from featherfx.solver.types import BLOCK


@loop_kernel
def _line_up(band, start, count, panel):
    """panel[s, r] = entry of column start + s in row start + r; zero beyond it."""
    width = band.shape[1]
    for s in range(count):
        panel[s, :s] = 0.0
        for d in range(width):
            panel[s, s + d] = band[start + s, d]
        for r in range(s + width, panel.shape[1]):
            panel[s, r] = 0.0
    for s in range(count, BLOCK):
        panel[s, :] = 0.0


@loop_kernel
def _put_back(panel, start, count, band):
    for s in range(count):
        for d in range(band.shape[1]):
            band[start + s, d] = panel[s, s + d]


@loop_kernel
def _take(other, column, factor, begin, end):
    """Entries begin to end of a column, taken from another as often as factor says."""
    for r in range(begin // LANES * LANES, end, LANES):
        put(other, r, load(other, r) - factor * load(column, r))


@kernel
def _eliminate(panel, count, end):
    """Factor count columns by themselves, end entries of each; returns False if a pivot is not
    positive. Entries above the diagonal are not kept."""
    for s in range(count):
        column = panel[s]
        if not column[s] > 0.0:
            return False
        scale = 1.0 / sqrt(column[s])
        for r in range(s // LANES * LANES, end, LANES):
            put(column, r, scale * load(column, r))
        for t in range(s + 1, count):
            _take(panel[t], column, column[t], t, end)
    return True


@loop_kernel
def _column(panel, t):
    """Entries t of all columns, each four times."""
    return (
        (spread(panel[0, t]), spread(panel[1, t]), spread(panel[2, t]), spread(panel[3, t])),
        (spread(panel[4, t]), spread(panel[5, t]), spread(panel[6, t]), spread(panel[7, t])),
    )


@loop_kernel
def _eight(panel, r):
    """Four rows from r on, of all columns."""
    return (
        (load(panel[0], r), load(panel[1], r), load(panel[2], r), load(panel[3], r)),
        (load(panel[4], r), load(panel[5], r), load(panel[6], r), load(panel[7], r)),
    )


@loop_kernel
def _product(a, b):
    """Sum of the products of eight pairs."""
    (p, q, r, s), (t, u, v, w) = a
    first = (p * b[0][0] + q * b[0][1]) + (r * b[0][2] + s * b[0][3])
    return first + ((t * b[1][0] + u * b[1][1]) + (v * b[1][2] + w * b[1][3]))


@loop_kernel
def _subtract(panel, count, end, flat, width):
    """Take a block from the count columns after it, down to row end; flat: what is left of the
    band, as (.,).

    column[r - t] -= sum_s panel[s, t] panel[s, r] for the column of row t.
    """
    for t in range(BLOCK, BLOCK + count, 2):
        a, b = _column(panel, t), _column(panel, t + 1)
        column, next_one = (t - BLOCK) * width - t, (t + 1 - BLOCK) * width - t - 1
        square = 0.0
        for s in range(BLOCK):
            square += panel[s, t] * panel[s, t]
        flat[column + t] -= square
        if t + 1 == BLOCK + count:
            for r in range(t + 1, end, LANES):
                lines = _eight(panel, r)
                put(flat, column + r, load(flat, column + r) - _product(a, lines))
            return
        for r in range(t + 1, end, LANES):
            lines = _eight(panel, r)
            put(flat, column + r, load(flat, column + r) - _product(a, lines))
            put(flat, next_one + r, load(flat, next_one + r) - _product(b, lines))


@kernel
def _factorise_narrow(band):
    """As factorise, of a band with fewer diagonals than lanes."""
    size, width = band.shape
    for j in range(size):
        if not band[j, 0] > 0.0:
            return False
        scale = 1.0 / sqrt(band[j, 0])
        for d in range(width):
            band[j, d] *= scale
        for t in range(1, min(width, size - j)):
            for d in range(t, width):
                band[j + t, d - t] -= band[j, t] * band[j, d]
    return True


@shared_kernel(bool)
def factorise(band, panel):
    """Factor band in place; returns False if the matrix is not positive definite.

    panel: scratch of panel_shape(B + 1).
    """
    size, width = band.shape
    if width < LANES:
        return _factorise_narrow(band)
    flat = shaped(band, (band.size,))
    for start in range(0, size, BLOCK):
        count = min(BLOCK, size - start)
        _line_up(band, start, count, panel)
        if not _eliminate(panel, count, min(count + width - 1, size - start)):
            return False
        _put_back(panel, start, count, band)
        below = start + BLOCK
        if below < size:
            after, end = min(width - 1, size - below), min(BLOCK + width - 1, size - start)
            _subtract(panel, after, end, flat[below * width :], width)
    return True


@kernel
def _forward(band, j, x):
    """Take columns j to j + 3 out of the rows after them."""
    size, width = band.shape
    a, b, c, d = band[j], band[j + 1], band[j + 2], band[j + 3]
    p = x[j] / a[0]
    q = (x[j + 1] - a[1] * p) / b[0]
    r = (x[j + 2] - a[2] * p - b[1] * q) / c[0]
    s = (x[j + 3] - a[3] * p - b[2] * q - c[1] * r) / d[0]
    x[j], x[j + 1], x[j + 2], x[j + 3] = p, q, r, s
    rest, e, f, g, h = x[j + 4 :], a[4:], b[3:], c[2:], d[1:]
    count = min(width - 4, size - j - 4)
    for k in range(count):
        rest[k] -= (e[k] * p + f[k] * q) + (g[k] * r + h[k] * s)
    for k in range(count, min(width - 1, size - j - 4)):
        value = h[k] * s
        if k < width - 2:
            value += g[k] * r
        if k < width - 3:
            value += f[k] * q
        rest[k] -= value


@kernel
def _backward(band, j, x):
    """Solve for rows j to j + 3 from those after them."""
    size, width = band.shape
    a, b, c, d = band[j], band[j + 1], band[j + 2], band[j + 3]
    rest, e, f, g, h = x[j + 4 :], a[4:], b[3:], c[2:], d[1:]
    p, q, r, s = 0.0, 0.0, 0.0, 0.0
    count = min(width - 4, size - j - 4)
    for k in range(count):
        value = rest[k]
        p += e[k] * value
        q += f[k] * value
        r += g[k] * value
        s += h[k] * value
    for k in range(count, min(width - 1, size - j - 4)):
        s += h[k] * rest[k]
        if k < width - 2:
            r += g[k] * rest[k]
        if k < width - 3:
            q += f[k] * rest[k]
    s = (x[j + 3] - s) / d[0]
    r = (x[j + 2] - r - c[1] * s) / c[0]
    q = (x[j + 1] - q - b[1] * r - b[2] * s) / b[0]
    p = (x[j] - p - a[1] * q - a[2] * r - a[3] * s) / a[0]
    x[j], x[j + 1], x[j + 2], x[j + 3] = p, q, r, s


@shared_kernel(None)
def solve_factored(band, x):
    """Solve with the factor of `factorise`; x: (N,), right-hand side in, solution out.

    Four columns at a time where there are as many, so that x is read and written once for them.
    """
    size, width = band.shape
    blocks = size // 4 if width >= 4 else 0
    for block in range(blocks):
        _forward(band, 4 * block, x)
    for j in range(4 * blocks, size):
        value = x[j] / band[j, 0]
        x[j] = value
        for d in range(1, min(width, size - j)):
            x[j + d] -= band[j, d] * value
    for j in range(size - 1, 4 * blocks - 1, -1):
        value = x[j]
        for d in range(1, min(width, size - j)):
            value -= band[j, d] * x[j + d]
        x[j] = value / band[j, 0]
    for block in range(blocks - 1, -1, -1):
        _backward(band, 4 * block, x)


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


# iterations at most; change of the quotient, part of it, that ends them
_MAX_ITERATIONS, _QUOTIENT_TOLERANCE = 100, 1e-9


@kernel
def _times(band, x, image):
    """Symmetric band (N, B + 1), as of banded_kernels, times x (N,), to image (N,)."""
    size, width = band.shape
    image[:] = 0.0
    for j in range(size):
        for d in range(min(width, size - j)):
            image[j + d] += band[j, d] * x[j]
            if d > 0:
                image[j] += band[j, d] * x[j + d]


@kernel
def lowest_quotient(stiffness, mass, factor, panel, mode, image):
    """Smallest stiffness over mass, 1/s^2; 0 where the stiffness is not positive definite.

    stiffness, mass: bands (N, B + 1). factor, panel: scratch of factorise. mode: (N,), first guess,
    becomes the mode. image: (N,) scratch.
    """
    copy_values(stiffness, factor)
    if not factorise(factor, panel):
        return 0.0
    quotient = 0.0
    for _ in range(_MAX_ITERATIONS):
        _times(mass, mode, image)
        copy_values(image, mode)
        solve_factored(factor, mode)
        _times(mass, mode, image)
        square, before = product(mode, image), quotient
        _times(stiffness, mode, image)
        quotient = product(mode, image) / square
        for k in range(mode.shape[0]):
            mode[k] /= square**0.5
        if abs(quotient - before) <= _QUOTIENT_TOLERANCE * quotient:
            break
    return quotient
