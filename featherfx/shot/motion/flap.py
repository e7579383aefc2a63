"""The procedural wing beat: angles of shoulder, elbow and wrist over a beat; and folding.

Frame: x forward, y to the left, z up. A beat starts at the top of the stroke: phase 0 to 1/2 is
the downstroke, 1/2 to 1 the upstroke. Positive angles, in degrees, on either side:

    shoulder  offset + amplitude cos(phase)          raises the wing, about x
    sweep     shoulder_sweep cos(phase)              moves the wing backwards, about z
    twist     twist sin(phase)                       lowers the leading edge, about y (the span)
    elbow     offset + amplitude cos(phase - elbow_phase)   folds the forearm forwards
    wrist     offset + amplitude cos(phase - wrist_phase)   folds the hand backwards

Elbow and wrist turn about their own hinges, where they have any, as those of wings from one table:
in the wing's plane feathers stay over each other. Those of other joints lean from the vertical, so
that a folding wing also flexes downwards.
The beat starts and ends at rest: within a quarter of a period the phase catches up with time.

Wings, tails and crests that open and close turn their joints about their hinges over time.
"""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from featherfx.algebra.interpolation import eased, smooth_step
from featherfx.algebra.rotation import from_rotation_vector
from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem
from featherfx.groom.types import Groom
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton, still_poses
from featherfx.shot.types import Motion, Shot

_ROLES = ("body", "shoulder", "elbow", "wrist")
_FOLDING = ("elbow", "wrist")
_HINGE_LEAN = math.radians(20.0)
_RAMP = 0.25  # of a beat
# What mirroring at the plane of symmetry (y -> -y) does to the entries of a rotation matrix.
MIRROR = np.outer((1.0, -1.0, 1.0), (1.0, -1.0, 1.0))


def _caught_up(beats: float, ramp: float) -> float:
    """Beats done after a start from rest; equal to beats once the ramp is over, C2."""
    return beats * smooth_step(beats / ramp)


@dataclass(frozen=True)
class Flap:
    """A wing beat. values: numbers of the motion by their name in the shot file.

    beats is the number of beats after which the wing rests; 0 stands for beating on and on.
    """

    values: Mapping[str, Any]

    def phase(self, time: float) -> float:
        """Phase in rad (2 pi a beat) at a time in seconds."""
        done, beats = max(time, 0.0) / self.values["period"], self.values["beats"]
        if beats <= 0.0:
            return 2.0 * math.pi * _caught_up(done, _RAMP)
        if done >= beats:
            return 2.0 * math.pi * beats
        ramp = min(_RAMP, 0.5 * beats)
        rising, falling = _caught_up(done, ramp), beats - _caught_up(beats - done, ramp)
        return 2.0 * math.pi * (rising if done < 0.5 * beats else falling)

    def fold(self, joint: str, phase: float) -> float:
        """Angle in rad by which "elbow" or "wrist" fold at a phase in rad."""
        amplitude, offset = self.values[f"{joint}_amplitude"], self.values[f"{joint}_offset"]
        lag = 2.0 * math.pi * self.values[f"{joint}_phase"]
        return math.radians(offset + amplitude * math.cos(phase - lag))

    def left(self, time: float) -> Array:
        """(4, 3, 3) rotations of body, shoulder, elbow and wrist of the left wing."""
        values, phase = self.values, self.phase(time)
        up, forth = math.cos(phase), math.sin(phase)
        raised = math.radians(values["shoulder_offset"] + values["shoulder_amplitude"] * up)
        swept = math.radians(values["shoulder_sweep"] * up)
        twisted = math.radians(values["twist"] * forth)
        lean = np.array((-math.sin(_HINGE_LEAN), 0.0, math.cos(_HINGE_LEAN)))
        shoulder = (
            from_rotation_vector(np.array((raised, 0.0, 0.0)))
            @ from_rotation_vector(np.array((0.0, 0.0, swept)))
            @ from_rotation_vector(np.array((0.0, twisted, 0.0)))
        )
        elbow = from_rotation_vector(lean * (1.0, 0.0, -1.0) * self.fold("elbow", phase))
        wrist = from_rotation_vector(lean * self.fold("wrist", phase))
        return np.stack((np.eye(3), shoulder, elbow, wrist))


def flapping(motion: Motion, shot: Shot, _skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom's joints that beat.

    A joint in the middle (side 0) has no wing to move and is driven as a body, as the groom itself
    is. Raises InputError where the groom has no shoulder on either side.
    """
    groom = shot.groom
    if not any(joint.role == "shoulder" and joint.side for joint in groom.joints):
        message = 'a flap needs a joint with role = "shoulder" and side = 1 or -1 in the groom'
        raise InputError(Problem(str(shot.source), "motion.kind", message))
    flap = Flap(motion.values)
    driven = [_ROLES.index(joint.role) if joint.side else 0 for joint in groom.joints]
    roles = np.array([0, *driven], dtype=np.int64)
    right = np.array([False, *(joint.side < 0 for joint in groom.joints)])[:, None, None]
    still = np.zeros((len(roles), 3))
    hinged = [
        (number, joint.role, float(np.linalg.norm(joint.hinge)))
        for number, joint in enumerate(groom.joints, 1)
        if joint.side and joint.role in _FOLDING and joint.hinge is not None and joint.hinge.any()
    ]
    own, none = [number for number, _, _ in hinged], np.zeros((3, len(roles)))

    def poses(time: float) -> JointPoses:
        picked, phase = flap.left(time)[roles], flap.phase(time)
        rotations = np.where(right, picked * MIRROR, picked)
        rotations[own] = np.eye(3)
        bends = np.zeros(len(roles))
        bends[own] = [flap.fold(role, phase) / whole for _, role, whole in hinged]
        return JointPoses(rotations, still, bends, *none)

    return poses


def folded(motion: Motion, shot: Shot, _skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that fold, as a shot asks for it."""
    return folding(shot.groom, motion.values, str(shot.source))


def folding(groom: Groom, values: Mapping[str, Any], source: str) -> PosesOverTime:
    """Poses of the joints that fold. values: of the motion. source: of the shot, for messages.

    Raises InputError where none of the joints meant folds.
    """
    pattern, keys = values["joints"], values["folds"]
    hinged = [
        (number, joint)
        for number, joint in enumerate(groom.joints, 1)
        if joint.hinge is not None and fnmatch.fnmatchcase(joint.name, pattern)
    ]
    if not hinged:
        known = ", ".join(joint.name for joint in groom.joints if joint.hinge is not None)
        message = f"'{pattern}' is no joint that folds. Those of wings, tails and crests do"
        raise InputError(
            Problem(source, "motion.joints", f"{message}: {known or 'there are none'}")
        )
    times, folds = ([key[name] for key in keys] for name in ("time", "fold"))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(groom.joints) + 1)
        fold = eased(times, folds, time)
        for number, joint in hinged:
            found.folds[number], found.aims[number] = fold - joint.fold, 1.0
        return found

    return poses
