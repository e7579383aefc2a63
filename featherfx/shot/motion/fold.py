"""Wings, tails and crests that open and close: their joints turn about their hinges over time."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from typing import Any

import numpy as np

from featherfx.algebra.ease import eased
from featherfx.algebra.rotation import from_rotation_vector
from featherfx.errors import InputError, Problem
from featherfx.groom.types import Groom
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, still_poses


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
        message = f"'{pattern}' is no joint that folds; those of wings, tails and crests do"
        raise InputError(
            Problem(source, "motion.joints", f"{message}: {known or 'there are none'}")
        )
    times, folds = ([key[name] for key in keys] for name in ("time", "fold"))

    def poses(time: float) -> JointPoses:
        found = still_poses(len(groom.joints) + 1)
        fold = eased(times, folds, time)
        for number, joint in hinged:
            turn = np.asarray(joint.hinge) * (fold - joint.fold)
            found.rotations[number] = from_rotation_vector(turn)
        return found

    return poses
