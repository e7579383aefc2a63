"""Follow-through: how much of what is simulated is shown.

The share of the channels `follow` scales the small turns that a feather deviates from its rest
shape by: 0 is the rest shape on its moving root, 1 what was simulated.

Feathers that are shown with other turns than those of their poses.

A feather is taken apart as those that guide others are (detail/guided.py): turns from row to row,
of the rachis' chords and of the barbs' segments, against its rest shape. A rule changes these small
turns, and the chain is put together again on its moving root. So nothing is stretched.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.feather.types import RowPoints, both, stacked
from featherfx.shot.detail.followers import in_world, rates_of, seen_from_roots
from featherfx.shot.detail.guided import INSTANT, Shapes, Turns
from featherfx.shot.direction.channels import courses, product, warn_of_unfelt
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.patterns import last_fitting

# turns that are shown at a time (s), from those of the poses
TurnRule = Callable[[Turns, float], Turns]


class ShownTurns:
    """Feathers whose turns a rule changes. members: (M,) their numbers. shapes: at rest."""

    def __init__(self, run: ShotRun, members: Indices) -> None:
        self._run, self.members = run, members
        placements = run.shot.groom.feathers
        mirrored = [placements[f].mirrored for f in members]
        self.shapes = Shapes([run.drawn[f] for f in members], mirrored)

    def change(self, index: int, poses: dict[int, FeatherPose], rule: TurnRule) -> None:
        """Change the poses of the members at a sample."""
        start, end = self._run.time(index - 1), self._run.time(index)
        taken = [poses[f] for f in self.members.tolist()]
        world = [
            stacked([getattr(pose, name) for pose in taken])
            for name in ("points", "velocities", "accelerations")
        ]
        roots = rates_of(self._run.motion, self.members, start, end)
        local = self._changed(seen_from_roots(world, roots), start, end, rule)
        points, velocities, accelerations = in_world(local, roots)
        for place, f in enumerate(self.members.tolist()):
            poses[f] = poses[f]._replace(
                points=points.at(place),
                velocities=velocities.at(place),
                accelerations=accelerations.at(place),
            )

    def _changed(
        self, local: Sequence[RowPoints], start: float, end: float, rule: TurnRule
    ) -> list[RowPoints]:
        """Points and their first and second rates in root frames."""
        h = INSTANT * (end - start)

        def at(step: float) -> RowPoints:
            moved = both(lambda x, v, a: x + step * v + 0.5 * step * step * a, *local)
            return self.shapes.posed(rule(self.shapes.turns(moved), end + step))

        before, now, after = at(-h), at(0.0), at(h)
        return [
            now,
            both(lambda a, b: (a - b) / (2.0 * h), after, before),
            both(lambda a, x, b: (a - 2.0 * x + b) / (h * h), after, now, before),
        ]


def scaled_turns(turns: Turns, fractions: Array) -> Turns:
    """Turns of F feathers times fractions (F,)."""
    along = turns.along * fractions[:, None, None]
    return Turns(along, turns.barbs * fractions[:, None, None, None, None])


class FollowThrough(Stage):
    """The feathers of a shot of which another part of the simulated motion is shown."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        shot, shown = run.shot, run.wanted
        warn_of_unfelt(shot, run.options.feathers)
        self._found = courses(shot, ("follow",))
        acted_on = np.zeros(len(run.drawn), dtype=np.bool_)
        for each in self._found:
            acted_on |= each.weights > 0.0
        # what flies by itself has no root that it could follow
        acted_on &= np.array(last_fitting(shot.detachments, shot.groom.feathers)) < 0
        members = shown[acted_on[shown]]
        self._shown = ShownTurns(run, members) if len(members) else None

    def follow(self, index: int, poses: dict[int, FeatherPose]) -> None:
        """Change the poses of those that are shown by their part at a sample."""
        if (shown := self._shown) is None:
            return
        shown.change(
            index,
            poses,
            lambda turns, time: scaled_turns(
                turns, product(self._found, "follow", time, shown.members)
            ),
        )
