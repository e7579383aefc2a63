"""The motion of a shot: which source moves its roots, and the paths that the solver follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from featherfx.algebra.interpolation import eased
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import dots, frames_to_quats, rotation_vectors, vectors_to_frames
from featherfx.groom.keys.preset import UNSCALED_CLOCK, Clock
from featherfx.packages import MOTION_SOURCES, brought, load_name
from featherfx.shot.frames import NO_CUTS
from featherfx.shot.motion.joints import (
    JointPoses,
    PosesOverTime,
    Skeleton,
    joint_roots,
    skeleton_of,
)
from featherfx.shot.roots import SAMPLES, Roots, arrived
from featherfx.shot.types import Motion, Shot
from featherfx.solver.state import RootPath


def root_motion(shot: Shot) -> Roots:
    """Find what moves the roots of a shot, its channels and cuts included.

    Raises InputError for a motion whose joints the groom lacks.
    """
    return uncut_motion(prepare_cuts(shot))


def prepare_cuts(shot: Shot) -> Shot:
    """The shot with its cuts, where anything moves."""
    if shot.frame_cuts is not NO_CUTS or not (shot.has_moving_roots or shot.colliders):
        return shot
    found: Shot = load_name("motion.cuts:with_cuts")(shot)
    return found


def uncut_motion(shot: Shot) -> Roots:
    """The same as its stages and keyframes have it where they are not led by cuts."""
    motion = undirected_motion(shot)
    for change in brought(shot, "roots"):
        motion = change(shot, motion)
    return motion


def undirected_motion(shot: Shot) -> Roots:
    """Beside a skin the motion's limbs count, and the skin carries them; without them the bones of
    a skeleton move wings."""
    if shot.skin is None:
        skeleton = skeleton_of(shot.groom)
        return joint_roots(shot.groom, skeleton, joint_poses(shot.motion, shot, skeleton))
    skin_roots = load_name("motion.limbs:skin_roots")
    if not shot.motion.of_limbs:
        return skin_roots(shot.groom, shot.skin)
    skeleton = skeleton_of(shot.groom)
    poses = without_body(joint_poses(shot.motion, shot, skeleton))
    return skin_roots(shot.groom, shot.skin, joint_roots(shot.groom, skeleton, poses))


def joint_poses(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of the joints of a shot's groom under a motion, in the time of its clock."""
    if motion.kind == "act":
        motion = _size_of_parts(motion)
    clock, source = motion.clock, load_name(MOTION_SOURCES[motion.kind])
    if clock == UNSCALED_CLOCK:
        poses: PosesOverTime = source(motion, shot, skeleton)
        return poses
    # what falls does so in its own ways and time, which the clock takes to the shot's
    own = replace(shot, gravity=shot.gravity / (clock.size * clock.tempo**2))
    return _clocked_poses(source(motion, own, skeleton), clock)


def _size_of_parts(motion: Motion) -> Motion:
    """An act whose parts have its size, so that it puts them together in the groom's own."""
    size, parts = motion.clock.size, motion.values["motions"]
    parts = tuple(replace(p, clock=replace(p.clock, size=size * p.clock.size)) for p in parts)
    clock = replace(motion.clock, size=1.0)
    return replace(motion, values=motion.values | {"motions": parts}, clock=clock)


def _clocked_poses(poses: PosesOverTime, clock: Clock) -> PosesOverTime:
    """Poses in the time, and by the amount, of a clock."""
    times, amounts = zip(*clock.amount, strict=True)

    def changed(time: float) -> JointPoses:
        own = (time - clock.start) * clock.tempo
        found, amount = poses(own), eased(times, amounts, own)
        if amount == 1.0 == clock.size:
            return found
        fraction = min(amount, 1.0)
        return JointPoses(
            rotations=scaled_turns(found.rotations, amount),
            displacements=clock.size * amount * found.displacements,
            bends=amount * found.bends,
            folds=amount * found.folds,
            aims=fraction * found.aims,
            taken=fraction * found.taken,
        )

    return changed


def scaled_turns(rotations: Array, amount: Array | float) -> Array:
    """Part of (J, 3, 3) rotations, about their axes."""
    return vectors_to_frames(amount * rotation_vectors(rotations))


def without_body(poses: PosesOverTime) -> PosesOverTime:
    """Poses of joints that leave the groom itself where it is."""

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
