"""Follow-through: how much of what is simulated is shown.

The share of the channels `follow` scales the small turns that a feather deviates from its rest
shape by (shown_turns.py): 0 is the rest shape on its moving root, 1 what was simulated.
"""

from __future__ import annotations

import numpy as np

from featherfx.shot.direction.channels import courses, product
from featherfx.shot.direction.shown_turns import ShownTurns, scaled_turns
from featherfx.shot.direction.unfelt_channels import warn_of_unfelt
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.run import ShotRun, Stage
from featherfx.shot.patterns import last_fitting


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
