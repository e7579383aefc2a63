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
at rest then; carry_points gives each piece its length.

Points of a feather carried to another grid, its barbs as long as at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.interpolation import Rows, rows_of
from featherfx.algebra.types import Flags
from featherfx.algebra.views import COUNT as LANES
from featherfx.algebra.views import views_of
from featherfx.feather.types import (
    LEADING,
    TRAILING,
    Array,
    Feather,
    Indices,
    MovingPoints,
    PointMap,
    RowMap,
    RowPoints,
    barb_slice,
    both,
)
from featherfx.jit.compiled import KernelModule

carry_kernels = KernelModule("featherfx.feather.carry_kernels")
# of a line of what is carried: points, first and second rates, a vector of the processor for each
LINE_WIDTH = 3 * LANES


class RowMapArrays(NamedTuple):
    """A RowMap as kernels take it."""

    nodes: Rows
    directors: Rows
    pieces: Array
    detail: Array


def density_map(coarse: Feather, fine: Feather, parts: bool = False) -> RowMap:
    """Map from the rows of one feather to those of another of the same kind and side.

    Neither has to have more rows or columns than the other. parts: whether strips between rows may
    part, so that a barb follows those on either side of it alone, linearly; so it does where there
    are fewer rows than before, as the next but one may be loose and hang elsewhere.
    """
    return _Between(coarse, fine, parts or fine.rows < coarse.rows).map()


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
    factors = np.full(unit.width, float(of_directors))
    factors[: unit.width - 2 * rows] = of_nodes
    return replace(unit, matrix=unit.matrix.scaled(factors))


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


def carry_points(to_fine: RowMap, points: RowPoints) -> RowPoints:
    """Points on another grid, its barbs as long as at rest."""
    still = both(np.zeros_like, points)
    return carry_motion(to_fine, points, still, still)[0]


def carry_motion(
    to_fine: RowMap, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
) -> MovingPoints:
    """The same with their first and second rates."""
    parts = points, velocities, accelerations
    given = MovingPoints(*(both(np.ascontiguousarray, each) for each in parts))
    found = _empty(to_fine)
    carry_kernels.carry_feather(
        _way(to_fine), given, np.zeros((to_fine.nodes.width, LINE_WIDTH)), found
    )
    return found


def with_detail(to_fine: RowMap, coarse: Feather, fine: Feather) -> RowMap:
    """The map between plane forms for feathers that lie on leaves, so that the rest shape of the
    one leads to that of the other."""
    base = RowPoints(to_fine.nodes(coarse.rest), to_fine.directors(coarse.rest))
    lateral, dorsal = base.directors[:, 0], base.directors[:, 1]
    frames = np.stack([np.cross(lateral, dorsal), lateral, dorsal], axis=2)
    missing = (fine.points - base.rows()).transpose(0, 2, 1)
    detail = np.linalg.solve(frames, missing).transpose(0, 2, 1)
    return to_fine._replace(detail=np.ascontiguousarray(detail, dtype=np.float64))


def _way(to_fine: RowMap) -> RowMapArrays:
    return RowMapArrays(
        to_fine.nodes.matrix, to_fine.directors.matrix, to_fine.pieces, to_fine.detail
    )


def _empty(to_fine: RowMap, *before: int) -> MovingPoints:
    """Room for what is carried, with axes in front."""
    shapes = [(*before, *each.shape) for each in (to_fine.nodes, to_fine.directors)]
    return MovingPoints(*(RowPoints(*map(np.empty, shapes)) for _ in MovingPoints._fields))


class PointCarrier:
    """Carries feathers of one grid to another, each by a map of its own (F of them)."""

    def __init__(self, maps: Sequence[RowMap]) -> None:
        self._first = maps[0]
        self._ways = views_of([_way(each) for each in maps])

    def __call__(
        self, some: Indices, points: RowPoints, velocities: RowPoints, accelerations: RowPoints
    ) -> MovingPoints:
        """As carry_motion, of some (K,) of the feathers that are given (F, ...)."""
        found = _empty(self._first, len(some))
        lines = np.zeros((self._first.nodes.width, LINE_WIDTH))
        given = MovingPoints(points, velocities, accelerations)
        carry_kernels.carry_feathers(self._ways.views, some, given, lines, found)
        return found


def carry_all(feather: Feather, grid: Feather, points: Sequence[RowPoints]) -> list[RowPoints]:
    """Carry points of a feather to another grid of it."""
    if feather is grid:
        return list(points)
    to_grid = density_map(feather, grid)
    return [carry_points(to_grid, each) for each in points]


def mean_distance(
    grid: Feather,
    one: tuple[Feather, Sequence[RowPoints]],
    other: tuple[Feather, Sequence[RowPoints]],
) -> float:
    """m, largest distance of the mean poses of two runs of a feather, as seen from its root, or
    difference of their swings, the largest RMS distances of nodes from their means.

    grid: the feather whose nodes count. Poses of either run need no common times.
    """
    nodes = [_seen_from_root(grid, carry_all(feather, grid, own)) for feather, own in (one, other)]
    mean = [each.mean(axis=0) for each in nodes]
    swing = [
        np.sqrt(((each - middle) ** 2).sum(axis=-1).mean(axis=0)).max()
        for each, middle in zip(nodes, mean, strict=True)
    ]
    apart = np.linalg.norm(mean[0] - mean[1], axis=-1).max()
    return float(max(apart, abs(swing[0] - swing[1])))


def _seen_from_root(grid: Feather, points: Sequence[RowPoints]) -> Array:
    """(T, K, 3) m, nodes of a grid in the frame of its root."""
    there, found = existing_nodes(grid), []
    for nodes, directors in points:
        d2, d3 = directors[0]
        found.append((nodes[there] - nodes[0, 0]) @ np.array([np.cross(d2, d3), d2, d3]).T)
    return np.array(found)


def existing_nodes(feather: Feather) -> Flags:
    """(n, 1 + 2 m) nodes of the rachis and of barbs that are there."""
    grown = np.repeat(feather.barb_length.T > 0.0, feather.columns, axis=1)
    return np.concatenate([np.ones((feather.rows, 1), dtype=np.bool_), grown], axis=1)


def max_distance(
    coarse: Feather, fine: Feather, points: Sequence[RowPoints], wanted: Sequence[RowPoints]
) -> float:
    """m, largest distance of the nodes of a coarse feather from where a fine one has them, in any
    of some poses; nodes of barbs that are not there do not count."""
    there = existing_nodes(coarse)
    ways = [
        np.linalg.norm(a.nodes - b.nodes, axis=-1)[there].max()
        for a, b in zip(points, carry_all(fine, coarse, wanted), strict=True)
    ]
    return float(max(ways))
