"""Feathers mirrored at y = 0, and places along a polyline. Batches first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Mirroring at y = 0 as seen by a feather: its x and z axes are mirrored, and y follows from them,
# so the frame stays right-handed and the leading vane changes to the side of -y.
_MIRROR = np.outer((1.0, -1.0, 1.0), (1.0, -1.0, 1.0))


def mirrored_frames(rotation: Array) -> Array:
    """(..., 3, 3) frames of feathers mirrored at y = 0, right-handed, dorsal still dorsal."""
    return rotation * _MIRROR


def mirrored_points(points: Array) -> Array:
    """(..., 3) points mirrored at y = 0."""
    return points * (1.0, -1.0, 1.0)


def along_polyline(points: Array, fraction: Array) -> Array:
    """(n, 3) points at fractions of a polyline's length. points: (k, 3), k >= 2."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    station = np.concatenate(([0.0], np.cumsum(lengths)))
    at = np.asarray(fraction, dtype=float) * station[-1]
    return np.column_stack([np.interp(at, station, points[:, axis]) for axis in range(3)])
