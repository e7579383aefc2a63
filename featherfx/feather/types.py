r"""Rest geometry of one feather: the barb grid and the surface drawn on it.

    row i+1   o---o---o---*===*---o---o---o        * rachis node      o barb node
              | / | / | /   |   \ | \ | \ |
    row i     o---o---o---*===*---o---o---o        every triangle has one edge along a barb
            trailing      rachis      leading

Nodes of a row, 1 + 2 m for m columns a side, positions:
    0            rachis node r
    1 .. m       leading barb nodes, root to end
    1+m .. 2m    trailing barb nodes, root to end
Directors of a row, unit vectors: d2 (to the leading side, within the vane; to the trailing side on
a mirrored feather) and d3 (dorsal); d1 = d2 x d3 is normal to the rachis' section.
Every surface point is a node of its row, or stands off one along the directors, so that one map
serves positions, velocities and accelerations.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from itertools import repeat
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.interpolation import Rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LEADING, TRAILING, RACHIS_PART = 0, 1, 2


class RowPoints(NamedTuple):
    """Nodes and directors of the rows of a feather, or their rates; with leading axes for many
    feathers.

    nodes: (n, 1 + 2 m, 3) m. directors: (n, 2, 3) unit vectors d2 and d3.
    """

    nodes: Array
    directors: Array

    @staticmethod
    def from_rows(rows: Array) -> RowPoints:
        """Those of one array, as `rows` gives it."""
        return RowPoints(np.delete(rows, (1, 2), axis=-2), rows[..., 1:3, :])

    def rows(self) -> Array:
        """(..., n, 3 + 2 m, 3), all in one array: of each row rachis node, d2, d3, then barbs."""
        parts = self.nodes[..., :1, :], self.directors, self.nodes[..., 1:, :]
        return np.concatenate(parts, axis=-2)

    def at(self, place: Any) -> RowPoints:
        """Those at a place of the leading axes."""
        return RowPoints(self.nodes[place], self.directors[place])

    def each(self) -> Iterator[RowPoints]:
        """Those at every place of the first axis, made as quickly as Python can."""
        return map(tuple.__new__, repeat(RowPoints), zip(self.nodes, self.directors, strict=True))

    def assign(self, other: RowPoints) -> None:
        """Set both, in place."""
        self.nodes[...], self.directors[...] = other

    def shifted(self, way: Array) -> RowPoints:
        """Moved by way (..., 3), or as fast: directors stay."""
        return RowPoints(self.nodes + way[..., None, None, :], self.directors)


def both(function: Callable[..., Array], *values: RowPoints) -> RowPoints:
    """A function of the nodes, and of the directors."""
    return RowPoints(*map(function, *values))


def turned(matrices: Array, points: RowPoints) -> RowPoints:
    """Every vector, as a row, times matrices (..., 3, 3) of its feather or row."""
    return both(lambda part: part @ matrices, points)


def stacked(points: Sequence[RowPoints]) -> RowPoints:
    """Stack those of feathers of one grid, with an axis in front."""
    # five times as fast as np.stack for thousands of small arrays
    return both(lambda *parts: np.concatenate(parts).reshape(-1, *parts[0].shape), *points)


def barb_slice(side: int, columns: int) -> slice:
    """The nodes of one side's barb within a row."""
    return slice(1 + side * columns, 1 + (side + 1) * columns)


@dataclass(frozen=True)
class FeatherSurface:
    """The mesh of one feather (vanes and a rachis tube), V points, T triangles.

    row: (V,) row of each point, and node: (V,) the node of that row that it is, or stands off by
        offset: (V, 2) m along the row's directors; vane points do not, those of the tube do.
    triangles: (T, 3) point indices, counter-clockwise seen from dorsal (vanes) or from outside
        (rachis tube, closed at both ends).
    part: (T,) LEADING, TRAILING or RACHIS_PART.
    barb_direction: (T, 3) unit, rest direction of the triangle's barb, root to end, feather frame
        (rachis triangles: along the rachis).
    st: (V, 2) u from trailing edge (0) over the rachis (0.5) to the leading edge (1), v from
        base (0) to tip (1).
    lips: (L, 2) points that coincide while the vane is whole, of vanes that may split
        (splits.py): the upper edge of a strip, and the barb above it, or -1 where
        no strip begins with that barb.
    """

    row: Indices
    node: Indices
    offset: Array
    triangles: Indices
    part: Indices
    barb_direction: Array
    st: Array
    lips: Indices = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    def points(self, values: RowPoints | Array) -> Array:
        """(..., V, 3) surface points, or their rates. values: also as an array (RowPoints.rows)."""
        if isinstance(values, np.ndarray):
            values = RowPoints.from_rows(values)
        directors = values.directors[..., self.row, :, :]
        along, up = (self.offset[:, k, None] * directors[..., k, :] for k in range(2))
        return np.asarray(values.nodes[..., self.row, self.node, :] + along + up)


