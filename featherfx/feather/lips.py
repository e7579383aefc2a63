"""The edges of splits: where a vane opens, its mesh has two points at one place of a barb.

A strip of the vane lies between two rows. It hangs on the barb of its lower row, as if its upper
edge were glued to the next barb. That edge is made of points of their own (Surface.lips): while the
strip is hooked there they coincide with the points of the barb above, where it is open they go
along with the barb below, rigidly with the frame of its nodes

    x = r + F c,    F = (t, n x t, n),    n = d3 - (d3.t) t, of unit length

r node, t direction of the barb there, d3 dorsal director of its row, and c the edge's place at
rest. Lips part where all triangles of the strip that meet in them are open: at the end of a split
they stay together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import Array, Feather, Indices, RowPoints

# s, over which rates of carried points are differenced, of points that move on by their rates
INSTANT = 1e-5


@dataclass(frozen=True)
class Lips:
    """The L lips of a feather that may part.

    point: (L,) of the mesh. row, node: (L,) that carry an open one; before, after: nodes of the
    row between which its barb runs there. place: (L, 3) m, c. cells: (L, 3) triangles of the
    strip that meet in it, numbers in Feather.cell, or that of the first of them again.
    """

    point: Indices
    row: Indices
    node: Indices
    before: Indices
    after: Indices
    place: Array
    cells: Indices

    @staticmethod
    def of(feather: Feather) -> Lips:
        surface, columns = feather.surface, feather.columns
        point = surface.lips[:, 0]
        row, node = surface.row[point] - 1, surface.node[point]
        side, column = (node - 1) // columns, (node - 1) % columns
        first = np.where(column == 0, 0, node - 1)
        last = np.where(column == columns - 1, node, node + 1)
        meeting = _meeting(feather.cell, side, row, column)
        still = Lips(point, row, node, first, last, np.zeros((len(point), 3)), meeting)
        away = feather.rest.nodes[row + 1, node] - feather.rest.nodes[row, node]
        place = np.einsum("lki,lk->li", still._frames(feather.rest), away)
        return Lips(point, row, node, first, last, place, meeting)

    def open(self, hooked: Array) -> NDArray[np.bool_]:
        """(L,) which are open, of the hooks (2, n-1, m, 2) of all triangles."""
        return np.asarray((hooked.ravel()[self.cells] == 0.0).all(axis=1))

    def carried(self, points: RowPoints) -> Array:
        """(L, 3) m, where they are as parts of the barbs that carry them."""
        nodes = points.nodes[self.row, self.node]
        return np.asarray(nodes + np.einsum("lik,lk->li", self._frames(points), self.place))

    def rates(
        self, points: RowPoints, velocities: RowPoints, accelerations: RowPoints | None = None
    ) -> Array:
        """(L, 3) velocities of carried points, or their accelerations where those are given."""
        second = velocities if accelerations is None else accelerations
        curve = 0.0 if accelerations is None else 0.5 * INSTANT**2
        before, after = (
            self.carried(
                RowPoints(
                    *(
                        x + sign * INSTANT * v + curve * a
                        for x, v, a in zip(points, velocities, second, strict=True)
                    )
                )
            )
            for sign in (-1.0, 1.0)
        )
        if accelerations is None:
            return (after - before) / (2.0 * INSTANT)
        return np.asarray((after - 2.0 * self.carried(points) + before) / INSTANT**2)

    def _frames(self, points: RowPoints) -> Array:
        """(L, 3, 3) columns t, n x t, n."""
        along = points.nodes[self.row, self.after] - points.nodes[self.row, self.before]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        normal = points.directors[self.row, 1]
        normal = normal - along * np.einsum("lk,lk->l", normal, along)[:, None]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return np.stack([along, np.cross(normal, along), normal], axis=-1)


def _meeting(cell: NDArray[np.bool_], side: Indices, row: Indices, column: Indices) -> Indices:
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
