"""Motions with a clock and an amount of their own, one upon the other.

A part moves the groom as the parts before it have left it: with carriers C of the joints so far,
R their rotations against their parents and F that of the part, a joint whose parent is p turns by

    C_p^T F C_p R

against its parent at rest, so that the axes of F are the groom's in the pose before. Turns about a
joint's own hinge go with the joint. A fold replaces the one that parts before have brought a joint
to, by its amount; an act does so with all that parts before have done to joints that it folds.

The lift that heaves a body leans with its bank: it goes along n, the axis across the body's heading
and its left, and its mean still bears the weight, so that a height h is heaved as h n / n_up.

Heads that stay level and do not heave while the body does, as birds hold them.

With the turn R of the body and its heading H, the turn about the vertical by which its axis points
ahead, the head is turned by R^T H against the body. The neck takes a part of that, and then turns
towards the place that the head has without heave and pitch of the beats. What is left of the way
there is the head's. Where beats heave the body by more than w_0, a part of the neck's length,
either way, by w, it goes a share of the way,

    w_0 (1 + tanh(w / w_0 - 1)) / w,

so that short necks take their heads along, and as softly as the body moves. Of the turn L that
levels a trunk (beat.py), which is the first, the head takes back a share alone, so that they do not
fold: it is turned by R^T H L^a, a = s (1 - share), with s from 0 to 1 as the body without beats is
pitched down from 0 to L.

Feet that stand while the body goes, by a share that changes over time.

A leg of two bones of lengths l1 and l2 from the hip reaches towards the place of its foot at rest,
d from the hip, by r. Beyond its reach d_0 at rest it stretches ever less, as it would snap straight
at its full length l1 + l2. Its first bone leans from the way by b:

    r = d,  of d > d_0:  d_0 + s (1 - exp((d_0 - d) / s)),  s = l1 + l2 - d_0
    cos(b) = (l1^2 + r^2 - l2^2) / (2 l1 r),

to the side to which the leg is bent at rest, in the plane of the way and of that bend. The foot
itself keeps its direction. So bodies that crouch and rise push off.

Source: Ros and Biewener, Pigeons (C. livia) follow their head during turning flight, Frontiers in
Neuroscience 11 (2017) 655, summary: the head is steady while the body turns.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from featherfx.algebra.interpolation import eased, smooth_step
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_from, from_rotation_vector, parallel, unit
from featherfx.shot.motion.beat import Flap, Track, track_of
from featherfx.shot.motion.joints import (
    HEAD,
    LEGS,
    NECK,
    JointPoses,
    MissingJointError,
    PosesOverTime,
    Skeleton,
    still_poses,
)
from featherfx.shot.motion.motion import joint_poses, scaled_turns
from featherfx.shot.types import Motion, Shot

_NECK_SHARE = 0.45  # of the turn that levels the head; by eye
_LEVEL_SHARE = 0.3  # of a trunk's turn to level that the head takes back; by eye
_NECK_WAY = 0.5  # of the way of the head, that the root of the neck goes along; by eye
_FARTHEST = 0.05  # w_0, of the neck's length; by eye


@dataclass(frozen=True)
class SteadyHead:
    """Poses with a steady head. calm: without heave and pitch. heave: m, by which beats heave the
    body either way at a time in s. share: of what is taken back.

    level: poses that level the trunk; None: there are none."""

    own: PosesOverTime
    calm: PosesOverTime
    heave: Callable[[float], float]
    skeleton: Skeleton
    share: float
    level: PosesOverTime | None = None

    def __call__(self, time: float) -> JointPoses:
        """Return the poses of joints at a time in s."""
        names, pivots = self.skeleton.names, self.skeleton.pivots
        head, there = names.index(HEAD), self._levelled(self.calm, time)
        found = self._levelled(self.own, time)
        turns, shifts = self.skeleton.carriers(there)
        goal = turns[head] @ pivots[head] + shifts[head]
        turns, shifts = self.skeleton.carriers(found)
        place = turns[head] @ pivots[head] + shifts[head]
        way, above = self.share * (goal - place), turns[0]
        if NECK in names:
            neck = names.index(NECK)
            free = _FARTHEST * float(np.linalg.norm(pivots[head] - pivots[neck]))
            whole = self.share * self.heave(time)
            if whole > free:
                way = way * (free + free * math.tanh(whole / free - 1.0)) / whole
        goal = place + way
        if NECK in names:
            way = _NECK_WAY * way
            found.displacements[neck] += turns[0].T @ way
            base, place = turns[neck] @ pivots[neck] + shifts[neck] + way, place + way
            turn = _turn_between(place - base, goal - base)
            place, above = base + turn @ (place - base), turn @ turns[neck]
            found.rotations[neck] = turns[0].T @ above
            found.rotations[head] = above.T @ turns[head]
        found.displacements[head] += above.T @ (goal - place)
        return found

    def _levelled(self, source: PosesOverTime, time: float) -> JointPoses:
        """Poses whose head is level."""
        poses = source(time)
        names, rotations = self.skeleton.names, poses.rotations.copy()
        heading = math.atan2(rotations[0, 1, 0], rotations[0, 0, 0])
        level = from_rotation_vector(np.array((0.0, 0.0, heading)))
        if self.level is not None:
            trunk = self.level(time).rotations[:1]
            steady = self.calm(time).rotations[0]
            down, most = (math.asin(np.clip(-each[2, 0], -1.0, 1.0)) for each in (steady, trunk[0]))
            part = smooth_step(down / most) if most > 0.0 else 0.0
            level = level @ scaled_turns(trunk, part * (1.0 - _LEVEL_SHARE))[0]
        back = scaled_turns((rotations[0].T @ level)[None], self.share)[0]
        whole = back @ rotations[names.index(NECK)] if NECK in names else back
        bent = np.eye(3)
        if NECK in names:
            bent = scaled_turns(back[None], _NECK_SHARE)[0] @ rotations[names.index(NECK)]
            rotations[names.index(NECK)] = bent
        head = names.index(HEAD)
        rotations[head] = bent.T @ whole @ rotations[head]
        return poses._replace(rotations=rotations, displacements=poses.displacements.copy())


def _turn_between(first: Array, second: Array) -> Array:
    """(3, 3) least turn from the direction of one (3,) to that of another."""
    axis = np.cross(first, second)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-15:
        return np.eye(3)
    return from_rotation_vector(math.atan2(sine, float(first @ second)) / sine * axis)


@dataclass(frozen=True)
class PlantedFeet:
    """Poses whose feet stand. planted: times (s) and shares. legs: (3,) hips, heels and feet, bent
    at rest. parents: (J,) of joints."""

    own: PosesOverTime
    skeleton: Skeleton
    planted: Track
    legs: Sequence[Indices]
    parents: Indices

    def __call__(self, time: float) -> JointPoses:
        """Return the poses of joints at a time in s."""
        found, share = self.own(time), eased(*self.planted, time)
        if share == 0.0:
            return found
        rotations = found.rotations.copy()
        turns, shifts = self.skeleton.carriers(found)
        for leg in self.legs:
            hip = turns[leg[0]] @ self.skeleton.pivots[leg[0]] + shifts[leg[0]]
            above = turns[self.parents[leg[0]]]
            for joint, turn in zip(leg, self._stand(leg, hip, above), strict=True):
                stands = above.T @ turn
                back = rotations[joint].T @ stands
                rotations[joint] = rotations[joint] @ scaled_turns(back[None], share)[0]
                above = turn
        return found._replace(rotations=rotations)

    def _stand(self, leg: Indices, hip: Array, above: Array) -> list[Array]:
        """(3, 3) turns of a leg's joints from rest, whose hip is at (3,) m. above: (3, 3), of what
        bears it."""
        upper, lower = np.diff(self.skeleton.pivots[leg], axis=0)
        first, second = np.linalg.norm(upper), np.linalg.norm(lower)
        way = self.skeleton.pivots[leg[2]] - hip
        bend = np.cross(upper, lower)
        aside = np.cross(way, np.cross(above @ bend, way))
        away, reach = float(np.linalg.norm(way)), float(np.linalg.norm(upper + lower))
        spare = float(first + second) - reach
        if away > reach:
            away = reach - spare * math.expm1((reach - away) / spare)
        cosine = (first**2 + away**2 - second**2) / (2.0 * first * away)
        lean = math.acos(np.clip(cosine, -1.0, 1.0))
        along = from_rotation_vector(-lean * unit(aside)) @ unit(way)
        rest = away * unit(way) - first * along
        return [
            frames_from(now, aside) @ frames_from(bone, bend).T
            for now, bone in ((along, upper), (rest, lower))
        ] + [np.eye(3)]


# share of a body's lift that bears its weight: of one that is level, and least that counts, so
# that bodies on their sides do not heave without bound
_LEVEL, _MIN_SHARE = 1.0 - 1e-12, 0.5


def acted(motion: Motion, shot: Shot, skeleton: Skeleton) -> PosesOverTime:
    """Poses of the parts of an act, one upon the other, with a steady head.

    A part whose joints the groom lacks is left out. Raises InputError where none is left.
    """
    calm = _composed(_without_heave(motion), shot, skeleton)
    poses = _banked(_composed(motion, shot, skeleton), calm, -unit(shot.gravity))
    share, names = motion.values.get("steady_head", 0.0), skeleton.names
    if share > 0.0 and HEAD in names:
        level, levels = None, _levels_of(motion)
        if levels.values["motions"]:
            with contextlib.suppress(MissingJointError):
                level = _composed(levels, shot, skeleton)
        heave = _heave_of(motion, float(np.linalg.norm(shot.gravity)))
        poses = SteadyHead(poses, calm, heave, skeleton, share, level)
    planted = track_of(motion.values.get("planted_feet", 0.0))
    whole = (np.array([names.index(k) for k in each]) for each in LEGS if {*each} <= {*names})
    bones = [(leg, np.diff(skeleton.pivots[leg], axis=0)) for leg in whole]
    legs = [leg for leg, (upper, lower) in bones if not parallel(upper, lower)]
    if not (any(planted[1]) and legs):
        return poses
    return PlantedFeet(poses, skeleton, planted, legs, PoseComposer.of(skeleton).parents)


def _heave_of(motion: Motion, gravity: float) -> Callable[[float], float]:
    """By how much (m) the beats of a motion heave a body either way, at a time in s of its own.
    gravity: m/s2."""
    if motion.kind == "flap":
        flap = Flap.read(motion.values)
        return lambda time: 0.5 * flap.heave_range(time, gravity)
    parts = [
        (each.clock, _heave_of(each, gravity / (each.clock.size * each.clock.tempo**2)))
        for each in motion.values.get("motions", ())
    ]

    def heave(time: float) -> float:
        found = 0.0
        for clock, own in parts:
            there = (time - clock.start) * clock.tempo
            times, amounts = zip(*clock.amount, strict=True)
            found += clock.size * eased(times, amounts, there) * own(there)
        return found

    return heave


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
