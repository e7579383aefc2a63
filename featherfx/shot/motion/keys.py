"""Motion from keyframes: poses of joints through poses at given times.

Each coordinate of a position, and each angle, is a curve of its own through its keys, a cubic of
Hermite from key to key,

    x(u) = x0 + s (3 u^2 - 2 u^3) + h r0 (u - 2 u^2 + u^3) + h r1 (u^3 - u^2),

u the fraction of the interval h, s the step, r0 and r1 the rates at its ends. Rates are monotone
unless a key's `tangents` says otherwise: 0 where steps change sign and where a curve begins or
ends, else the weighted harmonic mean of the rates beside the key. So no curve leaves the range of
the keys beside it, and a hold holds. Angles count turns: 720 degrees are two. Rotations by
quaternion take the shortest way, by the same rule for rotation vectors. With extrapolation
"linear" a curve goes on beyond its keys at the rate of the step beside.

Source: Fritsch and Butland, A method for constructing local monotone piecewise cubic interpolants,
SIAM J. Sci. Stat. Comput. 5 (1984).

Motion of a joint along an attribute of a USD stage: time samples, or a spline.

With the stage's axes as columns of B in the groom's, a place d of the stage, in its units of s
metres, is s B d, and a turn R is B R B^T.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import (
    from_angles,
    from_rotation_vector,
    quats_to_frames,
    rotation_spline,
    rotation_steps,
)
from featherfx.shot.motion.cuts import named_cuts
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton, still_poses
from featherfx.shot.types import Motion, Shot

Track = Callable[[float], Array]
Keyframes = Sequence[dict[str, Any]]

# way from key to key within a frame, over that beside it, from which on it is a cut
MIN_RATIO = 10.0
# frames from keyframe to keyframe within which a cut is: times of frames are rounded; rad, that
# takes the end of a feather as far as it is long
WITHIN, TURN = 1.5, np.pi / 3.0
_AFTER = 5e-9  # frames, of a cut after a frame


def keyed(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses through keyframes that the reader of the shot has checked.

    Curves before and after a cut are separate.
    """
    clock, rate = motion.clock, shot.frames_per_second
    cuts = [
        ((k + _AFTER) / rate - clock.start) * clock.tempo for k in sorted(cut_frames(motion, shot))
    ]
    tracks: list[tuple[int, int, Track]] = []
    for joint, name in enumerate(skeleton.names):
        keys = _keys(motion, name)
        for which, what in enumerate(_TRACKS):
            if keys[what]:
                goes_on = motion.values.get("extrapolation") == "linear"
                tracks.append((which, joint, _in_pieces(keys[what], what, cuts, goes_on)))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        for which, joint, track in tracks:
            found[which][joint] = track(time)
        return found

    return poses


def _keys(motion: Motion, joint: str) -> dict[str, Keyframes]:
    """Keyframes of a joint, by what they set."""
    own = [each for each in motion.values["keyframes"] if each.get("joint", "") == joint]
    return {what: [key for key in own if key.get(what) is not None] for what in _TRACKS}


def cut_frames(motion: Motion, shot: Shot) -> frozenset[int]:
    """Cuts of a motion by the frames before them: those that the shot names, else where a joint
    goes farther within a frame, from keyframe to keyframe, than the longest feather is long, or
    turns so far that the end of such a feather does."""
    if shot.cuts is not None:
        return named_cuts(shot)
    clock, rate = motion.clock, shot.frames_per_second
    far = max(each.kind.length for each in shot.groom.feathers)
    times: list[float] = []
    for joint in {each.get("joint", "") for each in motion.values["keyframes"]}:
        keys = _keys(motion, joint)
        times += _cuts(keys["position"], "position", clock.tempo / rate, far)
        times += _cuts(keys["rotation"], "rotation", clock.tempo / rate, TURN)
    places = ((time / clock.tempo + clock.start) * rate for time in times)
    return frozenset(math.floor(place + 1e-3) for place in places)


def _times(keys: Keyframes) -> Array:
    return np.array([key["time"] for key in keys], dtype=np.float64)


def _are_angles(keys: Keyframes) -> bool:
    """Return whether rotations are angles (rad, counted over turns), not quaternions."""
    return all(len(key["rotation"]) == 3 for key in keys)


