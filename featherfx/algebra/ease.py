"""Ways from 0 to 1 that begin and end at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def smooth_step(fraction: float) -> float:
    """Rises from 0 to 1 over fraction 0..1 with zero slope and curvature at both ends (C2)."""
    s = min(max(fraction, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def faded(fractions: ArrayLike) -> NDArray[np.float64]:
    """Rise from 0 to 1 over fractions 0..1 with zero slope at both ends (C1)."""
    s = np.clip(np.asarray(fractions, dtype=float), 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))
