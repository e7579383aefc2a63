"""Motion of a shot's joints over its frames: places, turns, rates, and the angles of its wings.

A wing's angles follow from the turn R of its shoulder against the body, since the opened wing, on
the left wing

    R = R_x(elevation) R_z(sweep) R_y(twist),

as a flap composes them, in its axes (beat.py); on the right one from the mirror image. Elbow and
wrist are their folds about their hinges, without these their turns. The fan is 1 where the hand is
open and 0 where it is folded. The span ratio is the reach of the wing (beat.py) over the largest
one of the shot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import frames_to_quats, rotation_vectors
from featherfx.groom.types import Joint
from featherfx.shot.motion.beat import MIRROR, wing_axes
from featherfx.shot.motion.joints import joint_roots, opened_poses, skeleton_of
from featherfx.shot.motion.motion import joint_poses
from featherfx.shot.types import Shot

_PER_FRAME = 8  # samples, by which rates are found
_SIDES = {1: "left", -1: "right"}


@dataclass(frozen=True)
class WingTrack:
    """A wing at T times. elevation, sweep, twist, elbow, wrist: (T,) rad. fan: (T,) 1 open, 0
    folded. span_ratio: (T,) of the largest. downstroke: fraction of the time between the first and
    the last top of the stroke in which the wing falls; None without two tops."""

    elevation: Array
    sweep: Array
    twist: Array
    elbow: Array
    wrist: Array
    fan: Array
    span_ratio: Array
    downstroke: float | None


@dataclass(frozen=True)
class JointTracks:
    """J joints at T times, of which the first, "", is the groom itself.

    times: (T,) s. names: of the joints. positions: (T, J, 3) m, of their pivots. rotations:
    (T, J, 3, 3). wings: by "left" and "right".
    """

    times: Array
    names: tuple[str, ...]
    positions: Array
    rotations: Array
    wings: dict[str, WingTrack]

    def largest_rates(self) -> dict[str, dict[str, float]]:
        """Return the largest speed (m/s), turn (rad/s) and acceleration (m/s2) of each joint."""
        step = self.times[1] - self.times[0] if len(self.times) > 1 else 1.0
        ways = np.diff(self.positions, axis=0)
        turns = np.einsum("tjkl,tjml->tjkm", self.rotations[1:], self.rotations[:-1])
        turned = np.linalg.norm(rotation_vectors(turns.reshape(-1, 3, 3)), axis=1)
        rates = {
            "speed": np.linalg.norm(ways, axis=2) / step,
            "turn": turned.reshape(turns.shape[:2]) / step,
            "acceleration": np.linalg.norm(np.diff(ways, axis=0), axis=2) / step**2,
        }
        largest = {name: each.max(axis=0, initial=0.0) for name, each in rates.items()}
        return {
            joint: {name: float(each[number]) for name, each in largest.items()}
            for number, joint in enumerate(self.names)
        }


def find_tracks(shot: Shot) -> JointTracks:
    """Follow the joints of a shot from its first frame to its last.

    Raises InputError for a motion whose joints the groom lacks.
    """
    groom = shot.groom
    skeleton = skeleton_of(groom)
    poses = cache(joint_poses(shot.motion, shot, skeleton))
    first, last = shot.first_frame, shot.last_frame
    count = _PER_FRAME * (last - first) + 1
    times = np.arange(count) / (_PER_FRAME * shot.frames_per_second)
    roots = joint_roots(groom, skeleton, poses)
    found = [poses(float(time)) for time in times]
    carriers = [skeleton.carriers(each) for each in found]
    rotations = np.stack([each[0] for each in carriers])
    shifts = np.stack([each[1] for each in carriers])
    positions = np.einsum("tjkl,jl->tjk", rotations, skeleton.pivots) + shifts
    lengths = np.array([each.kind.length for each in groom.feathers])
    tips = []
    for time in times:
        frames = roots.frames(float(time))
        tips.append(frames.positions + lengths[:, None] * frames.rotations[:, :, 0])
    opened = skeleton.turned(opened_poses(groom))
    own = np.stack([skeleton.turned(each) for each in found]) @ opened.swapaxes(1, 2)
    folds = np.stack([each.bends + each.folds for each in found])
    wings, axes = {}, wing_axes(groom)
    for side, name in _SIDES.items():
        joints = {
            joint.role: number
            for number, joint in enumerate(groom.joints, 1)
            if joint.side == side and joint.role != "body"
        }
        if "shoulder" in joints:
            borne = np.isin(roots.joints, skeleton.below(joints["shoulder"]))
            shoulder = joints["shoulder"]
            reach = np.stack(tips)[:, borne] - positions[:, shoulder][:, None]
            body = rotations[:, shoulder] @ (own[:, shoulder] @ opened[shoulder]).swapaxes(1, 2)
            reach = np.linalg.norm((reach @ body)[:, :, 1:], axis=2).max(axis=1, initial=0.0)
            wings[name] = _wing(joints, groom.joints, axes @ own @ axes.T, folds, reach, side)
    return JointTracks(times, skeleton.names, positions, rotations, wings)


def _wing(
    joints: dict[str, int],
    known: tuple[Joint, ...],
    own: Array,
    folds: Array,
    reach: Array,
    side: int,
) -> WingTrack:
    """Angles of a wing. joints: numbers by role. own: (T, J, 3, 3) turns against parents, since
    opened, in the axes of shoulders. folds: (T, J) turns about hinges, of whole ones. reach:
    (T,) m."""
    shoulder = own[:, joints["shoulder"]]
    angles = Rotation.from_matrix(shoulder if side > 0 else shoulder * MIRROR).as_euler("XZY")
    elevation, sweep, twist = np.unwrap(angles, axis=0).T

    def closed(role: str) -> tuple[Array, Array]:
        """Folds, of whole ones, and turns, rad, of a joint."""
        number = joints.get(role, 0)
        hinge = known[number - 1].hinge if number else None
        if hinge is None or not hinge.any():
            turns = own[:, number] if number else np.tile(np.eye(3), (len(own), 1, 1))
            return np.zeros(len(own)), np.linalg.norm(rotation_vectors(turns), axis=1)
        fold = known[number - 1].fold + folds[:, number]
        return fold, fold * np.linalg.norm(hinge)

    (_, elbow), (fold, wrist) = closed("elbow"), closed("wrist")
    return WingTrack(
        elevation,
        sweep,
        twist,
        elbow,
        wrist,
        1.0 - fold,
        reach / max(reach.max(), 1e-12),
        _downstroke(elevation),
    )


def _downstroke(elevation: Array) -> float | None:
    inner = elevation[1:-1]
    tops = 1 + np.flatnonzero((inner > elevation[:-2]) & (inner >= elevation[2:]))
    if elevation[0] > elevation[1]:
        tops = np.append(0, tops)
    if elevation[-1] > elevation[-2]:
        tops = np.append(tops, len(elevation) - 1)
    if len(tops) < 2:
        return None
    return float(np.mean(np.diff(elevation[tops[0] : tops[-1] + 1]) < 0.0))


def rate_lines(rates: dict[str, dict[str, float]]) -> Iterator[str]:
    """Yield a line for each joint that moves, of its largest rates."""
    for joint, each in rates.items():
        if each["speed"] or each["turn"]:
            rate = f"at most {each['speed']:.3g} m/s, {np.degrees(each['turn']):.3g} deg/s"
            yield f"joint {joint or 'of the groom'}: {rate}, {each['acceleration']:.3g} m/s2"


def frame_rows(shot: Shot, tracks: JointTracks) -> Iterator[dict[str, Any]]:
    """Yield a dict for each whole frame: `frame`, `joints` with `position` (m) and `rotation`
    (w, x, y, z), and `wings` with their angles (rad) and `downstroke` of the shot."""
    quats = frames_to_quats(tracks.rotations)
    names = [name for name in WingTrack.__dataclass_fields__ if name != "downstroke"]
    for number, frame in enumerate(range(shot.first_frame, shot.last_frame + 1)):
        k = _PER_FRAME * number
        joints = {
            name: {"position": tracks.positions[k, j].tolist(), "rotation": quats[k, j].tolist()}
            for j, name in enumerate(tracks.names)
        }
        wings: dict[str, dict[str, float | None]] = {
            side: {name: float(getattr(wing, name)[k]) for name in names}
            for side, wing in tracks.wings.items()
        }
        for side, wing in tracks.wings.items():
            wings[side]["downstroke"] = wing.downstroke
        yield {"frame": frame, "joints": joints, "wings": wings}
