"""The motion of a shot: which source moves its roots, and the paths that the solver follows."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.rotation import frames_to_quats, rotation_vectors
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.errors import InputError
from featherfx.shot.direction.roots import directed
from featherfx.shot.motion.act import clocked, together
from featherfx.shot.motion.flap import flapping, folding
from featherfx.shot.motion.joints import (
    JointPoses,
    PosesOverTime,
    Skeleton,
    held,
    joint_roots,
    shaken,
    skeleton_of,
    swung,
)
from featherfx.shot.motion.keys import keyed
from featherfx.shot.motion.limbs import carried, on_bones
from featherfx.shot.motion.roots import SAMPLES, Roots, arrived
from featherfx.shot.types import Motion, Shot
from featherfx.solver.state import RootPath


def root_motion(shot: Shot) -> Roots:
    """What moves the roots of a shot, its channels included.

    Beside a skin the motion's limbs count, and the skin carries them; without them the bones of a
    skeleton move wings. Raises InputError for a motion whose joints the groom lacks.
    """
    if shot.skin is not None and not shot.motion.of_limbs:
        return directed(shot, on_bones(shot.groom, shot.skin))
    skeleton = skeleton_of(shot.groom)
    poses = _poses(shot.motion, shot, skeleton)
    if shot.skin is None:
        return directed(shot, joint_roots(shot.groom, skeleton, poses))
    limbs = joint_roots(shot.groom, skeleton, _without_body(poses))
    return directed(shot, carried(shot.groom, shot.skin, limbs))


def _poses(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    return clocked(_unclocked(motion, shot, skeleton), motion.clock)


def _unclocked(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    values, joints, source = motion.values, len(skeleton.names), str(shot.source)
    match motion.kind:
        case "hold":
            return held(joints)
        case "shake":
            return shaken(joints, values)
        case "flap":
            return flapping(shot.groom, values, source)
        case "fold":
            return folding(shot.groom, values, source)
        case "keys":
            far = max(each.kind.length for each in shot.groom.feathers)
            return keyed(values["keyframes"], skeleton, 1.0 / shot.frames_per_second, far)
        case "swing":
            return swung(skeleton, values, source)
        case "act":
            return _act(values["motions"], shot, skeleton)
        case kind:
            raise ValueError(f"no motion is of kind {kind!r}")


def _act(parts: tuple[Motion, ...], shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Parts whose joints are there. Raises InputError where there are none."""
    found: list[PosesOverTime] = []
    lacking: list[InputError] = []
    for part in parts:
        try:
            found.append(_poses(part, shot, skeleton))
        except InputError as error:
            lacking.append(error)
    if not found:
        raise lacking[0]
    return together(found, skeleton)


def _without_body(poses: PosesOverTime) -> PosesOverTime:
    def limbs(time: float) -> JointPoses:
        found = poses(time)
        rotations, displacements = found.rotations.copy(), found.displacements.copy()
        rotations[0], displacements[0] = np.eye(3), 0.0
        return found._replace(rotations=rotations, displacements=displacements)

    return limbs


def root_path(motion: Roots, members: Indices, start: float, end: float) -> RootPath:
    """Paths of the roots with indices members (F,) from start to end (s)."""
    times = np.linspace(start, end, SAMPLES)[1:]
    frames = [arrived(motion, start), *(motion.frames(time) for time in times)]
    positions = np.stack([each.positions[members] for each in frames], axis=1)
    rotations = np.stack([each.rotations[members] for each in frames], axis=1)
    relative = np.einsum("fkij,flj->fkil", rotations, rotations[:, 0])
    vectors = rotation_vectors(relative)
    for k in range(1, SAMPLES):
        vectors[:, k] = _nearest_branch(vectors[:, k], vectors[:, k - 1])
    samples = np.concatenate([positions, vectors], axis=2)
    return RootPath(samples, frames_to_quats(rotations[:, 0]))


def _nearest_branch(vectors: Array, before: Array) -> Array:
    """Rotation vectors (F, 3) on the branch (full turns added) nearest to those before."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = np.divide(vectors, angle, out=np.zeros_like(vectors), where=angle > 1e-12)
    turns = np.round((dots(before, axis) - angle[:, 0]) / (2 * np.pi))
    return vectors + 2 * np.pi * turns[:, None] * axis
