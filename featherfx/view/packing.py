"""Points and colours in the bytes that a page takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array

Bytes = NDArray[np.uint8]

_PLACES = 65535


def packed_points(points: Array) -> bytes:
    """Points (V, 3): corner and size of their box (6 float32), then places in it (3 uint16)."""
    # column by column, which numpy does much faster
    low, high = (np.array([end(each) for each in points.T]) for end in (np.min, np.max))
    size = np.maximum(high - low, 1e-9)
    places = (points - low) * (_PLACES / size) + 0.5
    return np.concatenate([low, size]).astype("<f4").tobytes() + places.astype("<u2").tobytes()


def packed_colours(colours: Array) -> bytes:
    """Colours, or other values, from 0 to 1, a byte each."""
    rounded: Bytes = np.round(255.0 * np.clip(colours, 0.0, 1.0)).astype(np.uint8)
    return rounded.tobytes()
