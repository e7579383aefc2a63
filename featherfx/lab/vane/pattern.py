"""Sparse matrices of a membrane: which coordinates its elements couple, and their factors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import SuperLU, splu

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


class Pattern:
    """Pairs of coordinates that elements couple. nodes: (M, K). free: (2 N,) coordinates."""

    def __init__(self, nodes: NDArray[np.int64], free: Bools) -> None:
        unknown = (2 * nodes[:, :, None] + np.arange(2)).reshape(len(nodes), -1)
        rows = np.repeat(unknown, unknown.shape[1], axis=1).ravel()
        columns = np.tile(unknown, (1, unknown.shape[1])).ravel()
        self._size = len(free)
        key, self._slot = np.unique(columns * self._size + rows, return_inverse=True)
        self._columns, self._rows = np.divmod(key, self._size)
        number = np.cumsum(free) - 1
        self._inside = free[self._rows] & free[self._columns]
        self._inner_rows = number[self._rows[self._inside]]
        self._inner_starts = _starts(number[self._columns[self._inside]], int(free.sum()))
        self._starts = _starts(self._columns, self._size)

    def sum(self, blocks: Array) -> Array:
        """Values of the pairs, of the elements' blocks (M, 2 K, 2 K)."""
        return np.bincount(self._slot.ravel(), blocks.ravel()).astype(np.float64)

    def matrix(self, values: Array) -> csc_matrix:
        """Of all coordinates."""
        return csc_matrix((values, self._rows, self._starts), (self._size, self._size))

    def inner(self, values: Array) -> csc_matrix:
        """Of the free coordinates."""
        count = len(self._inner_starts) - 1
        data = (values[self._inside], self._inner_rows, self._inner_starts)
        return csc_matrix(data, (count, count))


def _starts(columns: NDArray[np.int64], size: int) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=size))])


def factorised(matrix: csc_matrix) -> SuperLU:
    """Without pivoting, which a definite matrix does not need; the order of least fill."""
    return splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
