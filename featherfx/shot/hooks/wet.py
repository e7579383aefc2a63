"""Wet feathers: water on the vane, hooks that it weakens, and air that finds its way through.

With the wetness w of a rule at a time, 0 to 1:

    mass of the vane at each node    m (1 + water w)
    yield and strength of hooks      f = 1 - (1 - hooks) w times what they are dry
    coefficients and added mass of the air    1 - (1 - drag) w times

Water comes and goes with the velocity of what it wets.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

from featherfx.feather.types import Feather
from featherfx.groom.types import Placement
from featherfx.mechanics.batch import vane_mass
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.frames import FeatherPose
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun, Stage
from featherfx.shot.patterns import last_fitting
from featherfx.shot.types import Shot, Wet


def wetness(rule: Wet, time: float) -> float:
    """Return the wetness of a rule at a time (s since the first frame), 0 to 1."""
    return float(np.interp(time, *np.transpose(rule.keys)))


class WetLoads(ShotLoad):
    """The feathers of a shot that are wet at times."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._rules = last_fitting(run.shot.wets, run.shot.groom.feathers)

    def key(self, feather: int) -> Hashable:
        """Number of the rule, or -1."""
        return self._rules[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The water of a batch."""
        rule, placements = self._rules[group.members[0]], self.run.shot.groom.feathers
        if rule < 0:
            return None
        some = [placements[f] for f in group.members]
        return Water(self.run.shot.wets[rule], group.feathers, some)


class Water(GroupLoad):
    """The water of a batch of feathers, all wet by one rule."""

    def __init__(
        self, rule: Wet, feathers: Sequence[Feather], placements: Sequence[Placement]
    ) -> None:
        self._rule, self._wet = rule, 0.0
        pairs = zip(feathers, placements, strict=True)
        self._vane = np.stack([vane_mass(feather, each.kind) for feather, each in pairs])

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Be as wet as at the end of a step; whether that is other than before."""
        before, self._wet = self._wet, wetness(self._rule, end)
        return self._wet != before

    def model(self, model: Model) -> Model:
        """Constant data at the present wetness, from those of dry feathers."""
        rule, wet = self._rule, self._wet
        drag = 1.0 - (1.0 - rule.drag) * wet
        wetted = model._replace(
            mass=model.mass + rule.water * wet * self._vane,
            attached=model.attached * np.array([drag, 1.0]),
        )
        left = 1.0 - (1.0 - rule.hooks) * wet
        hooks = model.hooks
        weaker = hooks._replace(
            limit=hooks.limit * left,
            growth=hooks.growth / left,
            release=hooks.release * left,
            bounds=hooks.bounds / left,
        )
        return wetted._replace(hooks=weaker)

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads of the batch at the present wetness: the shaft feels the air as ever."""
        left = 1.0 - (1.0 - self._rule.drag) * self._wet
        air = loads.air * np.array([1.0, left, left, 1.0])
        return loads._replace(air=air, added_mass=left * loads.added_mass)


class ClumpStage(Stage):
    """Barbs of wet feathers, as they are drawn."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        rules = last_fitting(run.shot.wets, run.shot.groom.feathers)
        self._rules = [rules[f] for f in run.wanted]

    def show(self, time: float, poses: list[FeatherPose]) -> list[FeatherPose]:
        """Have barbs come together in clumps."""
        clumps = [clumping(self.run.shot, rule, time) for rule in self._rules]
        return [p._replace(clumped=each) for p, each in zip(poses, clumps, strict=True)]


def clumping(shot: Shot, rule: int, time: float) -> tuple[float, int]:
    """Return how far barbs come together, and in how many clumps; rule: number, or -1."""
    if rule < 0:
        return 0.0, 1
    wet = shot.wets[rule]
    return wet.clump * wetness(wet, time), wet.clump_count
