"""Roots that are carried by the joints of a groom: a skeleton, and its poses over time."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from featherfx.algebra.interpolation import smooth_step
from featherfx.algebra.rotation import (
    from_rotation_vector,
    motions,
    rotation_vectors,
    shared_turns,
    vectors_to_frames,
)
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots
from featherfx.errors import InputError, Problem
from featherfx.groom.frames import bow_fraction
from featherfx.groom.types import Groom
from featherfx.shot.roots import RootFrames
from featherfx.shot.types import Motion, Shot

_TILTED = 0.5  # of a forearm's tilt, that a feather beside the elbow takes; measured on an owl


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
    whole fold, 0 where there is none.
    """

    names: tuple[str, ...]
    pivots: Array
    levels: tuple[tuple[Indices, Indices], ...]
    hinges: Array

    def turned(self, poses: JointPoses) -> Array:
        """(J, 3, 3) rotations of joints against their parents, with those about their hinges."""
        bent = poses.bends + poses.folds
        if not bent.any():
            return poses.rotations
        return poses.rotations @ vectors_to_frames(bent[:, None] * self.hinges)

    def carriers(self, poses: JointPoses) -> tuple[Array, Array]:
        """Rotations (J, 3, 3) and shifts (J, 3) such that a point x of the groom at rest that is
        carried by joint j goes to rotation x + shift."""
        rotations = self.turned(poses).copy()
        shifts = self.pivots + poses.displacements - _applied(rotations, self.pivots)
        for joints, parents in self.levels:
            carrier = rotations[parents]
            shifts[joints] = _applied(carrier, shifts[joints]) + shifts[parents]
            rotations[joints] = carrier @ rotations[joints]
        return rotations, shifts

    def poses(self, rotations: Array, shifts: Array) -> JointPoses:
        """Return the poses of joints that are carried so; see carriers. rotations: (J, 3, 3).
        shifts: (J, 3)."""
        own, away = rotations.copy(), shifts.copy()
        for joints, parents in self.levels:
            back = rotations[parents].swapaxes(1, 2)
            own[joints] = back @ rotations[joints]
            away[joints] = _applied(back, shifts[joints] - shifts[parents])
        return free_poses(own, away - self.pivots + _applied(own, self.pivots))


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
    return Skeleton(names, pivots, below, np.vstack([np.zeros(3), *hinges]))


@dataclass(frozen=True)
class Bows:
    """Bows of B of the feathers, which bend with their wings.

    members: (B,). joints: (B,) whose fold counts, carriers: (B,) that carry the bow. screws: (B, 6)
    of the whole bow at rest. hinges: (J, 3) 1/rad, of all joints, by which a turn since rest is
    more fold. folds: (J,) at rest.
    """

    members: Indices
    joints: Indices
    carriers: Indices
    screws: Array
    hinges: Array
    folds: Array

    def straightened(self, at_rest: RootFrames) -> RootFrames:
        """The roots at rest without the bow."""
        fraction = -bow_fraction(self.folds)[self.joints, None]
        still = np.tile(np.eye(3), (len(self.folds), 1, 1)), np.zeros((len(self.folds), 3))
        return self._bent(at_rest, fraction, *still)

    def bent(self, roots: RootFrames, turned: Array, rotations: Array, shifts: Array) -> RootFrames:
        """Roots of flat wings, bent as those of joints that are turned, (J, 3, 3), against their
        parents. rotations, shifts: of carriers."""
        turned = rotation_vectors(turned)
        folds = self.folds + dots(turned, self.hinges)
        return self._bent(roots, bow_fraction(folds)[self.joints, None], rotations, shifts)

    def _bent(
        self, roots: RootFrames, fraction: Array, rotations: Array, shifts: Array
    ) -> RootFrames:
        turns, ways = motions(fraction * self.screws)
        carrier, origin = rotations[self.carriers], shifts[self.carriers]
        turns = carrier @ turns @ carrier.swapaxes(1, 2)
        positions, frames = roots.positions.copy(), roots.rotations.copy()
        away = positions[self.members] - origin
        positions[self.members] = origin + _applied(turns, away) + _applied(carrier, ways)
        frames[self.members] = turns @ frames[self.members]
        return RootFrames(positions, frames)


def _bows(groom: Groom, index: dict[str, int]) -> Bows | None:
    found = [
        (number, index[turning.joints[1]], index[turning.joints[0]], turning.bow)
        for number, feather in enumerate(groom.feathers)
        if (turning := feather.turning) is not None and turning.bow is not None
    ]
    if not found:
        return None
    members, joints, carriers, screws = (np.array(each) for each in zip(*found, strict=True))
    hinges, folds = np.zeros((len(index), 3)), np.zeros(len(index))
    for number, joint in enumerate(groom.joints, 1):
        if joint.hinge is not None and joint.hinge.any():
            hinges[number] = joint.hinge / (joint.hinge @ joint.hinge)
            folds[number] = joint.fold
    return Bows(members, joints, carriers, screws, hinges, folds)


