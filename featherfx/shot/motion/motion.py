"""The motion of a shot: which source moves its roots, and the paths that the solver follows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import frames_to_quats, rotation_vectors
from featherfx.shot.direction.roots import directed
from featherfx.shot.motion.flap import flapping
from featherfx.shot.motion.fold import folding
from featherfx.shot.motion.joints import (
    PosesOverTime,
    Skeleton,
    held,
    joint_roots,
    shaken,
    skeleton_of,
)
from featherfx.shot.motion.keys import keyed
from featherfx.shot.motion.limbs import carried
from featherfx.shot.motion.roots import SAMPLES, Roots, arrived
from featherfx.shot.types import Shot
from featherfx.solver.step.root_path import RootPath

Array = NDArray[np.float64]


def root_motion(shot: Shot) -> Roots:
    """What moves the roots of a shot, its channels included.

    Raises InputError for a flap where the groom has no shoulder on either side.
    """
    if shot.skin is not None and shot.motion.kind != "fold":
        return directed(shot, shot.skin)
    skeleton = skeleton_of(shot.groom)
    roots: Roots = joint_roots(shot.groom, skeleton, _poses(shot, skeleton))
    if shot.skin is not None:
        roots = carried(shot.groom, shot.skin, roots)
    return directed(shot, roots)


def _poses(shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    values, joints = shot.motion.values, len(skeleton.names)
    match shot.motion.kind:
        case "hold":
            return held(joints)
        case "shake":
            return shaken(joints, values["amplitude"], values["frequency"], values["direction"])
        case "flap":
            return flapping(shot.groom, values, str(shot.source))
        case "fold":
            return folding(shot.groom, values, str(shot.source))
        case "keys":
            return keyed(values["keyframes"], skeleton)
        case kind:
            raise ValueError(f"no motion is of kind {kind!r}")


def root_path(motion: Roots, members: NDArray[np.int64], start: float, end: float) -> RootPath:
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
    turns = np.round((np.einsum("fk,fk->f", before, axis) - angle[:, 0]) / (2 * np.pi))
    return vectors + 2 * np.pi * turns[:, None] * axis
