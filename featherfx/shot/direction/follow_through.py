"""Follow-through: how much of what is simulated is shown.

A feather is taken apart as those that guide others are (detail/guided.py): turns from row to row,
of the shaft's chords and of the barbs' segments, against its rest shape. The share of the channels
`follow` scales each of these small turns, and the chain is put together again, so that nothing is
stretched; 0 is the rest shape on its moving root, 1 what was simulated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.feather.types import Feather, RowPoints, both, stacked
from featherfx.shot.detail.followers import in_world, rates_of, seen_from_roots
from featherfx.shot.detail.guided import INSTANT, Shapes, Turns
from featherfx.shot.direction.channels import courses, product
from featherfx.shot.frames import FeatherPose
from featherfx.shot.motion.roots import Roots
from featherfx.shot.patterns import last_fitting
from featherfx.shot.types import Shot

NAMES = ("follow",)


class FollowThrough:
    """The feathers of a shot of which another share is shown.

    drawn: all feathers on the meshes' grid. shown: (S,) numbers of those that are shown.
    """

    def __init__(self, shot: Shot, drawn: Sequence[Feather], motion: Roots, shown: Indices) -> None:
        self._found, self._motion = courses(shot, NAMES), motion
        acted_on = np.zeros(len(drawn), dtype=np.bool_)
        for each in self._found:
            acted_on |= each.weights > 0.0
        # what flies by itself has no root that it could follow
        acted_on &= np.array(last_fitting(shot.detachments, shot.groom.feathers)) < 0
        self._places = np.flatnonzero(acted_on[shown])
        self._members = shown[self._places]
        if len(self._members):
            mirrored = [shot.groom.feathers[f].mirrored for f in self._members]
            self._shapes = Shapes([drawn[f] for f in self._members], mirrored)

    def of(self, poses: Sequence[FeatherPose], start: float, end: float) -> list[FeatherPose]:
        """The poses of those that are shown, with the share of a time `end` (s).

        start: s, of the sample before.
        """
        found = list(poses)
        if not len(self._members):
            return found
        taken = [poses[k] for k in self._places.tolist()]
        world = [
            stacked([getattr(pose, name) for pose in taken])
            for name in ("points", "velocities", "accelerations")
        ]
        roots = rates_of(self._motion, self._members, start, end)
        moved = in_world(self._local(seen_from_roots(world, roots), start, end), roots)
        points, velocities, accelerations = moved
        for place, k in enumerate(self._places.tolist()):
            found[k] = replace(
                poses[k],
                points=points.at(place),
                velocities=velocities.at(place),
                accelerations=accelerations.at(place),
            )
        return found

    def _local(self, local: Sequence[RowPoints], start: float, end: float) -> list[RowPoints]:
        """Points and their first and second rates in root frames."""
        h = INSTANT * (end - start)

        def at(step: float) -> RowPoints:
            moved = both(lambda x, v, a: x + step * v + 0.5 * step * step * a, *local)
            turns = self._shapes.turns(moved)
            fraction = product(self._found, "follow", end + step, self._members)
            along = turns.along * fraction[:, None, None]
            return self._shapes.posed(
                Turns(along, turns.barbs * fraction[:, None, None, None, None])
            )

        before, now, after = at(-h), at(0.0), at(h)
        return [
            now,
            both(lambda a, b: (a - b) / (2.0 * h), after, before),
            both(lambda a, x, b: (a - 2.0 * x + b) / (h * h), after, now, before),
        ]
