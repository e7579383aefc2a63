"""Rows of vectors, and of rotations: matrices, unit quaternions (w, x, y, z), rotation vectors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from featherfx.algebra.types import Array, Indices


def unit(vectors: Any) -> Any:
    """Vectors (..., k) over their lengths; those without length stay zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, 1.0)


def distinct(numbers: Indices) -> Indices:
    """Return integers (...), each once, ascending: np.unique of newer NumPy hashes them, which
    takes longer than to sort."""
    found = np.sort(numbers, axis=None)
    return found[np.append(True, found[1:] != found[:-1])[: len(found)]]


def dots(first: Array, second: Array | Indices) -> Array:
    """(N,) products of rows (N, k)."""
    return np.asarray(np.einsum("nk,nk->n", first, second))


def applied(matrices: Array, vectors: Array) -> Array:
    """(K, 3, 3) matrices times (K, 3) vectors."""
    return np.asarray((matrices @ vectors[:, :, None])[..., 0])


def cross_columns(first: Array, second: Array) -> Array:
    """(3, N) cross products of the columns of (3, N)."""
    (x, y, z), (u, v, w) = first, second
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def triangle_edges(points: Array, triangles: Indices) -> tuple[Array, Array]:
    """(3, T), (3, T) ways from the first corners of triangles (T, 3) of points (V, 3) to the
    second and third ones."""
    columns = np.ascontiguousarray(points.T)
    start, first, second = (columns.take(corner, axis=1) for corner in triangles.T)
    first -= start
    second -= start
    return first, second


def arc_lengths(points: Array) -> Array:
    """(k,) lengths of a polyline (k, D) from its first point to each."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def face_products(corners: Array) -> Array:
    """(T, 3) normals of triangles (T, 3, 3), twice their area long."""
    a, b, c = (corners[:, k].T for k in range(3))
    return cross_columns(b - a, c - a).T


def vertex_normals(points: Array, triangles: Indices) -> Array:
    """(V, 3) unit, the mean of the triangles around weighted by area; zero where there are none."""
    sums = [
        sum(np.bincount(corner, each, len(points)) for corner in triangles.T)
        for each in face_products(points[triangles]).T
    ]
    return np.asarray(unit(np.stack(sums, axis=1)))


# rad: below it power series are as exact as sines
_SMALL_ANGLE = 1e-6


# by which a rotation's product with its transpose may be off the identity
_ORTHOGONAL = 1e-12
# rad: up to it scipy's rotations take power series
_SERIES_ANGLE = 1e-3


@cache
def _scipy() -> Any:
    """scipy's rotations, which take 14 MiB and longer to load than most commands to end. What is
    computed here has their bits; they are asked where a matrix is no rotation."""
    from scipy.spatial.transform import Rotation

    return Rotation


def frames_to_quats(frames: Array) -> Array:
    """(..., 3, 3) rotation matrices to (..., 4) unit quaternions."""
    flat = np.asarray(frames, dtype=float).reshape(-1, 3, 3)
    if _are_rotations(flat):
        quats = _quats(flat)
    else:
        quats = np.roll(_scipy().from_matrix(flat).as_quat(), 1, axis=-1)
    return quats.reshape(*frames.shape[:-2], 4)


def _are_rotations(flat: Array) -> bool:
    apart = np.abs(flat @ np.swapaxes(flat, 1, 2) - np.eye(3))
    right = np.einsum("ni,ni->n", np.cross(flat[:, 0], flat[:, 1]), flat[:, 2]) > 0.0
    return bool((apart < _ORTHOGONAL).all() and right.all())


def _quats(flat: Array) -> Array:
    """Unit quaternions (N, 4) by the largest of the diagonal's elements and their sum."""
    diagonal = np.diagonal(flat, axis1=1, axis2=2)
    trace = diagonal[:, 0] + diagonal[:, 1] + diagonal[:, 2]
    largest = np.argmax(np.concatenate([diagonal, trace[:, None]], axis=1), axis=1)
    quats = np.empty((len(flat), 4))
    for i in range(3):
        j, k, some = (i + 1) % 3, (i + 2) % 3, largest == i
        own = flat[some]
        quats[some, 0] = own[:, k, j] - own[:, j, k]
        quats[some, 1 + i] = 1.0 - trace[some] + 2.0 * own[:, i, i]
        quats[some, 1 + j] = own[:, j, i] + own[:, i, j]
        quats[some, 1 + k] = own[:, k, i] + own[:, i, k]
        rest = flat[largest == 3]
        quats[largest == 3, 1 + i] = rest[:, k, j] - rest[:, j, k]
    quats[largest == 3, 0] = 1.0 + trace[largest == 3]
    return quats / _length(quats)[:, None]


