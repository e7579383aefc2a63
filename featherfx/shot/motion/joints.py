"""Roots that are carried by the joints of a groom: a skeleton, and its poses over time.

Joints of a body that acts move, and that no feather hangs on, are neck, head, legs and feet. They
stand in the groom beside its own ones where `[motion.joints]` names what they drive, at the pivots
of that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import applied, shared_turns, vectors_to_frames
from featherfx.errors import InputError
from featherfx.groom.types import Groom, Joint
from featherfx.shot.roots import RootFrames
from featherfx.shot.types import Motion, Shot

if TYPE_CHECKING:
    from featherfx.shot.motion.wing_turns import ArmTurns, Bows
    from featherfx.shot.sources import MovingSurface


NECK, HEAD = "neck", "head"
TARSI = "right_tarsus", "left_tarsus"
# hips, heels and feet
LEGS = tuple((f"{side}_leg", f"{side}_tarsus", f"{side}_foot") for side in ("right", "left"))
# by their parents
BODY_JOINTS: Mapping[str, str] = {
    NECK: "",
    HEAD: NECK,
    "right_leg": "",
    "left_leg": "",
    "right_tarsus": "right_leg",
    "left_tarsus": "left_leg",
    "right_foot": "right_tarsus",
    "left_foot": "left_tarsus",
}


def with_body_joints(
    groom: Groom, driven: Mapping[str, str], surfaces: Sequence[MovingSurface]
) -> Groom:
    """A groom with those joints of bodies that drive joints of surfaces. driven: names of these by
    theirs."""
    known = {joint.name for joint in groom.joints}
    added: list[Joint] = []
    for name in BODY_JOINTS:
        for surface in surfaces:
            tree = surface.joint_tree
            if name in driven and name not in known and tree is not None:
                for place in tree.find(driven[name]):
                    known.add(name)
                    parent = BODY_JOINTS[name]
                    while parent and parent not in known:
                        parent = BODY_JOINTS[parent]
                    pivot = surface.joint_matrices(None)[place][3, :3]
                    added.append(Joint(name, pivot, parent))
    return replace(groom, joints=(*groom.joints, *added)) if added else groom


class MissingJointError(InputError):
    """Joints that a motion moves and the groom lacks."""


class JointPoses(NamedTuple):
    """rotations: (J, 3, 3), about the pivots, and displacements: (J, 3) m, of joints against their
    parents, whose axes are the groom's at rest.

    Before they rotate, joints turn about their own hinges by bends + folds, (J,), since rest and in
    whole folds. Of a motion upon another (act.py), bends are added and folds are what joints are
    brought to by a share aims, (J,). taken: (J,) share of all other that was done to the joint
    which is undone.
    """

    rotations: Array
    displacements: Array
    bends: Array
    folds: Array
    aims: Array
    taken: Array


# poses of all joints at a time in s
PosesOverTime = Callable[[float], JointPoses]


@dataclass(frozen=True)
class Skeleton:
    """J joints of which joint 0, named "", is the groom itself and the parent of all.

    names: of the joints. pivots: (J, 3) m, at rest in the groom's frame. levels: per depth below
    the groom, (joints, parents), index arrays of equal length. hinges: (J, 3) rad, turns of a
    whole fold, 0 where there is none. folds: (J,) at rest.
    """

    names: tuple[str, ...]
    pivots: Array
    levels: tuple[tuple[Indices, Indices], ...]
    hinges: Array
    folds: Array

    def below(self, joint: int) -> list[int]:
        """Return a joint and all that hang on it."""
        found = [joint]
        for joints, parents in self.levels:
            found += [int(each) for each, of in zip(joints, parents, strict=True) if of in found]
        return found

    def turned(self, poses: JointPoses) -> Array:
        """(J, 3, 3) rotations of joints against their parents, with those about their hinges."""
        if not (poses.bends.any() or poses.folds.any()):
            return poses.rotations
        bent = poses.bends + poses.folds
        return poses.rotations @ vectors_to_frames(bent[:, None] * self.hinges)

    def carriers(self, poses: JointPoses) -> tuple[Array, Array]:
        """Rotations (J, 3, 3) and shifts (J, 3) such that a point x of the groom at rest that is
        carried by joint j goes to rotation x + shift."""
        rotations = self.turned(poses).copy()
        shifts = self.pivots + poses.displacements - applied(rotations, self.pivots)
        for joints, parents in self.levels:
            carrier = rotations[parents]
            shifts[joints] = applied(carrier, shifts[joints]) + shifts[parents]
            rotations[joints] = carrier @ rotations[joints]
        return rotations, shifts

    def poses(self, rotations: Array, shifts: Array) -> JointPoses:
        """Return the poses of joints that are carried so; see carriers. rotations: (J, 3, 3).
        shifts: (J, 3)."""
        own, away = rotations.copy(), shifts.copy()
        for joints, parents in self.levels:
            back = rotations[parents].swapaxes(1, 2)
            own[joints] = back @ rotations[joints]
            away[joints] = applied(back, shifts[joints] - shifts[parents])
        return free_poses(own, away - self.pivots + applied(own, self.pivots))


def skeleton_of(groom: Groom) -> Skeleton:
    """The skeleton of a groom whose joints form a tree."""
    names = ("", *(joint.name for joint in groom.joints))
    index = {name: number for number, name in enumerate(names)}
    parents = np.array([0, *(index[joint.parent] for joint in groom.joints)], dtype=np.int64)
    depths, ancestors = np.zeros(len(names), dtype=np.int64), np.arange(len(names))
    while ancestors.any():
        depths[ancestors > 0] += 1
        ancestors = parents[ancestors]
    levels = [np.flatnonzero(depths == depth) for depth in range(1, int(depths.max()) + 1)]
    pivots = np.vstack([np.zeros((1, 3)), *(np.reshape(j.position, (1, 3)) for j in groom.joints)])
    hinges = [np.zeros(3) if j.hinge is None else np.asarray(j.hinge) for j in groom.joints]
    below = tuple((joints, parents[joints]) for joints in levels)
    folds = np.array([0.0, *(j.fold for j in groom.joints)])
    return Skeleton(names, pivots, below, np.vstack([np.zeros(3), *hinges]), folds)


@dataclass(frozen=True)
class JointRoots:
    """The F roots of a groom on its joints.

    joints: (F,) number of each feather's joint. between: (F, 2) of those that it turns between,
    and fractions: (F,) how far with the second. anchors: (F, 3) m, what the joint carries, about
    which the root turns. at_rest: the roots in the groom's frame, of flat wings. poses: of the
    joints over time. bows: of wings that bend as they fold. arms: of feathers on upper arms.
    are_beaten: whether these take a share of beats; where bones fold wings it is none.
    """

    skeleton: Skeleton
    joints: Indices
    between: Indices
    fractions: Array
    anchors: Array
    at_rest: RootFrames
    poses: PosesOverTime
    bows: Bows | None = None
    arms: ArmTurns | None = None
    are_beaten: bool = True

    def frames(self, time: float) -> RootFrames:
        """Root frames at a time in s.

        Smooth in time; times before 0 give the pose at 0 for hold, shake and flap, and the first
        keyframe's for keys.
        """
        poses = self.poses(time)
        rotations, shifts = self.skeleton.carriers(poses)
        turns = shared_turns(
            rotations[self.between[:, 0]], rotations[self.between[:, 1]], self.fractions
        )
        if self.arms is not None:
            turns = self.arms.less_tilted(turns, rotations)
        positions = applied(rotations[self.joints], self.anchors) + shifts[self.joints]
        positions += applied(turns, self.at_rest.positions - self.anchors)
        found = RootFrames(positions, turns @ self.at_rest.rotations)
        if self.bows is not None:
            turned = self.skeleton.turned(poses._replace(bends=0.0 * poses.bends))
            folded = poses.folds if self.are_beaten else None
            found = self.bows.bent(found, self.at_rest, turned, rotations, folded)
        if self.arms is not None and self.are_beaten:
            found = self.arms.less_beaten(found, poses.rotations, rotations, shifts)
        return found


def joint_roots(groom: Groom, skeleton: Skeleton, poses: PosesOverTime) -> JointRoots:
    """The roots of a groom on its joints, which move by poses."""
    index = {name: number for number, name in enumerate(skeleton.names)}
    joints = np.array([index[feather.joint] for feather in groom.feathers], dtype=np.int64)
    between = np.column_stack([joints, joints])
    at_rest = roots_at_rest(groom)
    fractions, anchors = np.zeros(len(joints)), at_rest.positions.copy()
    for number, feather in enumerate(groom.feathers):
        if feather.turning is not None:
            between[number] = [index[name] for name in feather.turning.joints]
            fractions[number] = feather.turning.fraction
            anchors[number] = feather.turning.anchor
    bows, arms = None, None
    if any(feather.turning is not None for feather in groom.feathers):
        from featherfx.shot.motion.wing_turns import find_arm_turns, find_bows

        bows, arms = find_bows(groom, index), find_arm_turns(groom, skeleton.pivots, index)
        at_rest = at_rest if bows is None else bows.straightened(at_rest)
    return JointRoots(skeleton, joints, between, fractions, anchors, at_rest, poses, bows, arms)


def roots_at_rest(groom: Groom) -> RootFrames:
    """The roots of a groom as it is."""
    positions = np.array([each.position for each in groom.feathers], dtype=np.float64)
    rotations = np.array([each.rotation for each in groom.feathers])
    return RootFrames(positions.reshape(-1, 3), rotations.reshape(-1, 3, 3))


def held(_motion: Motion, _shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that do not move."""
    still = still_poses(len(skeleton.names))
    return lambda time: still


