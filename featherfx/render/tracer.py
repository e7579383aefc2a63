"""Lights, background and floor of images.

Shadow and sky that few rays have found, smoothed over neighbouring pixels that agree.

Of each pixel the share V of the sun and O of the sky is known as a mean of n samples with a
variance, apart from the light that they are shares of, which keeps all that is fine. It becomes
the mean over pixels q near p, weighted by

    exp(-((V_p - V_q)^2 / (var_p + var_q) + the same of O) / 2)

where V, O and variances of the weights are means over 3 x 3 pixels (the test of Rousselle et al.
2012, with the weights of the bilateral filter). Where shadows differ by more than chance would
have it they stay as they are.

A pixel is 13 numbers: light of the sun and of the sky, were all of it there (3 each), V, O (3), the
variances of V and O, and the share of the pixel that is covered.
"""

from __future__ import annotations

from math import exp
from typing import Any

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from featherfx.algebra.types import Array
from featherfx.jit.compiled import kernel
from featherfx.render.camera import Eye
from featherfx.render.geometry import Geometry, geometry_of, joined
from featherfx.render.light_kernels import (
    EXPOSURE,
    FLOOR,
    HitSurface,
    Lights,
    RayHits,
    Tile,
    camera_rays,
    displayed,
    find_gaps,
    gather,
    pass_vanes,
    shade,
    shade_values,
    surface_points,
)

MEAN_NUMBERS = 13
SMOOTHING_REACH = 4  # pixels
_LEAST = 0.04  # variance of a sample, at least: some may all have found the same by chance
_V, _O, _VAR, _COVERED = 6, 7, 10, 12


@kernel
def _brightness(colour):
    return 0.3 * colour[0] + 0.5 * colour[1] + 0.2 * colour[2]


