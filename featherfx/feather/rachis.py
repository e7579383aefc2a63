"""The shaft at rest: stations of the rows, positions, frames and sections.

Rachis and barbs at rest are curves whose frame turns at a constant rate. A frame R(s) with
dR/ds = R [k] for a constant k turns to R(s) = exp(s [k]), and its first axis sweeps out the
position s V(s k) e1, both in closed form (Rodrigues), so that a curve is exact at any number of
points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.feather.types import Array
from featherfx.groom.types import FeatherKind

# Below this angle the closed form of (angle - sin(angle)) / angle^3 loses digits to cancellation;
# five terms of its series are exact to rounding there.
_SERIES_BELOW = 0.25


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

    A row falls exactly on the end of the calamus; calamus and vane are each divided equally, with
    rows in proportion to their lengths as nearly as possible (each at least one segment).
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
    along = station / kind.length
    # Positive rotation about d2 lowers the tangent (ventral), about d3 turns it to the leading
    # side: hence the sign of the sweep.
    total = np.radians([shape.twist, shape.camber, -shape.sweep])
    frame, mean_tangent = turn(along[:, None] * total)
    difference = shape.diameter_base - shape.diameter_tip
    width = shape.diameter_tip + difference * (1.0 - along) ** shape.taper
    return Rachis(
        station=station,
        position=station[:, None] * mean_tangent,
        frame=frame,
        width=width,
        height=kind.rachis_material.flattening * width,
        turning=total / kind.length,
        first_vane_row=first_vane_row,
    )


def turn(rotation_vector: Array) -> tuple[Array, Array]:
    """Frames and mean tangents after turning steadily by the given rotation vectors.

    rotation_vector: (..., 3) rad, in the frame of the curve's start.
    Returns (..., 3, 3) frames, columns d1, d2, d3, and (..., 3) the mean of d1 on the way: arc
    length times mean tangent is the position.
    """
    x, y, z = np.moveaxis(np.asarray(rotation_vector, dtype=np.float64), -1, 0)
    skew = np.zeros((*x.shape, 3, 3))
    skew[..., 0, 1], skew[..., 0, 2], skew[..., 1, 2] = -z, y, -x
    skew[..., 1, 0], skew[..., 2, 0], skew[..., 2, 1] = z, -y, x
    squared = skew @ skew
    angle = np.sqrt(x * x + y * y + z * z)
    first = np.sinc(angle / np.pi)[..., None, None]
    second = 0.5 * np.sinc(angle / (2.0 * np.pi))[..., None, None] ** 2
    third = _third_coefficient(angle)[..., None]
    frame = np.eye(3) + first * skew + second * squared
    mean_tangent = second[..., 0] * skew[..., 0] + third * squared[..., 0]
    mean_tangent[..., 0] += 1.0
    return frame, mean_tangent


def _third_coefficient(angle: Array) -> Array:
    """(angle - sin(angle)) / angle^3, accurate down to zero."""
    q = angle * angle
    series = (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0)))) / 6.0
    safe = np.maximum(angle, _SERIES_BELOW)
    return np.where(angle < _SERIES_BELOW, series, (safe - np.sin(safe)) / safe**3)
