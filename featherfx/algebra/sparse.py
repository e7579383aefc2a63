"""Sparse matrices that map points, for what every bake needs of them.

scipy's come with 10 MiB and a tenth of a second of all of numpy; what joins many maps uses them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.jit.compiled import KernelModule

sparse_kernels = KernelModule("featherfx.algebra.element_kernels")


class Rows(NamedTuple):
    """R rows of K columns. weights, columns: (N,) of what is not zero, row by row; first: (R + 1,),
    where each row begins among them, and the end."""

    weights: Array
    columns: Indices
    first: Indices

    def __matmul__(self, values: Array) -> Array:
        """(R, D), times values (K, D)."""
        result = np.empty((len(self.first) - 1, values.shape[1]))
        sparse_kernels.multiply_rows(self, np.ascontiguousarray(values, dtype=np.float64), result)
        return result

    def picked(self, rows: Indices) -> Rows:
        """Some of the rows (k,), in another order."""
        counts = (self.first[1:] - self.first[:-1])[rows]
        first = np.concatenate([[0], np.cumsum(counts)])
        entries = np.arange(first[-1]) + np.repeat(self.first[rows] - first[:-1], counts)
        return Rows(self.weights[entries], self.columns[entries], first)

    def scaled(self, factors: Array) -> Rows:
        """With every column times a factor (K,)."""
        return self._replace(weights=self.weights * factors[self.columns])

    def of_scipy(self, width: int) -> Any:
        """The same as scipy's matrix of so many columns."""
        from scipy.sparse import csr_array

        shape = len(self.first) - 1, width
        return csr_array((self.weights, self.columns, self.first), shape=shape)


def rows_of(weights: Array, columns: Indices) -> Rows:
    """Rows of weights (R, n) at columns (R, n); weights that are zero are left out."""
    there = weights != 0.0
    first = np.concatenate([[0], np.cumsum(np.count_nonzero(there, axis=1))])
    return Rows(weights[there], columns[there], first)


def from_scipy(matrix: Any) -> Rows:
    """Make the rows of scipy's matrix."""
    csr = matrix.tocsr()
    return Rows(csr.data, csr.indices.astype(np.int64), csr.indptr.astype(np.int64))
