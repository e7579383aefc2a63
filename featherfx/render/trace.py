"""Ray casting with Embree, shading in numpy: the same picture on every machine, without OpenGL.

Barbs are finer than triangles. They are drawn as shades between the barb lines of the mesh, by the
barycentric coordinate that runs from a triangle's barb edge to its opposite corner, and fade out
where they become finer than a pixel.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from featherfx.render.camera import PictureCamera
from featherfx.render.scene import DrawnPose, DrawnScene

Array = NDArray[np.float64]

_SAMPLES = 3
_BARBS_PER_ROW = 4
_BARB_DEPTH = 0.16
_ROWS_AT_ONCE = 48
_TOP, _BOTTOM = np.array([0.98, 0.98, 0.99]), np.array([0.80, 0.81, 0.83])


class Tracer:
    """Renders poses of a scene with one camera. size: (width, height) in pixels."""

    def __init__(self, scene: DrawnScene, camera: PictureCamera, size: tuple[int, int]) -> None:
        self._scene, self._camera, self._size = scene, camera, size
        light = 0.55 * camera.back + 0.65 * camera.up - 0.5 * camera.right
        self._light = light / np.linalg.norm(light)

    def picture(self, pose: DrawnPose, colours: Array, stripes: bool) -> NDArray[np.uint8]:
        """(height, width, 3) of one pose. colours: (T, 3), 0 to 1. stripes: barbs and light."""
        height = self._size[1]
        # Single precision rays: an origin near the feathers keeps far-off scenes exact.
        points = (pose.points - self._camera.eye).astype(np.float32)
        accelerated = rtcore_scene.EmbreeScene()
        mesh = TriangleMesh(accelerated, points, self._scene.triangles.astype(np.int32))
        lengths = self._row_spacing(pose) if stripes else None
        strips = []
        for top in range(0, height, _ROWS_AT_ONCE):
            rows = range(top, min(top + _ROWS_AT_ONCE, height))
            strips.append(self._strip(accelerated, pose, colours, lengths, rows))
        del mesh
        linear = np.concatenate(strips)
        return np.round(255 * np.clip(linear, 0, 1)).astype(np.uint8)

    def _strip(
        self, accelerated: Any, pose: DrawnPose, colours: Array, spacing: Array | None, rows: range
    ) -> Array:
        width, height = self._size
        steps = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
        x = (np.arange(width)[:, None] + steps).ravel()
        y = (np.arange(rows.start, rows.stop)[:, None] + steps).ravel()
        columns, lines = (a.ravel() for a in np.meshgrid(x, y))
        rays = self._camera.rays(columns, lines, self._size).astype(np.float32)
        found = accelerated.run(np.zeros_like(rays), rays, query="INTERSECT", output=True)
        hit = found["primID"] >= 0
        down = (lines / height)[:, None]
        shown = _TOP + (_BOTTOM - _TOP) * down**1.5
        if hit.any():
            hits = {name: found[name][hit] for name in ("primID", "u", "v", "tfar", "Ng")}
            shown[hit] = self._shade(accelerated, pose, colours, spacing, rays[hit], hits)
        blocks = shown.reshape(len(rows), _SAMPLES, width, _SAMPLES, 3)
        return blocks.mean(axis=(1, 3))

    def _shade(
        self, accelerated: Any, pose: DrawnPose, colours: Array, spacing: Array | None, rays: Array,
        hits: dict[str, Any],
    ) -> Array:  # fmt: skip
        face, u, v = hits["primID"], hits["u"].astype(float), hits["v"].astype(float)
        weights = np.stack([1 - u - v, u, v], axis=1)
        normal = np.einsum("nk,nkc->nc", weights, pose.normals[self._scene.triangles[face]])
        geometric = hits["Ng"].astype(float)
        normal = _facing(normal, np.where(np.abs(normal).sum(1, keepdims=True) > 0, rays, 0))
        geometric = _facing(geometric, rays)
        colour = colours[face]
        if spacing is not None:
            colour = colour * self._stripes(face, weights, hits["tfar"], spacing)[:, None]
        facing = np.maximum(-(normal * rays).sum(axis=1), 0)
        if spacing is None:
            # Colours that stand for values stay close to those of the key.
            return colour * (0.72 + 0.28 * facing)[:, None]
        place = rays * hits["tfar"][:, None] + geometric * (2e-4 * self._scene.extent_of_rest)
        toward = np.tile(self._light.astype(np.float32), (len(rays), 1))
        blocked = accelerated.run(place.astype(np.float32), toward, query="OCCLUDED") == 0
        towards = normal @ self._light
        # A vane lets light through: its far side is lit at half the strength.
        lit = np.maximum(towards, -0.5 * towards) * np.where(blocked, 0.4, 1.0)
        sky = 0.5 + 0.5 * (normal @ self._camera.up)
        brightness = 0.46 + 0.12 * sky + 0.16 * facing + 0.36 * lit
        return np.minimum(colour * brightness[:, None], 1.0)

    def _row_spacing(self, pose: DrawnPose) -> Array:
        """(T,) distance from the barb edge to its opposite corner; 0 where no barbs are drawn."""
        scene = self._scene
        corners = pose.points[scene.triangles]
        index = np.arange(len(corners))
        apex = np.maximum(scene.apex, 0)
        a, b = corners[index, (apex + 1) % 3], corners[index, (apex + 2) % 3]
        area = np.linalg.norm(np.cross(b - a, corners[index, apex] - a), axis=1)
        height = area / np.maximum(np.linalg.norm(b - a, axis=1), 1e-300)
        return np.where(scene.rachis | (scene.apex < 0), 0.0, height)

    def _stripes(self, face: Any, weights: Array, distance: Any, spacing: Array) -> Array:
        apex = np.maximum(self._scene.apex[face], 0)
        between = weights[np.arange(len(face)), apex]
        # Symmetric between two barbs, so that the two triangles of a cell meet at the same shade.
        wave = 0.5 - 0.5 * np.cos(2 * math.pi * _BARBS_PER_ROW * between)
        pixels = spacing[face] / _BARBS_PER_ROW / self._camera.pixel(distance, self._size[1])
        return 1 - _BARB_DEPTH * np.clip((pixels - 1) / 2.5, 0, 1) * (1 - wave) ** 2


def _facing(vectors: Array, rays: Array) -> Array:
    """Unit vectors, turned to the side that the rays come from."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    unit = vectors / np.where(length > 0, length, 1)
    away = (unit * rays).sum(axis=1, keepdims=True) > 0
    return np.where(away, -unit, unit)
