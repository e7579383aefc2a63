"""A cubic through points that never swings beyond its neighbours (PCHIP).

The cubic is that of Fritsch and Butland (1984, SIAM J. Sci. Stat. Comput. 5): between two points
the cubic Hermite curve of their values and slopes. The slope at a point is the weighted harmonic
mean of the secants on both sides,

    (w1 + w2) / slope = w1 / secant_before + w2 / secant_after
    w1 = 2 h_after + h_before,  w2 = h_after + 2 h_before      (h: lengths of the intervals)

and zero where these differ in sign; at the ends it is that of the parabola through three points,
limited so that the curve stays monotone. Written out here because feathers need nothing else of
the library that has it, which takes 40 MB and a third of a second to load.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array


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
