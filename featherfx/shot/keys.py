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

from featherfx.errors import InputError, Problem
from featherfx.shot.rotation import rotation_spline
from featherfx.shot.skeleton import Skeleton

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


def keys_of(keyframes: Sequence[dict[str, Any]], skeleton: Skeleton, source: str) -> Keys:
    """Tracks through the keyframes, in any order. Raises InputError with all that is wrong."""
    problems = _problems(keyframes, skeleton, source)
    if problems:
        raise InputError(*problems)
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
    return keyframe.get(what) is not None and len(keyframe[what]) > 0


def _problems(
    keyframes: Sequence[dict[str, Any]], skeleton: Skeleton, source: str
) -> list[Problem]:
    if not keyframes:
        return [Problem(source, "motion.keyframes", "holds no keyframe, at least 1 is needed")]
    found: list[Problem] = []
    taken: dict[tuple[str, str, float], int] = {}
    for number, keyframe in enumerate(keyframes):
        key = f"motion.keyframes[{number}]"
        joint = keyframe.get("joint", "")
        if joint not in skeleton.names:
            known = ", ".join(f'"{name}"' for name in skeleton.names)
            found.append(Problem(source, f"{key}.joint", f'"{joint}" is unknown, joints: {known}'))
        whats = [what for what in ("position", "rotation") if _has(keyframe, what)]
        if not whats:
            found.append(Problem(source, key, "has neither position nor rotation"))
        if "rotation" in whats and len(keyframe["rotation"]) == 4 and not any(keyframe["rotation"]):
            found.append(Problem(source, f"{key}.rotation", "is a quaternion of length zero"))
        for what in whats:
            first = taken.setdefault((joint, what, float(keyframe["time"])), number)
            if first != number:
                message = f"keyframe {first} has a {what} of this joint at {keyframe['time']} s too"
                found.append(Problem(source, f"{key}.time", message))
    return found


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
