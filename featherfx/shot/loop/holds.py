"""Holds of feathers besides their roots: grips that pull, and roots that let go, as in moult."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np

from featherfx.mechanics.model import Loads, Model
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun, Stage
from featherfx.shot.patterns import last_fitting

# of the largest force, from which a grip counts as at its limit
_AT_LIMIT = 1.0 - 1e-6


class GripStage(Stage):
    """Grips at their limit: the points that they lead stay behind."""

    def prepare(self) -> None:
        """Begin with no grip at its limit."""
        self._slipping: dict[tuple[str, int], dict[str, Any]] = {}

    def note(self, index: int) -> None:
        """Note grips whose points have stayed behind at a sample."""
        for group in self.run.groups:
            if group.grips and group.loads is not None and index > 0:
                self._note(group, group.loads, self.run.number(index))

    def _note(self, group: FeatherGroup, loads: Loads, number: float) -> None:
        used = [0] * len(group.names)
        for f, grip in group.grips:
            g = used[f]
            used[f] += 1
            point = group.state.points.nodes[f][tuple(loads.grip_node[f, g])]
            distance = float(np.linalg.norm(point - loads.grip_end[f, g]))
            force = float(loads.max_grip_force[f, g])
            if grip.stiffness * distance < _AT_LIMIT * force:
                continue
            found = {
                "feather": group.names[f],
                "row": grip.row,
                "frame": number,
                "force": force,
                "distance": distance,
                "strain": float(group.state.strains.rachis[f, 0, :, 0].max()),
            }
            known = self._slipping.setdefault((group.names[f], g), found)
            if distance > known["distance"]:
                self._slipping[group.names[f], g] = found | {"frame": known["frame"]}

    def report(self) -> dict[str, Any]:
        """Grips at their limit: the first frame, and the farthest that a point stayed behind."""
        return {"grips_at_limit": list(self._slipping.values())} if self._slipping else {}


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