@dataclass(frozen=True, repr=False)
class Feather:
    """Rest geometry of one feather, n rows, m columns a side, feather frame, metres.

    rows start at the follicle (row 0: root frame exactly at the origin, d1 = x, d2 = y, d3 = z)
    and end at the rachis tip. Barbs of the calamus and of an absent vane have length zero (all
    their nodes on the rachis); no triangle touches them. Within a vane a row may lack a barb too
    (at its base and tip); triangles then run in a fan to that row's rachis point.

    A mirrored feather is the exact mirror image in y. Its frames are right-handed all the same,
    with d2 = y at the root, so that its leading vane lies on the side of -d2 and -y; d3 is dorsal
    on both. Everything that says leading or trailing (columns, part, cell, st) holds unchanged.

    rest: nodes and directors at rest.
    station: (n,) m, arc length of the rachis at the rows.
    width, height: (n,) m, outer section of the rachis along d2 and d3.
    barb_length: (2, n) m, leading and trailing, along the nodes: m segments of barb_length / m.
    barb_span: (2, n) m, length of rachis whose barbs the row's barb stands for (0 where there
        is no barb).
    cell: (2, n - 1, m, 2) bool, whether triangle A (i,j)(i,j+1)(i+1,j) [index 0], its edge on row
        i, and triangle B (i,j+1)(i+1,j+1)(i+1,j) [index 1], its edge on row i+1, exist (j = 0 is
        the rachis). Those that would have no area do not.
    split: as cell, whether triangles are open at rest; of size 0 where none is.
    unsplit: (n, 1 + 2 m, 3) m, nodes as they would be without splits; of size 0 where there is
        none.
    """

    rest: RowPoints
    station: Array
    width: Array
    height: Array
    barb_length: Array
    barb_span: Array
    cell: NDArray[np.bool_]
    surface: FeatherSurface
    split: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0, 0, 2), dtype=np.bool_))
    unsplit: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))

    def __repr__(self) -> str:
        return f"Feather({self.rows} rows, {self.columns} columns)"

    @property
    def points(self) -> Array:
        """(n, 3 + 2 m, 3) nodes and directors at rest, as RowPoints.rows gives them."""
        return self.rest.rows()

    @property
    def rows(self) -> int:
        return len(self.station)

    @property
    def columns(self) -> int:
        return self.cell.shape[2]


@dataclass(frozen=True)
class PointMap:
    """A linear map of nodes and directors. matrix: (K, n (3 + 2 m)), all nodes first, row by row.
    shape: of the result, (..., 3): K points, or their rates. width: n (3 + 2 m)."""

    matrix: Rows
    shape: tuple[int, ...]
    width: int

    def __call__(self, values: RowPoints) -> Array:
        flat = np.concatenate([each.reshape(-1, 3) for each in values])
        return (self.matrix @ flat).reshape(self.shape)

    def picked(self, points: Indices) -> PointMap:
        """The map to some of the points alone. points: (k,) or (k, l), into the K points."""
        return PointMap(self.matrix.picked(points.ravel()), (*points.shape, 3), self.width)


class MovingPoints(NamedTuple):
    """Points of a feather and their first two rates; of several with an axis in front."""

    points: RowPoints
    velocities: RowPoints
    accelerations: RowPoints


class RowMap(NamedTuple):
    """A linear map to the nodes and directors of another grid.

    pieces: (n, 2 m) m, the lengths of its barbs' pieces at rest, node by node, of the piece that
    ends there. detail: (n, 3 + 2 m, 3) what its rest shape has besides, in the frames of its rows
    (RowPoints.rows); of size 0 for none.
    """

    nodes: PointMap
    directors: PointMap
    pieces: Array
    detail: Array = np.zeros((0, 0, 3))

    def __call__(self, values: RowPoints) -> RowPoints:
        return RowPoints(self.nodes(values), self.directors(values))


