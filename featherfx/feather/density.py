"""One feather at two densities: nodes and directors of a fine grid from those of a coarse one.

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
at rest then; carry_points (shapes.py) gives each piece its length.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.interpolation import linear_weights, rows_of
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    Indices,
    PointMap,
    RowMap,
    barb_slice,
)


def density_map(coarse: Feather, fine: Feather, parts: bool = False) -> RowMap:
    """Map from the rows of one feather to those of another of the same kind and side.

    Neither has to have more rows or columns than the other. parts: whether strips between rows may
    part, so that a barb follows those on either side of it alone, linearly; so it does where there
    are fewer rows than before, as the next but one may be loose and hang elsewhere.
    """
    return _Between(coarse, fine, parts or fine.rows < coarse.rows).map()


class _Between:
    """Weights by which a fine feather's rows follow those of a coarse one next to them.

    Of N fine rows each takes from a window of w coarse ones alone. first: (N,) the first of those;
    values, slopes: (N, w) weights of the rachis'; barbs: per side (N, w), of barbs' nodes.
    """

    def __init__(self, coarse: Feather, fine: Feather, parts: bool) -> None:
        self.coarse, self.fine = coarse, fine
        weights = hermite_weights(coarse.station, fine.station)
        barbs = [_barb_weights(coarse, fine, side, parts) for side in (LEADING, TRAILING)]
        used = np.any([each != 0.0 for each in (*weights, *barbs)], axis=0)
        low, high = used.argmax(axis=1), coarse.rows - used[:, ::-1].argmax(axis=1)
        width = int((high - low).max())
        self.first = np.minimum(low, coarse.rows - width)
        window = self.first[:, None] + np.arange(width)
        taken = [np.take_along_axis(each, window, axis=1) for each in (*weights, *barbs)]
        self.values, self.slopes, *self.barbs = taken
        # coarse nodes and directors of each window, (N, w, 3 + 2 m, 3) at rest
        self.rest = np.concatenate(coarse.rest, axis=1)[window]
        self._window = window

    def map(self) -> RowMap:
        """To all nodes and directors."""
        fine, size = self.fine, 1 + 2 * self.coarse.columns
        nodes = self._empty(1 + 2 * fine.columns)
        nodes[..., 0] = self.values[:, None]
        along, _ = hermite_weights(*(_places(each) for each in (self.coarse, fine)))
        for side, weights in zip((LEADING, TRAILING), self.barbs, strict=True):
            own, given = (barb_slice(side, each.columns) for each in (fine, self.coarse))
            spread = along[None, 1:, None, 1:] * weights[:, None, :, None]
            nodes[:, own, :, given] = spread
            nodes[:, own, :, 0] -= spread.sum(axis=-1)
        axes = self._empty(2)
        for k in range(2):
            axes[:, k, :, size + k] = self.values
        points, directors = map(self._completed, (nodes, axes), fine.rest)
        return RowMap(points, directors, _pieces(fine))

    def _empty(self, points: int) -> Array:
        """(N, B, w, 3 + 2 m) weights, for B points a row."""
        return np.zeros((self.fine.rows, points, *self.rest.shape[1:3]))

    def _completed(self, weights: Array, rest: Array) -> PointMap:
        """The map by weights with what it misses of the rest shape (N, B, 3), in the frame of each
        row."""
        size = 1 + 2 * self.coarse.columns
        frame = np.stack(
            [
                np.einsum("kw,kwd->kd", own, self.rest[:, :, at])
                for own, at in ((self.slopes, 0), (self.values, size), (self.values, size + 1))
            ],
            axis=-1,
        )
        missing = rest - np.einsum("kbwc,kwcd->kbd", weights, self.rest)
        parts = np.linalg.solve(frame[:, None], missing[..., None])[..., 0]
        for part, own, at in (
            (0, self.slopes, 0),
            (1, self.values, size),
            (2, self.values, size + 1),
        ):
            weights[..., at] += parts[..., part, None] * own[:, None]
        rows = weights.shape[0] * weights.shape[1]
        columns = np.broadcast_to(self._columns()[:, None], weights.shape)
        matrix = rows_of(weights.reshape(rows, -1), columns.reshape(rows, -1))
        return PointMap(matrix, rest.shape, self.coarse.rows * (size + 2))

    def _columns(self) -> Indices:
        """(N, w, 3 + 2 m), where nodes and directors of the windows are among all coarse ones."""
        n, size = self.coarse.rows, 1 + 2 * self.coarse.columns
        nodes = np.arange(n * size).reshape(n, size)
        directors = n * size + np.arange(2 * n).reshape(n, 2)
        return np.concatenate([nodes, directors], axis=1)[self._window]


def _places(feather: Feather) -> Array:
    return np.linspace(0.0, 1.0, feather.columns + 1)


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


def _barb_weights(coarse: Feather, fine: Feather, side: int, parts: bool) -> Array:
    """(N, n) weights of coarse barbs for fine ones; parts: as in density_map."""
    found = np.zeros((fine.rows, coarse.rows))
    grown = np.flatnonzero(coarse.barb_length[side] > 0.0)
    if len(grown):
        knots = coarse.station[grown]
        weights = hermite_weights(knots, fine.station)[0]
        if parts:
            weights = linear_weights(knots, fine.station)
        weights = _reach(fine, side)[:, None] * weights / _reach(coarse, side)[grown]
        found[:, grown] = weights
    return found


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
