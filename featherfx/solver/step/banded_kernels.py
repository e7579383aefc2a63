"""Cholesky factor of a symmetric banded matrix, in place.

Storage: band (N, B + 1), band[j, d] = A[j + d, j], so that the column below the diagonal is
contiguous; entries beyond the last row are zero. Columns are eliminated in blocks: a block is
factored by itself, copied to a panel that lines its columns up row by row, and taken from every
later column in one pass, so that an entry is read and written once for the whole block. Passes are
a multiple of CHUNK entries long, for which the processor needs no remainder loop; what lies beyond
a column's end gets zeros subtracted.
"""

from math import sqrt

from featherfx.jit.compiled import kernel, loop_kernel, shared_kernel

BLOCK = 8  # columns; `_subtract` is written out for this many
CHUNK = 16


def panel_shape(width):
    """Shape of the scratch that factorise wants for a band of this width."""
    return BLOCK, width + CHUNK


@loop_kernel
def _scale(column, factor):
    for d in range(column.shape[0]):
        column[d] *= factor


@loop_kernel
def _take(other, column, factor):
    for d in range(column.shape[0]):
        other[d] -= factor * column[d]


@kernel
def _eliminate(band, start, count):
    """Factor count columns by themselves; returns False if a pivot is not positive."""
    width = band.shape[1]
    for j in range(start, start + count):
        column = band[j]
        if not column[0] > 0.0:
            return False
        _scale(column, 1.0 / sqrt(column[0]))
        for t in range(1, min(start + count - j, width)):
            _take(band[j + t], column[t:], column[t])
    return True


@loop_kernel
def _line_up(band, start, panel):
    """panel[s, r] = entry of column start + s in row start + BLOCK + r; zero outside the band."""
    width = band.shape[1]
    for s in range(BLOCK):
        first = BLOCK - s
        count = max(width - first, 0)
        for r in range(count):
            panel[s, r] = band[start + s, first + r]
        for r in range(count, panel.shape[1]):
            panel[s, r] = 0.0


@loop_kernel
def _subtract(panel, count, flat, width):
    """Take a block from the count columns after it; flat: what is left of the band, as (.,).

    column[r] -= sum_s panel[s, t] panel[s, t + r] for column t.
    """
    for t in range(count):
        a, b, c, d = panel[0, t:], panel[1, t:], panel[2, t:], panel[3, t:]
        e, f, g, h = panel[4, t:], panel[5, t:], panel[6, t:], panel[7, t:]
        a0, b0, c0, d0, e0, f0, g0, h0 = a[0], b[0], c[0], d[0], e[0], f[0], g[0], h[0]
        column = flat[t * width :]
        length = (width - 1 - t + CHUNK - 1) // CHUNK * CHUNK
        for r in range(min(length, column.shape[0])):
            first = (a0 * a[r] + b0 * b[r]) + (c0 * c[r] + d0 * d[r])
            second = (e0 * e[r] + f0 * f[r]) + (g0 * g[r] + h0 * h[r])
            column[r] -= first + second


@shared_kernel(bool)
def factorise(band, panel):
    """Factor band in place; returns False if the matrix is not positive definite.

    panel: scratch of panel_shape(B + 1).
    """
    size, width = band.shape
    flat = band.reshape(band.size)
    for start in range(0, size, BLOCK):
        if not _eliminate(band, start, min(BLOCK, size - start)):
            return False
        below = start + BLOCK
        if below < size:
            _line_up(band, start, panel)
            _subtract(panel, min(width - 1, size - below), flat[below * width :], width)
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
