"""Feathers that are not solved: rigid ones follow their roots, guided ones their guides.

Guides are seen from their moving roots, and what follows them is carried back into the world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather, shifted
from featherfx.shot.detail.guided import Followers, Shapes
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.motion.roots import RootFrames, Roots, root_rates
from featherfx.shot.types import Shot

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class FeatherPose:
    """points, velocities, accelerations: (n, P, 3) of one feather."""

    points: Array
    velocities: Array
    accelerations: Array


def rigid_poses(
    feathers: Mapping[int, Feather], motion: Roots, start: float, end: float
) -> dict[int, FeatherPose]:
    """Poses of feathers at their rest shape at a time `end` (s), by their number in the groom.

    start: s, of the sample before (see root_rates).
    """
    members = np.array(list(feathers), dtype=np.int64)
    local = np.stack([feather.points for feather in feathers.values()])
    world = [shifted(_turned(r, local), p) for p, r in _rates(motion, members, start, end)]
    return _by_number(members, world)


class Carried:
    """The guided feathers of a shot.

    drawn: all feathers on the meshes' grid. guided, simulated: numbers in the groom, of those that
    are ever guided and those that may guide. wanted: numbers of those that are shown; of others
    nothing is computed, but whom a feather follows does not depend on them. guides: numbers of
    those that do guide.
    """

    def __init__(
        self,
        shot: Shot,
        drawn: Sequence[Feather],
        guided: Indices,
        simulated: Indices,
        wanted: Indices,
    ) -> None:
        self.guided, self.guides = guided, np.zeros(0, dtype=np.int64)
        if not len(guided):
            return
        guides, weights = guide_weights(shot, guided, simulated)
        weights = weights[np.isin(guided, wanted)]
        self.guided = guided = guided[np.isin(guided, wanted)]
        if not len(guided):
            return
        used = np.unique(weights.indices)
        guides, weights = guides[used], weights[:, used]
        placements = shot.groom.feathers
        own, others = (
            Shapes([drawn[f] for f in members], [placements[f].mirrored for f in members])
            for members in (guided, guides)
        )
        self.guides = guides
        self._followers = Followers(own, others, weights)

    def poses(
        self, guides: Mapping[int, FeatherPose], motion: Roots, start: float, end: float
    ) -> dict[int, FeatherPose]:
        """Poses of the guided at a time `end` (s), by numbers in the groom.

        guides: poses of the guides. start: s, of the sample before.
        """
        poses = [guides[int(f)] for f in self.guides]
        given = [
            np.stack([getattr(pose, name) for pose in poses])
            for name in ("points", "velocities", "accelerations")
        ]
        points, rates, seconds = _seen_from_roots(given, _rates(motion, self.guides, start, end))
        moved = self._followers.motion(points, rates, seconds, end - start)
        return _by_number(self.guided, _in_world(moved, _rates(motion, self.guided, start, end)))


def _rates(motion: Roots, members: Indices, start: float, end: float) -> list[RootFrames]:
    """Root frames of some feathers at end, and their first and second rates."""
    return [
        RootFrames(*(values[members] for values in each)) for each in root_rates(motion, start, end)
    ]


def _by_number(members: Indices, world: Sequence[Array]) -> dict[int, FeatherPose]:
    return {int(f): FeatherPose(*pose) for f, *pose in zip(members, *world, strict=True)}


def _seen_from_roots(world: Sequence[Array], roots: Sequence[RootFrames]) -> list[Array]:
    """Points (F, n, P, 3) and their first and second rates in moving root frames.

    With x = p + R y:  R y' = x' - p' - R' y,  R y'' = x'' - p'' - R'' y - 2 R' y'.
    """
    (p, r), (p1, r1), (p2, r2) = roots
    back = r.swapaxes(1, 2)
    y = _turned(back, shifted(world[0], -p))
    y1 = _turned(back, shifted(world[1], -p1) - _turned(r1, y))
    y2 = _turned(back, shifted(world[2], -p2) - _turned(r2, y) - 2.0 * _turned(r1, y1))
    return [y, y1, y2]


def _in_world(local: Sequence[Array], roots: Sequence[RootFrames]) -> list[Array]:
    """The inverse of _seen_from_roots."""
    (p, r), (p1, r1), (p2, r2) = roots
    y, y1, y2 = local
    return [
        shifted(_turned(r, y), p),
        shifted(_turned(r1, y), p1) + _turned(r, y1),
        shifted(_turned(r2, y), p2) + 2.0 * _turned(r1, y1) + _turned(r, y2),
    ]


def _turned(matrices: Array, points: Array) -> Array:
    """Material points (F, n, P, 3) times matrices (F, 3, 3)."""
    flat = points.reshape(len(points), -1, 3)
    return np.asarray(flat @ matrices.swapaxes(1, 2)).reshape(points.shape)
