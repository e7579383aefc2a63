"""Turns of feathers that bend with a folding wing, leave its plane with the forearm, or close the
way from a wing that beats to its body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import (
    applied,
    dots,
    frames_to_quats,
    motions,
    rotation_vectors,
    unit,
    vectors_to_frames,
)
from featherfx.groom.types import Groom
from featherfx.shot.roots import RootFrames

_TILTED = 0.5  # of a forearm's tilt, that a feather beside the elbow takes; measured on an owl
_BORNE = 0.38  # of the upper arm, from the shoulder, whose feathers the body bears; by crossings
# of an owl's wings in flight


@dataclass(frozen=True)
class Bows:
    """Bows of B of the feathers, which bend with their wings.

    Each feather carries its own, so that what bends it stays the same in all poses; by how far a
    folded wing stands off its shoulder belongs to the body. Those of a wing need its upper arm
    folded, too: a wing that beats folds its hand away from the body.

    members: (B,). joints: (B,) whose fold counts, arms: (B,) upper arms, of other feathers 0.
    screws: (B, 6) of the whole bow at rest. offsets: (B, 3) m, of the wing's. hinges: (J, 3) rad,
    of all joints, by which a turn since rest is more fold. folds: (J,) at rest.
    """

    members: Indices
    joints: Indices
    arms: Indices
    screws: Array
    offsets: Array
    hinges: Array
    folds: Array

    def straightened(self, at_rest: RootFrames) -> RootFrames:
        """The roots at rest without the bow."""
        fraction = np.maximum(self.folds, 0.0)[self.joints, None]
        positions = at_rest.positions.copy()
        positions[self.members] -= fraction * self.offsets
        off = RootFrames(positions, at_rest.rotations)
        return self._bent(off, off, -fraction)

    def bent(
        self,
        roots: RootFrames,
        at_rest: RootFrames,
        turned: Array,
        rotations: Array,
        folded: Array | None,
    ) -> RootFrames:
        """Roots of flat wings, bent as those of joints that are turned, (J, 3, 3), against their
        parents, but for what beats bend. at_rest: roots of flat wings. rotations: (J, 3, 3) of
        carriers. folded: (J,) whole folds since rest, without turns as of beats; None: upper arms
        do not count."""
        whole = np.maximum(np.linalg.norm(self.hinges, axis=1), 1e-12)
        # the part of a turn about a hinge: one square to it besides, as of a hand, changes none
        w, *v = frames_to_quats(turned).T
        sine = np.copysign(1.0, w) * dots(np.stack(v, axis=1), self.hinges)
        along = 2.0 * np.arctan2(sine, np.abs(w) * whole)
        folds = self.folds + along / whole
        rest, fraction = (np.maximum(each, 0.0)[self.joints] for each in (self.folds, folds))
        more = (fraction - rest)[:, None] * self.hinges[self.arms]
        if folded is not None:
            own = np.maximum(folds, self.folds + folded)
            shut, arm = (np.maximum(each, 0.0)[self.arms] for each in (self.folds, own))
            most = arm + np.maximum(rest - shut, 0.0)
            fraction = np.where(self.arms > 0, np.minimum(fraction, most), fraction)
        found = self._bent(roots, at_rest, fraction[:, None])
        body = rotations[self.arms] @ vectors_to_frames(-more)
        found.positions[self.members] += applied(body, fraction[:, None] * self.offsets)
        return found

    def _bent(self, roots: RootFrames, at_rest: RootFrames, fraction: Array) -> RootFrames:
        turns, ways = motions(fraction * self.screws)
        own, still = at_rest.positions[self.members], at_rest.rotations[self.members]
        positions, frames = roots.positions.copy(), roots.rotations.copy()
        carrier = frames[self.members] @ still.swapaxes(1, 2)
        positions[self.members] += applied(carrier, applied(turns, own) + ways - own)
        frames[self.members] = carrier @ turns @ still
        return RootFrames(positions, frames)


def find_bows(groom: Groom, index: dict[str, int]) -> Bows | None:
    """Find the bows of a groom's feathers. index: number of each joint."""
    hinges, folds = np.zeros((len(index), 3)), np.zeros(len(index))
    arms, offsets = np.zeros(len(index), dtype=np.int64), np.zeros((len(index), 3))
    for number, joint in enumerate(groom.joints, 1):
        folds[number] = joint.fold
        if joint.hinge is not None:
            hinges[number] = joint.hinge
        if joint.offset is not None:
            offsets[number] = joint.offset
        if joint.role == "shoulder" and hinges[number].any():
            arms[number] = number
        elif joint.role in ("elbow", "wrist"):
            arms[number] = arms[index[joint.parent]]
    found = [
        (number, last, arms[last], turning.bow)
        for number, feather in enumerate(groom.feathers)
        if (turning := feather.turning) is not None and turning.bow is not None
        for last in [index[turning.joints[1]]]
    ]
    if not found:
        return None
    members, joints, of, screws = map(np.array, zip(*found, strict=True))
    return Bows(members, joints, of, screws, offsets[of], hinges, folds)


