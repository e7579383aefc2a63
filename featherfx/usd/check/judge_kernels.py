"""Kernels of the judge: lengths of strands, jumps of points, errors of velocities.

    stretch    l / l_rest - 1                                of a rachis or barb, l along its nodes
    jump       x(t - h) - 2 x(t) + x(t + h), over L          of a point of a feather L long
    explained  h (v(t + h) - v(t - h)) / 2                   of a jump, by the velocities
    error      v(t) - (x(t - 2h) - 8 x(t - h) + 8 x(t + h) - x(t + 2h)) / 12h

The five-point difference is exact to h^4 / 30 times the fifth derivative, the central one to
h^2 / 6 times the third (Abramowitz and Stegun, Handbook of Mathematical Functions, 25.3). They
differ by little where samples resolve the motion.
"""

from __future__ import annotations

from math import log2, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import length, scale, sub
from featherfx.jit.compiled import kernel

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Indices = NDArray[np.int64]

# of the histogram of errors: bins of a factor of two, and the exponent that the first is of
BINS_PER_OCTAVE, MIN_EXPONENT, OCTAVES = 32, -60, 100


class Strands(NamedTuple):
    """K strands of F feathers, over N nodes.

    node_first: (N + 1,) first of each node's points in node_points. first: (K + 1,) first segment
    of each strand. start, end: (S,) nodes of the segments. feather, kind: (K,) of each strand.
    root: (F,) node of each feather.
    """

    node_first: Indices
    node_points: Indices
    first: Indices
    start: Indices
    end: Indices
    feather: Indices
    kind: Indices
    root: Indices


class Worst(NamedTuple):
    """Largest values so far, (F, 4) of each feather: stretch of its rachis, of a barb, jump, and
    what velocities leave of a jump.

    at: (F, 4) time codes.
    """

    value: Array
    at: Array


class ThreeSamples(NamedTuple):
    """Three samples of a track, step s apart.

    points: of (V, 3). roots: of (F, 3). rates: (V, 3) of the first and the last; of length 0 where
    there are none. code: of the middle one.
    """

    points: tuple[Floats, Floats, Floats]
    roots: tuple[Array, Array, Array]
    rates: tuple[Floats, Floats]
    step: float
    code: float


@kernel
def find_nodes(points, strands, nodes):
    """Nodes (N, 3) of points (V, 3)."""
    for n in range(nodes.shape[0]):
        low, high = strands.node_first[n], strands.node_first[n + 1]
        x = y = z = 0.0
        for k in range(low, high):
            v = strands.node_points[k]
            x, y, z = x + points[v, 0], y + points[v, 1], z + points[v, 2]
        count = float(high - low)
        nodes[n, 0], nodes[n, 1], nodes[n, 2] = x / count, y / count, z / count


@kernel
def strand_lengths(nodes, strands, out):
    """Lengths (K,) of strands."""
    for k in range(out.shape[0]):
        total = 0.0
        for s in range(strands.first[k], strands.first[k + 1]):
            total += length(sub(nodes[strands.end[s]], nodes[strands.start[s]]))
        out[k] = total


@kernel
def _keep(value, code, f, kind, worst):
    if value > worst.value[f, kind]:
        worst.value[f, kind], worst.at[f, kind] = value, code


@kernel
def keep_stretches(lengths, rest, strands, rounding, code, worst):
    """Keep the largest stretches. lengths, rest: (K,). rounding: of a coordinate."""
    for k in range(rest.shape[0]):
        segments = strands.first[k + 1] - strands.first[k]
        away = abs(lengths[k] - rest[k]) - rounding * sqrt(float(segments))
        if away > 0.0 and rest[k] > 0.0:
            _keep(away / rest[k], code, strands.feather[k], strands.kind[k], worst)


@kernel
def _jump(before, here, after):
    return (
        float(before[0]) - 2.0 * here[0] + after[0],
        float(before[1]) - 2.0 * here[1] + after[1],
        float(before[2]) - 2.0 * here[2] + after[2],
    )


@kernel
def keep_jumps(samples, owner, sizes, limits, worst):
    """Keep the largest jumps.

    owner: (V,) feather of each point. sizes: (F,) lengths. limits: least jump, and least ratio to
    that of the root.
    """
    points, roots, rates = samples.points, samples.roots, samples.rates
    for v in range(owner.shape[0]):
        f = owner[v]
        jump = _jump(points[0][v], points[1][v], points[2][v])
        size = length(jump)
        if size <= limits[0] * sizes[f]:
            continue
        if size <= limits[1] * length(_jump(roots[0][f], roots[1][f], roots[2][f])):
            continue
        _keep(size / sizes[f], samples.code, f, 2, worst)
        if rates[0].shape[0] > 0:
            explained = scale(0.5 * samples.step, sub(rates[1][v], rates[0][v]))
            size = length(sub(jump, explained))
        _keep(size / sizes[f], samples.code, f, 3, worst)


@kernel
def _count(square, counts):
    place = 0
    if square > 0.0:
        place = int((0.5 * log2(square) - MIN_EXPONENT) * BINS_PER_OCTAVE)
    counts[min(max(place, 0), counts.shape[0] - 1)] += 1


@kernel
def count_errors(before, after, rates, step, counts):
    """Count errors of velocities by size; return the sum of squares of the velocities.

    before, after: points at two samples each, the nearer first. rates: (V, 3). step: s. counts: of
    errors, and of what the two differences of points differ by.
    """
    total = 0.0
    for v in range(rates.shape[0]):
        error = wave = 0.0
        for c in range(3):
            near = float(after[0][v, c]) - before[0][v, c]
            far = float(after[1][v, c]) - before[1][v, c]
            rate = (8.0 * near - far) / (12.0 * step)
            error += (rates[v, c] - rate) ** 2
            wave += (rate - near / (2.0 * step)) ** 2
            total += float(rates[v, c]) ** 2
        _count(error, counts[0])
        _count(wave, counts[1])
    return total
