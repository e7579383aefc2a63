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
from featherfx.render.geometry import Geometry, geometry_of, joined
from featherfx.render.light_kernels import (
    FLOOR,
    Lights,
    Points,
    Surface,
    Tile,
    camera_rays,
    gather,
    pass_vanes,
    shade,
    shade_values,
    surface_points,
)

ROWS_AT_ONCE = 16
_FLOOR = 40.0  # half of a floor's side, over the size of all that stands on it
_LAYERS = 4  # of vanes that light of the sun may pass; what lies under more is dark
_OFFSET = 2e-5  # of the size of all that is drawn: how far rays start off a surface
_TOP, _BOTTOM = np.array([0.70, 0.73, 0.77]), np.array([0.50, 0.52, 0.55])
# light of the sun and of the sky at zenith, horizon and ground; tangent of the sun's half angle
_SUN, _SUN_RADIUS = (1.75, 1.62, 1.42), 0.22
_SKY = (0.66, 0.76, 0.90), (0.95, 0.97, 1.0), (0.60, 0.55, 0.50)


def lights_of(eye: Eye) -> Lights:
    """A sun over the left shoulder of who looks, under a bright sky above warm ground."""
    up = np.array([0.0, 0.0, 1.0])
    zenith, horizon, ground = (np.array(colour) for colour in _SKY)
    sun = 0.38 * eye.back + 0.60 * up + 0.35 * eye.up - 0.55 * eye.right
    return Lights(
        sun=sun / np.linalg.norm(sun),
        sun_light=np.array(_SUN),
        sun_radius=_SUN_RADIUS,
        up=up,
        zenith=zenith,
        horizon=horizon,
        ground=ground,
        harmonics=_harmonics(zenith, horizon, ground),
    )


def _harmonics(zenith: Array, horizon: Array, ground: Array) -> Array:
    """(3, 3) of Lights: Legendre coefficients of the sky by height, as a surface receives them."""
    height, weight = np.polynomial.legendre.leggauss(64)
    above, below = np.sqrt(np.maximum(height, 0.0)), 1.0 - np.exp(5.0 * np.minimum(height, 0.0))
    sky = horizon + np.outer(above, zenith - horizon) + np.outer(below, ground - horizon)
    orders = np.polynomial.legendre.legvander(height, 2) * weight[:, None]
    received = np.array([1.0, 2.0 / 3.0, 0.25]) * np.array([0.5, 1.5, 2.5])
    return np.asarray(received[:, None] * (orders.T @ sky))


def _floor(middle: Array, height: float, half: float) -> Geometry:
    """A square around a middle (3,), at a height."""
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    points = np.array([(middle[0] + x, middle[1] + y, height) for x, y in corners])
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    return geometry_of(points, triangles, FLOOR, up, np.ones(3))


def _points(count: int) -> Points:
    """Room for what `count` rays hit."""
    places, beyond, normals, tangents, colours, to_sun, to_sky = np.zeros((7, count, 3), np.float32)
    material = np.zeros(count, np.uint8)
    return Points(places, beyond, normals, tangents, colours, to_sun, to_sky, material)


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
            geometry = joined([geometry, _floor(middle, floor - self._offset, _FLOOR * size)])
        self._embree = rtcore_scene.EmbreeScene()
        points = np.ascontiguousarray(geometry.points - middle, dtype=np.float32)
        self._mesh = TriangleMesh(self._embree, points, geometry.triangles)
        # of one layout in memory, for which kernels are compiled once
        parts = (getattr(geometry, name) for name in Surface._fields)
        self._surface = Surface(*map(np.ascontiguousarray, parts))
        # the first query builds the tree; then several threads may ask
        self._hits(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def rows(self, top: int) -> NDArray[np.uint8]:
        """(R, columns, 3) of the picture, at most ROWS_AT_ONCE rows from `top` on."""
        lens, samples = self.lens, self._samples
        count = min(ROWS_AT_ONCE, lens.rows - top)
        rays = np.zeros((count * lens.columns * samples, 3), np.float32)
        tile = Tile(lens, top, samples, self._offset, np.zeros_like(rays), rays)
        camera_rays(tile)
        found = self._hits(tile.origins, rays)
        which = np.flatnonzero(found["primID"] >= 0)
        place = np.repeat((top + np.arange(count) + 0.5) / lens.rows, lens.columns)[:, None]
        behind = _TOP + (_BOTTOM - _TOP) * place**1.5
        sums, covered = np.zeros((count * lens.columns, 3)), np.zeros(count * lens.columns)
        if len(which):
            shown = self._shown(tile, found, which, behind)
            gather(which, samples, shown, sums, covered)
        picture = (sums + (samples - covered)[:, None] * behind) / samples
        return np.round(255 * picture.clip(0, 1)).astype(np.uint8).reshape(count, -1, 3)

    def _shown(self, tile: Tile, found: dict[str, Any], which: Any, behind: Array) -> Array:
        """(N, 3) colours of the samples `which`, 0 to 1. behind: (P, 3) of what is behind all."""
        points, shown = _points(len(which)), np.zeros((len(which), 3))
        hits = tuple(found[name] for name in ("primID", "u", "v", "tfar", "Ng"))
        surface, lights = self._surface, self._lights
        surface_points(surface, lights, tile, hits, which, points)
        if self._values:
            shade_values(points, tile.rays, which, shown)
            return shown
        sunlight = self._sunlight(points)
        sky = self._hits(points.beyond, points.to_sky)["primID"]
        shade(surface, lights, points, tile.rays, which, sunlight, sky, shown)
        on_floor = np.flatnonzero(points.material == FLOOR)
        shown[on_floor] *= behind[which[on_floor] // self._samples]
        return shown

    def _sunlight(self, points: Points) -> Array:
        """(N,) share of the sun's light that arrives through vanes."""
        light = np.ones(len(points.places))
        going = np.arange(len(light))
        for _ in range(_LAYERS):
            found = self._hits(points.places[going], points.to_sun[going])
            hits = (found["primID"], found["tfar"])
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
