"""Motion from keyframes: smooth poses of joints through poses at given times.

A keyframe holds time (s), joint (name; "" is the whole groom), and at least one of
    position: [3] m, displacement of the joint's pivot from its place at rest,
    rotation: about the pivot; [3] degrees about x, then y, then z (fixed axes), or [4] a
        quaternion w, x, y, z of any length but zero,
both in the frame of the parent joint, whose axes are the groom's at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import rotation_spline
from featherfx.shot.motion.skeleton import Skeleton

Array = NDArray[np.float64]
Track = Callable[[float], Array]


@dataclass(frozen=True)
class Keys:
    """Tracks per joint number: position (3,) m and rotation (3, 3) over time in seconds."""

    joints: int
    positions: tuple[tuple[int, Track], ...]
    rotations: tuple[tuple[int, Track], ...]

    def __call__(self, time: float) -> tuple[Array, Array]:
        """(J, 3, 3) rotations and (J, 3) m displacements against the parents."""
        turns = np.broadcast_to(np.eye(3), (self.joints, 3, 3)).copy()
        shifts = np.zeros((self.joints, 3))
        for joint, track in self.rotations:
            turns[joint] = track(time)
        for joint, track in self.positions:
            shifts[joint] = track(time)
        return turns, shifts


def keys_of(keyframes: Sequence[dict[str, Any]], skeleton: Skeleton) -> Keys:
    """Tracks through keyframes, in any order, that the reader of the shot has checked."""
    ordered = sorted(keyframes, key=lambda keyframe: keyframe["time"])
    positions: list[tuple[int, Track]] = []
    rotations: list[tuple[int, Track]] = []
    for number, name in enumerate(skeleton.names):
        for what, tracks in (("position", positions), ("rotation", rotations)):
            keyed = [k for k in ordered if k.get("joint", "") == name and _has(k, what)]
            if keyed:
                times = np.array([k["time"] for k in keyed], dtype=np.float64)
                make = _position_track if what == "position" else _rotation_track
                tracks.append((number, make(times, [k[what] for k in keyed])))
    return Keys(len(skeleton.names), tuple(positions), tuple(rotations))


def _has(keyframe: dict[str, Any], what: str) -> bool:
    return keyframe.get(what) is not None


def _position_track(times: Array, values: list[Any]) -> Track:
    from scipy.interpolate import CubicSpline

    points = np.array(values, dtype=np.float64)
    if len(times) == 1:
        return lambda time: points[0]
    spline = CubicSpline(times, points, bc_type="clamped")
    first, last = times[0], times[-1]
    return lambda time: np.asarray(spline(min(max(time, first), last)))


def _rotation_track(times: Array, values: list[Any]) -> Track:
    return rotation_spline(times, np.stack([_matrix(value) for value in values]))


def _matrix(value: Sequence[float]) -> Array:
    from scipy.spatial.transform import Rotation

    if len(value) == 4:
        return np.asarray(Rotation.from_quat(value, scalar_first=True).as_matrix())
    return np.asarray(Rotation.from_euler("xyz", value, degrees=True).as_matrix())
