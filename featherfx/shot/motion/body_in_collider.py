"""Bodies that an act leads through a collider, such as the ground.

Points of the skin are followed from frame to frame. Over a triangle that a point p is nearest to,
with the normal n and the nearest place c, its height is n (p - c), where p stands over that place.
Where the height changes its sign from one frame to the next, the point has gone through.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import dots, face_products
from featherfx.errors import InputWarning
from featherfx.groom.skin.skin import closest
from featherfx.shot.motion.body import BodySurface
from featherfx.shot.skin import SkinSurfaces
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Shot

_DEEP = 0.01  # depth over the body's size, from which on it is told
_MAX_POINTS = 1000  # that are looked at
_MAX_FRAMES = 400  # likewise
_BESIDE = 1e-3  # of a distance, by which a point may be beside what it stands over


def warn_of_passage(shot: Shot, skin: SkinSurfaces, colliders: Sequence[TimedSurface]) -> None:
    """Say where an act leads a body through colliders, in which frame the deepest and how deep."""
    last = shot.last_frame - shot.first_frame
    frames = np.unique(np.linspace(0, last, _MAX_FRAMES).round().astype(int)).tolist()
    carried = [each for each in skin.surfaces if isinstance(each, BodySurface) and each.body_path]
    walls = [each for each in colliders if not isinstance(each.surface, BodySurface)]
    for surface in carried if walls else ():
        stride, body = -(-len(surface.rest) // _MAX_POINTS), TimedSurface(surface, skin.clock)
        ways = [body.points(k / shot.frames_per_second)[::stride] for k in frames]
        size = float(np.linalg.norm(np.ptp(ways[0], axis=0)))
        for wall in walls:
            deep = _depths(ways, wall, [k / shot.frames_per_second for k in frames])
            worst = int(deep.argmax())
            if deep[worst] > _DEEP * size:
                warnings.warn(
                    f"{shot.source}: motion: leads the body {surface.path} through collider"
                    f" {wall.surface.path}, by {1e3 * deep[worst]:.3g} mm at frame"
                    f" {shot.first_frame + frames[worst]}. Give a path that stays outside",
                    InputWarning,
                    stacklevel=2,
                )


def _depths(ways: Sequence[Array], wall: TimedSurface, times: Sequence[float]) -> Array:
    """(K,) m, how deep a body is in a collider, and was not at first. ways: points (V, 3) m of the
    body at times (K,) s."""
    deep, before, through = np.zeros(len(ways)), np.zeros(len(ways[0])), None
    usual = 0.0
    for k, (points, time) in enumerate(zip(ways, times, strict=True)):
        heights = _heights(points, wall.points(time)[wall.surface.triangles])
        if through is None and heights.any():
            through = heights * np.sign(heights.sum()) < 0.0
            usual = np.abs(heights[through]).max(initial=0.0)
        if through is None:
            continue
        through ^= heights * before < 0.0
        before, deep[k] = heights, max(0.0, np.abs(heights[through]).max(initial=0.0) - usual)
    return deep


def _heights(points: Array, corners: Array) -> Array:
    """(N,) m, of points (N, 3) over the triangles (T, 3, 3) that they are nearest to; 0 where they
    stand over none."""
    triangle, weights = closest(points, corners)
    away = points - np.einsum("nk,nkc->nc", weights, corners[triangle])
    normals = face_products(corners[triangle])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    height = dots(away, normals)
    beside = np.linalg.norm(away - height[:, None] * normals, axis=1)
    return np.where(beside <= _BESIDE * np.abs(height), height, 0.0)
