"""Feathers that are not simulated: their rest shape follows the root."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather

Array = NDArray[np.float64]
Frames = Callable[[float], tuple[Array, Array]]
Roots = list[tuple[Array, Array]]

_SAMPLES = 5


@dataclass(frozen=True)
class FeatherPose:
    """points, velocities, accelerations: (n, P, 3) of one feather."""

    points: Array
    velocities: Array
    accelerations: Array


def rigid_poses(
    feathers: dict[int, Feather], frames: Frames, start: float, end: float
) -> dict[int, FeatherPose]:
    """Poses of feathers at a time `end` (s), by their number in the groom.

    frames: root positions (F, 3) and rotations (F, 3, 3) at a time. Rates are those of the
    polynomial through evenly spaced poses from `start` on; without a time in between, none.
    """
    numbers = list(feathers)
    local = np.stack([feather.points for feather in feathers.values()])
    world = [
        shifted(positions[numbers], local) + turned(rotations[numbers], local)
        for positions, rotations in root_rates(frames, start, end)
    ]
    return {f: FeatherPose(*pose) for f, *pose in zip(numbers, *world, strict=True)}


def root_rates(frames: Frames, start: float, end: float) -> Roots:
    """Root positions (F, 3) and rotations (F, 3, 3) at end, then their first and second rates."""
    now = frames(end)
    if not end > start:
        return [now, *[(np.zeros_like(now[0]), np.zeros_like(now[1]))] * 2]
    times = np.linspace(start, end, _SAMPLES)
    samples = [frames(float(time)) for time in times[:-1]] + [now]
    positions = np.stack([sample[0] - now[0] for sample in samples])
    rotations = np.stack([sample[1] - now[1] for sample in samples])
    return [now] + [
        (np.tensordot(weights, positions, 1), np.tensordot(weights, rotations, 1))
        for weights in end_rates(times)
    ]


def shifted(vectors: Array, like: Array) -> Array:
    """Vectors (F, 3) for all material points (F, n, P, 3); directors do not move."""
    shifts = np.repeat(vectors[:, None, None], like.shape[2], axis=2)
    shifts[:, :, 1:3] = 0.0
    return shifts


def turned(matrices: Array, points: Array) -> Array:
    """Material points (F, n, P, 3) times matrices (F, 3, 3)."""
    flat = points.reshape(len(points), -1, 3)
    return np.asarray(flat @ matrices.swapaxes(1, 2)).reshape(points.shape)


def end_rates(times: Array) -> tuple[Array, Array]:
    """(K,) weights of values at K times that give the first and second rate at the last one."""
    powers = np.vander(times - times[-1], increasing=True)
    inverse = np.linalg.inv(powers)
    return inverse[1], 2.0 * inverse[2]
