"""Curves whose frame turns at a constant rate: the rachis and every barb at rest are such curves.

A frame R(s) with dR/ds = R [k] for a constant k turns to R(s) = exp(s [k]), and its first axis
sweeps out the position s V(s k) e1, both in closed form (Rodrigues), so that a curve is exact at
any number of points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this angle the closed form of (angle - sin(angle)) / angle^3 loses digits to cancellation;
# five terms of its series are exact to rounding there.
_SERIES_BELOW = 0.25


def turn(rotation_vector: Array) -> tuple[Array, Array]:
    """Frames and mean tangents after turning steadily by the given rotation vectors.

    rotation_vector: (..., 3) rad, in the frame of the curve's start.
    Returns (..., 3, 3) frames, columns d1, d2, d3, and (..., 3) the mean of d1 on the way: arc
    length times mean tangent is the position.
    """
    x, y, z = np.moveaxis(np.asarray(rotation_vector, dtype=np.float64), -1, 0)
    skew = np.zeros((*x.shape, 3, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -z, y, -x
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = z, -y, x
    squared = skew @ skew
    angle = np.sqrt(x * x + y * y + z * z)
    first = np.sinc(angle / np.pi)[..., None, None]
    second = 0.5 * np.sinc(angle / (2.0 * np.pi))[..., None, None] ** 2
    third = _third_coefficient(angle)[..., None]
    frame = np.eye(3) + first * skew + second * squared
    mean_tangent = second[..., 0] * skew[..., 0] + third * squared[..., 0]
    mean_tangent[..., 0] += 1.0
    return frame, mean_tangent


def _third_coefficient(angle: Array) -> Array:
    """(angle - sin(angle)) / angle^3, accurate down to zero."""
    q = angle * angle
    series = (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0)))) / 6.0
    safe = np.maximum(angle, _SERIES_BELOW)
    return np.where(angle < _SERIES_BELOW, series, (safe - np.sin(safe)) / safe**3)
