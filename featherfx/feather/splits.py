"""Splits of a vane: gaps that stand open at rest, and edges of the mesh where a vane opens.

A split lies in the strip between the two rows next to its place. At its edges the ends of the barbs
are moved apart by its width, further away by less, over a distance of SPLIT_SPREAD widths: a barb
of length L turns by 2 u / L more over its length, so that its end moves by u across it and its root
stays. Barbs between two splits are drawn together.

A strip of the vane lies between two rows. It hangs on the barb of its lower row, as if its upper
edge were glued to the next barb. That edge is made of points of their own (Surface.lips): while the
strip is hooked there they coincide with the points of the barb above, where it is open they go
along with the barb below, rigidly with the frame of its nodes

    x = r + F c,    F = (t, n x t, n),    n = d3 - (d3.t) t, of unit length

r node, t direction of the barb there, d3 dorsal director of its row, and c the edge's place at
rest, of a strip that is split at rest as if it were not. Lips part where all triangles of the strip
that meet in them are open: at the end of a split they stay together. Barbs that are drawn between
rows go along with their strip.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.algebra.vectors import dots
from featherfx.feather.types import Array, Feather, Indices, RowPoints
from featherfx.groom.splits import Split

# widths of a split over which the barbs beside it are moved
SPLIT_SPREAD = 4.0


def strips_of(splits: Sequence[Split], place: Array, grown: Flags) -> dict[int, Split]:
    """Row below each split, and the split; of several in one strip the deepest.

    place: (n,) of the rows, share of the vane's length. grown: (n,) whether they have a barb.
    """
    between = np.flatnonzero(grown[:-1] & grown[1:])
    if len(between) == 0:
        return {}
    middle = 0.5 * (place[between] + place[between + 1])
    found: dict[int, Split] = {}
    for split in splits:
        row = int(between[np.argmin(np.abs(middle - split.position))])
        if row not in found or split.depth > found[row].depth:
            found[row] = split
    return found


def open_cells(splits: dict[int, Split], exists: Flags) -> Flags:
    """(n-1, m, 2) triangles that are open at rest. splits: of strips_of. exists: as the result."""
    result, columns = np.zeros(exists.shape, dtype=np.bool_), exists.shape[1]
    along = (np.arange(columns) + 0.5) / columns
    for row, split in splits.items():
        result[row] = (along >= min(1.0 - split.depth, along[-1]))[:, None]
    return result & exists


def splay(splits: dict[int, Split], across: Array, length: Array, size: float) -> Array:
    """(n,) rad, by how much more the barbs turn towards the tip.

    splits: of strips_of. across: (n,) m, places of the barbs along a line that crosses them.
    length: (n,) m, of the barbs, 0 for none. size: m, of the feather.
    """
    moved = np.zeros(len(length))
    for row, split in splits.items():
        half = 0.5 * split.width * size
        if half == 0.0:
            continue
        above = np.arange(len(length)) > row
        away = np.where(above, across - across[row + 1], across[row] - across)
        fading = np.maximum(1.0 - away / (2.0 * SPLIT_SPREAD * half), 0.0)
        moved += np.where(above, half, -half) * fading
    return np.divide(2.0 * moved, length, out=np.zeros_like(moved), where=length > 0.0)


# s, over which rates of carried points are differenced, of points that move on by their rates
_DIFFERENCE_TIME = 1e-5


@dataclass(frozen=True)
class BarbPoints:
    """Points that go along rigidly with L nodes of barbs.

    row, node: (L,) that carry them; before, after: nodes of the row between which its barb runs
    there. place: (L, 3) m, c.
    """

    row: Indices
    node: Indices
    before: Indices
    after: Indices
    place: Array

    @staticmethod
    def attach(
        points: RowPoints, row: Indices, side: Indices, column: Indices, at: Array
    ) -> BarbPoints:
        """Those that are at places (L, 3) m while rows have these points; column: 0 the root."""
        last = points.nodes.shape[1] // 2
        node, before, after = (
            np.where(c > 0, side * last + c, 0)
            for c in (column, np.maximum(column - 1, 0), np.minimum(column + 1, last))
        )
        still = BarbPoints(row, node, before, after, np.zeros((len(row), 3)))
        away = at - points.nodes[row, node]
        return replace(still, place=np.einsum("lki,lk->li", still._frames(points), away))

    def positions(self, points: RowPoints) -> Array:
        """(L, 3) m, where they are."""
        nodes = points.nodes[self.row, self.node]
        return np.asarray(nodes + np.einsum("lik,lk->li", self._frames(points), self.place))

    def _frames(self, points: RowPoints) -> Array:
        """(L, 3, 3) columns t, n x t, n."""
        along = points.nodes[self.row, self.after] - points.nodes[self.row, self.before]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        normal = points.directors[self.row, 1]
        normal = normal - along * dots(normal, along)[:, None]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.stack([along, np.cross(normal, along), normal], axis=-1)


def difference_rates(
    carried: Callable[[RowPoints], Array],
    points: RowPoints,
    velocities: RowPoints,
    accelerations: RowPoints | None = None,
) -> Array:
    """(L, 3) velocities of carried points, or their accelerations where those are given."""
    second = velocities if accelerations is None else accelerations
    curve = 0.0 if accelerations is None else 0.5 * _DIFFERENCE_TIME**2
    before, after = (
        carried(
            RowPoints(
                *(
                    x + sign * _DIFFERENCE_TIME * v + curve * a
                    for x, v, a in zip(points, velocities, second, strict=True)
                )
            )
        )
        for sign in (-1.0, 1.0)
    )
    if accelerations is None:
        return (after - before) / (2.0 * _DIFFERENCE_TIME)
    return np.asarray((after - 2.0 * carried(points) + before) / _DIFFERENCE_TIME**2)


@dataclass(frozen=True)
class SplitEdges(BarbPoints):
    """The L lips of a feather that may part.

    point: (L,) of the mesh. cells: (L, 3) triangles of the strip that meet in it, numbers in
    Feather.cell, or that of the first of them again.
    """

    point: Indices
    cells: Indices

    @staticmethod
    def from_feather(feather: Feather) -> SplitEdges:
        surface, columns = feather.surface, feather.columns
        point = surface.lips[:, 0]
        row, node = surface.row[point] - 1, surface.node[point]
        side, column = (node - 1) // columns, (node - 1) % columns

        def hanging(rest: RowPoints) -> BarbPoints:
            return BarbPoints.attach(rest, row, side, column + 1, rest.nodes[row + 1, node])

        own = hanging(feather.rest)
        place = own.place
        if feather.split.size:
            gapes = feather.split.max(axis=(2, 3), keepdims=True)[side, row, 0]
            place = np.where(gapes, hanging(unsplit(feather)).place, place)
        meeting = _meeting(feather.cell, side, row, column)
        return SplitEdges(row, node, own.before, own.after, place, point, meeting)

    def open(self, hooked: Array) -> Flags:
        """(L,) which are open, of the hooks (2, n-1, m, 2) of all triangles."""
        return np.asarray((hooked.ravel()[self.cells] == 0.0).all(axis=1))


def unsplit(feather: Feather) -> RowPoints:
    """Nodes and directors of a feather at rest as if nothing of it were split."""
    return feather.rest._replace(nodes=feather.unsplit) if feather.unsplit.size else feather.rest


@dataclass(frozen=True)
class SplitBarbs:
    """P points of barbs that are drawn between the rows of a vane that may part.

    near, far: the point as part of the barb below, carried by the nodes on either side of it.
    fraction: (P,) of far. cells: (2, P, 3), triangles that meet in the strip's upper edge at near
    and far, as in SplitEdges, -1 where that is no part of a strip.
    """

    near: BarbPoints
    far: BarbPoints
    fraction: Array
    cells: Indices

    @staticmethod
    def from_curves(
        feather: Feather, station: Array, side: Indices, along: Array, at: Array
    ) -> SplitBarbs:
        """station, along: (P,) share of the rachis and of the barb. at: (P, 3) m, on the vane
        without splits."""
        rest, columns = unsplit(feather), feather.columns
        places = feather.station / feather.station[-1]
        row = np.clip(np.searchsorted(places, station, side="right") - 1, 0, feather.rows - 2)
        first = np.minimum((along * columns).astype(np.int64), columns - 1)
        barbs = feather.barb_length > 0.0
        grown = barbs[side, row] & barbs[side, row + 1]
        # what lies in no strip never parts: any barb will do
        row = np.where(grown, row, barbs.argmax(axis=1)[side])
        ends, cells = [], []
        for column in (first, first + 1):
            ends.append(BarbPoints.attach(rest, row, side, column, at))
            meeting = _meeting(feather.cell, side, row, np.maximum(column - 1, 0))
            cells.append(np.where((grown & (column > 0))[:, None], meeting, -1))
        return SplitBarbs(ends[0], ends[1], along * columns - first, np.stack(cells))

    def parted(self, hooked: Array) -> SplitMesh | None:
        """Those of which a part goes along with the barb below, of the hooks of all triangles
        (2, n-1, m, 2); None where there are none."""
        near, far = (hooked.ravel()[self.cells] == 0.0).all(axis=2) & (self.cells[..., 0] >= 0)
        part = (1.0 - self.fraction) * near + self.fraction * far
        points = np.flatnonzero(part > 0.0)
        if len(points) == 0:
            return None
        ends = _picked(self.near, points), _picked(self.far, points)
        return SplitMesh(points, part[points, None], *ends, self.fraction[points, None])


@dataclass(frozen=True)
class SplitMesh:
    """Q of the points of SplitBarbs: numbers; part (Q, 1) of each that goes along with the barb
    below; near, far and share (Q, 1) as there."""

    numbers: Indices
    part: Array
    near: BarbPoints
    far: BarbPoints
    fraction: Array

    def positions(self, points: RowPoints) -> Array:
        """(Q, 3) m, where they are as parts of the barbs below."""
        ends = self.near.positions(points), self.far.positions(points)
        return np.asarray((1.0 - self.fraction) * ends[0] + self.fraction * ends[1])

    def joined(self, curves: Array, own: Array) -> Array:
        """(P, 3) points or rates as of a whole vane with those (Q, 3) of the parted ones."""
        result = curves.copy()
        result[self.numbers] += self.part * (own - curves[self.numbers])
        return result


def _picked(carried: BarbPoints, numbers: Indices) -> BarbPoints:
    return BarbPoints(*(getattr(carried, each.name)[numbers] for each in fields(carried)))


def _meeting(cell: Flags, side: Indices, row: Indices, column: Indices) -> Indices:
    """(L, 3) triangles that meet in the upper node of a strip at the end of its cell `column`: B of
    that cell, A and B of the next."""
    number = np.arange(cell.size).reshape(cell.shape)
    own = number[side, row, column, 1]
    following = np.minimum(column + 1, cell.shape[2] - 1)
    found = [own]
    for half in range(2):
        there = (following > column) & cell[side, row, following, half]
        found.append(np.where(there, number[side, row, following, half], own))
    return np.stack(found, axis=1)
