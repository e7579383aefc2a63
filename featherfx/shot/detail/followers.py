"""Feathers that are not solved: rigid ones follow their roots, guided ones their guides.

Guides are seen from their moving roots, and what follows them is carried back into the world.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.feather.types import Feather, RowPoints, both, stacked
from featherfx.shot.detail.guided import Followers, Shapes, carry_to_world
from featherfx.shot.detail.guides import guide_weights
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import Guidance, ShotRun, Stage
from featherfx.shot.roots import RootFrames, Roots, root_rates


def rigid_poses(
    feathers: Mapping[int, Feather], motion: Roots, start: float, end: float
) -> dict[int, FeatherPose]:
    """Poses of feathers at their rest shape at a time `end` (s), by their number in the groom.

    start: s, of the sample before (see root_rates).
    """
    members = np.array(list(feathers), dtype=np.int64)
    local = stacked([feather.rest for feather in feathers.values()])
    world = [turned_by(r, local).shifted(p) for p, r in rates_of(motion, members, start, end)]
    return _by_number(members, world)


class FollowerStage(Stage):
    """The rigid and the guided feathers of a shot: nothing is solved of them.

    Of feathers whose poses are not needed nothing is computed, but whom a feather follows does not
    depend on these.
    """

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        rigid, guided = (run.options.at_level(level) for level in ("rigid", "guided"))
        run.rigid, run.guided = (int(np.isin(each, run.wanted).sum()) for each in (rigid, guided))
        if len(guided):
            weights = guide_weights(run.shot, guided, run.options.leading)
            run.guidance = Guidance(guided, *weights)
            run.pose_also(run.wanted)

    @cached_property
    def _rigid(self) -> dict[int, Feather]:
        """Rigid feathers, by number."""
        rigid = np.intersect1d(self.run.options.at_level("rigid"), self.run.posed)
        return {f: self.run.drawn[f] for f in rigid.tolist()}

    @cached_property
    def _followed(self) -> tuple[Guidance, Followers] | None:
        """Guided feathers that follow points of their guides, not a coat's field."""
        found, run = self.run.guidance, self.run
        if found is not None:
            unasked = np.setdiff1d(found.members, run.posed)
            found = found.without(np.union1d(unasked, run.lifted))
        if found is None:
            return None
        placements = run.shot.groom.feathers
        own, others = (
            Shapes([run.drawn[f] for f in members], [placements[f].mirrored for f in members])
            for members in (found.members, found.guides)
        )
        return found, Followers(own, others, found.weights)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Add the poses of rigid and guided feathers at a sample."""
        motion, start, end = self.run.motion, self.run.time(index - 1), self.run.time(index)
        if self._rigid:
            poses |= rigid_poses(self._rigid, motion, start, end)
        if self._followed is not None:
            poses |= _guided_poses(*self._followed, poses, motion, (start, end))


def _guided_poses(
    guidance: Guidance,
    followers: Followers,
    solved: Mapping[int, FeatherPose],
    motion: Roots,
    span: tuple[float, float],
) -> dict[int, FeatherPose]:
    """Poses of guided feathers at the end of a span (s) between two samples, by number."""
    (start, end), members = span, guidance.members
    poses = [solved[int(f)] for f in guidance.guides]
    given = [
        stacked([getattr(pose, name) for pose in poses])
        for name in ("points", "velocities", "accelerations")
    ]
    points, rates, seconds = seen_from_roots(given, rates_of(motion, guidance.guides, start, end))
    posed, step = followers.moving(points, rates, seconds, end - start)
    roots = tuple(map(tuple, rates_of(motion, members, start, end)))
    # each place is read before it is written over
    world = posed if posed[0] is not posed[1] else [both(np.copy, each) for each in posed]
    for part, shifted in enumerate((1.0, 0.0)):  # nodes, directors
        vectors = [tuple(_flat(each[part]) for each in many) for many in (posed, world)]
        carry_to_world(vectors[0], step, shifted, roots, vectors[1])
    return _by_number(members, world)


def rates_of(motion: Roots, members: Indices, start: float, end: float) -> list[RootFrames]:
    """Root frames of some feathers at end, and their first and second rates."""
    return [
        RootFrames(*(values[members] for values in each)) for each in root_rates(motion, start, end)
    ]


def _by_number(members: Indices, world: Sequence[RowPoints]) -> dict[int, FeatherPose]:
    return dict(zip(members.tolist(), FeatherPose.each(world), strict=True))


def seen_from_roots(world: Sequence[RowPoints], roots: Sequence[RootFrames]) -> list[RowPoints]:
    """Points and their first and second rates in moving root frames.

    With x = p + R y:  R y' = x' - p' - R' y,  R y'' = x'' - p'' - R'' y - 2 R' y'.
    """
    (p, r), (p1, r1), (p2, r2) = roots
    back = r.swapaxes(1, 2)
    x, x1, x2 = (values.shifted(-place) for values, place in zip(world, (p, p1, p2), strict=True))
    y = turned_by(back, x)
    y1 = turned_by(back, both(np.subtract, x1, turned_by(r1, y)))
    turning = turned_by(r2, y), turned_by(r1, y1)
    y2 = turned_by(back, both(lambda x, second, first: x - second - 2.0 * first, x2, *turning))
    return [y, y1, y2]


def in_world(local: Sequence[RowPoints], roots: Sequence[RootFrames]) -> list[RowPoints]:
    """The inverse of seen_from_roots."""
    (p, r), (p1, r1), (p2, r2) = roots
    y, y1, y2 = local
    first = turned_by(r1, y).shifted(p1), turned_by(r, y1)
    second = turned_by(r2, y).shifted(p2), turned_by(r1, y1), turned_by(r, y2)
    return [
        turned_by(r, y).shifted(p),
        both(np.add, *first),
        both(lambda a, b, c: a + 2.0 * b + c, *second),
    ]


def _flat(vectors: Array) -> Array:
    """(F, ..., 3) vectors of each feather in one axis."""
    return vectors.reshape(len(vectors), -1, 3)


def turned_by(matrices: Array, points: RowPoints) -> RowPoints:
    """Points of F feathers times matrices (F, 3, 3)."""
    back = matrices.swapaxes(1, 2)
    return both(lambda part: (_flat(part) @ back).reshape(part.shape), points)
