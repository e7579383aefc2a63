"""The colliders of a shot as walls: where their meshes are at both ends of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from featherfx.shot.scenes import Surface
from featherfx.shot.types import Shot
from featherfx.solver.contact_wall import Wall, outward, wall_of
from featherfx.solver.state import State

Array = NDArray[np.float64]

# depth, as a share of the longest feather, from which a node finds its way out of a body
DEPTH_SHARE = 0.02


class Bodies:
    """Meshes that feathers bump into.

    begun: whether the shot is under way; before, the points of vanes that are inside a body count
    as grown in and are left alone until they come out.
    """

    def __init__(self, shot: Shot, longest: float) -> None:
        self._surfaces = shot.colliders
        self._triangles = [outward(surface.triangles, surface.rest) for surface in self._surfaces]
        self._first = shot.first_frame / shot.frames_per_second
        self._depth = DEPTH_SHARE * longest
        self.begun = False

    def walls(self, states: Sequence[State], start: float, end: float, margin: float) -> list[Wall]:
        """The bodies from start to end, s since the first frame, for feathers in these states."""
        if not self._surfaces:
            return []
        fastest = max(float(np.abs(state.velocity).max()) for state in states)
        walls = []
        for surface, triangles in zip(self._surfaces, self._triangles, strict=True):
            before, after = self._points(surface, start), self._points(surface, end)
            own = float(np.abs(after - before).max(initial=0.0))
            way = np.sqrt(3.0) * (fastest * (end - start) + own)
            reach = margin + self._depth + float(way)
            walls.append(wall_of(before, after, triangles, reach, not self.begun))
        return walls

    def _points(self, surface: Surface, time: float) -> Array:
        return surface.points((self._first + time) * surface.time_codes_per_second)
