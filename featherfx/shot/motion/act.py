"""Motions with a clock and an amount of their own, one upon the other.

A part moves the groom as the parts before it have left it: with carriers C of the joints so far,
R their rotations against their parents and F that of the part, a joint whose parent is p turns by

    C_p^T F C_p R

against its parent at rest, so that the axes of F are the groom's in the pose before. Turns about a
joint's own hinge go with the joint. A fold replaces the one that parts before have brought a joint
to, by its amount; an act does so with all that parts before have done to joints that it folds.

The lift that heaves a body leans with its bank: it goes along n, the axis across the body's heading
and its left, and its mean still bears the weight, so that a height h is heaved as h n / n_up.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import unit
from featherfx.shot.motion.body_joints import HEAD
from featherfx.shot.motion.joints import (
    JointPoses,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    still_poses,
)
from featherfx.shot.motion.motion import joint_poses, scaled_turns
from featherfx.shot.motion.steady_head import SteadyHead
from featherfx.shot.types import Motion, Shot

# share of a body's lift that bears its weight: of one that is level, and least that counts, so
# that bodies on their sides do not heave without bound
_LEVEL, _MIN_SHARE = 1.0 - 1e-12, 0.5


def acted(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of the parts of an act, one upon the other, with a steady head.

    A part whose joints the groom lacks is left out. Raises InputError where none is left.
    """
    calm = _composed(_without_heave(motion), shot, skeleton)
    poses = _banked(_composed(motion, shot, skeleton), calm, -unit(shot.gravity))
    share = motion.values.get("steady_head", 0.0)
    if share == 0.0 or HEAD not in skeleton.names:
        return poses
    level, levels = None, _levels_of(motion)
    if levels.values["motions"]:
        with contextlib.suppress(MissingJointError):
            level = _composed(levels, shot, skeleton)
    return SteadyHead(poses, calm, skeleton, share, level)


def _levels_of(motion: Motion) -> Motion:
    """An act with its parts alone that level trunks."""
    parts = tuple(map(_levels_of, motion.values.get("motions", ())))
    kept = [each for each in parts if each.kind == "level" or each.values.get("motions")]
    return replace(motion, values=motion.values | {"motions": tuple(kept)})


def _banked(poses: PosesOverTime, calm: PosesOverTime, up: Array) -> PosesOverTime:
    """Poses whose heave leans with the bank. calm: without heave. up: (3,)."""

    def leant(time: float) -> JointPoses:
        found = poses(time)
        ahead, left = found.rotations[0][:, :2].T
        lift = unit(np.cross(ahead - (ahead @ up) * up, left))
        share = float(lift @ up)
        if share < _LEVEL:
            still = calm(time).displacements[0]
            height = (found.displacements[0] - still) @ up
            found.displacements[0] += height * (lift / max(share, _MIN_SHARE) - up)
        return found

    return leant


def _without_heave(motion: Motion) -> Motion:
    """A motion whose beats neither heave nor pitch the body."""
    values = dict(motion.values)
    if motion.kind == "act":
        values["motions"] = tuple(map(_without_heave, values["motions"]))
    elif motion.kind == "flap":
        values |= {"heave": 0.0, "pitch": 0.0}
    return replace(motion, values=values)


def _composed(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of the parts of an act, one upon the other. Raises InputError."""
    parts: list[PosesOverTime] = []
    lacking: list[MissingJointError] = []
    for part in motion.values["motions"]:
        try:
            parts.append(joint_poses(part, shot, skeleton))
        except MissingJointError as error:
            lacking.append(error)
    if not parts:
        raise lacking[0]
    compose = PoseComposer.of(skeleton)

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        for part in parts:
            found = compose(found, part(time))
        return found._replace(taken=found.aims)

    return poses


@dataclass(frozen=True)
class PoseComposer:
    """One pose upon another. parents: (J,)."""

    skeleton: Skeleton
    parents: Indices

    @classmethod
    def of(cls, skeleton: Skeleton) -> PoseComposer:
        parents = np.zeros(len(skeleton.names), dtype=np.int64)
        for joints, above in skeleton.levels:
            parents[joints] = above
        return cls(skeleton, parents)

    def __call__(self, before: JointPoses, then: JointPoses) -> JointPoses:
        kept = 1.0 - then.taken
        if then.taken.any():
            before = before._replace(
                rotations=scaled_turns(before.rotations, kept[:, None]), bends=kept * before.bends
            )
        limbs = before.rotations.copy()
        limbs[0] = np.eye(3)  # axes of limbs go with the groom
        still = np.zeros_like(before.displacements)
        carriers, _ = self.skeleton.carriers(before._replace(rotations=limbs, displacements=still))
        parents = carriers[self.parents]
        back = parents.transpose(0, 2, 1)
        rotations = back @ then.rotations @ parents @ before.rotations
        shifts = before.displacements + (back @ then.displacements[:, :, None])[:, :, 0]
        return JointPoses(
            rotations,
            shifts,
            before.bends + then.bends,
            (1.0 - then.aims) * before.folds + then.folds,
            1.0 - (1.0 - then.aims) * (1.0 - before.aims),
            1.0 - kept * (1.0 - before.taken),
        )
