"""The colliders of a shot as walls: where their meshes are at both ends of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from featherfx.shot.motion.cuts import cut_surfaces
from featherfx.shot.types import Shot
from featherfx.solver.contact.types import Wall
from featherfx.solver.contact.wall import outward, wall_of
from featherfx.solver.state import State

Array = NDArray[np.float64]

# times within a frame at which bodies are looked at, to tell whether they come near
LOOKS = 5
# depth, over the longest feather's length, from which a node finds its way out of a body
DEPTH = 0.02


class Bodies:
    """Meshes that feathers bump into.

    begun: whether the shot is under way; before, the points of vanes that are inside a body count
    as grown in and are left alone until they come out.
    """

    def __init__(self, shot: Shot, longest: float) -> None:
        self._bodies = cut_surfaces(shot, longest)
        surfaces = [body.surface for body in shot.colliders]
        self._triangles = [outward(surface.triangles, surface.rest) for surface in surfaces]
        self._depth = DEPTH * longest
        self.begun = False

    def warn(self, k: int, number: float) -> None:
        """Say which bodies are cut from frame k to k + 1, whose number is given."""
        for body in self._bodies:
            body.warn(k, number)

    def approach(self, states: Sequence[State], start: float, end: float, margin: float) -> bool:
        """Whether a body that moves between start and end (s) comes near any feather at rest.

        margin: m, what counts as near. Told by boxes: never missed, at times said in vain.
        """
        if not self._bodies:
            return False
        nodes = [state.points.nodes for state in states]
        low = np.concatenate([each.min(axis=(1, 2)) for each in nodes]) - margin
        high = np.concatenate([each.max(axis=(1, 2)) for each in nodes]) + margin
        times = np.linspace(start, end, LOOKS)
        for body in self._bodies:
            poses = np.stack([body.points(time) for time in times])
            if np.ptp(poses, axis=0).max(initial=0.0) == 0.0:
                continue
            near = (low <= poses.max(axis=(0, 1))) & (poses.min(axis=(0, 1)) <= high)
            if near.all(axis=1).any():
                return True
        return False

    def walls(self, states: Sequence[State], start: float, end: float, margin: float) -> list[Wall]:
        """The bodies from start to end, s since the first frame, for feathers in these states."""
        if not self._bodies:
            return []
        fastest = max(float(np.abs(state.velocity.nodes).max()) for state in states)
        walls = []
        for body, triangles in zip(self._bodies, self._triangles, strict=True):
            cut = end > start and body.is_cut(start)
            before, after = body.after(start) if cut else body.points(start), body.points(end)
            own = float(np.abs(after - before).max(initial=0.0))
            way = np.sqrt(3.0) * (fastest * (end - start) + own)
            reach = margin + self._depth + float(way)
            # what a body lands on has grown into it as well
            walls.append(wall_of(before, after, triangles, reach, cut or not self.begun))
        return walls
