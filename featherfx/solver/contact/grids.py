"""Feathers of several grids side by side: their points on the widest of them all.

Points that a smaller grid lacks stay zero; no surface has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Grids:
    """The grids of B bodies in batches.

    first: (G + 1,) first body of each batch. rows, columns: (G,) of the batches.
    """

    first: Indices
    rows: Indices
    columns: Indices

    @property
    def bodies(self) -> int:
        return int(self.first[-1])

    @property
    def most_rows(self) -> int:
        return int(self.rows.max(initial=1))

    @property
    def most_columns(self) -> int:
        return int(self.columns.max(initial=0))

    def own_columns(self) -> Indices:
        """(B,) columns of each body's grid."""
        return np.repeat(self.columns, np.diff(self.first))

    def put(self, values: Array, batch: int, bodies: Indices | slice, to: Array) -> None:
        """Write values (k, n, P, ...) of some bodies (counted in their batch) to those of all,
        (B, most rows, widest P, ...)."""
        m, trailing = int(self.columns[batch]), 3 + self.most_columns
        own = to[self.first[batch] : self.first[batch + 1], : self.rows[batch]]
        own[bodies, :, : 3 + m] = values[:, :, : 3 + m]
        own[bodies, :, trailing : trailing + m] = values[:, :, 3 + m :]

    def together(self, parts: Sequence[Array]) -> Array:
        """(B, most rows, widest P, ...) from one (F, n, P, ...) per batch."""
        shape = self.bodies, self.most_rows, 3 + 2 * self.most_columns
        found = np.zeros(shape + parts[0].shape[3:])
        for batch, values in enumerate(parts):
            self.put(values, batch, slice(None), found)
        return found


def grids_of(counts: Sequence[int], rows: Sequence[int], columns: Sequence[int]) -> Grids:
    """Of batches of so many feathers, with so many rows, and columns a side."""
    first = np.concatenate([[0], np.cumsum(np.asarray(counts, dtype=np.int64))])
    return Grids(first, np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64))
