"""Heads that stay level and do not heave while the body does, as birds hold them.

With the turn R of the body and its heading H, the turn about the vertical by which its axis points
ahead, the head is turned by R^T H against the body. The neck takes a part of that, and then turns
towards the place that the head has without heave and pitch of the beats. What is left of the way
there is the head's. Of a way w beyond w_0, a part of the neck's length, it goes

    w_0 (1 + tanh(w / w_0 - 1)),

so that short necks take their heads along. Of the turn L that levels a trunk (swings.py), which is
the first, the head takes back a share alone, so that they do not fold: it is turned by R^T H L^a,
a = s (1 - share), with s from 0 to 1 as the body without beats is pitched down from 0 to L.

Source: Ros and Biewener, Pigeons (C. livia) follow their head during turning flight, Frontiers in
Neuroscience 11 (2017) 655, summary: the head is steady while the body turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.interpolation import smooth_step
from featherfx.algebra.types import Array
from featherfx.algebra.vectors import from_rotation_vector
from featherfx.shot.motion.body_joints import HEAD, NECK
from featherfx.shot.motion.joints import JointPoses, PosesOverTime, Skeleton
from featherfx.shot.motion.motion import scaled_turns

_NECK_SHARE = 0.45  # of the turn that levels the head; by eye
_LEVEL_SHARE = 0.3  # of a trunk's turn to level that the head takes back; by eye
_NECK_WAY = 0.5  # of the way of the head, that the root of the neck goes along; by eye
_FARTHEST = 0.05  # w_0, of the neck's length; by eye


@dataclass(frozen=True)
class SteadyHead:
    """Poses with a steady head. calm: without heave and pitch. share: of what is taken back.

    level: poses that level the trunk; None: there are none."""

    own: PosesOverTime
    calm: PosesOverTime
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
            whole = float(np.linalg.norm(way))
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
