"""Motion from keyframes: smooth poses of joints through poses at given times.

A keyframe holds time (s), joint (name; "" is the whole groom), and at least one of
    position: [3] m, displacement of the joint's pivot from its place at rest,
    rotation: about the pivot; [3] degrees about x, then y, then z (fixed axes), or [4] a
        quaternion w, x, y, z of any length but zero,
both in the frame of the parent joint, whose axes are the groom's at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from featherfx.algebra.rotation import from_angles, quats_to_frames, rotation_spline
from featherfx.algebra.types import Array
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton, still_poses

Track = Callable[[float], Array]


def keyed(keyframes: Sequence[dict[str, Any]], skeleton: Skeleton) -> PosesOverTime:
    """Poses through keyframes, in any order, that the reader of the shot has checked."""
    ordered = sorted(keyframes, key=lambda keyframe: keyframe["time"])
    tracks: list[tuple[int, int, Track]] = []
    for joint, name in enumerate(skeleton.names):
        for which, (what, track) in enumerate(_TRACKS.items()):
            own = [k for k in ordered if k.get("joint", "") == name and k.get(what) is not None]
            if own:
                times = np.array([keyframe["time"] for keyframe in own], dtype=np.float64)
                tracks.append((which, joint, track(times, [keyframe[what] for keyframe in own])))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        for which, joint, track in tracks:
            found[which][joint] = track(time)
        return found

    return poses


def _position_track(times: Array, values: list[Any]) -> Track:
    # takes half a second to load, and few shots have keyframes
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
    if len(value) == 4:
        return quats_to_frames(np.asarray(value, dtype=float))
    return from_angles(value)


# what a keyframe may set, in the order of JointPoses
_TRACKS = {"rotation": _rotation_track, "position": _position_track}
