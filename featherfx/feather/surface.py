"""The mesh of one feather: both vanes and a closed tube round the rachis."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.rachis import Rachis
from featherfx.feather.types import LEADING, RACHIS, TRAILING, Array, Indices, Surface


def build_surface(
    points: Array,
    rachis: Rachis,
    barb_length: Array,
    cell: NDArray[np.bool_],
    tube_sides: int,
) -> Surface:
    """Mesh of a feather that is not mirrored.

    points: (n, P, 3) m, material points. barb_length: (2, n) m. cell: (2, n - 1, m, 2).
    tube_sides: corners of the rachis tube's section, at least 3.
    """
    vane = vane_surface(points, rachis.station, barb_length, cell)
    reach = max(float(barb_length.max()), 0.5 * float(rachis.width.max()))
    tube = _tube(points, rachis, reach, tube_sides)
    tube = replace(tube, triangles=tube.triangles + len(vane.row))
    both = ((getattr(vane, each.name), getattr(tube, each.name)) for each in fields(Surface))
    return Surface(*map(np.concatenate, both))


def vane_surface(
    points: Array, station: Array, barb_length: Array, cell: NDArray[np.bool_]
) -> Surface:
    """Both vanes, which share the rachis points; only points that a triangle uses.

    points: (n, P, 3) m. station: (n,) m. barb_length: (2, n) m. cell: (2, n - 1, m, 2).
    """
    count = points.shape[1]
    columns = cell.shape[2]
    sides = [_side_triangles(barb_length[s], cell[s], s, columns) for s in (LEADING, TRAILING)]
    corners = np.concatenate([corner for corner, _ in sides])
    root, end = np.concatenate([edge for _, edge in sides]).T
    position = points.reshape(-1, 3)
    along = position[end] - position[root]
    used, triangles = np.unique(corners, return_inverse=True)
    row, term = np.divmod(used, count)
    node = np.where(term > 2 + columns, 2 + columns - term, np.maximum(term - 2, 0))
    weights = np.zeros((len(used), 3))
    weights[:, 0] = 1.0
    return Surface(
        row=row,
        terms=np.stack((term, np.zeros_like(term), np.zeros_like(term)), axis=-1),
        weights=weights,
        triangles=triangles.reshape(-1, 3),
        part=np.repeat(np.array([LEADING, TRAILING]), [len(corner) for corner, _ in sides]),
        barb_direction=along / np.linalg.norm(along, axis=-1, keepdims=True),
        st=np.stack((0.5 + 0.5 * node / columns, station[row] / station[-1]), axis=-1),
    )


def _side_triangles(
    barb_length: Array, cell: NDArray[np.bool_], side: int, columns: int
) -> tuple[Indices, Indices]:
    """(T, 3) corners and (T, 2) barb edges, root to end, as flat material point numbers."""
    rows = len(barb_length)
    count = 3 + 2 * columns
    first = 3 + side * columns
    term = np.concatenate(([0], np.arange(first, first + columns)))
    # A barb of length zero is its rachis point; one mesh point stands for all its nodes.
    node = np.arange(rows)[:, None] * count + np.where(barb_length[:, None] > 0.0, term, 0)
    here, out, up, diagonal = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    lower, upper = (here, out, up), (out, diagonal, up)
    if side == LEADING:
        lower, upper = (here, up, out), (out, up, diagonal)
    corners = np.stack((np.stack(lower, -1), np.stack(upper, -1)), axis=2)
    edges = np.stack((np.stack((here, out), -1), np.stack((up, diagonal), -1)), axis=2)
    return corners[cell], edges[cell]


def _tube(points: Array, rachis: Rachis, reach: float, sides: int) -> Surface:
    """A closed tube: a ring a row and a centre point at either end.

    reach: m, distance that stands for half the width of the texture, so that the tube takes as
    much of it as of the vane.
    """
    rows = len(rachis.station)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    lateral = 0.5 * np.outer(rachis.width, np.cos(angle)).ravel()
    vertical = 0.5 * np.outer(rachis.height, np.sin(angle)).ravel()
    row = np.concatenate((np.repeat(np.arange(rows), sides), [0, rows - 1]))
    weights = np.zeros((len(row), 3))
    weights[:, 0] = 1.0
    weights[:-2, 1], weights[:-2, 2] = lateral, vertical
    ring = np.arange(rows * sides).reshape(rows, sides)
    following = np.roll(ring, -1, axis=1)
    lower, beside = ring[:-1], following[:-1]
    upper, opposite = ring[1:], following[1:]
    walls = np.stack(
        (np.stack((lower, beside, opposite), -1), np.stack((lower, opposite, upper), -1)), axis=2
    ).reshape(-1, 3)
    base = np.stack((np.full(sides, rows * sides), following[0], ring[0]), axis=-1)
    tip = np.stack((np.full(sides, rows * sides + 1), ring[-1], following[-1]), axis=-1)
    shaft = np.diff(points[:, 0], axis=0)
    shaft /= np.linalg.norm(shaft, axis=-1, keepdims=True)
    ends = np.repeat(rachis.frame[[0, -1], :, 0], sides, axis=0)
    st = np.stack((0.5 + 0.5 * weights[:, 1] / reach, rachis.station[row] / rachis.station[-1]), -1)
    return Surface(
        row=row,
        terms=np.tile(np.array([0, 1, 2]), (len(row), 1)),
        weights=weights,
        triangles=np.concatenate((walls, base, tip)),
        part=np.full(len(walls) + 2 * sides, RACHIS),
        barb_direction=np.concatenate((np.repeat(shaft, 2 * sides, axis=0), ends)),
        st=st,
    )
