"""Both vanes beside the shaft: how wide they are, and at which angles their barbs stand.

Angles are those of the picture's texture: the direction along which the grey changes least, by the
structure tensor (Bigun and Granlund 1987), averaged as doubled angles, where barbs show.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from featherfx.algebra.types import Array
from featherfx.trace.shaft import ShaftLine
from featherfx.trace.silhouette import AlignedPicture

LEFT, RIGHT = 1.0, -1.0
# shares of the shaft at which widths are taken, on past its tip
_FRACTIONS = np.linspace(0.0, 1.12, 673)
# blur of the widths, of these
_EVEN = 2.0
# a vane begins where it is so much wider than the calamus, of the length
_BEGINS = 0.005
# along a vane, and from the shaft to the edge: bins in which angles are averaged
_ALONG, _OUT = np.linspace(0.08, 0.92, 6), np.linspace(0.0, 1.0, 4)
# pixels that are left out beside shaft and edge
_MARGIN = 6.0
# how much of a direction texture must have, 0 to 1, for it to count; pixels of the blurs
# and of a gradient, grey a pixel
_LEAST_COHERENCE = 0.35
_FINE, _COARSE, _LEAST_TEXTURE = 1.0, 2.0, 1e-3
# deg that barbs may stand at, and curl by
_ALLOWED, _CURL = (8.0, 118.0), (-10.0, 30.0)


def widths(laid: AlignedPicture, line: ShaftLine, side: float) -> tuple[Array, Array]:
    """(K,) shares of the length along the shaft, and (K,) how far the vane of a side goes from it,
    across, in lengths: to its outermost pixel."""
    places, heading = line.at(_FRACTIONS)
    across = side * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    reach = np.arange(0.0, laid.mask.shape[1], 0.5)
    at = places[:, None] + reach[:, None] * across[:, None]
    inside = ndimage.map_coordinates(
        laid.mask.astype(np.float32), [at[..., 0], at[..., 1]], order=1
    )
    outermost = np.where(inside > 0.5, reach, 0.0).max(axis=1) / line.length
    there = outermost > 0.0
    return _FRACTIONS, np.where(there, ndimage.gaussian_filter1d(outermost, _EVEN), 0.0)


def calamus_of(fractions: Array, left: Array, right: Array) -> tuple[float, float]:
    """Find the start of the first vane, a fraction of the length, and half the calamus width."""
    bare = 0.5 * float(np.median((left + right)[(fractions > 0.005) & (fractions < 0.04)]))
    beyond = np.maximum(left, right) - bare

    def lasting(least: float) -> float:
        wide = ndimage.minimum_filter1d(beyond > least, 13, origin=-6) & (fractions < 0.9)
        return float(fractions[np.argmax(wide)]) if wide.any() else 0.0

    # where it has grown to that, back along the line on which it grows to twice of it
    first = lasting(_BEGINS)
    return max(2.0 * first - max(lasting(2.0 * _BEGINS), first), 0.0), bare


def simplified(points: Array, tolerance: float) -> Array:
    """The polyline without the points that lie within a tolerance of it (Douglas and Peucker)."""
    keep = np.zeros(len(points), dtype=bool)
    keep[[0, -1]] = True
    spans = [(0, len(points) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        chord = points[high] - points[low]
        apart = points[low + 1 : high] - points[low]
        off = np.abs(chord[0] * apart[:, 1] - chord[1] * apart[:, 0]) / (np.hypot(*chord) or 1.0)
        far = int(off.argmax())
        if off[far] > tolerance:
            keep[low + 1 + far] = True
            spans += [(low, low + 1 + far), (low + 1 + far, high)]
    return points[keep]


def barb_angles(
    laid: AlignedPicture,
    line: ShaftLine,
    side: float,
    bare: tuple[float, float],
    edge: tuple[Array, Array],
) -> list[tuple[float, float, float]]:
    """(position, angle, curl) of guides of a vane where its barbs show, in degrees.

    bare: as of `calamus_of`. edge: as of `widths`.
    """
    (calamus, thick), direction, found = bare, _directions(laid), []
    for position in _ALONG:
        fraction = calamus + (1.0 - calamus) * (position + np.linspace(-0.04, 0.04, 33))
        places, heading = line.at(fraction)
        across = side * np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        # between the shaft, which gets thinner, and the edge
        low = thick * (1.0 - 0.8 * fraction) * line.length + _MARGIN
        high = np.interp(fraction, *edge) * line.length - _MARGIN
        angles = []
        for part in pairwise(_OUT):
            ways = low + np.linspace(*part, 15)[:, None] * np.maximum(high - low, 0.0)
            at = (places + ways[..., None] * across).reshape(-1, 2).T
            real, imag = (
                ndimage.map_coordinates(each, at, order=1)
                for each in (direction.real, direction.imag)
            )
            mean = ((real + 1j * imag) * np.exp(-2j * np.tile(heading, len(ways)))).mean()
            if abs(mean) > _LEAST_COHERENCE and np.mean(high - low) > _MARGIN:
                angles.append((sum(part) / 2.0, np.degrees(side * 0.5 * np.angle(mean)) % 180.0))
        if angles:
            found.append((float(position), *_root_and_curl(angles)))
    return [each for each in found if _ALLOWED[0] < each[1] < _ALLOWED[1]]


def straightened(guides: list[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """Guides whose angles are a line over their positions, through the middle of the slopes between
    any two (Theil 1950, Sen 1968), all with the middle curl; at least two guides."""
    places, angles, curls = np.array(guides).T
    first, second = np.triu_indices(len(places), 1)
    slope = np.median((angles[second] - angles[first]) / (places[second] - places[first]))
    line = np.median(angles - slope * places) + slope * places
    within = np.clip(line, *_ALLOWED)
    return [
        (float(p), float(a), float(np.median(curls))) for p, a in zip(places, within, strict=True)
    ]


def _root_and_curl(angles: list[tuple[float, float]]) -> tuple[float, float]:
    """Angle at the shaft and curl, in degrees, of (part of the way to the edge, angle)."""
    places, values = np.array(angles).T
    rise = float(np.polyfit(places, values, 1)[0]) if len(angles) == len(_OUT) - 1 else 0.0
    curl = float(np.clip(-rise, *_CURL))
    return float(np.mean(values) + curl * np.mean(places)), curl


def _directions(laid: AlignedPicture) -> NDArray[np.complex128]:
    """(U, V) doubled direction of the texture's lines, as long as it is coherent, 0 to 1: the
    difference of the eigenvalues of the gradient's tensor over their sum."""
    along, across = (
        ndimage.gaussian_filter(laid.grey, _FINE, order=order) for order in ((1, 0), (0, 1))
    )
    core = ndimage.binary_erosion(laid.mask, iterations=3)
    # lines run across the gradient: the doubled angle is turned by pi
    tensor = -((along + 1j * across) ** 2) * core
    real, imag, total = (
        ndimage.gaussian_filter(each, _COARSE)
        for each in (tensor.real, tensor.imag, np.abs(tensor))
    )
    return np.asarray((real + 1j * imag) / np.maximum(total, _LEAST_TEXTURE**2))
