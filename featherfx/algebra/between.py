"""Smooth motion through evenly spaced samples: of points, rotations and matrices.

About every sample (a knot) there is a polynomial through the five nearest; between two knots the
motion passes from the polynomial of the one to that of the other by 3 u^2 - 2 u^3. It goes through
all samples, its velocity and acceleration are continuous (C2), and it depends on three samples on
either side only. At the ends of the samples the polynomials go through those that there are;
beyond, the motion goes on with the velocity at the end, its acceleration fading out. Rotations are
treated in the same way as rotation vectors against the knot, on the rotation group.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import rotation_part, rotation_vectors

Array = NDArray[np.float64]

# knots on either side of a knot that its polynomial goes through
_REACH = 2
# knots, over which acceleration fades out beyond the ends
_FADE = 4.0
# of a knot's distance: as near a time is a knot
_NEAR = 1e-9


class Stencil(NamedTuple):
    """What the motion at a time is made of.

    times: (n,) of knots. weights: (2, n) of the polynomials about the knot before and the one
    after, which stand at numbers middles (2,) among them. share: of the latter.
    """

    times: Array
    weights: Array
    middles: tuple[int, int]
    share: float

    def value(self, samples: Array) -> Array:
        """(...) vectors between samples (n, ...), one for each of the times."""
        weights = (1.0 - self.share) * self.weights[0] + self.share * self.weights[1]
        return np.asarray(np.tensordot(weights, samples, 1))

    def turn(self, samples: Array) -> Array:
        """(..., 3, 3) rotations between samples (n, ..., 3, 3)."""
        before, after = (
            samples[middle] @ _rotations(self._chart(samples, middle, weights))
            for middle, weights in zip(self.middles, self.weights, strict=True)
        )
        way = rotation_vectors(np.swapaxes(before, -1, -2) @ after)
        return np.asarray(before @ _rotations(self.share * way))

    def _chart(self, samples: Array, middle: int, weights: Array) -> Array:
        vectors = rotation_vectors(np.swapaxes(samples[middle], -1, -2) @ samples)
        return np.asarray(np.tensordot(weights, vectors, 1))

    def matrix(self, samples: Array) -> Array:
        """(..., 4, 4) affine maps of row vectors between samples (n, ..., 4, 4): place, stretch and
        rotation each on its own."""
        if (samples == samples[0]).all():
            return np.asarray(samples[0])
        linear = samples[..., :3, :3]
        sign = np.where(np.linalg.det(linear) < 0.0, -1.0, 1.0)[..., None, None]
        turned = rotation_part(sign * linear)
        stretch = self.value(linear @ np.swapaxes(turned, -1, -2))
        found = np.array(samples[0])
        found[..., :3, :3] = stretch @ self.turn(turned)
        found[..., 3, :3] = self.value(samples[..., 3, :3])
        return found


@dataclass(frozen=True)
class Knots:
    """Times start + k step of samples. first, last: numbers k of the first and last that there are;
    None: there is no end."""

    start: float
    step: float
    first: int | None = None
    last: int | None = None

    def stencil(self, time: float) -> Stencil:
        """What the motion at a time is made of."""
        place = (time - self.start) / self.step
        if abs(place - round(place)) < _NEAR:
            place = float(round(place))
        first = -math.inf if self.first is None else self.first
        last = math.inf if self.last is None else self.last
        if not first <= place <= last:
            end = int(min(max(place, first), last))
            knots = self._around(end)
            weights = _onwards(np.array(knots) - end, place - end)
            both = knots.index(end)
            return Stencil(self._times(knots), np.stack([weights, weights]), (both, both), 0.0)
        if place == round(place):
            return Stencil(self._times([int(place)]), np.ones((2, 1)), (0, 0), 0.0)
        before = math.floor(place)
        around = [self._around(before), self._around(before + 1)]
        knots = list(range(around[0][0], around[1][-1] + 1))
        weights = np.zeros((2, len(knots)))
        for row, some in zip(weights, around, strict=True):
            row[some[0] - knots[0] : some[-1] - knots[0] + 1] = _lagrange(np.array(some), place)
        middles = before - knots[0], before + 1 - knots[0]
        u = place - before
        return Stencil(self._times(knots), weights, middles, u * u * (3.0 - 2.0 * u))

    def _around(self, knot: int) -> list[int]:
        low = knot - _REACH if self.first is None else max(knot - _REACH, self.first)
        high = knot + _REACH if self.last is None else min(knot + _REACH, self.last)
        return list(range(low, high + 1))

    def _times(self, knots: list[int]) -> Array:
        return self.start + self.step * np.array(knots, dtype=np.float64)


def _lagrange(knots: NDArray[np.int64], place: float) -> Array:
    """(n,) weights of samples at n knots in the polynomial through them at a place."""
    apart = (knots[:, None] - knots[None, :]).astype(np.float64)
    ratio = (place - knots[None, :]) / np.where(apart == 0.0, 1.0, apart)
    return np.asarray(np.where(apart == 0.0, 1.0, ratio).prod(axis=1))


def _onwards(knots: NDArray[np.int64], beyond: float) -> Array:
    """(n,) weights of samples at an end, the knot 0, and those next to it, `beyond` it."""
    powers = np.linalg.inv(np.vander(knots.astype(np.float64), increasing=True))
    value, first = powers[0], powers[1] if len(knots) > 1 else 0.0
    second = 2.0 * powers[2] if len(knots) > 2 else 0.0
    away = abs(beyond)
    left = max(1.0 - away / _FADE, 0.0)
    bend = _FADE * away / 3.0 + _FADE**2 / 12.0 * (left**4 - 1.0)
    return np.asarray(value + beyond * first + bend * second)


def _rotations(vectors: Array) -> Array:
    """(..., 3) rotation vectors to (..., 3, 3) rotation matrices."""
    from scipy.spatial.transform import Rotation

    flat = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return np.asarray(flat.reshape(*vectors.shape, 3))
