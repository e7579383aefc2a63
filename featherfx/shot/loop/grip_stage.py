"""Grips that pull with their largest force, in the frame loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from featherfx.mechanics.model import Loads
from featherfx.shot.loop.groups import FeatherGroup
from featherfx.shot.loop.run import Stage

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
