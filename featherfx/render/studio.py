"""Lights, background and floor of images."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array
from featherfx.render.camera import Eye
from featherfx.render.geometry import Geometry, geometry_of
from featherfx.render.light_kernels import EXPOSURE, FLOOR, Lights

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
