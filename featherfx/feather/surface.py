"""The mesh of one feather: both vanes and a closed tube round the rachis."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.rachis import Rachis
from featherfx.feather.types import (
    LEADING,
    RACHIS_PART,
    TRAILING,
    Array,
    FeatherSurface,
    Indices,
    barb_slice,
)


def build_surface(
    nodes: Array,
    rachis: Rachis,
    barb_length: Array,
    cell: Flags,
    tube_sides: int,
    splits: bool,
) -> FeatherSurface:
    """Mesh of a feather that is not mirrored.

    nodes: (n, 1 + 2 m, 3) m. barb_length: (2, n) m. cell: (2, n - 1, m, 2).
    tube_sides: corners of the rachis tube's section, at least 3. splits: as in vane_surface.
    """
    vane = vane_surface(nodes, rachis.station, barb_length, cell, splits)
    reach = max(float(barb_length.max()), 0.5 * float(rachis.width.max()))
    tube = _tube(nodes[:, 0], rachis, reach, tube_sides)
    tube = replace(tube, triangles=tube.triangles + len(vane.row))
    both = ((getattr(vane, each.name), getattr(tube, each.name)) for each in fields(FeatherSurface))
    return FeatherSurface(*map(np.concatenate, both))


def vane_surface(
    nodes: Array,
    station: Array,
    barb_length: Array,
    cell: Flags,
    splits: bool = False,
) -> FeatherSurface:
    """Both vanes, which share the rachis points; only points that a triangle uses.

    nodes: (n, 1 + 2 m, 3) m. station: (n,) m. barb_length: (2, n) m. cell: (2, n - 1, m, 2).
    splits: whether strips between rows may part, so that their upper edges have points of their
    own.
    """
    columns, size = cell.shape[2], nodes.shape[0] * nodes.shape[1]
    sides = [
        _side_triangles(barb_length[s], cell[s], s, columns, size if splits else 0)
        for s in (LEADING, TRAILING)
    ]
    corners = np.concatenate([corner for corner, _ in sides])
    root, end = np.concatenate([edge for _, edge in sides]).T
    position = nodes.reshape(-1, 3)
    along = position[end] - position[root]
    used, triangles = np.unique(corners, return_inverse=True)
    row, node = np.divmod(used % size, nodes.shape[1])
    place = np.where(node > columns, columns - node, node)
    return FeatherSurface(
        row=row,
        node=node,
        offset=np.zeros((len(used), 2)),
        triangles=triangles.reshape(-1, 3),
        part=np.repeat(np.array([LEADING, TRAILING]), [len(corner) for corner, _ in sides]),
        barb_direction=along / np.linalg.norm(along, axis=-1, keepdims=True),
        st=np.stack((0.5 + 0.5 * place / columns, station[row] / station[-1]), axis=-1),
        lips=_lips(used, size),
    )


def _lips(used: Indices, size: int) -> Indices:
    """(L, 2) points that are lips and those they coincide with. used: (V,) flat numbers of nodes,
    `size` more for lips."""
    lips = np.flatnonzero(used >= size)
    partner = np.minimum(np.searchsorted(used, used[lips] - size), len(used) - 1)
    return np.stack([lips, np.where(used[partner] == used[lips] - size, partner, -1)], axis=1)


def _side_triangles(
    barb_length: Array, cell: Flags, side: int, columns: int, lip: int
) -> tuple[Indices, Indices]:
    """(T, 3) corners and (T, 2) barb edges, root to end, as flat numbers of nodes.

    lip: added to corners that are points of their own, at upper edges between two barbs.
    """
    rows = len(barb_length)
    of_row = np.concatenate(([0], np.arange(1 + 2 * columns)[barb_slice(side, columns)]))
    # A barb of length zero is its rachis point; one mesh point stands for all its nodes.
    node = np.where(barb_length[:, None] > 0.0, of_row, 0)
    node += np.arange(rows)[:, None] * (1 + 2 * columns)
    here, out, up, diagonal = node[:-1, :-1], node[:-1, 1:], node[1:, :-1], node[1:, 1:]
    own = lip * ((barb_length[:-1] > 0.0) & (barb_length[1:] > 0.0))[:, None]
    beyond = diagonal + own
    # the rachis does not part
    above = up + np.where(np.arange(columns) > 0, own, 0)
    lower, upper = (here, out, above), (out, beyond, above)
    if side == LEADING:
        lower, upper = (here, above, out), (out, above, beyond)
    corners = np.stack((np.stack(lower, -1), np.stack(upper, -1)), axis=2)
    edges = np.stack((np.stack((here, out), -1), np.stack((up, diagonal), -1)), axis=2)
    return corners[cell], edges[cell]


def _tube(shaft: Array, rachis: Rachis, reach: float, sides: int) -> FeatherSurface:
    """A closed tube: a ring a row and a centre point at either end.

    shaft: (n, 3) m, rachis nodes.
    reach: m, distance that stands for half the width of the texture, so that the tube takes as
    much of it as of the vane.
    """
    rows = len(rachis.station)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    lateral = 0.5 * np.outer(rachis.width, np.cos(angle)).ravel()
    vertical = 0.5 * np.outer(rachis.height, np.sin(angle)).ravel()
    row = np.concatenate((np.repeat(np.arange(rows), sides), [0, rows - 1]))
    offset = np.zeros((len(row), 2))
    offset[:-2, 0], offset[:-2, 1] = lateral, vertical
    ring = np.arange(rows * sides).reshape(rows, sides)
    following = np.roll(ring, -1, axis=1)
    lower, beside = ring[:-1], following[:-1]
    upper, opposite = ring[1:], following[1:]
    walls = np.stack(
        (np.stack((lower, beside, opposite), -1), np.stack((lower, opposite, upper), -1)), axis=2
    ).reshape(-1, 3)
    base = np.stack((np.full(sides, rows * sides), following[0], ring[0]), axis=-1)
    tip = np.stack((np.full(sides, rows * sides + 1), ring[-1], following[-1]), axis=-1)
    along = np.diff(shaft, axis=0)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    ends = np.repeat(rachis.frame[[0, -1], :, 0], sides, axis=0)
    st = np.stack((0.5 + 0.5 * offset[:, 0] / reach, rachis.station[row] / rachis.station[-1]), -1)
    return FeatherSurface(
        row=row,
        node=np.zeros_like(row),
        offset=offset,
        triangles=np.concatenate((walls, base, tip)),
        part=np.full(len(walls) + 2 * sides, RACHIS_PART),
        barb_direction=np.concatenate((np.repeat(along, 2 * sides, axis=0), ends)),
        st=st,
    )