def _steps(keys: Keyframes, what: str) -> Array:
    """(K - 1, 3) from key to key: m, or rad of angles or of the shortest turn."""
    if what == "rotation" and not _are_angles(keys):
        return rotation_steps(_frames(keys))
    steps = np.diff(np.array([key[what] for key in keys], dtype=np.float64), axis=0)
    return np.radians(steps) if what == "rotation" else steps


def _cuts(keys: Keyframes, what: str, frame: float, far: float) -> list[float]:
    """s, of the keyframes after which a joint is cut to another pose, where the way to the next is
    far. frame: s."""
    if len(keys) < 2:
        return []
    times, ways = _times(keys), np.linalg.norm(_steps(keys, what), axis=1)
    intervals = np.diff(times)
    rates = np.concatenate([[0.0], ways / intervals, [0.0]])
    beside = frame * np.maximum(rates[:-2], rates[2:])
    cut = (intervals < WITHIN * frame) & (ways > far) & (ways > MIN_RATIO * beside)
    return times[:-1][cut].tolist()


def _in_pieces(keys: Keyframes, what: str, cuts: Sequence[float], goes_on: bool) -> Track:
    """A track through keyframes that is cut right after some times (s), and goes on beyond them."""
    ends = [0, *np.searchsorted(_times(keys), cuts).tolist(), len(keys)]
    pieces = {
        low: _TRACKS[what](
            keys[low:high],
            _rates(keys[low:high], what, low > 0 or goes_on, high < len(keys) or goes_on),
            (low > 0 or goes_on, high == len(keys) and goes_on),
        )
        for low, high in pairwise(ends)
        if high > low
    }
    if len(pieces) == 1:
        return next(iter(pieces.values()))
    firsts, tracks = list(pieces), list(pieces.values())
    # a cut at which this track has no keyframes on one side leaves it whole there
    begins = [-np.inf, *(cuts[ends.index(low) - 1] for low in firsts[1:])]
    return lambda time: tracks[bisect_left(begins, time) - 1](time)


def _monotone_rates(rates: Array, intervals: Array, cut_before: bool, cut_after: bool) -> Array:
    """(K, n) rates at keys from those between them, (K - 1, n), taken as vectors.

    At an end 0, at a cut that of the interval beside it.
    """
    found = np.zeros((len(rates) + 1, rates.shape[1]))
    if cut_before:
        found[0] = rates[0]
    if cut_after:
        found[-1] = rates[-1]
    squares = (rates * rates).sum(axis=1)
    for key in range(1, len(rates)):
        product = rates[key - 1] @ rates[key]
        if product <= 0.0:
            continue
        before, after = intervals[key - 1], intervals[key]
        # each interval counts by the other's length, as in the source
        first, second = before + 2.0 * after, 2.0 * before + after
        inverse = first * rates[key - 1] / squares[key - 1] + second * rates[key] / squares[key]
        cosine = product / np.sqrt(squares[key - 1] * squares[key])
        found[key] = cosine * (first + second) * inverse / (inverse @ inverse)
    return found


def _rates(keys: Keyframes, what: str, cut_before: bool, cut_after: bool) -> Array:
    """(K - 1, 2, 3) rates at the beginning and the end of each interval; NaN where a key holds."""
    if len(keys) < 2:
        return np.zeros((0, 2, 3))
    intervals = np.diff(_times(keys))
    between = _steps(keys, what) / intervals[:, None]
    as_vectors = what == "rotation" and not _are_angles(keys)
    parts = [between] if as_vectors else np.split(between, 3, axis=1)
    smooth = np.hstack([_monotone_rates(p, intervals, cut_before, cut_after) for p in parts])
    found = np.stack([smooth[:-1], smooth[1:]], axis=1)
    for key, frame in enumerate(keys):
        tangents = frame.get("tangents", "smooth")
        sides = [(key, 0)] * (key < len(between)) + [(key - 1, 1)] * (key > 0)
        for interval, end in sides:
            if tangents == "linear":
                found[interval, end] = between[interval]
            elif tangents == "flat":
                found[interval, end] = 0.0
            elif tangents == "step" and end == 0:
                found[interval] = np.nan
            elif not isinstance(tangents, str):
                given = np.asarray(tangents, dtype=np.float64)
                found[interval, end] = np.radians(given) if what == "rotation" else given
    # what holds has no rate at its end either
    found[np.isnan(found).any(axis=(1, 2))] = np.nan
    return found


