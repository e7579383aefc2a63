"""Where to look from, so that every feather of every chosen frame is in the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.render.scene import DrawnPose, DrawnScene
from featherfx.usd.space import StageSpace

Array = NDArray[np.float64]

_ANGLE = math.radians(24)
_MARGIN = 1.06
# (right, up) of the fixed views in a z-up frame: top, from -y, and from +x.
_FIXED = {
    "top": ((1, 0, 0), (0, 1, 0)),
    "side": ((1, 0, 0), (0, 0, 1)),
    "front": ((0, 1, 0), (0, 0, 1)),
}


@dataclass(frozen=True)
class PictureCamera:
    """eye: (3,). right, up, back: unit (3,). tangent: of half the vertical angle of view."""

    eye: Array
    right: Array
    up: Array
    back: Array
    tangent: float

    def rays(self, columns: Array, rows: Array, size: tuple[int, int]) -> Array:
        """Unit directions (N, 3) through picture positions in pixels (y down)."""
        width, height = size
        x = (2 * columns / width - 1) * self.tangent * width / height
        y = (1 - 2 * rows / height) * self.tangent
        rays = x[:, None] * self.right + y[:, None] * self.up - self.back
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)

    def pixel(self, distance: Array | float, height: int) -> Array | float:
        """Size of a pixel at a distance, stage units."""
        return 2 * self.tangent * distance / height


def choose_camera(
    scene: DrawnScene, poses: Sequence[DrawnPose], view: str, up_axis: str, size: tuple[int, int]
) -> PictureCamera:
    """A camera of a view (one of featherfx.render.picture.VIEWS) that frames all poses."""
    world_up = StageSpace(1.0, up_axis).directions(np.array([0.0, 0.0, 1.0]))
    if view == "auto":
        right, up = _three_quarter(scene, poses, world_up)
    else:
        turned = StageSpace(1.0, up_axis).directions
        right, up = (turned(np.array(vector, dtype=float)) for vector in _FIXED[view])
    return _framing(right, up, np.concatenate([pose.points for pose in poses]), size)


def _three_quarter(
    scene: DrawnScene, poses: Sequence[DrawnPose], world_up: Array
) -> tuple[Array, Array]:
    """(right, up) of a view that sees the vanes from their broad side, a little from aside."""
    areas = []
    for pose in poses:
        a, b, c = (pose.points[scene.triangles[:, k]] for k in range(3))
        areas.append(0.5 * np.cross(b - a, c - a))
    normals = np.concatenate(areas)
    size = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    broad = np.linalg.eigh(np.einsum("tk,tl,t->kl", normals, normals, 1 / size))[1][:, -1]
    toward = broad @ world_up
    if abs(toward) < 0.3:
        toward = broad @ normals.sum(axis=0)
    broad = broad if toward >= 0 else -broad
    points = np.concatenate([pose.points for pose in poses])
    flat = (points - points.mean(axis=0)) @ (np.eye(3) - np.outer(broad, broad))
    # The greatest spread lies along the picture's width, pointing to the positive axis.
    long = np.linalg.eigh(flat.T @ flat)[1][:, -1]
    long = long if long[np.argmax(np.abs(long))] > 0 else -long
    up = np.cross(broad, long)
    if up @ world_up < -0.1:
        long, up = -long, -up
    raised = world_up if abs(broad @ world_up) < 0.7 else -up
    back = broad + 0.35 * raised - 0.2 * long
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    across = np.cross(back, right)
    return right, across / np.linalg.norm(across)


def _framing(right: Array, up: Array, points: Array, size: tuple[int, int]) -> PictureCamera:
    """The nearest camera of given axes from which all points are in the picture."""
    back = np.cross(right, up)
    tangent, aspect = math.tan(_ANGLE / 2), size[0] / size[1]
    local = points @ np.stack([right, up, back], axis=1)
    centre = 0.5 * (local.min(axis=0) + local.max(axis=0))
    x, y, z = (local - centre).T
    needed = np.maximum(np.abs(y) / tangent, np.abs(x) / (tangent * aspect))
    distance = max(float((z + _MARGIN * needed).max()), 1e-9)
    eye = centre[0] * right + centre[1] * up + (centre[2] + distance) * back
    return PictureCamera(eye, right, up, back, tangent)