def _length(quats: Array) -> Array:
    """(N,) summed in scipy's order, the real part last."""
    w, x, y, z = (quats * quats).T
    return np.sqrt(x + y + z + w)


def quats_to_frames(quats: Array) -> Array:
    """(..., 4) unit quaternions to (..., 3, 3) rotation matrices. Raises ValueError for 0."""
    flat = quats.reshape(-1, 4)
    length = _length(flat)
    if (length == 0.0).any():
        raise ValueError("a quaternion of length 0 is no rotation")
    return _frames(flat / length[:, None]).reshape(*quats.shape[:-1], 3, 3)


def _frames(unit: Array) -> Array:
    w, x, y, z = unit.T
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    rows = (
        (xx - yy - zz + ww, 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)),
        (2.0 * (x * y + z * w), -xx + yy - zz + ww, 2.0 * (y * z - x * w)),
        (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), -xx - yy + zz + ww),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def rotation_vectors(frames: Array) -> Array:
    """(..., 3, 3) rotation matrices to (..., 3) rotation vectors, rad."""
    quats = frames_to_quats(frames).reshape(-1, 4)
    quats = np.where(quats[:, :1] < 0.0, -quats, quats)
    x, y, z = (quats[:, 1:] * quats[:, 1:]).T
    halves = map(math.atan2, np.sqrt(x + y + z).tolist(), quats[:, 0].tolist())
    angle = 2.0 * np.array(list(halves))
    square = angle * angle
    small = 2.0 + square / 12.0 + 7.0 * square * square / 2880.0
    near = angle <= _SERIES_ANGLE
    factor = np.divide(angle, np.sin(0.5 * angle), out=small, where=~near)
    return (factor[:, None] * quats[:, 1:]).reshape(*frames.shape[:-2], 3)


def vectors_to_frames(vectors: Array) -> Array:
    """(..., 3) rotation vectors, rad, to (..., 3, 3) rotation matrices."""
    flat = np.asarray(vectors, dtype=float).reshape(-1, 3)
    x, y, z = (flat * flat).T
    angle = np.sqrt(x + y + z)
    square = angle * angle
    half = 0.5 - square / 48.0 + square * square / 3840.0
    np.divide(np.sin(0.5 * angle), angle, out=half, where=angle > _SERIES_ANGLE)
    real = np.cos(0.5 * angle)[:, None]
    unit = np.concatenate([real, half[:, None] * flat], axis=1)
    return _frames(unit).reshape(*vectors.shape, 3)


def along_rows(quats: Array) -> Array:
    """(..., n, 4) quaternions with the signs that are nearest to those of the row before.

    Rows whose signs do not belong together would count as turned by 2 pi against each other
    (featherfx/mechanics/rachis_kernels.py).
    """
    close = np.einsum("...nk,...nk->...n", quats[..., 1:, :], quats[..., :-1, :])
    sign = np.cumprod(np.where(close < 0.0, -1.0, 1.0), axis=-1)
    return np.concatenate([quats[..., :1, :], quats[..., 1:, :] * sign[..., None]], axis=-2)


