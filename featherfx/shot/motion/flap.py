"""Poses of a groom whose wings beat (beat.py), and of wings, tails and crests that fold.

They open and close by turns of their joints about their hinges over time.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from typing import Any

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.errors import Problem
from featherfx.groom.types import Groom
from featherfx.shot.motion.flap_fits import fitted_beat
from featherfx.shot.motion.joints import (
    JointPoses,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    still_poses,
)
from featherfx.shot.types import Motion, Shot


def flapping(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of a groom's joints that beat.

    A joint in the middle (side 0) has no wing to move and is driven as a body, as the groom itself
    is. Raises MissingJointError where the groom has no shoulder on either side. Wings that do not
    reach a span ratio come as near as they do, with a warning.
    """
    groom, source = shot.groom, str(shot.source)
    if not any(joint.role == "shoulder" and joint.side for joint in groom.joints):
        message = 'a flap needs a joint with role = "shoulder" and side = 1 or -1 in the groom'
        raise MissingJointError(Problem(source, "motion.kind", message))
    flap, wings = fitted_beat(motion.values, groom, skeleton, source)
    weight = float(np.linalg.norm(shot.gravity))
    up = -shot.gravity / weight if weight else np.zeros(3)
    shoulders = [each.position for each in groom.joints if each.role == "shoulder" and each.side]
    middle = np.mean(shoulders, axis=0) * (1.0, 0.0, 1.0) / motion.clock.size

    def poses(time: float) -> JointPoses:
        found = wings.poses(flap, flap.phase(time), time, eased(*flap.fold_factors, time))
        height, pitch = flap.heave(time, weight)
        turn = from_rotation_vector(np.array((0.0, -pitch, 0.0)))
        found.displacements[0] = height * up + middle - turn @ middle
        found.rotations[0] = turn
        return found

    return poses


def folded(motion: Motion, shot: Shot, _skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that fold, as a shot asks for it."""
    return folding(shot.groom, motion.values, str(shot.source))


def folding(groom: Groom, values: Mapping[str, Any], source: str) -> PosesOverTime:
    """Poses of the joints that fold. values: of the motion. source: of the shot, for messages.

    Raises MissingJointError where none of the joints meant folds.
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
        raise MissingJointError(
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
