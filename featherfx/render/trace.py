"""Ray casting with Embree, shading in compiled code: the same picture on every machine, without
OpenGL. Rows of a picture are independent of each other, so that threads may share it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from featherfx.algebra.types import Array
from featherfx.render.camera import Eye
from featherfx.render.geometry import Geometry, joined
from featherfx.render.light_kernels import (
    FLOOR,
    HitSurface,
    RayHits,
    Tile,
    camera_rays,
    find_gaps,
    gather,
    pass_vanes,
    shade,
    shade_values,
    surface_points,
)
from featherfx.render.smooth_kernels import NUMBERS, REACH, finish, gather_light
from featherfx.render.studio import backdrop, floor_of, light_of, lights_of

ROWS_AT_ONCE = 16
_LAYERS = 4  # of vanes that light of the sun may pass; what lies under more is dark
_OFFSET = 2e-5  # of the size of all that is drawn: how far rays start off a surface
_GAPS = 6  # between barbs that a ray goes through


def _points(count: int) -> RayHits:
    """Room for what `count` rays hit."""
    places, beyond, normals, tangents, colours, to_sun, to_sky = np.zeros((7, count, 3), np.float32)
    material, (through, film) = np.zeros(count, np.uint8), np.zeros((2, count), np.float32)
    return RayHits(
        places, beyond, normals, tangents, colours, to_sun, to_sky, material, through, film
    )


def _hit(found: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(found[name] for name in ("primID", "u", "v", "tfar", "Ng"))


class Tracer:
    """Draws one pose as one camera sees it. samples: rays a pixel, a power of 2. values: whether
    colours stand for values, so that there is neither light nor shadow. floor: height, m, of a
    floor that takes shadow; None: there is none."""

    def __init__(
        self,
        geometry: Geometry,
        eye: Eye,
        samples: int,
        values: bool,
        floor: float | None = None,
    ) -> None:
        self._samples, self._values = samples, values
        # single precision: an origin amid what is drawn keeps far-off scenes exact
        low, high = geometry.points.min(axis=0), geometry.points.max(axis=0)
        middle = 0.5 * (low + high)
        self.lens, self._lights = eye.lens(middle), lights_of(eye)
        size = float((high - low).max())
        self._offset = _OFFSET * size
        if floor is not None:
            geometry = joined([geometry, floor_of(middle, floor - self._offset, size)])
        self._embree = rtcore_scene.EmbreeScene()
        points = np.ascontiguousarray(geometry.points - middle, dtype=np.float32)
        self._mesh = TriangleMesh(self._embree, points, geometry.triangles)
        # of one layout in memory, for which kernels are compiled once
        parts = (getattr(geometry, name) for name in HitSurface._fields)
        self._surface = HitSurface(*map(np.ascontiguousarray, parts))
        # the first query builds the tree; then several threads may ask
        self._hits(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        numbers = 0 if values else NUMBERS
        self._pixels = np.zeros((self.lens.rows, self.lens.columns, numbers), np.float32)

    def trace(self, top: int) -> None:
        """Find the light of at most ROWS_AT_ONCE rows from `top` on, which `rows` asks for."""
        if self._values:
            return
        tile, found, which = self._seen(top)
        if len(which):
            rows = self._pixels[top : top + ROWS_AT_ONCE].reshape(-1, NUMBERS)
            gather_light(which, self._samples, self._light(tile, found, which), rows)

    def rows(self, top: int) -> NDArray[np.uint8]:
        """(R, columns, 3) of the picture, at most ROWS_AT_ONCE rows from `top` on. All rows are
        traced."""
        lens = self.lens
        count = min(ROWS_AT_ONCE, lens.rows - top)
        behind = backdrop(lens.columns, top, count, lens.rows)
        shown = np.zeros_like(behind)
        if self._values:
            self._valued(top, behind, shown)
        else:
            means = np.zeros((count + 2 * REACH, lens.columns, 4))
            finish(self._pixels, top, behind, means, shown)
        return np.round(255 * shown.clip(0, 1)).astype(np.uint8)

    def _valued(self, top: int, behind: Array, shown: Array) -> None:
        """Fill `shown` (R, columns, 3) with colours that stand for values."""
        tile, found, which = self._seen(top)
        sums, covered = shown.reshape(-1, 3), np.zeros(shown.shape[0] * shown.shape[1])
        if len(which):
            points, values = self._points(tile, found, which), np.zeros((len(which), 3))
            shade_values(points, tile.rays, which, values)
            gather(which, self._samples, values, sums, covered)
        shown += (self._samples - covered).reshape(*shown.shape[:2], 1) * behind
        shown /= self._samples

    def _seen(self, top: int) -> tuple[Tile, dict[str, Any], Any]:
        """Rays of at most ROWS_AT_ONCE rows, what they hit, and the numbers of those that do."""
        lens, samples = self.lens, self._samples
        count = min(ROWS_AT_ONCE, lens.rows - top)
        rays = np.zeros((count * lens.columns * samples, 3), np.float32)
        tile = Tile(lens, top, samples, self._offset, np.zeros_like(rays), rays)
        camera_rays(tile)
        found = self._hits(tile.origins, rays)
        going = np.flatnonzero(found["primID"] >= 0)
        for _ in range(_GAPS):
            gaps = np.zeros(len(going), np.bool_)
            find_gaps(self._surface, _hit(found), going, gaps)
            going = going[gaps]
            if not len(going):
                break
            far = found["tfar"][going] + np.float32(self._offset)
            behind = tile.origins[going] + far[:, None] * rays[going]
            for name, values in self._hits(behind, rays[going]).items():
                found[name][going] = values
            found["tfar"][going] += far
            going = going[found["primID"][going] >= 0]
        return tile, found, np.flatnonzero(found["primID"] >= 0)

    def _points(self, tile: Tile, found: dict[str, Any], which: Any) -> RayHits:
        points = _points(len(which))
        surface_points(self._surface, self._lights, tile, _hit(found), which, points)
        return points

    def _light(self, tile: Tile, found: dict[str, Any], which: Any) -> tuple[Array, ...]:
        """As gather_light takes it, of the samples `which`."""
        points, surface = self._points(tile, found, which), self._surface
        lit, open_sky, seen = np.zeros((3, len(which), 3))
        sunlight = self._sunlight(points)
        sky = self._hits(points.beyond, points.to_sky)["primID"]
        shade(surface, self._lights, points, tile.rays, which, sky, (lit, open_sky, seen))
        on_floor = np.flatnonzero(points.material == FLOOR)
        if len(on_floor):
            rows = len(tile.rays) // (tile.lens.columns * tile.samples)
            behind = backdrop(tile.lens.columns, tile.top, rows, tile.lens.rows).reshape(-1, 3)
            colours = light_of(behind)[which[on_floor] // tile.samples]
            lit[on_floor] *= colours
            open_sky[on_floor] *= colours
        return lit, open_sky, sunlight, seen

    def _sunlight(self, points: RayHits) -> Array:
        """(N,) share of the sun's light that arrives through vanes."""
        light = np.ones(len(points.places))
        going = np.arange(len(light))
        for _ in range(_LAYERS):
            found = self._hits(points.places[going], points.to_sun[going])
            hits = _hit(found)[:4]
            pass_vanes(
                self._surface, hits, going, self._offset, points.places, points.to_sun, light
            )
            going = going[(found["primID"] >= 0) & (light[going] > 0.0)]
            if not len(going):
                return light
        light[going] = 0.0
        return light

    def _hits(self, origins: Any, rays: Any) -> dict[str, Any]:
        found: dict[str, Any] = self._embree.run(origins, rays, query="INTERSECT", output=True)
        return found
