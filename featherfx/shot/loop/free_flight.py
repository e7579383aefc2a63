"""Feathers that leave their roots, as in moult: from then on nothing holds them."""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from featherfx.mechanics.model import Model
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun
from featherfx.shot.patterns import last_fitting

# of a sample, the step in which a feather that has left its root begins to fall: the first one is
# of first order
_FIRST_STEP = 1.0 / 32.0


class FreeFlight(ShotLoad):
    """The feathers of a shot that leave their roots."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._rules = last_fitting(run.shot.detachments, run.shot.groom.feathers)

    def key(self, feather: int) -> Hashable:
        """Number of the rule, or -1."""
        return self._rules[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The flight of a batch."""
        rule = self._rules[group.members[0]]
        if rule < 0:
            return None
        shot = self.run.shot
        return _Flight(shot.time_of(shot.detachments[rule].frame), self.run.time(1))


class _Flight(GroupLoad):
    """A batch that leaves its roots at a time in s. step: s, between samples."""

    def __init__(self, time: float, step: float) -> None:
        self._time, self._step, self._has_left = time, step, False

    def renew(self, group: FeatherGroup, start: float, end: float) -> bool:
        """Leave the roots in the step within whose first half the time is."""
        leaves = end > 0.0 and start > self._time - 0.5 * self._step
        if self._has_left or not leaves:
            return False
        self._has_left = True
        group.restart_steps(_FIRST_STEP * self._step)
        return True

    def model(self, model: Model) -> Model:
        """A model that nothing holds, once the roots are left."""
        return model._replace(held=np.zeros_like(model.held)) if self._has_left else model