@dataclass(frozen=True)
class ArmTurns:
    """Turns of A of the feathers, on the upper arms of wings.

    With a forearm they turn in the wing's plane, as all feathers do. Out of it each turns by its
    share alone: with the whole tilt, roots that stay in the upper arm's plane, side by side, would
    swap the order in which their vanes lie. Of a beat's swing s, but not of its twist, inner ones
    take a share a(w), too: they close the way from wing to body, on skin that both carry. Their
    roots stand along the curve w, s a(w) of polar coordinates, and vanes lie along it,
    turned about their shafts by atan(w s a'(w)), less next to body and wing.

    members: (A,). arms, forearms, parents: (A,) joints. pivots: (A, 3) m, of shoulders. bones:
    (A, 3) m, and dorsal: (A, 3) units, at rest. ways: (A,) from the shoulder, 0, to the elbow, 1.
    """

    members: Indices
    arms: Indices
    forearms: Indices
    parents: Indices
    pivots: Array
    bones: Array
    dorsal: Array
    ways: Array

    def less_tilted(self, turns: Array, rotations: Array) -> Array:
        """Turns (F, 3, 3) without the part of tilts that is not theirs. rotations: (J, 3, 3), as
        carriers have."""
        arm, forearm = rotations[self.arms], rotations[self.forearms]
        relative = rotation_vectors(arm.swapaxes(1, 2) @ forearm)
        within = dots(relative, self.dorsal)[:, None] * self.dorsal
        share = _TILTED * np.clip(self.ways, 0.0, 1.0)
        own = vectors_to_frames(within + share[:, None] * (relative - within))
        result = turns.copy()
        result[self.members] = arm @ own @ forearm.swapaxes(1, 2) @ turns[self.members]
        return result

    def less_beaten(
        self, roots: RootFrames, own: Array, rotations: Array, shifts: Array
    ) -> RootFrames:
        """Roots without the part of beats that is not theirs. own: (J, 3, 3), turns of joints but
        for those about hinges. rotations, shifts: of carriers."""
        share = np.clip((self.ways - _BORNE) / (1.0 - _BORNE), 0.0, 1.0)
        slope = 4.0 * share * (1.0 - share) / (1.0 - _BORNE)
        parent, beat = rotations[self.parents], own[self.arms]
        now = applied(rotations[self.arms], self.bones)
        before = applied(parent @ (parent @ beat).swapaxes(1, 2), now)
        axis = np.cross(before, now)
        swing = np.arctan2(np.linalg.norm(axis, axis=1), dots(before, now))
        axis = unit(axis)
        back = vectors_to_frames(((share - 1.0) * swing)[:, None] * axis)
        shoulders = applied(rotations[self.arms], self.pivots) + shifts[self.arms]
        positions, frames = roots.positions.copy(), roots.rotations.copy()
        bone = self.ways[:, None] * now
        away = applied(back, positions[self.members] - shoulders - bone)
        found = back @ frames[self.members]
        shaft = found[:, :, 0]
        roll = np.arctan(self.ways * slope * swing) * dots(axis, shaft)
        rolled = vectors_to_frames(roll[:, None] * shaft)
        positions[self.members] = shoulders + applied(back, bone) + applied(rolled, away)
        frames[self.members] = rolled @ found
        return RootFrames(positions, frames)


def find_arm_turns(groom: Groom, pivots: Array, index: dict[str, int]) -> ArmTurns | None:
    """Find the feathers on upper arms. pivots: (J, 3) m. index: number of each joint."""
    joints = {joint.name: joint for joint in groom.joints}
    found = []
    for number, feather in enumerate(groom.feathers):
        if feather.turning is None:
            continue
        forearm = joints.get(feather.turning.joints[0])
        if forearm is None or forearm.role != "elbow" or forearm.parent != feather.joint:
            continue
        arm, there = index[feather.joint], index[forearm.name]
        if forearm.hinge is None or not forearm.hinge.any():
            continue
        bone, parent = pivots[there] - pivots[arm], index[joints[feather.joint].parent]
        way = (feather.turning.anchor - pivots[arm]) @ bone / (bone @ bone)
        dorsal = forearm.hinge / np.linalg.norm(forearm.hinge)
        found.append((number, arm, there, parent, pivots[arm], bone, dorsal, way))
    return ArmTurns(*map(np.array, zip(*found, strict=True))) if found else None
