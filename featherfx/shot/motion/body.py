"""Bodies that an act carries: a skin goes, as one piece, where the act takes the whole groom.

The skin stands as it is at the first frame. With the turn R and the way d of the groom under the
act, a point x of it goes to R x + d. Roots, coat and contact see the surface there, and limbs fold
on it as on any other skin.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.shot.clock import StageClock
from featherfx.shot.motion.joints import skeleton_of
from featherfx.shot.motion.motion import joint_poses
from featherfx.shot.skin import SkinSurfaces
from featherfx.shot.sources import MovingSurface
from featherfx.shot.types import Shot

# turn (3, 3) and way (3,) m of a body at a time in s
BodyPath = Callable[[float], tuple[Array, Array]]
_ALWAYS = 1e9  # time codes, within which a body moves


class BodySurface:
    """A surface that is carried along a path. at_first: as the scene has it. clock: of its stage.

    All that does not move is that of the surface at the first frame (sources.MovingSurface).
    """

    sampled, knots = (-_ALWAYS, _ALWAYS), None

    def __init__(self, at_first: MovingSurface, path: BodyPath, clock: StageClock) -> None:
        self.at_first, self.body_path, self._clock = at_first, path, clock

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "at_first":
            raise AttributeError(name)
        return getattr(self.at_first, name)

    def carriers(self, code: float) -> tuple[Array, Array]:
        """Turn (3, 3) and way (3,) m at a time code."""
        clock = self._clock
        return self.body_path((code - clock.start) / (clock.step * clock.frames_per_second))

    def corners(self, code: float, triangles: Indices) -> Array:
        """(F, 3, 3) m, corners of triangles (F, 3) of points at a time code."""
        return self._carried(self.at_first.corners(self._clock.start, triangles), code)

    def points(self, code: float) -> Array:
        """(V, 3) m, all points at a time code."""
        return self._carried(self.at_first.points(self._clock.start), code)

    def is_mirrored(self, code: float) -> bool:
        """Return whether it is mirrored against rest."""
        return self.at_first.is_mirrored(self._clock.start)

    def masked(self, chosen: Flags) -> BodySurface:
        """The same with some of its triangles (T,) alone."""
        return BodySurface(self.at_first.masked(chosen), self.body_path, self._clock)

    def smoothed(self, knots: Any) -> BodySurface:
        """The same: its path is smooth."""
        return self

    def _carried(self, points: Array, code: float) -> Array:
        turn, way = self.carriers(code)
        return np.asarray(points @ turn.T + way)


def carry_body(shot: Shot, skin: SkinSurfaces) -> SkinSurfaces:
    """The surfaces of a shot's skin as its act carries them; as they are where none does."""
    if shot.motion.kind != "act" or shot.motion.values["body"] != "act":
        return skin
    skeleton = skeleton_of(shot.groom)
    poses = joint_poses(shot.motion, shot, skeleton)

    def path(time: float) -> tuple[Array, Array]:
        found = poses(time)
        return found.rotations[0], found.displacements[0]

    surfaces = tuple(
        cast(MovingSurface, BodySurface(each, path, skin.clock)) for each in skin.surfaces
    )
    return replace(skin, surfaces=surfaces)
