"""The rachis at rest: stations of the rows, positions, frames and sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.feather.profiles import at_places
from featherfx.feather.types import Array
from featherfx.groom.course import shaft
from featherfx.groom.types import FeatherKind


@dataclass(frozen=True)
class Rachis:
    """The rachis sampled at n rows.

    station: (n,) m, arc length. position: (n, 3) m. frame: (n, 3, 3), columns d1, d2, d3.
    width, height: (n,) m, outer section along d2 and d3.
    first_vane_row: the row at which calamus and vane meet.
    """

    station: Array
    position: Array
    frame: Array
    width: Array
    height: Array
    first_vane_row: int


def row_stations(length: float, calamus: float, rows: int) -> tuple[Array, int]:
    """(rows,) m, near-equal arc lengths of the rows, and the row where the vane begins.

    A row falls exactly on the end of the calamus; calamus and vane are each divided equally, with
    rows in proportion to their lengths as nearly as possible (each at least one segment).
    """
    bare = min(max(round(calamus * (rows - 1)), 1), rows - 2) if calamus > 0.0 else 0
    end = calamus * length
    below = np.linspace(0.0, end, bare + 1)
    above = np.linspace(end, length, rows - bare)
    return np.concatenate((below[:-1], above)), bare


def build_rachis(kind: FeatherKind, rows: int) -> Rachis:
    """Sample the rachis of a kind at near-equal arc lengths; rows >= 3."""
    shape = kind.rachis
    station, first_vane_row = row_stations(kind.length, kind.calamus, rows)
    along = station / kind.length
    frame, mean_tangent = shaft(shape, along)
    difference = shape.diameter_base - shape.diameter_tip
    width = shape.diameter_tip + difference * (1.0 - along) ** shape.taper
    width = width * at_places(shape.diameter_profile, along)
    return Rachis(
        station=station,
        position=station[:, None] * mean_tangent,
        frame=frame,
        width=width,
        height=kind.rachis_material.flattening * width,
        first_vane_row=first_vane_row,
    )
