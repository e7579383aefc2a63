"""Ways from 0 to 1 that begin and end at rest."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


def smooth_step(fraction: float) -> float:
    """Rises from 0 to 1 over fraction 0..1 with zero slope and curvature at both ends (C2)."""
    s = min(max(fraction, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def eased(times: Sequence[float], values: Sequence[float], time: float) -> float:
    """Value at a time between those at ascending times, at rest at each of them and outside."""
    after = bisect_right(times, time)
    if after in (0, len(times)):
        return values[min(after, len(times) - 1)]
    before, step = values[after - 1], times[after] - times[after - 1]
    return before + smooth_step((time - times[after - 1]) / step) * (values[after] - before)


def faded(fractions: ArrayLike) -> NDArray[np.float64]:
    """Rise from 0 to 1 over fractions 0..1 with zero slope at both ends (C1)."""
    s = np.clip(np.asarray(fractions, dtype=float), 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))
