"""Interpolation: smooth motion through samples, monotone cubics through points, eases.

Smooth motion goes through evenly spaced samples of points, rotations and matrices. About every
sample (a knot) there is a polynomial through the five nearest; between two knots the motion passes
from the polynomial of the one to that of the other by 3 u^2 - 2 u^3. It goes through all samples,
its velocity and acceleration are continuous (C2), and it depends on three samples on either side
only. At the ends of the samples the polynomials go through those that there are; beyond, places go
on with the velocity at the end, their acceleration fading out, and what turns or changes its shape
comes to rest, so that a wing does not turn over. Rotations are treated in the same way as rotation
vectors against the knot, on the rotation group.

A monotone cubic through points never swings beyond its neighbours (PCHIP). It is that of Fritsch
and Butland (1984, SIAM J. Sci. Stat. Comput. 5): between two points the cubic Hermite curve of
their values and slopes. The slope at a point is the weighted harmonic mean of the secants on both
sides,

    (w1 + w2) / slope = w1 / secant_before + w2 / secant_after
    w1 = 2 h_after + h_before,  w2 = h_after + 2 h_before      (h: lengths of the intervals)

and zero where these differ in sign; at the ends it is that of the parabola through three points,
limited so that the curve stays monotone. Written out here because feathers need nothing else of
the library that has it, which takes 40 MB and a third of a second to load.

Sparse matrices that map points, for what every bake needs of them.

scipy's come with 10 MiB and a tenth of a second of all of numpy; what joins many maps uses them.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import frames_to_quats, rotation_part, rotation_vectors
from featherfx.jit.compiled import KernelModule

kernels = KernelModule("featherfx.algebra.element_kernels")

# knots on either side of a knot that its polynomial goes through
_REACH = 2
# knots beyond the ends, over which acceleration fades out, and turns come to rest
_FADE = 4.0
# of a knot's distance: as near a time is a knot
_NEAR = 1e-9


class Stencil(NamedTuple):
    """Samples and weights of the motion at a time.

    times: (n,) of knots. weights: (2, n) of the polynomials about the knot before and the one
    after, which stand at numbers middles (2,) among them. fraction: of the latter. onwards: (n,)
    weights of places, which differ beyond the ends.
    """

    times: Array
    weights: Array
    onwards: Array
    middles: tuple[int, int]
    fraction: float

    def value(self, samples: Array) -> Array:
        """(...) values between samples (n, ...), one for each of the times."""
        weights = (1.0 - self.fraction) * self.weights[0] + self.fraction * self.weights[1]
        return np.asarray(np.tensordot(weights, samples, 1))

    def place(self, samples: Array) -> Array:
        """(...) the same of places, which go on beyond the ends."""
        return np.asarray(np.tensordot(self.onwards, samples, 1))

    def points(self, samples: Array) -> Array:
        """(V, 3) points between samples (n, V, 3): their middle is a place."""
        if len(samples) == 1:
            return np.asarray(samples[0])
        middle = samples.mean(axis=1, dtype=np.float64)
        return np.asarray(self.value(samples) + self.place(middle) - self.value(middle))

    def apart(self, samples: Array) -> Maps:
        """Affine maps (n, K, 4, 4) of row vectors at the times, as `map` has them: for all times
        between the same two knots."""
        if len(samples) == 1 or (samples == samples[0]).all():
            return Maps(samples, None)
        linear = samples[..., :3, :3]
        sign = np.where(np.linalg.det(linear) < 0.0, -1.0, 1.0)[..., None, None]
        turned = rotation_part(sign * linear)
        stretch = linear @ np.swapaxes(turned, -1, -2)
        ends = turned[list(self.middles)]
        ways = rotation_vectors(np.swapaxes(ends, -1, -2)[:, None] @ turned)
        return Maps(samples, (stretch, KnotTurns(frames_to_quats(ends), ways)))

    def map(self, maps: Maps) -> Array:
        """(K, 4, 4) between affine maps: place, stretch and rotation each on its own."""
        samples, parts = maps
        if parts is None:
            return np.asarray(samples[0])
        stretch, turns = parts
        found, turned = np.array(samples[0]), np.empty(stretch.shape[1:])
        kernels.blend_turns(turns, self.weights, self.fraction, np.empty((2, 3)), turned)
        found[..., :3, :3] = self.value(stretch) @ turned
        found[..., 3, :3] = self.place(samples[..., 3, :3])
        return found

    def matrix(self, samples: Array) -> Array:
        """(4, 4) between affine maps of row vectors (n, 4, 4)."""
        return np.asarray(self.map(self.apart(samples[:, None]))[0])


class KnotTurns(NamedTuple):
    """Rotations about two knots. ends: (2, K, 4) unit quaternions at the knots. ways: (2, n, K, 3)
    rad, from there to the rotations at n knots around."""

    ends: Array
    ways: Array


class Maps(NamedTuple):
    """Affine maps of K joints, of row vectors, at some knots. samples: (n, K, 4, 4). parts:
    stretches (n, K, 3, 3) and rotations; None where all are the same."""

    samples: Array
    parts: tuple[Array, KnotTurns] | None


@dataclass(frozen=True)
class Knots:
    """Times start + k step of samples. first, last: numbers k of the first and last that there are;
    None: there is no end. ends: gives for a time the numbers between which there is no cut, which
    may be infinite. is_linear: samples lead the motion within cuts only."""

    start: float
    step: float
    first: int | None = None
    last: int | None = None
    ends: Callable[[float], tuple[float, float]] | None = None
    is_linear: bool = False

    def leads(self, time: float) -> bool:
        """Return whether samples lead the motion at a time."""
        return not self.is_linear or self._ends(time)[0] > (time - self.start) / self.step

    def _ends(self, time: float) -> tuple[float, float]:
        first = -math.inf if self.first is None else float(self.first)
        last = math.inf if self.last is None else float(self.last)
        if self.ends is not None:
            low, high = self.ends(time)
            first, last = max(first, low), min(last, high)
        return first, max(first, last)

    def stencil(self, time: float) -> Stencil:
        """Samples and weights of the motion at a time."""
        place = (time - self.start) / self.step
        first, last = self._ends(time)
        if abs(place - round(place)) < _NEAR:
            place = float(round(place))
        if not first <= place <= last:
            end = int(min(max(place, first), last))
            knots = self._around(end, first, last)
            if end in (self.first, self.last):
                places, turns = _beyond(np.array(knots) - end, place - end)
            else:
                places = turns = _lagrange(np.array(knots), place)
            both = knots.index(end)
            weights = np.stack([turns, turns])
            return Stencil(self._times(knots), weights, places, (both, both), 0.0)
        if place == round(place):
            times, one = self._times([int(place)]), np.ones((2, 1))
            return Stencil(times, one, one[0], (0, 0), 0.0)
        before = math.floor(place)
        around = [self._around(before + k, first, last) for k in (0, 1)]
        knots = list(range(around[0][0], around[1][-1] + 1))
        weights = np.zeros((2, len(knots)))
        for row, some in zip(weights, around, strict=True):
            row[some[0] - knots[0] : some[-1] - knots[0] + 1] = _lagrange(np.array(some), place)
        middles = before - knots[0], before + 1 - knots[0]
        u = place - before
        fraction = u * u * (3.0 - 2.0 * u)
        both = (1.0 - fraction) * weights[0] + fraction * weights[1]
        return Stencil(self._times(knots), weights, both, middles, fraction)

    def _around(self, knot: int, first: float, last: float) -> list[int]:
        """Knots that the polynomial about one goes through, between the first and the last; about
        one beside a cut one more, since it has to go on from there."""
        low, high = max(knot - _REACH, first), min(knot + _REACH, last)
        if low == knot != self.first:
            high = min(high + 1, last)
        elif high == knot != self.last:
            low = max(low - 1, first)
        return list(range(int(low), int(high) + 1))

    def _times(self, knots: list[int]) -> Array:
        return self.start + self.step * np.array(knots, dtype=np.float64)


def _lagrange(knots: Indices, place: float) -> Array:
    """(n,) weights of samples at n knots in the polynomial through them at a place."""
    apart = (knots[:, None] - knots[None, :]).astype(np.float64)
    ratio = (place - knots[None, :]) / np.where(apart == 0.0, 1.0, apart)
    return np.asarray(np.where(apart == 0.0, 1.0, ratio).prod(axis=1))


def _beyond(knots: Indices, way: float) -> tuple[Array, Array]:
    """(n,) weights of samples at an end, the knot 0, and those next to it, a way beyond it: of
    places and of what comes to rest."""
    powers = np.linalg.inv(np.vander(knots.astype(np.float64), increasing=True))
    value, rate = powers[0], powers[1] if len(knots) > 1 else 0.0
    bend = 2.0 * powers[2] if len(knots) > 2 else 0.0
    away = abs(way) / _FADE
    # the integrals of a rate of change that falls off as (1 - x)^2 from 1 to 0
    fading = away / 3.0 + (max(1.0 - away, 0.0) ** 4 - 1.0) / 12.0
    places = value + way * rate + _FADE**2 * fading * bend
    x = min(away, 1.0)
    # and those of 1 - 10 x^3 + 15 x^4 - 6 x^5 (once) and of (1 - x)^2 (1 - 4 x) (twice)
    gone = math.copysign(x - x**4 * (2.5 + x * (x - 3.0)), way)
    bent = x * x * (0.5 + x * (x * (0.75 - 0.2 * x) - 1.0))
    return np.asarray(places), np.asarray(value + _FADE * gone * rate + _FADE**2 * bent * bend)


def monotone(places: Array, values: Array, at: Array) -> Array:
    """(K, c) interpolated at (K,).

    places: (n,) increasing, n >= 2. values: (n, c). Beyond the ends the last cubics go on.
    """
    lengths = np.diff(places)
    secants = np.diff(values, axis=0) / lengths[:, None]
    slopes = _slopes(lengths, secants)
    piece = np.clip(np.searchsorted(places, at, side="right") - 1, 0, len(lengths) - 1)
    length = lengths[piece][:, None]
    within = ((at - places[piece]) / lengths[piece])[:, None]
    rise, before, after = secants[piece], slopes[piece], slopes[piece + 1]
    cubic = within * (before + after - 2.0 * rise) + (3.0 * rise - 2.0 * before - after)
    return np.asarray(values[piece] + within * length * (before + within * cubic))


def _slopes(lengths: Array, secants: Array) -> Array:
    """(n, c) slopes at the points."""
    if len(lengths) == 1:
        return np.concatenate([secants, secants])
    before, after = secants[:-1], secants[1:]
    h_before, h_after = lengths[:-1, None], lengths[1:, None]
    first, second = 2.0 * h_after + h_before, h_after + 2.0 * h_before
    same = before * after > 0.0
    product = np.where(same, before * after, 1.0)
    weighted = np.where(same, first * after + second * before, 1.0)
    inner = np.where(same, (first + second) * product / weighted, 0.0)
    start = _end_slope(lengths[0], lengths[1], secants[0], secants[1])
    end = _end_slope(lengths[-1], lengths[-2], secants[-1], secants[-2])
    return np.concatenate([start[None], inner, end[None]])


def _end_slope(near: float, far: float, secant: Array, next_secant: Array) -> Array:
    """(c,) slope at an end, from the two intervals next to it."""
    slope = ((2.0 * near + far) * secant - near * next_secant) / (near + far)
    steep = (secant * next_secant <= 0.0) & (np.abs(slope) > 3.0 * np.abs(secant))
    limited = np.where(steep, 3.0 * secant, slope)
    return np.where(slope * secant <= 0.0, 0.0, limited)


def smooth_step(fraction: float) -> float:
    """Rises from 0 to 1 over fraction 0..1 with zero slope and curvature at both ends (C2)."""
    s = min(max(fraction, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


def eased(times: Sequence[float], values: Sequence[float], time: float) -> float:
    """Value at a time between those at ascending times, at rest at each of them and outside."""
    after = bisect_right(times, time)
    if after in (0, len(times)):
        return values[min(after, len(times) - 1)]
    before, step = values[after - 1], times[after] - times[after - 1]
    return before + smooth_step((time - times[after - 1]) / step) * (values[after] - before)


def eased_integral(times: Sequence[float], values: Sequence[float], time: float) -> float:
    """Integral of `eased` from the first of the times to a time."""
    total = min(time - times[0], 0.0) * values[0] + max(time - times[-1], 0.0) * values[-1]
    for (begin, end), (before, after) in zip(pairwise(times), pairwise(values), strict=True):
        u = min(max((time - begin) / (end - begin), 0.0), 1.0)
        total += (end - begin) * (before * u + (after - before) * u**4 * (2.5 + u * (u - 3.0)))
    return total


def faded(fractions: ArrayLike) -> NDArray[np.float64]:
    """Rise from 0 to 1 over fractions 0..1 with zero slope at both ends (C1)."""
    s = np.clip(np.asarray(fractions, dtype=float), 0.0, 1.0)
    return np.asarray(s * s * (3.0 - 2.0 * s))


sparse_kernels = KernelModule("featherfx.algebra.element_kernels")


class Rows(NamedTuple):
    """R rows of K columns. weights, columns: (N,) of what is not zero, row by row; first: (R + 1,),
    where each row begins among them, and the end."""

    weights: Array
    columns: Indices
    first: Indices

    def __matmul__(self, values: Array) -> Array:
        """(R, D), times values (K, D)."""
        result = np.empty((len(self.first) - 1, values.shape[1]))
        sparse_kernels.multiply_rows(self, np.ascontiguousarray(values, dtype=np.float64), result)
        return result

    def picked(self, rows: Indices) -> Rows:
        """Some of the rows (k,), in another order."""
        counts = (self.first[1:] - self.first[:-1])[rows]
        first = np.concatenate([[0], np.cumsum(counts)])
        entries = np.arange(first[-1]) + np.repeat(self.first[rows] - first[:-1], counts)
        return Rows(self.weights[entries], self.columns[entries], first)

    def scaled(self, factors: Array) -> Rows:
        """With every column times a factor (K,)."""
        return self._replace(weights=self.weights * factors[self.columns])

    def of_scipy(self, width: int) -> Any:
        """The same as scipy's matrix of so many columns."""
        from scipy.sparse import csr_array

        shape = len(self.first) - 1, width
        return csr_array((self.weights, self.columns, self.first), shape=shape)


def rows_of(weights: Array, columns: Indices) -> Rows:
    """Rows of weights (R, n) at columns (R, n); weights that are zero are left out."""
    there = weights != 0.0
    first = np.concatenate([[0], np.cumsum(np.count_nonzero(there, axis=1))])
    return Rows(weights[there], columns[there], first)


def from_scipy(matrix: Any) -> Rows:
    """Make the rows of scipy's matrix."""
    csr = matrix.tocsr()
    return Rows(csr.data, csr.indices.astype(np.int64), csr.indptr.astype(np.int64))


def linear_weights(knots: Array, places: Array) -> Array:
    """(K, n) weights of values at knots (n,), ascending, for values at places (K,): linear hats.

    Places beyond the knots take the value of the nearest.
    """
    return np.stack([np.interp(places, knots, unit) for unit in np.eye(len(knots))], axis=1)
