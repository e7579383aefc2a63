"""Root frames: from two vectors, from angles, turned, mirrored and interpolated. Batches first."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Mirroring at y = 0 as seen by a feather: its x and z axes are mirrored, and y follows from them,
# so the frame stays right-handed and the leading vane changes to the side of -y.
_MIRROR = np.outer((1.0, -1.0, 1.0), (1.0, -1.0, 1.0))


def frames_from(direction: ArrayLike, up: ArrayLike) -> Array:
    """(..., 3, 3) frames whose x axis is `direction` and whose z axis leans to `up`.

    direction, up: (..., 3), not zero and not parallel (see `parallel`).
    """
    along = np.asarray(direction, dtype=float)
    x = along / np.linalg.norm(along, axis=-1, keepdims=True)
    y = np.cross(np.asarray(up, dtype=float), x)
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack((x, y, np.cross(x, y)), axis=-1)


def parallel(direction: ArrayLike, up: ArrayLike) -> NDArray[np.bool_]:
    """(...) whether two vectors are zero or closer than about 0.006 degrees to parallel."""
    first, second = np.asarray(direction, dtype=float), np.asarray(up, dtype=float)
    scale = np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1)
    sine = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(sine <= 1e-4 * scale)


def about_x(degrees: ArrayLike) -> Array:
    """(..., 3, 3) rotations about x."""
    angle = np.radians(np.asarray(degrees, dtype=float))
    result = np.zeros((*angle.shape, 3, 3))
    result[..., 0, 0] = 1.0
    result[..., 1, 1] = result[..., 2, 2] = np.cos(angle)
    result[..., 2, 1] = np.sin(angle)
    result[..., 1, 2] = -np.sin(angle)
    return result


def from_angles(degrees: ArrayLike) -> Array:
    """(3, 3) rotation about x, then y, then z, the axes fixed."""
    x, y, z = np.radians(np.asarray(degrees, dtype=float))
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x(np.degrees(x))


def mirrored_frames(rotation: Array) -> Array:
    """(..., 3, 3) frames of feathers mirrored at y = 0, right-handed, dorsal still dorsal."""
    return rotation * _MIRROR


def mirrored_points(points: Array) -> Array:
    """(..., 3) points mirrored at y = 0."""
    return points * (1.0, -1.0, 1.0)


def interpolated(first: Array, last: Array, fraction: Array) -> Array:
    """(n, 3, 3) frames on the shortest way on the rotation group, at equal angular rate.

    first, last: (3, 3). fraction: (n,) 0 at first, 1 at last.
    """
    rotation = first.T @ last
    angle = float(np.arccos(np.clip(0.5 * (np.trace(rotation) - 1.0), -1.0, 1.0)))
    axis = _axis(rotation, angle)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    part = np.asarray(fraction, dtype=float)[:, None, None] * angle
    rotations = np.eye(3) + np.sin(part) * cross + (1.0 - np.cos(part)) * (cross @ cross)
    return np.asarray(first @ rotations)


def _axis(rotation: Array, angle: float) -> Array:
    """Unit axis of a rotation, also for half turns, where the skew part vanishes."""
    skew = (rotation - rotation.T)[[2, 0, 1], [1, 2, 0]]
    if angle < 1e-12:
        return np.array([1.0, 0.0, 0.0])
    if angle < np.pi - 1e-4:
        return np.asarray(skew / np.linalg.norm(skew))
    symmetric = 0.5 * (rotation + rotation.T) + np.eye(3)
    column = symmetric[:, int(np.argmax(np.diag(symmetric)))]
    axis = column / np.linalg.norm(column)
    return np.asarray(axis if axis @ skew >= 0 else -axis)


def along_polyline(points: Array, fraction: Array) -> Array:
    """(n, 3) points at fractions of a polyline's length. points: (k, 3), k >= 2."""
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    station = np.concatenate(([0.0], np.cumsum(lengths)))
    at = np.asarray(fraction, dtype=float) * station[-1]
    return np.column_stack([np.interp(at, station, points[:, axis]) for axis in range(3)])
