"""Rachis and vanes of a traced picture: their lines, outlines and barb angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import CubicSpline, PchipInterpolator

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import arc_lengths
from featherfx.errors import InputError, Problem
from featherfx.trace.silhouette import AlignedPicture

# blur along, a share of the feather's length, and across, of half the width of the calamus
_ALONG, _SCALES = 0.02, (1.0, 0.7, 0.45, 0.3)
# of a shaft that shows, how far its ridge is above the middle one of the feather
_MIN_CONTRAST = 2.5
# times as wide as at its base, up to where a feather is calamus
_STILL_BARE = 1.4
# waves of the path that are shorter than a share of it are evened out; pixels from it beyond which
# a place of the path counts less, and how often it is fitted
_WAVE, _OFF, _FITS = 0.2, 2.0, 5
_FINE = 2001


@dataclass(frozen=True)
class ShaftLine:
    """A smooth line from base to tip. places: (N, 2) in AlignedPicture, evenly apart; length:
    pixels."""

    places: Array
    length: float

    @cached_property
    def _along(self) -> Array:
        return np.linspace(0.0, 1.0, len(self.places))

    @cached_property
    def heading(self) -> Array:
        """(N,) rad, of its tangent, to the left."""
        step = np.gradient(self.places, axis=0)
        return np.unwrap(np.arctan2(step[:, 1], step[:, 0]))

    def at(self, fraction: Array) -> tuple[Array, Array]:
        """(K, 2) places and (K,) headings at shares of the length; straight on past both ends."""
        inside = np.clip(fraction, 0.0, 1.0)
        heading = np.interp(inside, self._along, self.heading)
        places = np.stack([np.interp(inside, self._along, c) for c in self.places.T], axis=1)
        beyond = (fraction - inside)[:, None] * self.length
        return places + beyond * np.stack([np.cos(heading), np.sin(heading)], axis=1), heading


def shaft_of(laid: AlignedPicture, source: str) -> ShaftLine:
    """The shaft that shows in a picture. Raises InputError where none does; source: the file."""
    columns = np.flatnonzero(laid.mask.any(axis=1))
    columns = np.arange(columns[0], columns[-1] + 1)
    mask = laid.mask[columns]
    bare, width = _bare(mask)
    found = [_path(each, mask, bare) for each in _ridges(laid.grey[columns], width)]
    contrast, path, shown = max(found, key=lambda each: each[0])
    if contrast < _MIN_CONTRAST:
        message = "the shaft does not show in the picture. Give its line from base to tip (--shaft)"
        raise InputError(Problem(source, "", message))
    along = columns.astype(np.float64)
    return _even(np.stack([along, _smooth(path.astype(np.float64), shown)], axis=1))


def _smooth(path: Array, shown: Array) -> Array:
    """(U,) the smooth line nearest to the path (U,), which counts by how much it shows (U,): least
    squares with a penalty on third differences (Whittaker 1923)."""
    rough, weight = _roughness(len(path)), shown
    for _ in range(_FITS):
        bands = rough.copy()
        bands[-1] += weight
        smooth = np.asarray(scipy.linalg.solveh_banded(bands, weight * path))
        weight = shown / np.maximum(1.0, np.abs(smooth - path) / _OFF)
    return smooth


def _roughness(count: int) -> Array:
    """(4, count) the upper bands of the penalty's matrix."""
    shape = count - 3, count
    third = scipy.sparse.diags_array([-1.0, 3.0, -3.0, 1.0], offsets=[0, 1, 2, 3], shape=shape)
    matrix = (_WAVE * count / (2.0 * np.pi)) ** 6 * (third.T @ third)
    bands = np.zeros((4, count))
    for k in range(4):
        bands[3 - k, k:] = matrix.diagonal(k)
    return bands


def _bare(mask: Flags) -> tuple[Flags, float]:
    """(U,) the calamus, where the feather is as narrow as at its base, and how wide that is."""
    width = mask.sum(axis=1)
    base = float(np.median(width[round(0.01 * len(width)) : round(0.04 * len(width)) + 1]))
    wide = np.flatnonzero(width > _STILL_BARE * base)
    return np.arange(len(width)) < (wide[0] if len(wide) else len(width)), base


def _ridges(grey: Array, width: float) -> list[Array]:
    """(U, V) how much a place is the middle of a bright line along the feather, and of a dark one:
    the greatest scaled second derivative across, for lines up to a width."""
    along = _ALONG * len(grey)
    bent = [
        sigma**2 * ndimage.gaussian_filter(grey, (along, sigma), order=(0, 2))
        for sigma in (max(0.5 * width * part, 1.0) for part in _SCALES)
    ]
    return [np.max([sign * each for each in bent], axis=0) for sign in (-1.0, 1.0)]


