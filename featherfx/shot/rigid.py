"""Feathers that are not simulated: their rest shape follows the root."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather
from featherfx.shot.placement import place

Array = NDArray[np.float64]
Frames = Callable[[float], tuple[Array, Array]]


@dataclass(frozen=True)
class FeatherPose:
    """points, velocities, accelerations: (n, P, 3) of one feather."""

    points: Array
    velocities: Array
    accelerations: Array


def rigid_poses(
    feathers: dict[int, Feather], frames: Frames, start: float, end: float, samples: int = 5
) -> dict[int, FeatherPose]:
    """Poses of feathers at a time `end` (s), by their number in the groom.

    frames: root positions (F, 3) and rotations (F, 3, 3) at a time. Rates are those of the
    polynomial through evenly spaced poses from `start` on; without a time in between, none.
    """
    if not end > start:
        positions, rotations = frames(end)
        poses = {}
        for f, feather in feathers.items():
            points = place(feather.points, positions[f], rotations[f])
            poses[f] = FeatherPose(points, np.zeros_like(points), np.zeros_like(points))
        return poses
    times = np.linspace(start, end, samples)
    roots = [frames(float(time)) for time in times]
    first, second = end_rates(times)
    found = {}
    for f, feather in feathers.items():
        path = np.stack([place(feather.points, r[0][f], r[1][f]) for r in roots])
        rates = [np.tensordot(weights, path - path[-1], 1) for weights in (first, second)]
        found[f] = FeatherPose(path[-1], *rates)
    return found


def end_rates(times: Array) -> tuple[Array, Array]:
    """(K,) weights of values at K times that give the first and second rate at the last one."""
    powers = np.vander(times - times[-1], increasing=True)
    inverse = np.linalg.inv(powers)
    return inverse[1], 2.0 * inverse[2]
