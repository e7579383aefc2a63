r"""One feather at two densities: material points of a fine grid from those of a coarse one.

A fine point is the coarse points' interpolation plus what that misses at rest, carried along by
the interpolated frame of its row:

    rachis, d2, d3   q(s) = sum_i w_i(s) q_i                + frame(s) c
    barb node        x = r(s) + sum_ij w_i(s) v_j(u) L / L_i (x_ij - r_i) + frame(s) c

s is the arc length of the rachis, u the place on the barb, L how far barbs reach at rest. w and v
are cubic Hermite weights with slopes of parabolas through three neighbours: once continuously
differentiable, local, and fixed, unlike monotone ones. frame(s) has the columns r'(s), d2(s) and
d3(s), all linear in the coarse points, and c is chosen so that the rest shape comes out. So the
map is linear, the same for positions and their rates; rest shape and rigid motions are exact, and
so is every barb of a coarse row that is a fine row, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from featherfx.feather.types import LEADING, TRAILING, Array, Feather, PointMap


def density_map(coarse: Feather, fine: Feather) -> PointMap:
    """Map from the material points of one feather to those of another of the same kind and side.

    Neither has to have more rows or columns than the other. The result is (N, 3 + 2 M, 3) for N
    rows and M columns of `fine`.
    """
    along = _Along(coarse, fine)
    nodes = [_barb_nodes(coarse, fine, side, along.rachis[0]) for side in (LEADING, TRAILING)]
    matrix = along.completed(sparse.vstack([*along.rachis, *nodes]), fine.points.swapaxes(0, 1))
    count = fine.points.shape[1]
    by_row = np.arange(count * fine.rows).reshape(count, fine.rows).T.ravel()
    matrix = matrix[by_row]
    matrix.eliminate_zeros()
    return PointMap(matrix, fine.points.shape)


def scaled_map(unit: PointMap, size: float, points: int) -> PointMap:
    """The density map between the same two feathers `size` times as large.

    points: material points in a row of the values that are mapped. Positions grow and directors do
    not, so rows and columns of the matrix are scaled by the size and its inverse where they belong
    to positions. Much faster than a map of its own.
    """
    if size == 1.0:
        return unit
    rows, columns = (
        np.full(count, factor)
        for count, factor in zip(unit.matrix.shape, (size, 1.0 / size), strict=True)
    )
    rows.reshape(-1, unit.shape[-2])[:, 1:3] = 1.0
    columns.reshape(-1, points)[:, 1:3] = 1.0
    matrix = unit.matrix.copy()
    matrix.data *= np.repeat(rows, np.diff(matrix.indptr)) * columns[matrix.indices]
    return PointMap(matrix, unit.shape)


class _Along:
    """Interpolation along the rachis. rachis: (N, n P) sparse, for rachis points, d2 and d3."""

    def __init__(self, coarse: Feather, fine: Feather) -> None:
        weights, slopes = hermite_weights(coarse.station, fine.station)
        picks = [_pick(coarse, point) for point in range(3)]
        self.rachis = [sparse.csr_array(weights) @ pick for pick in picks]
        self._frame = [sparse.csr_array(slopes) @ picks[0], *self.rachis[1:]]
        self._rest = coarse.points.reshape(-1, 3)
        axes = [axis @ self._rest for axis in self._frame]
        self._rest_frame = np.stack(axes, axis=-1)

    def completed(self, interpolation: Any, rest: Array) -> Any:
        """An interpolation with what it misses of the rest shape, in the frame of each row.

        interpolation: (B N, n P), B points of all N rows, point by point. rest: (B, N, 3).
        """
        missing = rest - (interpolation @ self._rest).reshape(rest.shape)
        parts = np.linalg.solve(self._rest_frame, missing[..., None])[..., 0].reshape(-1, 3)
        for axis, part in zip(self._frame, parts.T, strict=True):
            repeated = sparse.vstack([axis] * len(rest))
            interpolation = interpolation + sparse.diags_array(part) @ repeated
        return interpolation.tocsr()


def linear_weights(knots: Array, places: Array) -> Array:
    """(K, n) weights of values at knots (n,), ascending, for values at places (K,): linear hats.

    Places beyond the knots take the value of the nearest.
    """
    return np.stack([np.interp(places, knots, unit) for unit in np.eye(len(knots))], axis=1)


def hermite_weights(knots: Array, places: Array) -> tuple[Array, Array]:
    """(K, n) weights of values at knots (n,), ascending, for values and slopes at places (K,).

    Places beyond the knots take the value of the nearest.
    """
    count, places = len(knots), np.clip(places, knots[0], knots[-1])
    if count == 1:
        return np.ones((len(places), 1)), np.zeros((len(places), 1))
    step = np.diff(knots)
    below = np.clip(np.searchsorted(knots, places, side="right") - 1, 0, count - 2)
    h = step[below]
    t = (places - knots[below]) / h
    slope = _slope_weights(step)
    every = np.arange(len(places))

    def combined(low: Array, high: Array, low_slope: Array, high_slope: Array) -> Array:
        weights = low_slope[:, None] * slope[below] + high_slope[:, None] * slope[below + 1]
        weights[every, below] += low
        weights[every, below + 1] += high
        return np.asarray(weights)

    rise = t * t * (3.0 - 2.0 * t)
    values = combined(1.0 - rise, rise, h * t * (1.0 - t) ** 2, h * t * t * (t - 1.0))
    rate = 6.0 * t * (1.0 - t) / h
    slopes = combined(-rate, rate, (1.0 - t) * (1.0 - 3.0 * t), t * (3.0 * t - 2.0))
    return values, slopes


def _slope_weights(step: Array) -> Array:
    """(n, n) weights of the slope at each knot: of the parabola through it and two neighbours."""
    count = len(step) + 1
    chord = np.zeros((count - 1, count))
    every = np.arange(count - 1)
    chord[every, every], chord[every, every + 1] = -1.0 / step, 1.0 / step
    if count == 2:
        return np.repeat(chord, 2, axis=0)
    weight = (step[:-1] / (step[:-1] + step[1:]))[:, None]
    inner = (1.0 - weight) * chord[:-1] + weight * chord[1:]
    return np.concatenate((2.0 * chord[:1] - inner[:1], inner, 2.0 * chord[-1:] - inner[-1:]))


def _barb_nodes(coarse: Feather, fine: Feather, side: int, rachis: Any) -> Any:
    """(M N, n P) sparse, the interpolated nodes of one side, node by node from the root on."""
    roots = sparse.vstack([rachis] * fine.columns).tocsr()
    grown = np.flatnonzero(coarse.barb_length[side] > 0.0)
    if len(grown) == 0:
        return roots
    weights, _ = hermite_weights(coarse.station[grown], fine.station)
    weights = _reach(fine, side)[:, None] * weights / _reach(coarse, side)[grown]
    along, _ = hermite_weights(*(np.linspace(0.0, 1.0, f.columns + 1) for f in (coarse, fine)))
    root, first = _pick(coarse, 0)[grown], 3 + side * coarse.columns
    offsets = [_pick(coarse, first + j)[grown] - root for j in range(coarse.columns)]
    spread = sparse.kron(along[1:, 1:], sparse.csr_array(weights), format="csr")
    return (roots + spread @ sparse.vstack(offsets)).tocsr()


def _reach(feather: Feather, side: int) -> Array:
    """(n,) m, from roots to ends of barbs at rest: does not depend on the columns."""
    end = 2 + (side + 1) * feather.columns
    return np.asarray(np.linalg.norm(feather.points[:, end] - feather.points[:, 0], axis=1))


def _pick(feather: Feather, point: int) -> Any:
    """(n, n P) sparse: one material point of every row."""
    rows, count = feather.rows, feather.points.shape[1]
    every = np.arange(rows)
    places = (every, every * count + point)
    return sparse.csr_array((np.ones(rows), places), shape=(rows, rows * count))