def _path(ridge: Array, mask: Flags, bare: Flags) -> tuple[float, Indices, Array]:
    """Find the best line (U,), its contrast, and its visibility along it, 0.1 to 1."""
    inner = ndimage.binary_erosion(mask, iterations=3) & ~bare[:, None]
    usual = float(np.median(np.abs(ridge[inner]))) if inner.any() else 0.0
    value = np.where(mask, ridge / (usual or np.inf), -10.0)
    value[bare] = _near_the_middle(mask[bare])
    path = _best_path(value)
    along = value[np.arange(len(path)), path]
    contrast = 0.0 if bare.all() else float(np.median(along[~bare]))
    shown = np.clip(along / (contrast or np.inf), 0.1, 1.0)
    return contrast, path, np.where(bare, 1.0, shown)


def _near_the_middle(mask: Flags) -> Array:
    """(U, V) worth of a calamus, whose own line is the middle of the mask."""
    places = np.arange(mask.shape[1])
    middle = (mask * places).sum(axis=1) / np.maximum(mask.sum(axis=1), 1)
    return np.asarray(10.0 - np.abs(places - middle[:, None]))


def _best_path(value: Array) -> Indices:
    """(U,) the places of a path through (U, V) with the greatest sum, one to the side at most."""
    total, came = value[0].copy(), np.zeros(value.shape, dtype=np.int8)
    for row in range(1, len(value)):
        low, high = np.full_like(total, -np.inf), np.full_like(total, -np.inf)
        low[1:], high[:-1] = total[:-1], total[1:]
        options = np.stack([low - 0.5, total, high - 0.5])
        best = options.argmax(axis=0)
        came[row] = best - 1
        total = value[row] + options.max(axis=0)
    path = np.empty(len(value), dtype=np.int64)
    path[-1] = int(total.argmax())
    for row in range(len(value) - 1, 0, -1):
        path[row - 1] = path[row] + came[row, path[row]]
    return path


def drawn_shaft(
    laid: AlignedPicture, pixels: Sequence[tuple[float, float]], source: str
) -> ShaftLine:
    """The shaft through columns and rows of the photo, from base to tip. Raises InputError."""
    given = np.array(pixels, dtype=np.float64)
    places = laid.from_photo(given) if np.isfinite(given).all() else given[:0]
    if len(places) < 2 or (np.diff(places[:, 0]) <= 0.0).any():
        message = "needs two points or more, COLUMN,ROW from base to tip, all of them numbers"
        raise InputError(Problem(source, "shaft", message))
    line = CubicSpline if len(places) > 2 else PchipInterpolator
    along = np.linspace(places[0, 0], places[-1, 0], _FINE)
    return _even(np.stack([along, line(places[:, 0], places[:, 1])(along)], axis=1))


def _even(places: Array) -> ShaftLine:
    way = arc_lengths(places)
    wanted = np.linspace(0.0, way[-1], _FINE)
    even = np.stack([np.interp(wanted, way, column) for column in places.T], axis=1)
    return ShaftLine(even, float(way[-1]))


LEFT, RIGHT = 1.0, -1.0
# shares of the shaft at which widths are taken, on past its tip
_FRACTIONS = np.linspace(0.0, 1.12, 673)
# blur of the widths, of these
_EVEN = 2.0
# a vane begins where it is so much wider than the calamus, of the length
_BEGINS = 0.005
# along a vane, and from the shaft to the edge: bins in which angles are averaged
_ALONG_BARBS, _OUT = np.linspace(0.08, 0.92, 6), np.linspace(0.0, 1.0, 4)
# pixels that are left out beside shaft and edge
_MARGIN = 6.0
# how much of a direction texture must have, 0 to 1, for it to count; pixels of the blurs
# and of a gradient, grey a pixel
_MIN_COHERENCE = 0.35
_FINE_BARBS, _COARSE, _MIN_TEXTURE = 1.0, 2.0, 1e-3
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
    for position in _ALONG_BARBS:
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
            if abs(mean) > _MIN_COHERENCE and np.mean(high - low) > _MARGIN:
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
        ndimage.gaussian_filter(laid.grey, _FINE_BARBS, order=order) for order in ((1, 0), (0, 1))
    )
    core = ndimage.binary_erosion(laid.mask, iterations=3)
    # lines run across the gradient: the doubled angle is turned by pi
    tensor = -((along + 1j * across) ** 2) * core
    real, imag, total = (
        ndimage.gaussian_filter(each, _COARSE)
        for each in (tensor.real, tensor.imag, np.abs(tensor))
    )
    return np.asarray((real + 1j * imag) / np.maximum(total, _MIN_TEXTURE**2))
