"""Poses of joints that swing: a groom along a line, or joints about an axis; of level trunks."""

from __future__ import annotations

import fnmatch
import math

import numpy as np

from featherfx.algebra.interpolation import smooth_step
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.errors import Problem
from featherfx.groom.types import Groom
from featherfx.shot.motion.body_joints import HEAD, NECK, TARSI
from featherfx.shot.motion.joints import (
    JointPoses,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    still_poses,
)
from featherfx.shot.types import Motion, Shot

TAIL = "tail"  # the joint that a tail hangs on


def shaken(motion: Motion, _shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom that swings along a line as a whole, from rest."""
    values, joints = motion.values, len(skeleton.names)
    axis = np.asarray(values["direction"], dtype=np.float64)
    way = values["amplitude"] / np.linalg.norm(axis) * axis

    def poses(time: float) -> JointPoses:
        found = still_poses(joints)
        periods = max(time, 0.0) * values["frequency"]
        swing = math.sin(2.0 * math.pi * periods) * smooth_step(periods / values["ramp_periods"])
        found.displacements[0] = swing * way
        return found

    return poses


def swung(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that swing about an axis, from rest.

    Raises MissingJointError where none of the joints is there.
    """
    values = motion.values
    pattern = values["joints"]
    moved = [k for k, name in enumerate(skeleton.names) if fnmatch.fnmatchcase(name, pattern)]
    if not moved:
        known = ", ".join(skeleton.names[1:]) or "none"
        message = f"'{pattern}' is no joint of the groom. There are: {known}"
        raise MissingJointError(Problem(str(shot.source), "motion.joints", message))
    axis = math.radians(values["angle"]) * np.asarray(values["axis"], dtype=np.float64)

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        swings = max(time, 0.0) * values["frequency"]
        way = math.sin(2.0 * math.pi * (swings - values["phase"]))
        way *= smooth_step(swings / values["ramp_periods"])
        found.rotations[moved] = from_rotation_vector(way * axis)
        return found

    return poses


def levelled(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom whose trunk rises no steeper than by an angle, from the root of its tail to
    the middle between its shoulders, and its neck no steeper than by another; tarsi and the head
    keep their direction.

    Raises MissingJointError where it has no tail or no shoulders.
    """
    trunk = trunk_of(shot.groom)
    if trunk is None:
        told = f"levels a trunk, and the groom lacks shoulders or the joint '{TAIL}'"
        raise MissingJointError(Problem(str(shot.source), "motion.kind", told))
    middle, rise = trunk
    down = max(rise - math.radians(motion.values["trunk_angle"]), 0.0)
    found = still_poses(len(skeleton.names))
    found.rotations[0] = _nose_down(down)
    tarsi = [k for k, name in enumerate(skeleton.names) if name in TARSI]
    found.rotations[tarsi] = found.rotations[0].T
    found.displacements[0] = (middle - found.rotations[0] @ middle) / motion.clock.size
    if HEAD in skeleton.names and NECK in skeleton.names:
        neck, head = skeleton.names.index(NECK), skeleton.names.index(HEAD)
        way, tail = skeleton.pivots[head] - skeleton.pivots[neck], skeleton.names.index(TAIL)
        steeper = math.atan2(way[2], way[0]) - down - math.radians(motion.values["neck_angle"])
        # short necks bend no tighter than round the length of the trunk
        most = np.linalg.norm(way) / np.linalg.norm(middle - skeleton.pivots[tail])
        bent = min(max(steeper, 0.0), float(most))
        found.rotations[neck], found.rotations[head] = _nose_down(bent), _nose_down(-bent)
    return lambda _: found


def _nose_down(angle: float) -> Array:
    """(3, 3) turn by an angle (rad) about the axis to the left."""
    return from_rotation_vector(np.array((0.0, angle, 0.0)))


def trunk_of(groom: Groom) -> tuple[Array, float] | None:
    """(3,) m, the middle between the shoulders of a groom, and rad, by which its trunk rises to
    there from the root of its tail; None where it lacks either."""
    shoulders = [each.position for each in groom.joints if each.role == "shoulder" and each.side]
    tails = [each.position for each in groom.joints if each.name == TAIL]
    if not (shoulders and tails):
        return None
    middle = np.mean(shoulders, axis=0) * (1.0, 0.0, 1.0)
    ahead, _, up = middle - tails[0]
    return middle, math.atan2(up, ahead)
