"""Where the roots of all feathers are at any time: the motion of a shot, evaluated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import smooth_step
from featherfx.errors import InputError, Problem
from featherfx.groom.types import Groom
from featherfx.shot.motion.flap import Flap, roles_of
from featherfx.shot.motion.keys import keys_of
from featherfx.shot.motion.skeleton import Skeleton, skeleton_of
from featherfx.shot.types import Shot

Array = NDArray[np.float64]
# Time in s to rotations (J, 3, 3) and displacements (J, 3) of the joints against their parents.
LocalPoses = Callable[[float], tuple[Array, Array]]


class Roots(Protocol):
    """Whatever moves roots."""

    def frames(self, time: float) -> tuple[Array, Array]:
        """Root positions (F, 3) m and rotations (F, 3, 3) in the world frame at a time in s."""


@dataclass(frozen=True)
class RootMotion:
    """Roots of F feathers that are carried by the joints of a skeleton.

    joints: (F,) number of each feather's joint. positions: (F, 3) m and rotations: (F, 3, 3), at
    rest in the groom's frame. poses: joints' poses against their parents over time.
    """

    skeleton: Skeleton
    joints: NDArray[np.int64]
    positions: Array
    rotations: Array
    poses: LocalPoses

    def frames(self, time: float) -> tuple[Array, Array]:
        """Root positions (F, 3) m and rotations (F, 3, 3) in the world frame at a time in s.

        Columns of a rotation are the feather's x, y and z axes. Smooth in time; times before 0
        give the pose at 0 for hold, shake and flap, and the first keyframe's for keys.
        """
        turns, shifts = self.skeleton.pose(*self.poses(time))
        carriers = turns[self.joints]
        positions = (carriers @ self.positions[:, :, None])[..., 0] + shifts[self.joints]
        return positions, carriers @ self.rotations


def root_motion(shot: Shot) -> Roots:
    """The root motion of a shot.

    Raises InputError for a flap where the groom has no shoulder on either side.
    """
    if shot.skin is not None:
        return shot.skin
    groom = shot.groom
    skeleton = skeleton_of(groom)
    index = {name: number for number, name in enumerate(skeleton.names)}
    return RootMotion(
        skeleton=skeleton,
        joints=np.array([index[feather.joint] for feather in groom.feathers], dtype=np.int64),
        positions=np.array([f.position for f in groom.feathers], dtype=np.float64).reshape(-1, 3),
        rotations=np.array([f.rotation for f in groom.feathers]).reshape(-1, 3, 3),
        poses=_local_poses(shot, skeleton),
    )


def _local_poses(shot: Shot, skeleton: Skeleton) -> LocalPoses:
    values = shot.motion.values
    joints = len(skeleton.names)
    match shot.motion.kind:
        case "hold":
            still = _at_rest(joints)
            return lambda time: still
        case "shake":
            return _shake(joints, values["amplitude"], values["frequency"], values["direction"])
        case "flap":
            return _flap(shot.groom, Flap(values), str(shot.source))
        case "keys":
            return keys_of(values["keyframes"], skeleton)
        case kind:
            raise ValueError(f"no motion is of kind {kind!r}")


def _at_rest(joints: int) -> tuple[Array, Array]:
    return np.broadcast_to(np.eye(3), (joints, 3, 3)).copy(), np.zeros((joints, 3))


def _shake(joints: int, amplitude: float, frequency: float, direction: Array) -> LocalPoses:
    """The whole groom swings by amplitude (m) along direction, from rest within 1/4 period."""
    axis = np.asarray(direction, dtype=np.float64)
    axis = axis / np.linalg.norm(axis)

    def poses(time: float) -> tuple[Array, Array]:
        turns, shifts = _at_rest(joints)
        periods = max(time, 0.0) * frequency
        swing = math.sin(2.0 * math.pi * periods) * smooth_step(4.0 * periods)
        shifts[0] = amplitude * swing * axis
        return turns, shifts

    return poses


def _flap(groom: Groom, flap: Flap, source: str) -> LocalPoses:
    if not any(joint.role == "shoulder" and joint.side for joint in groom.joints):
        message = 'a flap needs a joint with role = "shoulder" and side = 1 or -1 in the groom'
        raise InputError(Problem(source, "motion.kind", message))
    roles = roles_of(groom.joints)
    right = np.array([False, *(joint.side < 0 for joint in groom.joints)])
    still = np.zeros((len(roles), 3))
    return lambda time: (flap.rotations(roles, right, time), still)
