"""Wet feathers: water on the vane, hooks that it weakens, and air that finds its way through.

With the wetness w of a rule at a time, 0 to 1:

    mass of the vane at each node    m (1 + water w)
    yield and strength of hooks      f = 1 - (1 - hooks) w times what they are dry
    coefficients of the air          1 - (1 - drag) w times

Water comes and goes with the velocity of what it wets.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.feather.types import Feather
from featherfx.groom.types import Placement
from featherfx.mechanics.batch import vane_mass
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.types import Shot, Wet


def wetness(rule: Wet, time: float) -> float:
    """Of a rule at a time (s since the first frame), 0 to 1."""
    return float(np.interp(time, *np.transpose(rule.keys)))


class Water:
    """The water of a batch of feathers, all wet by one rule."""

    def __init__(
        self, rule: Wet, feathers: Sequence[Feather], placements: Sequence[Placement]
    ) -> None:
        self._rule, self._wet = rule, 0.0
        pairs = zip(feathers, placements, strict=True)
        self._vane = np.stack([vane_mass(feather, each.kind) for feather, each in pairs])

    def soak(self, time: float) -> bool:
        """Be as wet as at a time (s since the first frame); whether that is other than before."""
        before, self._wet = self._wet, wetness(self._rule, time)
        return self._wet != before

    def model(self, dry: Model) -> Model:
        """Constant data at the present wetness, from those of dry feathers."""
        rule, wet = self._rule, self._wet
        model = dry._replace(mass=dry.mass + rule.water * wet * self._vane)
        left = 1.0 - (1.0 - rule.hooks) * wet
        hooks = dry.hooks
        weaker = hooks._replace(
            limit=hooks.limit * left,
            growth=hooks.growth / left,
            release=hooks.release * left,
            bounds=hooks.bounds / left,
        )
        return model._replace(hooks=weaker)

    def through(self, loads: Loads) -> Loads:
        """Loads of the batch at the present wetness: the shaft feels the air as ever."""
        left = 1.0 - (1.0 - self._rule.drag) * self._wet
        return loads._replace(air=loads.air * np.array([1.0, left, left, 1.0]))


def clumping(shot: Shot, rule: int, time: float) -> tuple[float, int]:
    """How far barbs come together, and in how many clumps; rule: of wet_rules."""
    if rule < 0:
        return 0.0, 1
    wet = shot.wets[rule]
    return wet.clump * wetness(wet, time), wet.clump_count