def from_rotation_vector(vector: Array) -> Array:
    """(3,) axis times angle in rad to the (3, 3) rotation matrix."""
    x, y, z = float(vector[0]), float(vector[1]), float(vector[2])
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < _SMALL_ANGLE:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        sine, versine = math.sin(angle) / angle, (1.0 - math.cos(angle)) / square
    return np.array(
        (
            (
                1.0 - versine * (y * y + z * z),
                versine * x * y - sine * z,
                versine * x * z + sine * y,
            ),
            (
                versine * x * y + sine * z,
                1.0 - versine * (x * x + z * z),
                versine * y * z - sine * x,
            ),
            (
                versine * x * z - sine * y,
                versine * y * z + sine * x,
                1.0 - versine * (x * x + y * y),
            ),
        )
    )


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


def rotation_part(matrices: Array) -> Array:
    """(..., 3, 3) proper rotations nearest to matrices (..., 3, 3)."""
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return np.asarray(left @ right)


def start_tangent(points: Array, stations: Array) -> Array:
    """(3,) unit tangent at the first place on a curve, as `transported` takes turns from it."""
    way = points[1] - points[0]
    if len(points) > 2:
        way = np.gradient(points, stations, axis=0, edge_order=2)[0]
    return np.asarray(way / np.linalg.norm(way))


def transported(points: Array, stations: Array) -> Array:
    """(n, 3, 3) turns since the first of places (n, 3) on a curve, without turning about it.

    stations: (n,) where the places are along the curve, ascending.
    """
    if len(points) < 3:
        return np.tile(np.eye(3), (len(points), 1, 1))
    way = np.gradient(points, stations, axis=0, edge_order=2)
    along = way / np.linalg.norm(way, axis=1, keepdims=True)
    turns = [np.eye(3)]
    for before, after in pairwise(along):
        axis = np.cross(before, after)
        sine = float(np.linalg.norm(axis))
        angle = math.atan2(sine, float(before @ after))
        step = from_rotation_vector(axis * (angle / sine if sine > 0.0 else 1.0))
        turns.append(step @ turns[-1])
    return np.stack(turns)


def motions(screws: Array) -> tuple[Array, Array]:
    """Turns (n, 3, 3) and shifts (n, 3) of the motions of screws (n, 6) within a time of 1.

    screws: rotation vector, rad, and the velocity of the origin. A point x goes to turn x + shift.
    """
    turning, velocity = screws[:, :3], screws[:, 3:]
    shifts = np.einsum("nij,nj->ni", _mean_turns(turning), velocity)
    return vectors_to_frames(turning), shifts


def screws_of(turns: Array, shifts: Array) -> Array:
    """(n, 6) screws of motions, turns (n, 3, 3) by less than half a turn and shifts (n, 3)."""
    turning = rotation_vectors(turns)
    velocity = np.linalg.solve(_mean_turns(turning), shifts[:, :, None])[:, :, 0]
    return np.concatenate([turning, velocity], axis=1)


def _mean_turns(vectors: Array) -> Array:
    """(n, 3, 3) means of the turns by 0 to 1 times rotation vectors (n, 3), the left Jacobian of
    the exponential map."""
    square = np.einsum("nk,nk->n", vectors, vectors)[:, None, None]
    small = square < 1e-6
    angle = np.sqrt(np.where(small, 1.0, square))
    second = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(angle)) / angle**2)
    third = np.where(small, 1.0 / 6.0 - square / 120.0, (angle - np.sin(angle)) / angle**3)
    crosses = np.cross(vectors[:, None, :], np.eye(3)).swapaxes(1, 2)
    return np.asarray(np.eye(3) + second * crosses + third * (crosses @ crosses))


def about_x(degrees: ArrayLike) -> Array:
    """(..., 3, 3) rotations about x."""
    angle = np.radians(np.asarray(degrees, dtype=float))
    result = np.zeros((*angle.shape, 3, 3))
    result[..., 0, 0] = 1.0
    result[..., 1, 1] = result[..., 2, 2] = np.cos(angle)
    result[..., 2, 1] = np.sin(angle)
    result[..., 1, 2] = -np.sin(angle)
    return result


