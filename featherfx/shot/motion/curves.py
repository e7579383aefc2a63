"""Motion of a joint along an attribute of a USD stage: time samples, or a spline.

With the stage's axes as columns of B in the groom's, a place d of the stage, in its units of s
metres, is s B d, and a turn R is B R B^T.
"""

from __future__ import annotations

from fnmatch import fnmatchcase

import numpy as np

from featherfx.algebra.vectors import from_angles, quats_to_frames
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton, still_poses
from featherfx.shot.types import Motion, Shot


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
