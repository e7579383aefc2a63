"""Carrying a feather's material points into the world."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def place(points: Array, position: Array, rotation: Array) -> Array:
    """Material points (n, P, 3) in the feather frame to the world frame.

    position: (3,) m and rotation: (3, 3) of the root. Points 1 and 2 of a row are directors
    (featherfx/feather/types.py): they turn, but do not move.
    """
    placed = points @ rotation.T
    placed[:, 0] += position
    placed[:, 3:] += position
    return np.asarray(placed)