@dataclass(frozen=True)
class BarbCurves:
    """Barbs of a feather as B curves of K points, from base to tip, leading vane first.

    points: (B, K, 3) m, at rest, root first. widths: (B, K) m, of barbs with their barbules within
    the vane. ramus: (B, K) part of the width that the barb itself has.
    side: (B,) LEADING or TRAILING. st: (B, K, 2) texture coordinates, those of the vane's surface.
    points_map: from the simulated feather's rows (or rates) to points. hooked: (B, K) share of
    barbules that are hooked. mirrored: whether the feather is. strands: splits.SplitBarbs of the
    points, one curve after the other, of a vane that may part. barbules: barbules.Barbules that are
    drawn besides.
    """

    points: Array
    widths: Array
    ramus: Array
    side: Indices
    st: Array
    points_map: PointMap
    hooked: Array
    mirrored: bool = False
    strands: Any = None
    barbules: Any = None

    def drawn(self, values: Array) -> Array:
        """(B K + C 3, ...) values of all curves' points, from those of the barbs' (B K, ...)."""
        if self.barbules is None:
            return values
        return np.concatenate([values, self.barbules.matrix @ values])

    def of_curves(self, values: Any) -> Any:
        """(B + C, ...) values of all curves, from those of the barbs (B, ...)."""
        return (
            values
            if self.barbules is None
            else np.concatenate([values, values[self.barbules.barb]])
        )

    @property
    def drawn_widths(self) -> Array:
        """(B K + C 3,) m, of all curves' points."""
        own = self.widths.ravel()
        return own if self.barbules is None else np.append(own, self.barbules.widths)

    @property
    def counts(self) -> Indices:
        """(B + C,) points of each curve."""
        own = np.full(*self.widths.shape)
        return (
            own if self.barbules is None else np.append(own, np.full(*self.barbules.widths.shape))
        )

    @property
    def index(self) -> Indices:
        """(B,) number of each barb on its vane, from the base."""
        return np.arange(len(self.side)) - np.where(self.side == TRAILING, self._leading, 0)

    @property
    def _leading(self) -> int:
        return int(np.count_nonzero(self.side == LEADING))

    @property
    def neighbours(self) -> tuple[Indices, Indices]:
        """(B,) barbs before and after each on its vane; itself where there is none."""
        own = np.arange(len(self.side))
        before, after = np.maximum(own - 1, 0), np.minimum(own + 1, len(own) - 1)
        before = np.where(self.side[before] == self.side, before, own)
        return before, np.where(self.side[after] == self.side, after, own)

    def normals(self, points: Array) -> Array:
        """(B K, 3) unit, dorsal, at points (B K, 3) of a pose: across the barbs, times along."""
        curves = points.reshape(*self.widths.shape, 3)
        before, after = self.neighbours
        normal = np.cross(curves[after] - curves[before], np.gradient(curves, axis=1))
        normal *= np.where((self.side == LEADING) != self.mirrored, 1.0, -1.0)[:, None, None]
        size = np.linalg.norm(normal, axis=2, keepdims=True)
        unit = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0.0)
        # any where barbs lie on one another
        return np.where(size > 0.0, unit, [0.0, 0.0, 1.0]).reshape(-1, 3)


def make_read_only(record: Any) -> None:
    """Let nobody write to the arrays of a record."""
    for entry in fields(record):
        value = getattr(record, entry.name)
        if is_dataclass(value):
            make_read_only(value)
            continue
        for array in value if isinstance(value, RowPoints) else (value,):
            array.flags.writeable = False


_SHARED: WeakValueDictionary[tuple[Any, ...], Any] = WeakValueDictionary()


def share(values: NDArray[Any]) -> NDArray[Any]:
    """The one array of this content that is in use, to which nobody writes: feathers of one grid
    differ in shape, but hardly in topology."""
    content = hashlib.blake2b(np.ascontiguousarray(values).data).digest()
    key = values.shape, values.dtype.str, content
    found = _SHARED.get(key)
    if found is None:
        found = values.copy()  # not what it is a part of
        found.flags.writeable = False
        _SHARED[key] = found
    return found


def scale_feather(feather: Feather, size: float) -> Feather:
    """The feather `size` times as large. Directors and the mesh's topology stay the same."""
    if size == 1.0:
        return feather
    lengths = ("station", "width", "height", "barb_length", "barb_span", "unsplit")
    own = {name: size * getattr(feather, name) for name in lengths}
    nodes, offset = size * feather.rest.nodes, size * feather.surface.offset
    for array in (*own.values(), nodes, offset):
        array.flags.writeable = False  # the others are those of the feather
    surface = replace(feather.surface, offset=offset)
    return replace(feather, rest=feather.rest._replace(nodes=nodes), surface=surface, **own)
