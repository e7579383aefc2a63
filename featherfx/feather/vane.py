"""One vane of a feather on its curved rachis: barb nodes, cells, and what is wrong with them.

The mesh of one feather: both vanes and a closed tube round the rachis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.barbs import Barbs, trace_barbs, without_barb
from featherfx.feather.profiles import Rachis
from featherfx.feather.types import (
    LEADING,
    RACHIS_PART,
    TRAILING,
    Array,
    FeatherSurface,
    Indices,
    barb_slice,
)
from featherfx.groom.types import FeatherKind

if TYPE_CHECKING:
    from featherfx.groom.splits import Split

# A barb at the end of a vane that is shorter than its neighbour by this factor may be dropped.
_SHORT_END = 0.5


@dataclass(frozen=True)
class VaneGrid:
    """A vane at n rows, m columns.

    nodes: (n, m + 1, 3) m, barb nodes with the root first, feather frame.
    cell: (n - 1, m, 2) which triangles exist (featherfx/feather/types.py).
    barb_length: (n,) m, along the nodes. problems: what makes the vane unusable.
    """

    nodes: Array
    cell: Flags
    barb_length: Array
    problems: tuple[str, ...]


@dataclass(frozen=True)
class _Cells:
    """Nodes, existing triangles, and the rows (n - 1,) above which the vane is folded when laid
    flat and as built."""

    nodes: Array
    exists: Flags
    folded_flat: Flags
    folded: Flags


def build_vane(
    kind: FeatherKind, side: int, rachis: Rachis, columns: int, splits: Sequence[Split] = ()
) -> VaneGrid:
    """Trace the barbs of one side (LEADING or TRAILING) and span the vane between them.

    Between a barb and a row without one the vane is a fan of triangles; where a fan would fold
    over it is left out, and the barb is the vane's edge. Where an end barb much shorter than its
    neighbour would fold the vane, it is dropped. splits: beside which the barbs give way.
    """
    barbs, messages = trace_barbs(kind, side, rachis, columns, splits)
    cells = _cells(kind, side, rachis, barbs)
    while (short := _short_end(barbs.arc_length, cells.folded | cells.folded_flat)) >= 0:
        barbs = without_barb(barbs, short)
        cells = _cells(kind, side, rachis, barbs)
    return VaneGrid(
        nodes=cells.nodes,
        cell=cells.exists,
        barb_length=columns * np.linalg.norm(barbs.local[:, 1], axis=-1),
        problems=(*messages, *_fold_message(rachis, cells)),
    )


def _cells(kind: FeatherKind, side: int, rachis: Rachis, barbs: Barbs) -> _Cells:
    outward = np.array([1.0, 1.0 if side == LEADING else -1.0, 1.0])
    offset = np.einsum("nab,njb->nja", rachis.frame, barbs.local * outward)
    nodes = rachis.position[:, None] + offset
    dorsal = np.einsum("nab,njb->nja", rachis.frame, barbs.dorsal * outward)
    area, signed_area = cell_areas(nodes, dorsal, side)
    exists = existing_cells(area, rachis.first_vane_row, kind.length)
    up = np.broadcast_to([0.0, 0.0, 1.0], dorsal.shape)
    flat_area, flat_signed_area = cell_areas(barbs.flat * outward, up, side)
    flat_exists = existing_cells(flat_area, rachis.first_vane_row, kind.length)
    folded = folded_rows(exists, signed_area)
    folded_flat = folded_rows(flat_exists, flat_signed_area)
    grown = barbs.arc_length > 0.0
    fan = grown[1:] != grown[:-1]
    exists[fan & (folded | folded_flat)] = False
    if (kind.leading if side == LEADING else kind.trailing).wrap:
        exists[grown[1:] & ~grown[:-1]] = False  # a fan spans a hollow base as a chord
    return _Cells(nodes, exists, folded_flat & ~fan, folded & ~fan)


def _short_end(arc_length: Array, folded: Flags) -> int:
    """Row of an end barb that folds the vane because it is much shorter than its neighbour, or
    -1."""
    grown = np.concatenate(([False], arc_length > 0.0, [False]))
    for row in np.flatnonzero(folded):
        short, other = (row, row + 1) if arc_length[row] < arc_length[row + 1] else (row + 1, row)
        beyond = 2 * short - other
        if not grown[beyond + 1] and arc_length[short] < _SHORT_END * arc_length[other]:
            return int(short)
    return -1


def _fold_message(rachis: Rachis, cells: _Cells) -> tuple[str, ...]:
    x = rachis.station - rachis.station[rachis.first_vane_row]
    for folded, reason in (
        (
            cells.folded_flat,
            "neighbouring barbs cross or fold over each other {}: their angles or "
            "curls differ too much for their length, or they turn back towards the rachis",
        ),
        (
            cells.folded,
            "the vane folds over {}: the camber, sweep or twist of the rachis or the "
            "camber of the barbs is too strong for their length",
        ),
    ):
        rows = np.flatnonzero(folded)
        if len(rows):
            low, high = x[rows[0]] / x[-1], x[rows[0] + 1] / x[-1]
            return (reason.format(f"between positions {low:.3g} and {high:.3g}"),)
    return ()


# Share of the feather's length squared below which a triangle counts as having no area.
_NO_AREA = 1e-10


def cell_areas(nodes: Array, dorsal: Array, side: int) -> tuple[Array, Array]:
    """Areas and facings of the two triangles of every cell of one vane.

    nodes: (n, m + 1, 3) m, barb nodes with the root first. dorsal: (n, m + 1, 3) unit, the upper
    side of the vane at the nodes. Returns (n - 1, m, 2) m^2, the area of triangles A and B
    (featherfx/feather/types.py), and their signed area seen from dorsal at the triangle's barb;
    negative where the vane is folded over.
    """
    here, above = nodes[:-1], nodes[1:]
    first = np.cross(here[:, 1:] - here[:, :-1], above[:, :-1] - here[:, :-1])
    second = np.cross(above[:, :-1] - above[:, 1:], here[:, 1:] - above[:, 1:])
    # Both run clockwise seen from dorsal on the leading side.
    normal = np.stack((first, second), axis=2) * (-0.5 if side == LEADING else 0.5)
    middle = dorsal[:, 1:] + dorsal[:, :-1]
    middle /= np.linalg.norm(middle, axis=-1, keepdims=True)
    facing = np.stack((middle[:-1], middle[1:]), axis=2)
    return np.linalg.norm(normal, axis=-1), np.sum(normal * facing, axis=-1)


def existing_cells(area: Array, first_vane_row: int, length: float) -> Flags:
    """(n - 1, m, 2) which triangles have an area and lie in the vane."""
    exists = area > _NO_AREA * length**2
    exists[:first_vane_row] = False
    return exists


def folded_rows(exists: Flags, signed_area: Array) -> Flags:
    """(n - 1,) between which rows and the next a triangle that exists is folded over."""
    return np.any(exists & (signed_area <= 0.0), axis=(1, 2))


def barb_span(station: Array, barb_length: Array, first_vane_row: int) -> Array:
    """(n,) m, rachis length nearest to each row within the vane; zero where there is no barb."""
    reach = np.zeros(len(station))
    half = 0.5 * np.diff(station[first_vane_row:])
    reach[first_vane_row:-1] += half
    reach[first_vane_row + 1 :] += half
    return np.where(barb_length > 0.0, reach, 0.0)


def build_surface(
    nodes: Array,
    rachis: Rachis,
    barb_length: Array,
    cell: Flags,
    tube_sides: int,
    splits: bool,
    above_vane: float = 0.5,
) -> FeatherSurface:
    """Mesh of a feather that is not mirrored.

    nodes: (n, 1 + 2 m, 3) m. barb_length: (2, n) m. cell: (2, n - 1, m, 2).
    tube_sides: corners of the rachis tube's section, at least 3. splits: as in vane_surface.
    above_vane: share of the tube's height that is dorsal of the vanes.
    """
    vane = vane_surface(nodes, rachis.station, barb_length, cell, splits)
    reach = max(float(barb_length.max()), 0.5 * float(rachis.width.max()))
    tube = _tube(nodes[:, 0], rachis, reach, tube_sides, above_vane)
    tube = replace(tube, triangles=tube.triangles + len(vane.row))
    both = ((getattr(vane, each.name), getattr(tube, each.name)) for each in fields(FeatherSurface))
    return FeatherSurface(*map(np.concatenate, both))


def vane_surface(
    nodes: Array, station: Array, barb_length: Array, cell: Flags, splits: bool = False
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


def _tube(
    axis: Array, rachis: Rachis, reach: float, sides: int, above_vane: float
) -> FeatherSurface:
    """A closed tube: a ring a row and a centre point at either end.

    axis: (n, 3) m, rachis nodes.
    reach: m, distance that stands for half the width of the texture, so that the tube takes as
    much of it as of the vane.
    """
    rows = len(rachis.station)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    lateral = 0.5 * np.outer(rachis.width, np.cos(angle)).ravel()
    vertical = 0.5 * np.outer(rachis.height, np.sin(angle))
    vertical = (vertical + (above_vane - 0.5) * rachis.height[:, None]).ravel()
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
    along = np.diff(axis, axis=0)
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
