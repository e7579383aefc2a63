"""Wings, tails and crests that open and close on a skin: it carries the joint that they hang on.

The first joint of a limb goes with the skin as the root that is nearest to it; feathers of the limb
go with that joint and with the poses of those below it, all others with the skin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.types import Groom
from featherfx.shot.motion.roots import RootFrames, Roots

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class LimbRoots:
    """Roots of a skin, some of them on limbs.

    members: (L,) feathers of limbs. bearers: (L,) the feather whose root carries each one's limb.
    rest: (F,) roots in the groom's frame.
    """

    skin: Roots
    joints: Roots
    members: Indices
    bearers: Indices
    rest: RootFrames

    def frames(self, time: float) -> RootFrames:
        """Where the roots are at a time, s since the first frame."""
        positions, rotations = self.skin.frames(time)
        moved = self.joints.frames(time)
        bearer, own = self.bearers, self.members
        turn = rotations[bearer] @ self.rest.rotations[bearer].transpose(0, 2, 1)
        away = (moved.positions[own] - self.rest.positions[bearer])[:, :, None]
        places = positions[bearer] + (turn @ away)[:, :, 0]
        positions[own], rotations[own] = places, turn @ moved.rotations[own]
        return RootFrames(positions, rotations)


def carried(groom: Groom, skin: Roots, joints: Roots) -> Roots:
    """The roots of a groom on a skin whose limbs fold as their joints do."""
    joint_of = {joint.name: joint for joint in groom.joints}
    firsts: dict[str, str] = {}
    for joint in groom.joints:
        first = joint
        while first.parent:
            first = joint_of[first.parent]
        firsts[joint.name] = first.name
    rest = RootFrames(
        np.array([each.position for each in groom.feathers]),
        np.array([each.rotation for each in groom.feathers]),
    )
    members = np.flatnonzero([each.turning is not None for each in groom.feathers])
    bearer = {
        name: int(np.linalg.norm(rest.positions - joint_of[name].position, axis=1).argmin())
        for name in set(firsts.values())
    }
    bearers = [bearer[firsts[groom.feathers[k].joint]] for k in members]
    return LimbRoots(skin, joints, members, np.array(bearers, dtype=np.int64), rest)
