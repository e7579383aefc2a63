"""Turns of feathers that bend with a folding wing, or leave its plane with the forearm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.algebra.rotation import motions, rotation_vectors
from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import applied, dots
from featherfx.groom.frames import bow_fraction
from featherfx.groom.types import Groom
from featherfx.shot.roots import RootFrames

_TILTED = 0.5  # of a forearm's tilt, that a feather beside the elbow takes; measured on an owl


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
        positions[self.members] = origin + applied(turns, away) + applied(carrier, ways)
        frames[self.members] = turns @ frames[self.members]
        return RootFrames(positions, frames)


def find_bows(groom: Groom, index: dict[str, int]) -> Bows | None:
    """Find the bows of a groom's feathers. index: number of each joint."""
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


def find_tilts(groom: Groom, pivots: Array, index: dict[str, int]) -> Tilts | None:
    """Find the tilts of a groom's feathers. pivots: (J, 3) m. index: number of each joint."""
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
        bone = pivots[there] - pivots[arm]
        way = (feather.turning.anchor - pivots[arm]) @ bone / (bone @ bone)
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
