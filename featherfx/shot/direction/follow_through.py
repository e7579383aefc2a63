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

from featherfx.feather.types import RowPoints, both, stacked
from featherfx.shot.detail.followers import in_world, rates_of, seen_from_roots
from featherfx.shot.detail.guided import INSTANT, Shapes, Turns
from featherfx.shot.direction.channels import courses, product
from featherfx.shot.direction.unsimulated_targets import warn_of_unfelt
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.patterns import last_fitting

_NAMES = ("follow",)


class FollowThrough(Stage):
    """The feathers of a shot of which another part of the simulated motion is shown."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        shot, drawn, shown = run.shot, run.drawn, run.wanted
        warn_of_unfelt(shot, run.options.feathers)
        self._found = courses(shot, _NAMES)
        acted_on = np.zeros(len(drawn), dtype=np.bool_)
        for each in self._found:
            acted_on |= each.weights > 0.0
        # what flies by itself has no root that it could follow
        acted_on &= np.array(last_fitting(shot.detachments, shot.groom.feathers)) < 0
        self._members = shown[acted_on[shown]]
        if len(self._members):
            mirrored = [shot.groom.feathers[f].mirrored for f in self._members]
            self._shapes = Shapes([drawn[f] for f in self._members], mirrored)

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Change the poses of those that are shown by their part at a sample."""
        if not len(self._members):
            return
        start, end = self.run.time(index - 1), self.run.time(index)
        taken = [poses[f] for f in self._members.tolist()]
        world = [
            stacked([getattr(pose, name) for pose in taken])
            for name in ("points", "velocities", "accelerations")
        ]
        roots = rates_of(self.run.motion, self._members, start, end)
        moved = in_world(self._local(seen_from_roots(world, roots), start, end), roots)
        points, velocities, accelerations = moved
        for place, f in enumerate(self._members.tolist()):
            poses[f] = replace(
                poses[f],
                points=points.at(place),
                velocities=velocities.at(place),
                accelerations=accelerations.at(place),
            )

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
