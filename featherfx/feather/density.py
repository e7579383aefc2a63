r"""One feather at two densities: nodes and directors of a fine grid from those of a coarse one.

A fine point is the coarse points' interpolation plus what that misses at rest, carried along by
the interpolated frame of its row:

    rachis, d2, d3   q(s) = sum_i w_i(s) q_i                + frame(s) c
    barb node        x = r(s) + sum_ij w_i(s) v_j(u) L / L_i (x_ij - r_i) + frame(s) c

s is the arc length of the rachis, u the place on the barb, L how far barbs reach at rest. w and v
are cubic Hermite weights with slopes of parabolas through three neighbours: once continuously
differentiable, local, and fixed, unlike monotone ones. frame(s) has the columns r'(s), d2(s) and
d3(s), all linear in the coarse points, and c is chosen so that the rest shape comes out. So the
map is linear, the same for positions and their rates; rest shape and rigid motions are exact, and
so is every barb of a coarse row that is a fine row, too. Barbs are a little longer or shorter than
at rest then; lengths.py gives each piece its length.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    PointMap,
    RowMap,
    RowPoints,
    barb_slice,
)


def density_map(coarse: Feather, fine: Feather, parts: bool = False) -> RowMap:
    """Map from the rows of one feather to those of another of the same kind and side.

    Neither has to have more rows or columns than the other. parts: whether strips between rows may
    part, so that a barb follows those on either side of it alone, linearly; so it does where there
    are fewer rows than before, as the next but one may be loose and hang elsewhere.
    """
    along = _Along(coarse, fine)
    parts = parts or fine.rows < coarse.rows
    nodes = [_barb_nodes(coarse, fine, side, along.rachis, parts) for side in (LEADING, TRAILING)]
    interpolated = RowPoints(
        scipy.sparse.vstack([along.rachis, *nodes]), scipy.sparse.vstack(along.directors)
    )
    points, axes = map(along.completed, interpolated, fine.rest)
    return RowMap(points, axes, _pieces(fine))


def scaled_map(unit: RowMap, size: float, rows: int) -> RowMap:
    """The density map between the same two feathers `size` times as large.

    rows: of the values that are mapped. Positions grow and directors do not, so only what goes
    from one to the other is scaled. Much faster than a map of its own.
    """
    if size == 1.0:
        return unit
    directors = _scaled(unit.directors, 1 / size, 1, rows)
    return RowMap(scaled_points(unit.nodes, size, rows), directors, size * unit.pieces)


def scaled_points(unit: PointMap, size: float, rows: int) -> PointMap:
    """The same of a map to points alone."""
    return _scaled(unit, 1.0, size, rows)


def _scaled(unit: PointMap, of_nodes: float, of_directors: float, rows: int) -> PointMap:
    """A map of `rows` rows with what goes from nodes, and from directors, times a factor each."""
    if of_nodes == of_directors:
        return unit
    matrix = unit.matrix.copy()
    nodes = matrix.shape[1] - 2 * rows
    matrix.data *= np.where(matrix.indices < nodes, of_nodes, of_directors)
    return PointMap(matrix, unit.shape)


class _Along:
    """Interpolation along the rachis. rachis: (N, K) sparse, K nodes and directors of the coarse
    feather, and directors: the same for d2 and d3."""

    def __init__(self, coarse: Feather, fine: Feather) -> None:
        weights, slopes = map(scipy.sparse.csr_array, hermite_weights(coarse.station, fine.station))
        self.rachis = weights @ _node(coarse, 0)
        self.directors = [weights @ _director(coarse, k) for k in range(2)]
        self._frame = [slopes @ _node(coarse, 0), *self.directors]
        self._rest = np.concatenate([part.reshape(-1, 3) for part in coarse.rest])
        axes = [axis @ self._rest for axis in self._frame]
        self._rest_frame = np.stack(axes, axis=-1)

    def completed(self, interpolation: Any, rest: Array) -> PointMap:
        """An interpolation with what it misses of the rest shape, in the frame of each row.

        interpolation: (B N, K), B points of all N rows, point by point. rest: (N, B, 3).
        """
        by_point = rest.swapaxes(0, 1)
        missing = by_point - (interpolation @ self._rest).reshape(by_point.shape)
        parts = np.linalg.solve(self._rest_frame, missing[..., None])[..., 0].reshape(-1, 3)
        for axis, part in zip(self._frame, parts.T, strict=True):
            repeated = scipy.sparse.vstack([axis] * len(by_point))
            interpolation = interpolation + scipy.sparse.diags_array(part) @ repeated
        by_row = np.arange(len(parts)).reshape(by_point.shape[:2]).T.ravel()
        matrix = interpolation.tocsr()[by_row]
        matrix.eliminate_zeros()
        return PointMap(matrix, rest.shape)


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


def _barb_nodes(coarse: Feather, fine: Feather, side: int, rachis: Any, parts: bool) -> Any:
    """(M N, K) sparse, the interpolated nodes of one side, node by node from the root on.

    parts: as in density_map.
    """
    roots = scipy.sparse.vstack([rachis] * fine.columns).tocsr()
    grown = np.flatnonzero(coarse.barb_length[side] > 0.0)
    if len(grown) == 0:
        return roots
    knots = coarse.station[grown]
    weights = hermite_weights(knots, fine.station)[0]
    if parts:
        weights = linear_weights(knots, fine.station)
    weights = _reach(fine, side)[:, None] * weights / _reach(coarse, side)[grown]
    along, _ = hermite_weights(*(np.linspace(0.0, 1.0, f.columns + 1) for f in (coarse, fine)))
    root, barb = _node(coarse, 0)[grown], barb_slice(side, coarse.columns)
    offsets = [_node(coarse, node)[grown] - root for node in range(barb.start, barb.stop)]
    spread = scipy.sparse.kron(along[1:, 1:], scipy.sparse.csr_array(weights), format="csr")
    return (roots + spread @ scipy.sparse.vstack(offsets)).tocsr()


def _pieces(feather: Feather) -> Array:
    """(n, 2 m) m, as of RowMap."""
    nodes, m = feather.rest.nodes, feather.columns
    before = nodes[:, [0, *range(1, m), 0, *range(m + 1, 2 * m)]]
    return np.asarray(np.linalg.norm(nodes[:, 1:] - before, axis=-1))


def _reach(feather: Feather, side: int) -> Array:
    """(n,) m, from roots to ends of barbs at rest: does not depend on the columns."""
    nodes = feather.rest.nodes
    end = barb_slice(side, feather.columns).stop - 1
    return np.asarray(np.linalg.norm(nodes[:, end] - nodes[:, 0], axis=1))


def _node(feather: Feather, node: int) -> Any:
    """(n, K) sparse: one node of every row."""
    size = 1 + 2 * feather.columns
    return _picked(feather, np.arange(feather.rows) * size + node)


def _director(feather: Feather, k: int) -> Any:
    """(n, K) sparse: one director of every row."""
    nodes = feather.rows * (1 + 2 * feather.columns)
    return _picked(feather, nodes + 2 * np.arange(feather.rows) + k)


def _picked(feather: Feather, places: Any) -> Any:
    rows = feather.rows
    shape = rows, rows * (3 + 2 * feather.columns)
    return scipy.sparse.csr_array((np.ones(rows), (np.arange(rows), places)), shape=shape)
