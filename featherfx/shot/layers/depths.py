"""Depths of feathers in each other in what is written, and distances from where they were
simulated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.shot.layers.lift_kernels import MOST
from featherfx.shot.layers.types import Array, Indices, Stack

# over the thickness: width and number of the bins that depths are counted in, deeper ones in the
# last
BIN, BINS = 1e-3, 100_000
# pairs and feathers that are named
_MAX_NAMED = 10
# of its length, lift from which on a feather is told of
LIFTED = 0.25
# what sums of rows may differ by
ROUNDING = 1e-9


class Depths:
    """Depths of all pairs of a stack that touch, over their thickness, sample after sample."""

    def __init__(self, stack: Stack) -> None:
        self._pairs: Indices = stack.pairs
        self._counts = np.zeros(BINS + 1, dtype=np.int64)
        self._worst = np.full(len(stack.pairs), -np.inf)
        self._frame = np.zeros(len(stack.pairs))

    def add(self, depths: Array, touching: NDArray[np.bool_], frame: float) -> None:
        """depths: (K,) of one sample, below 0 where there is a gap. touching: (K,) which count."""
        bins = np.minimum(np.ceil(np.maximum(depths[touching], 0.0) / BIN), BINS).astype(np.int64)
        self._counts += np.bincount(bins, minlength=BINS + 1)
        deeper = depths > self._worst
        self._worst[deeper], self._frame[deeper] = depths[deeper], frame

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Distribution over pairs and samples, and the pairs that were deepest. names: ids."""
        worst = np.maximum(self._worst, 0.0)
        order = np.argsort(-worst, kind="stable")[:_MAX_NAMED]
        return {
            "written_depth": {
                "median": self._quantile(0.5),
                "p99": self._quantile(0.99),
                "worst": float(worst.max(initial=0.0)),
            },
            "pairs_deep": [
                {
                    "feather": names[self._pairs[k, 0]],
                    "other": names[self._pairs[k, 1]],
                    "depth": float(worst[k]),
                    "frame": float(self._frame[k]),
                }
                for k in order.tolist()
                if worst[k] > 0.0
            ],
            "pairs_touching": int(self._counts.sum()),
        }

    def _quantile(self, fraction: float) -> float:
        """Depth that a share of the pairs and samples do not exceed, to BIN."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        place = np.searchsorted(np.cumsum(self._counts), fraction * total)
        return float(min(BIN * place, self._worst.max(initial=0.0)))


class Lifted:
    """The largest lift of every feather, over its length, sample after sample. lengths: (F,) m."""

    def __init__(self, lengths: Array) -> None:
        self._lengths = lengths
        self._most, self._frame = np.zeros(len(lengths)), np.zeros(len(lengths))

    def add(self, lift: Array, frame: float) -> None:
        """lift: (F, n, 2 m + 1) m, of the nodes at one sample."""
        most = lift.max(axis=(1, 2)) / self._lengths
        higher = most > self._most
        self._most[higher], self._frame[higher] = most[higher], frame

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Count the feathers that were lifted by LIFTED or more and as far as any may be, and name
        those that were lifted most. names: ids."""
        order = np.argsort(-self._most, kind="stable")[:_MAX_NAMED]
        return {
            "feathers_lifted": int((self._most >= LIFTED).sum()),
            "feathers_at_limit": int((self._most > MOST - ROUNDING).sum()),
            "worst_lifted": [
                {
                    "feather": names[k],
                    "lift": float(self._most[k] * self._lengths[k]),
                    "of_length": float(self._most[k]),
                    "frame": float(self._frame[k]),
                }
                for k in order.tolist()
                if self._most[k] >= LIFTED
            ],
        }