def still_poses(joints: int) -> JointPoses:
    """The poses at rest."""
    return free_poses(np.tile(np.eye(3), (joints, 1, 1)), np.zeros((joints, 3)))


def opened_poses(groom: Groom) -> JointPoses:
    """Poses of joints that stay, but for wings, tails and crests, which are open."""
    found = still_poses(len(groom.joints) + 1)
    found.folds[1:] = [-joint.fold for joint in groom.joints]
    return found


def free_poses(rotations: Array, displacements: Array) -> JointPoses:
    """Poses of joints that do not turn about their hinges."""
    return JointPoses(rotations, displacements, *np.zeros((4, len(rotations))))


def first_joints(groom: Groom) -> dict[str, str]:
    """The first joint of the limb that each joint is of, by names: a shoulder, whatever carries it,
    else the topmost."""
    joint_of = {joint.name: joint for joint in groom.joints}
    firsts: dict[str, str] = {}
    for joint in groom.joints:
        first = joint
        while first.parent and first.role != "shoulder":
            first = joint_of[first.parent]
        firsts[joint.name] = first.name
    return firsts


def of_wings(groom: Groom) -> Flags:
    """(F,) which feathers of a groom are carried by the joints of a wing."""
    shoulders = {each.name for each in groom.joints if each.role == "shoulder"}
    firsts = first_joints(groom)
    return np.array([firsts.get(each.joint) in shoulders for each in groom.feathers], dtype=bool)
