"""Guided feathers in the world: their guides seen from moving roots, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Feather
from featherfx.shot.detail.guided import Followers, Shapes
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.detail.rigid import FeatherPose, Frames, Roots, root_rates, shifted, turned
from featherfx.shot.types import Shot

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
        self, guides: Mapping[int, FeatherPose], frames: Frames, start: float, end: float
    ) -> dict[int, FeatherPose]:
        """Poses of the guided at a time `end` (s), by numbers in the groom.

        guides: poses of the guides. frames: root positions (F, 3) m and rotations (F, 3, 3) at a
        time. start: s, of the sample before.
        """
        poses = [guides[int(f)] for f in self.guides]
        given = [
            np.stack([getattr(pose, name) for pose in poses])
            for name in ("points", "velocities", "accelerations")
        ]
        roots = root_rates(frames, start, end)
        local = _seen_from_roots(given, [(p[self.guides], r[self.guides]) for p, r in roots])
        points, rates, seconds = local
        moved = self._followers.motion(points, rates, seconds, end - start)
        world = _in_world(moved, [(p[self.guided], r[self.guided]) for p, r in roots])
        return {int(f): FeatherPose(*pose) for f, *pose in zip(self.guided, *world, strict=True)}


def _seen_from_roots(world: Sequence[Array], roots: Roots) -> list[Array]:
    """Points (F, n, P, 3) and their first and second rates in moving root frames.

    With x = p + R y:  R y' = x' - p' - R' y,  R y'' = x'' - p'' - R'' y - 2 R' y'.
    """
    (p, r), (p1, r1), (p2, r2) = roots
    y = _back(world[0] - shifted(p, world[0]), r)
    y1 = _back(world[1] - shifted(p1, y) - turned(r1, y), r)
    y2 = _back(world[2] - shifted(p2, y) - turned(r2, y) - 2.0 * turned(r1, y1), r)
    return [y, y1, y2]


def _in_world(local: Sequence[Array], roots: Roots) -> list[Array]:
    """The inverse of _seen_from_roots."""
    (p, r), (p1, r1), (p2, r2) = roots
    y, y1, y2 = local
    return [
        shifted(p, y) + turned(r, y),
        shifted(p1, y) + turned(r1, y) + turned(r, y1),
        shifted(p2, y) + turned(r2, y) + 2.0 * turned(r1, y1) + turned(r, y2),
    ]


def _back(points: Array, rotations: Array) -> Array:
    return turned(rotations.swapaxes(1, 2), points)