@kernel
def gather_light(which, samples, found, pixels):
    """Fill pixels (P, MEAN_NUMBERS) with the samples `which` of theirs.

    found: of each sample, light of the sun, of the sky, share of the one (N,), and of the other (N,
    3).
    """
    lit, open_sky, sunlight, seen = found
    for index in range(len(which)):
        pixel, weights = pixels[which[index] // samples], (lit[index], open_sky[index])
        sun, sky = _brightness(weights[0]) + 1e-6, _brightness(weights[1]) + 1e-6
        share = sky * _brightness(seen[index])
        for k in range(3):
            pixel[k] += weights[0][k]
            pixel[3 + k] += weights[1][k]
            pixel[_O + k] += (weights[1][k] + 1e-6) * seen[index, k]
        pixel[_V] += sun * sunlight[index]
        pixel[_VAR] += sun * sunlight[index] ** 2
        pixel[_VAR + 1] += share * share / sky
        pixel[_COVERED] += 1.0
    for index in range(len(pixels)):
        pixel = pixels[index]
        count = pixel[_COVERED]
        if count == 0.0:
            continue
        sun, sky = _brightness(pixel[:3]) + 1e-6 * count, _brightness(pixel[3:6]) + 1e-6 * count
        pixel[_V] /= sun
        for k in range(3):
            pixel[_O + k] /= pixel[3 + k] + 1e-6 * count
            pixel[k] /= count
            pixel[3 + k] /= count
        spread = pixel[_VAR] / sun - pixel[_V] ** 2
        pixel[_VAR] = max(spread, _LEAST) / count
        spread = pixel[_VAR + 1] / sky - _brightness(pixel[_O : _O + 3]) ** 2
        pixel[_VAR + 1] = max(spread, _LEAST) / count
        pixel[_COVERED] = count / samples


@kernel
def _means(pixels, row, column, means):
    """Fill `means` (4,) with V, O and their variances over the pixels around one."""
    total = 0.0
    means[:] = 0.0
    for y in range(max(row - 1, 0), min(row + 2, pixels.shape[0])):
        for x in range(max(column - 1, 0), min(column + 2, pixels.shape[1])):
            pixel = pixels[y, x]
            weight = pixel[_COVERED]
            total += weight
            means[0] += weight * pixel[_V]
            means[1] += weight * _brightness(pixel[_O : _O + 3])
            means[2] += weight * weight * pixel[_VAR]
            means[3] += weight * weight * pixel[_VAR + 1]
    if total > 0.0:
        means[0], means[1] = means[0] / total, means[1] / total
        means[2], means[3] = means[2] / (total * total), means[3] / (total * total)


@kernel
def _smoothed(pixels, means, row, column, top, light):
    """Fill `light` (3,) with that of a pixel. means: of the rows from `top` on."""
    own, total = means[row - top, column], 0.0
    sun, sky_r, sky_g, sky_b = 0.0, 0.0, 0.0, 0.0
    for y in range(max(row - SMOOTHING_REACH, 0), min(row + SMOOTHING_REACH + 1, pixels.shape[0])):
        for x in range(
            max(column - SMOOTHING_REACH, 0), min(column + SMOOTHING_REACH + 1, pixels.shape[1])
        ):
            pixel, other = pixels[y, x], means[y - top, x]
            if pixel[_COVERED] == 0.0:
                continue
            apart = (own[0] - other[0]) ** 2 / (own[2] + other[2])
            apart += (own[1] - other[1]) ** 2 / (own[3] + other[3])
            if apart > 16.0:
                continue
            weight = pixel[_COVERED] * exp(-0.5 * apart)
            total += weight
            sun += weight * pixel[_V]
            sky_r += weight * pixel[_O]
            sky_g += weight * pixel[_O + 1]
            sky_b += weight * pixel[_O + 2]
    own_light = pixels[row, column]
    light[0] = (sun * own_light[0] + sky_r * own_light[3]) / total
    light[1] = (sun * own_light[1] + sky_g * own_light[4]) / total
    light[2] = (sun * own_light[2] + sky_b * own_light[5]) / total


@kernel
def finish(pixels, top, behind, means, shown):
    """Fill `shown` (R, columns, 3) of displays, 0 to 1, with the rows of pixels (rows, columns,
    MEAN_NUMBERS) from `top` on.

    behind: (R, columns, 3) what is seen where nothing is. means: room for
    (R + 2 SMOOTHING_REACH, columns, 4).
    """
    first = max(top - SMOOTHING_REACH, 0)
    last = min(top + len(shown) + SMOOTHING_REACH, pixels.shape[0])
    for row in range(first, last):
        for column in range(pixels.shape[1]):
            _means(pixels, row, column, means[row - first, column])
    for row in range(len(shown)):
        for column in range(pixels.shape[1]):
            covered, light = pixels[top + row, column, _COVERED], shown[row, column]
            light[:] = 0.0
            if covered > 0.0:
                _smoothed(pixels, means, top + row, column, first, light)
            for k in range(3):
                back = (1.0 - covered) * behind[row, column, k]
                light[k] = covered * displayed(light[k]) + back


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
        self, geometry: Geometry, eye: Eye, samples: int, values: bool, floor: float | None = None
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
        numbers = 0 if values else MEAN_NUMBERS
        self._pixels = np.zeros((self.lens.rows, self.lens.columns, numbers), np.float32)

    def trace(self, top: int) -> None:
        """Find the light of at most ROWS_AT_ONCE rows from `top` on, which `rows` asks for."""
        if self._values:
            return
        tile, found, which = self._seen(top)
        if len(which):
            rows = self._pixels[top : top + ROWS_AT_ONCE].reshape(-1, MEAN_NUMBERS)
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
            means = np.zeros((count + 2 * SMOOTHING_REACH, lens.columns, 4))
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


_FLOOR = 40.0  # half of a floor's side, over the size of all that stands on it
# all by eye: of displays, behind all, in the middle, at the corners, and below
_BEHIND = np.array([[0.68, 0.71, 0.735], [0.36, 0.41, 0.47], [0.54, 0.535, 0.53]])
# light of the sun, of the lamp behind, and of the sky at zenith, horizon and ground; tangent of the
# sun's half angle
_SUN, _SUN_RADIUS, _RIM = (2.25, 2.06, 1.78), 0.16, (0.55, 0.62, 0.75)
_SKY = (0.60, 0.68, 0.82), (0.76, 0.80, 0.86), (0.66, 0.61, 0.55)


def lights_of(eye: Eye) -> Lights:
    """A sun over the right shoulder of who looks, under a bright sky above warm ground, and a lamp
    behind on the left."""
    up = np.array([0.0, 0.0, 1.0])
    zenith, horizon, ground = (np.array(colour) for colour in _SKY)
    sun = 0.60 * eye.back + 0.15 * up + 0.85 * eye.up + 0.55 * eye.right
    rim = -0.75 * eye.back + 0.45 * eye.up - 0.60 * eye.right
    # (3, 3) of Lights: Legendre coefficients of the sky by height, as a surface receives them
    height, weight = np.polynomial.legendre.leggauss(64)
    above, below = np.sqrt(np.maximum(height, 0.0)), 1.0 - np.exp(5.0 * np.minimum(height, 0.0))
    sky = horizon + np.outer(above, zenith - horizon) + np.outer(below, ground - horizon)
    orders = np.polynomial.legendre.legvander(height, 2) * weight[:, None]
    received = np.array([1.0, 2.0 / 3.0, 0.25]) * np.array([0.5, 1.5, 2.5])
    return Lights(
        sun=sun / np.linalg.norm(sun),
        sun_light=np.array(_SUN),
        sun_radius=_SUN_RADIUS,
        rim=rim / np.linalg.norm(rim),
        rim_light=np.array(_RIM),
        up=up,
        zenith=zenith,
        horizon=horizon,
        ground=ground,
        harmonics=np.asarray(received[:, None] * (orders.T @ sky)),
    )


def floor_of(middle: Array, height: float, size: float) -> Geometry:
    """A square around a middle (3,), at a height. size: m, of what stands on it."""
    half = _FLOOR * size
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    points = np.array([(middle[0] + x, middle[1] + y, height) for x, y in corners])
    triangles = np.array([(0, 1, 2), (0, 2, 3)])
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    return geometry_of(points, triangles, FLOOR, up, np.ones(3))


def backdrop(columns: int, top: int, count: int, rows: int) -> Array:
    """(count, columns, 3) of displays, what is seen where nothing is, of rows from `top` on: a wall
    that is lit in the middle, and a floor."""
    middle, corner, below = _BEHIND
    x = (np.arange(columns) + 0.5) / columns - 0.5
    y = ((top + np.arange(count) + 0.5) / rows - 0.42)[:, None]
    away = np.clip(1.9 * (x * x + 1.1 * y * y), 0.0, 1.0)[..., None]
    wall = middle + away * (corner - middle)
    low = np.clip((y - 0.12) / 0.46, 0.0, 1.0)[..., None]
    return np.asarray(wall + low * low * (3.0 - 2.0 * low) * 0.7 * (below - wall))


def light_of(shown: Array) -> Array:
    """Light that displays show so; undoes `displayed`."""
    value = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    square, linear = 2.51 - 2.43 * value, 0.03 - 0.59 * value
    root = np.sqrt(linear * linear + 0.56 * square * value)
    return np.asarray((root - linear) / (2.0 * square) / EXPOSURE)