def from_angles(degrees: ArrayLike, order: str = "xyz") -> Array:
    """(3, 3) rotation by angles about x, y and z, one axis after the other, the axes fixed.

    degrees: (3,) about x, y, z. order: in which the axes come.
    """
    about = about_x(degrees)
    turned = np.eye(3)
    for axis in ("xyz".index(name) for name in order):
        turned = np.roll(about[axis], (axis, axis), (0, 1)) @ turned
    return turned


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


def shared_turns(first: Array, second: Array, fractions: Array) -> Array:
    """(n, 3, 3) rotations on the shortest way from first to second, (n, 3, 3), by shares (n,)."""
    turning = np.flatnonzero(fractions)
    result = first.copy()
    if len(turning):
        ways = rotation_vectors(np.swapaxes(first[turning], -1, -2) @ second[turning])
        part = vectors_to_frames(fractions[turning, None] * ways)
        result[turning] = first[turning] @ part
    return result


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


def to_rate_of_vector(vector: Array, angular_velocity: Array) -> Array:
    """Rate of the rotation vector (3,) of a body that turns at angular_velocity (3,) rad/s.

    Inverse of the left Jacobian of the exponential map; singular only at a full turn.
    """
    angle = float(np.linalg.norm(vector))
    half = 0.5 * angle
    factor = 1.0 / 12.0 if angle < 1e-3 else (1.0 - half / math.tan(half)) / (angle * angle)
    first = np.cross(vector, angular_velocity)
    return np.asarray(angular_velocity - 0.5 * first + factor * np.cross(vector, first))


@dataclass(frozen=True)
class RotationSpline:
    """Smooth rotations through keys, at rest before the first and after the last.

    times: (K,) s, ascending. rotations: (K, 3, 3). coefficients: (K - 1, 3, 3) of the rotation
    vector u (c1 + u (c2 + u c3)) from key to key, u the fraction of the interval. The angular
    velocity is continuous, and so is its rate where the axis does not turn; the curve does not
    depend on the frame in which the keys are given.
    """

    times: Array
    rotations: Array
    coefficients: Array

    def __call__(self, time: float) -> Array:
        """(3, 3) rotation at a time in seconds."""
        last = len(self.times) - 1
        key = int(np.searchsorted(self.times, time, side="right")) - 1
        if key < 0 or key >= last:
            return self.rotations[0 if key < 0 else last]
        u = (time - self.times[key]) / (self.times[key + 1] - self.times[key])
        first, second, third = self.coefficients[key]
        return from_rotation_vector(u * (first + u * (second + u * third))) @ self.rotations[key]


def rotation_steps(rotations: Array) -> Array:
    """(K - 1, 3) rad, rotation vectors from each of K rotations (K, 3, 3) to the next."""
    return rotation_vectors(rotations[1:] @ rotations[:-1].transpose(0, 2, 1))


def rotation_spline(times: Array, rotations: Array, rates: Array) -> RotationSpline:
    """Spline through rotations (K, 3, 3) at ascending times (K,) in seconds; K >= 1.

    rates: (K - 1, 2, 3) rad/s, at the beginning and the end of each interval; NaN where the first
    rotation is held. scipy's RotationSpline is not used because it chooses the rates.
    """
    coefficients = np.zeros((len(times) - 1, 3, 3))
    steps, intervals = rotation_steps(rotations), np.diff(times)
    for key in np.flatnonzero(~np.isnan(rates).any(axis=(1, 2))):
        step, interval = steps[key], intervals[key]
        start = rates[key, 0] * interval
        end = to_rate_of_vector(step, rates[key, 1]) * interval
        coefficients[key] = start, 3.0 * step - 2.0 * start - end, start + end - 2.0 * step
    return RotationSpline(times, rotations, coefficients)
