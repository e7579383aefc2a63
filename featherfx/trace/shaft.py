"""The shaft in a picture: the line from base to tip along which the grey is a ridge or a valley.

Barbs run across the shaft, so a blur along the feather leaves little of them and all of the shaft.
The path along which the second derivative across is greatest is found by dynamic programming, and
smoothed by a line from which single stretches may be off (Huber 1964).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from scipy import ndimage
from scipy.interpolate import CubicSpline, PchipInterpolator

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem
from featherfx.trace.silhouette import AlignedPicture

# blur along, a share of the feather's length, and across, of half the width of the calamus
_ALONG, _SCALES = 0.02, (1.0, 0.7, 0.45, 0.3)
# of a shaft that shows, how far its ridge is above the middle one of the feather
_LEAST_CONTRAST = 2.5
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
    if contrast < _LEAST_CONTRAST:
        message = "the shaft does not show in the picture. Give its line from base to tip (--shaft)"
        raise InputError(Problem(source, "", message))
    along = columns.astype(np.float64)
    return _even(np.stack([along, _smooth(along, path.astype(np.float64), shown)], axis=1))


def _smooth(along: Array, path: Array, shown: Array) -> Array:
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
    places = laid.from_photo(np.array(pixels, dtype=np.float64))
    if len(places) < 2 or (np.diff(places[:, 0]) <= 0.0).any():
        message = "needs two points or more, COLUMN,ROW from base to tip"
        raise InputError(Problem(source, "shaft", message))
    line = CubicSpline if len(places) > 2 else PchipInterpolator
    along = np.linspace(places[0, 0], places[-1, 0], _FINE)
    return _even(np.stack([along, line(places[:, 0], places[:, 1])(along)], axis=1))


def _even(places: Array) -> ShaftLine:
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    wanted = np.linspace(0.0, way[-1], _FINE)
    even = np.stack([np.interp(wanted, way, column) for column in places.T], axis=1)
    return ShaftLine(even, float(way[-1]))