@dataclass(frozen=True)
class Tilts:
    """Tilts of T of the feathers, on the upper arms of wings, with forearms that leave the plane.

    In that plane they turn with the forearm, as all feathers do. Out of it each turns by its share
    alone: with the whole tilt, roots that stay in the upper arm's plane, side by side, would swap
    the order in which their vanes lie.

    members: (T,). arms, forearms: (T,) joints. dorsal: (T, 3) units at rest. shares: (T,).
    """

    members: Indices
    arms: Indices
    forearms: Indices
    dorsal: Array
    shares: Array

    def lessened(self, turns: Array, rotations: Array) -> Array:
        """Turns (F, 3, 3) without what is not theirs. rotations: (J, 3, 3), as carriers have."""
        arm, forearm = rotations[self.arms], rotations[self.forearms]
        relative = rotation_vectors(arm.swapaxes(1, 2) @ forearm)
        within = dots(relative, self.dorsal)[:, None] * self.dorsal
        own = within + self.shares[:, None] * (relative - within)
        own, _ = motions(np.concatenate([own, np.zeros_like(own)], axis=1))
        result = turns.copy()
        result[self.members] = arm @ own @ forearm.swapaxes(1, 2) @ turns[self.members]
        return result


def _tilts(groom: Groom, skeleton: Skeleton, index: dict[str, int]) -> Tilts | None:
    joints = {joint.name: joint for joint in groom.joints}
    members, arms, forearms, dorsal, shares = [], [], [], [], []
    for number, feather in enumerate(groom.feathers):
        if feather.turning is None:
            continue
        forearm = joints.get(feather.turning.joints[0])
        if forearm is None or forearm.role != "elbow" or forearm.parent != feather.joint:
            continue
        arm, there = index[feather.joint], index[forearm.name]
        if forearm.hinge is None or not forearm.hinge.any():
            continue
        bone = skeleton.pivots[there] - skeleton.pivots[arm]
        way = (feather.turning.anchor - skeleton.pivots[arm]) @ bone / (bone @ bone)
        members.append(number)
        arms.append(arm)
        forearms.append(there)
        dorsal.append(forearm.hinge / np.linalg.norm(forearm.hinge))
        shares.append(_TILTED * float(np.clip(way, 0.0, 1.0)))
    if not members:
        return None
    return Tilts(
        np.array(members), np.array(arms), np.array(forearms), np.array(dorsal), np.array(shares)
    )


@dataclass(frozen=True)
class JointRoots:
    """The F roots of a groom on its joints.

    joints: (F,) number of each feather's joint. between: (F, 2) of those that it turns between,
    and fractions: (F,) how far with the second. anchors: (F, 3) m, what the joint carries, about
    which the root turns. at_rest: the roots in the groom's frame, of flat wings. poses: of the
    joints over time. bows: of wings that bend as they fold.
    """

    skeleton: Skeleton
    joints: Indices
    between: Indices
    fractions: Array
    anchors: Array
    at_rest: RootFrames
    poses: PosesOverTime
    bows: Bows | None = None
    tilts: Tilts | None = None

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
        if self.tilts is not None:
            turns = self.tilts.lessened(turns, rotations)
        positions = _applied(rotations[self.joints], self.anchors) + shifts[self.joints]
        positions += _applied(turns, self.at_rest.positions - self.anchors)
        flat = RootFrames(positions, turns @ self.at_rest.rotations)
        if self.bows is None:
            return flat
        return self.bows.bent(flat, self.skeleton.turned(poses), rotations, shifts)


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
    bows = _bows(groom, index)
    if bows is not None:
        at_rest = bows.straightened(at_rest)
    tilts = _tilts(groom, skeleton, index)
    return JointRoots(skeleton, joints, between, fractions, anchors, at_rest, poses, bows, tilts)


def roots_at_rest(groom: Groom) -> RootFrames:
    """The roots of a groom as it is."""
    positions = np.array([each.position for each in groom.feathers], dtype=np.float64)
    rotations = np.array([each.rotation for each in groom.feathers])
    return RootFrames(positions.reshape(-1, 3), rotations.reshape(-1, 3, 3))


def held(_motion: Motion, _shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of joints that do not move."""
    still = still_poses(len(skeleton.names))
    return lambda time: still


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

    Raises InputError where none of the joints is there.
    """
    values = motion.values
    pattern = values["joints"]
    moved = [k for k, name in enumerate(skeleton.names) if fnmatch.fnmatchcase(name, pattern)]
    if not moved:
        known = ", ".join(skeleton.names[1:]) or "none"
        message = f"'{pattern}' is no joint of the groom. There are: {known}"
        raise InputError(Problem(str(shot.source), "motion.joints", message))
    axis = math.radians(values["angle"]) * np.asarray(values["axis"], dtype=np.float64)

    def poses(time: float) -> JointPoses:
        found = still_poses(len(skeleton.names))
        swings = max(time, 0.0) * values["frequency"]
        way = math.sin(2.0 * math.pi * (swings - values["phase"]))
        way *= smooth_step(swings / values["ramp_periods"])
        found.rotations[moved] = from_rotation_vector(way * axis)
        return found

    return poses


def still_poses(joints: int) -> JointPoses:
    """The poses at rest."""
    return free_poses(np.tile(np.eye(3), (joints, 1, 1)), np.zeros((joints, 3)))


def free_poses(rotations: Array, displacements: Array) -> JointPoses:
    """Poses of joints that do not turn about their hinges."""
    return JointPoses(rotations, displacements, *np.zeros((4, len(rotations))))


def _applied(matrices: Array, vectors: Array) -> Array:
    """(K, 3, 3) matrices times (K, 3) vectors."""
    return np.asarray((matrices @ vectors[:, :, None])[..., 0])