def _frames(keys: Keyframes) -> Array:
    """(K, 3, 3) rotations at keys."""
    return np.stack([_frame(key["rotation"], key.get("order", "xyz")) for key in keys])


def _frame(rotation: Sequence[float], order: str) -> Array:
    if len(rotation) == 4:
        return quats_to_frames(np.asarray(rotation, dtype=float))
    return from_angles(rotation, order)


def _beyond(
    times: Array, rates: Array, goes_on: tuple[bool, bool], time: float
) -> tuple[float, Array]:
    """The nearest time from the first key to the last, and what the rate there adds, (3,), until
    another. goes_on: before and after them."""
    inside = min(max(time, times[0]), times[-1])
    end = 0 if time < inside else -1
    if time == inside or not goes_on[end] or not len(rates) or np.isnan(rates[end, end, 0]):
        return inside, np.zeros(3)
    return inside, (time - inside) * rates[end, end]


def _curve(times: Array, values: Array, rates: Array, goes_on: tuple[bool, bool]) -> Track:
    """(3,) at a time through values (K, 3), at rest beyond them unless it goes on."""

    def value(time: float) -> Array:
        inside, way = _beyond(times, rates, goes_on, time)
        key = int(np.searchsorted(times, inside, side="right")) - 1
        if key == len(rates) or np.isnan(rates[key, 0, 0]):
            return np.asarray(values[key] + way)
        interval = times[key + 1] - times[key]
        u = (inside - times[key]) / interval
        rise = u * u * (3.0 - 2.0 * u) * (values[key + 1] - values[key])
        begin, end = u * (1.0 - u) ** 2 * rates[key, 0], u * u * (u - 1.0) * rates[key, 1]
        return np.asarray(values[key] + rise + interval * (begin + end) + way)

    return value


def _position_track(keys: Keyframes, rates: Array, goes_on: tuple[bool, bool]) -> Track:
    places = np.array([key["position"] for key in keys], dtype=float)
    return _curve(_times(keys), places, rates, goes_on)


def _rotation_track(keys: Keyframes, rates: Array, goes_on: tuple[bool, bool]) -> Track:
    times = _times(keys)
    if not _are_angles(keys):
        turns = rotation_spline(times, _frames(keys), rates)

        def turned(time: float) -> Array:
            inside, way = _beyond(times, rates, goes_on, time)
            return np.asarray(from_rotation_vector(way) @ turns(inside))

        return turned
    degrees = np.array([key["rotation"] for key in keys], dtype=np.float64)
    curve = _curve(times, degrees, np.degrees(rates), goes_on)
    order = keys[0].get("order", "xyz")
    return lambda time: from_angles(curve(time), order)


# what a keyframe may set, in the order of JointPoses
_TRACKS = {"rotation": _rotation_track, "position": _position_track}


def followed(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a joint that an attribute leads. The attribute is read when it is asked for."""
    values, source, count = motion.values, motion.values["source"], len(skeleton.names)
    what, _, axis = values["sets"].partition("_")
    step = 1.0
    if values["time"] == "seconds":
        step = source.time_codes_per_second / shot.frames_per_second
    scaled = source.to_world.T
    axes = scaled / np.linalg.norm(scaled[:, 0])
    joints = [k for k, name in enumerate(skeleton.names) if fnmatchcase(name, values["joint"])]

    def poses(time: float) -> JointPoses:
        found = still_poses(count)
        given = source.value((shot.first_frame + time * shot.frames_per_second) * step)
        if axis:
            given = given * np.eye(3)["xyz".index(axis)]
        if what == "position":
            found.displacements[joints] = scaled @ given
        else:
            is_quaternion = len(given) == 4
            turn = quats_to_frames(given) if is_quaternion else from_angles(given, values["order"])
            found.rotations[joints] = axes @ turn @ axes.T
        return found

    return poses
