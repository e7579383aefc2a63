"""One vane of a feather on its curved rachis: barb nodes, cells, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.feather.barbs import Barbs, trace_barbs, without_barb
from featherfx.feather.rachis import Rachis
from featherfx.feather.types import LEADING, Array
from featherfx.groom.splits import Split
from featherfx.groom.types import FeatherKind

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
