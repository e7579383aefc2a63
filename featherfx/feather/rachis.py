"""The shaft at rest: stations of the rows, positions, frames and sections."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.curve import turn
from featherfx.groom.types import FeatherKind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rachis:
    """The shaft sampled at n rows.

    station: (n,) m, arc length. position: (n, 3) m. frame: (n, 3, 3), columns d1, d2, d3.
    width, height: (n,) m, outer section along d2 and d3.
    turning: (3,) rad/m, constant rate at which the frame turns, in the frame itself.
    first_vane_row: the row at which calamus and vane meet.
    """

    station: Array
    position: Array
    frame: Array
    width: Array
    height: Array
    turning: Array
    first_vane_row: int


def row_stations(length: float, calamus: float, rows: int) -> tuple[Array, int]:
    """(rows,) m, near-equal arc lengths of the rows, and the row where the vane begins.

    A row falls exactly on the end of the calamus; calamus and vane are each divided equally, into
    shares of rows as near as possible to their shares of the length (each at least one segment).
    """
    bare = min(max(round(calamus * (rows - 1)), 1), rows - 2) if calamus > 0.0 else 0
    end = calamus * length
    below = np.linspace(0.0, end, bare + 1)
    above = np.linspace(end, length, rows - bare)
    return np.concatenate((below[:-1], above)), bare


def build_rachis(kind: FeatherKind, rows: int) -> Rachis:
    """Sample the shaft of a kind at near-equal arc lengths; rows >= 3."""
    shape = kind.rachis
    station, first_vane_row = row_stations(kind.length, kind.calamus, rows)
    share = station / kind.length
    # Positive rotation about d2 lowers the tangent (ventral), about d3 turns it to the leading
    # side: hence the sign of the sweep.
    total = np.radians([shape.twist, shape.camber, -shape.sweep])
    frame, mean_tangent = turn(share[:, None] * total)
    difference = shape.diameter_base - shape.diameter_tip
    width = shape.diameter_tip + difference * (1.0 - share) ** shape.taper
    return Rachis(
        station=station,
        position=station[:, None] * mean_tangent,
        frame=frame,
        width=width,
        height=kind.rachis_material.flattening * width,
        turning=total / kind.length,
        first_vane_row=first_vane_row,
    )
