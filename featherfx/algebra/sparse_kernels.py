"""Products of sparse matrices, row by row, and solves by their factors."""

from featherfx.algebra.lanes import COUNT as LANES
from featherfx.algebra.lanes import load, put
from featherfx.jit.compiled import kernel


@kernel
def multiply_rows(rows, values, result):
    """result (R, D) = rows times values (K, D), D small."""
    for r in range(result.shape[0]):
        for d in range(result.shape[1]):
            total = 0.0
            for k in range(rows.first[r], rows.first[r + 1]):
                total += rows.weights[k] * values[rows.columns[k], d]
            result[r, d] = total


@kernel
def solve_factors(factors, values):
    """Solve L D L^T x = values for values (N, 4), which become x. factors: SparseFactors."""
    starts, rows, weights = factors.starts, factors.rows, factors.weights
    count = values.shape[0]
    for j in range(count):
        own = load(values, LANES * j)
        for k in range(starts[j], starts[j + 1]):
            i = LANES * rows[k]
            put(values, i, load(values, i) - weights[k] * own)
        put(values, LANES * j, own / factors.scales[j])
    for j in range(count - 1, -1, -1):
        own = load(values, LANES * j)
        for k in range(starts[j], starts[j + 1]):
            own = own - weights[k] * load(values, LANES * rows[k])
        put(values, LANES * j, own)
