"""Cholesky factor of a symmetric banded matrix, in place.

Storage: band (N, B + 1), band[j, d] = A[j + d, j], so that the column below the diagonal is
contiguous; entries beyond the last row are zero. Columns are eliminated two at a time, so that
each entry of the trailing band is read and written once for both.
"""

from math import sqrt

from featherfx.compiled import kernel


@kernel
def factorise(band):
    """Factor band in place; returns False if the matrix is not positive definite."""
    size, width = band.shape
    for j in range(0, size, 2):
        pivot = band[j, 0]
        if not pivot > 0.0:
            return False
        scale = 1.0 / sqrt(pivot)
        for d in range(width):
            band[j, d] *= scale
        if j + 1 >= size:
            return True
        factor = band[j, 1]
        for d in range(width - 1):
            band[j + 1, d] -= factor * band[j, d + 1]
        pivot = band[j + 1, 0]
        if not pivot > 0.0:
            return False
        scale = 1.0 / sqrt(pivot)
        for d in range(width):
            band[j + 1, d] *= scale
        last = min(width, size - j - 1)
        for d in range(1, last):
            row = band[j + 1 + d]
            second = band[j + 1, d]
            if d + 1 < width:
                first = band[j, d + 1]
                for e in range(width - d - 1):
                    row[e] -= first * band[j, d + 1 + e] + second * band[j + 1, d + e]
                row[width - d - 1] -= second * band[j + 1, width - 1]
            else:
                row[0] -= second * second
    return True


@kernel
def solve_factored(band, x):
    """Solve with the factor of `factorise`; x: (N,), right-hand side in, solution out."""
    size, width = band.shape
    for j in range(size):
        value = x[j] / band[j, 0]
        x[j] = value
        last = min(width, size - j)
        for d in range(1, last):
            x[j + d] -= band[j, d] * value
    for j in range(size - 1, -1, -1):
        value = x[j]
        last = min(width, size - j)
        for d in range(1, last):
            value -= band[j, d] * x[j + d]
        x[j] = value / band[j, 0]
