"""Products of sparse matrices, row by row."""

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
