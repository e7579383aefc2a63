"""The joints of a groom as arrays, and the poses that follow from the poses of the parents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.types import Groom

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Skeleton:
    """J joints of which joint 0, named "", is the groom itself and the parent of all.

    names: of the joints. pivots: (J, 3) m, at rest in the groom's frame. levels: per depth below
    the groom, (joints, parents), index arrays of equal length.
    """

    names: tuple[str, ...]
    pivots: Array
    levels: tuple[tuple[Indices, Indices], ...]

    def pose(self, rotations: Array, displacements: Array) -> tuple[Array, Array]:
        """Poses of all joints from their poses against their parents.

        rotations: (J, 3, 3), about the pivots, displacements: (J, 3) m, both in the frame of the
        parent, whose axes are the groom's at rest. Returns turns (J, 3, 3) and shifts (J, 3) such
        that a point x of the groom at rest that is carried by joint j goes to turn x + shift.
        """
        turned = (rotations @ self.pivots[:, :, None])[..., 0]
        turns = rotations.copy()
        shifts = self.pivots + displacements - turned
        for joints, parents in self.levels:
            carrier = turns[parents]
            shifts[joints] = (carrier @ shifts[joints][..., None])[..., 0] + shifts[parents]
            turns[joints] = carrier @ turns[joints]
        return turns, shifts


def skeleton_of(groom: Groom) -> Skeleton:
    """The skeleton of a groom whose joints form a tree."""
    names = ("", *(joint.name for joint in groom.joints))
    index = {name: number for number, name in enumerate(names)}
    parents = [0, *(index[joint.parent] for joint in groom.joints)]
    depths = np.zeros(len(names), dtype=np.int64)
    for joint in range(1, len(names)):
        ancestor = joint
        while ancestor:
            ancestor = parents[ancestor]
            depths[joint] += 1
    of = np.array(parents, dtype=np.int64)
    levels = []
    for depth in range(1, int(depths.max()) + 1):
        joints = np.flatnonzero(depths == depth)
        levels.append((joints, of[joints]))
    pivots = np.vstack([np.zeros((1, 3)), *(np.reshape(j.position, (1, 3)) for j in groom.joints)])
    return Skeleton(names, pivots, tuple(levels))
