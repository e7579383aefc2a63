"""Numpy arrays to USD value arrays and back; the only place that knows how.

USD copies a buffer once into an array of its own; the buffer must be contiguous and of the
element type, which the callers' float32 arrays are, so that no second copy is made.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pxr import Vt


def vec3f(values: ArrayLike) -> Any:
    """(N, 3) to Vt.Vec3fArray."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def vec2d(values: ArrayLike) -> Any:
    """(N, 2) to Vt.Vec2dArray."""
    return Vt.Vec2dArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float64))


def vec2f(values: ArrayLike) -> Any:
    """(N, 2) to Vt.Vec2fArray."""
    return Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def floats(values: ArrayLike) -> Any:
    """(N,) to Vt.FloatArray."""
    return Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))


def ints(values: ArrayLike) -> Any:
    """(N,) to Vt.IntArray."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, dtype=np.int32))


def strings(*values: str) -> Any:
    """Strings to Vt.StringArray."""
    return Vt.StringArray(list(values))


def to_numpy(value: Any) -> NDArray[Any]:
    """A USD numeric array (None: empty) to numpy; shares memory where USD allows it."""
    return np.empty(0) if value is None else np.asarray(value)
