"""Motion from keyframes: smooth poses of joints through poses at given times.

A keyframe holds time (s), joint (name; "" is the whole groom), and at least one of
    position: [3] m, displacement of the joint's pivot from its place at rest,
    rotation: about the pivot; [3] degrees about x, then y, then z (fixed axes), or [4] a
        quaternion w, x, y, z of any length but zero,
both in the frame of the parent joint, whose axes are the groom's at rest.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.algebra.rotation import (
    from_angles,
    quats_to_frames,
    rotation_spline,
    rotation_vectors,
)
from featherfx.algebra.types import Array
from featherfx.shot.motion.cuts import FARTHER
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton, still_poses
from featherfx.shot.types import Motion, Shot

Track = Callable[[float], Array]

# frames from keyframe to keyframe within which a cut is: times of frames are rounded; rad, that
# takes the end of a feather as far as it is long
WITHIN, TURN = 1.5, np.pi / 3.0


def keyed(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses through keyframes, in any order, that the reader of the shot has checked.

    A joint that goes farther within a frame, from keyframe to keyframe, than the longest feather is
    long, or turns so far that the end of such a feather does, is cut to another place (cuts.py):
    curves before and after are separate.
    """
    frame = 1.0 / shot.frames_per_second
    far = max(each.kind.length for each in shot.groom.feathers)
    ordered = sorted(motion.values["keyframes"], key=lambda keyframe: keyframe["time"])
    tracks: list[tuple[int, int, Track]] = []
    for joint, name in enumerate(skeleton.names):
        own = [each for each in ordered if each.get("joint", "") == name]
        keys = {what: [k for k in own if k.get(what) is not None] for what in _TRACKS}
        times, values = _values(keys["position"], "position")
        ways = np.linalg.norm(np.diff(np.reshape(values, (-1, 3)), axis=0), axis=1)
        turned, turns = _values(keys["rotation"], "rotation")
        cuts = sorted(
            {*_cuts(times, ways, frame, far), *_cuts(turned, _angles(turns), frame, TURN)}
        )
        for which, (what, track) in enumerate(_TRACKS.items()):
            if keys[what]:
                tracks.append((which, joint, _in_pieces(track, *_values(keys[what], what), cuts)))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        for which, joint, track in tracks:
            found[which][joint] = track(time)
        return found

    return poses


def _values(keys: Sequence[dict[str, Any]], what: str) -> tuple[Array, list[Any]]:
    """Times (s) and values of keyframes."""
    return np.array([key["time"] for key in keys], dtype=np.float64), [key[what] for key in keys]


def _angles(values: Sequence[Any]) -> Array:
    """rad, between rotations and the next ones."""
    frames = np.reshape([_matrix(each) for each in values], (-1, 3, 3))
    steps = rotation_vectors(frames[1:] @ frames[:-1].transpose(0, 2, 1))
    return np.asarray(np.linalg.norm(steps, axis=1))


def _cuts(times: Array, ways: Array, frame: float, far: float) -> list[float]:
    """s, times between keyframes at which a joint is cut to another pose, where the way from one
    to the next is far. frame: s."""
    if len(times) < 2:
        return []
    intervals = np.diff(times)
    rates = np.concatenate([[0.0], ways / intervals, [0.0]])
    beside = frame * np.maximum(rates[:-2], rates[2:])
    cut = (intervals < WITHIN * frame) & (ways > far) & (ways > FARTHER * beside)
    return [0.5 * (times[k] + times[k + 1]) for k in np.flatnonzero(cut)]


def _in_pieces(
    track: Callable[..., Track], times: Array, values: list[Any], cuts: Sequence[float]
) -> Track:
    """A track through values at times (s) that is cut at some."""
    ends = [0, *np.searchsorted(times, cuts).tolist(), len(times)]
    pieces = {
        low: track(times[low:high], values[low:high], low > 0, high < len(times))
        for low, high in pairwise(ends)
        if high > low
    }
    if len(pieces) == 1:
        return next(iter(pieces.values()))
    firsts, tracks = list(pieces), list(pieces.values())
    # a cut at which this track has no keyframes on one side leaves it whole there
    begins = [-np.inf, *(cuts[ends.index(low) - 1] for low in firsts[1:])]
    return lambda time: tracks[bisect_right(begins, time) - 1](time)


def _position_track(times: Array, values: list[Any], cut_before: bool, cut_after: bool) -> Track:
    # takes half a second to load, and few shots have keyframes
    from scipy.interpolate import CubicSpline

    points = np.array(values, dtype=np.float64)
    if len(times) == 1:
        return lambda time: points[0]
    # at rest at the first and the last keyframe, but not at a cut
    bounds = tuple((2 if cut else 1, np.zeros(3)) for cut in (cut_before, cut_after))
    spline = CubicSpline(times, points, bc_type=bounds)
    first, last = times[0], times[-1]
    return lambda time: np.asarray(spline(min(max(time, first), last)))


def _rotation_track(times: Array, values: list[Any], cut_before: bool, cut_after: bool) -> Track:
    return rotation_spline(times, np.stack([_matrix(value) for value in values]))


def _matrix(value: Sequence[float]) -> Array:
    if len(value) == 4:
        return quats_to_frames(np.asarray(value, dtype=float))
    return from_angles(value)


# what a keyframe may set, in the order of JointPoses
_TRACKS = {"rotation": _rotation_track, "position": _position_track}
