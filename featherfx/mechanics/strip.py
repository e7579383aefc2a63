"""A flat rectangular strip as a feather: rows along x, straight barbs along y, hardly a shaft.

The body of the virtual experiments with plates and of side-by-side runs with other simulators.
"""

from __future__ import annotations

import numpy as np

from featherfx.feather.surface import vane_surface
from featherfx.feather.types import Feather
from featherfx.groom.types import (
    FeatherKind,
    RachisMaterial,
    RachisShape,
    VaneMaterial,
    VaneShape,
)

# m; a shaft of nearly no stiffness and mass, because a section of no size has no torsion constant
NO_SHAFT = 1e-9


def strip_kind(length: float, vane: VaneMaterial) -> FeatherKind:
    """Kind of a strip of the given length (m) and vane."""
    nothing = VaneShape((), ())
    return FeatherKind(
        name="strip",
        length=length,
        calamus=0.0,
        barb_spacing=length,
        rachis=RachisShape(NO_SHAFT, NO_SHAFT, 1.0, 0.0, 0.0, 0.0),
        leading=nothing,
        trailing=nothing,
        vane_material=vane,
        rachis_material=RachisMaterial(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0),
    )


def strip_feather(length: float, width: float, rows: int, columns: int) -> Feather:
    """Rest geometry of a strip 0..length by -width/2..width/2 (m); columns: to each side of x."""
    station = np.linspace(0.0, length, rows)
    points = np.zeros((rows, 3 + 2 * columns, 3))
    points[:, 1, 1], points[:, 2, 2] = 1.0, 1.0
    reach = 0.5 * width * np.arange(1, columns + 1) / columns
    points[:, [0, *range(3, 3 + 2 * columns)], 0] = station[:, None]
    points[:, 3 : 3 + columns, 1] = reach
    points[:, 3 + columns :, 1] = -reach
    share = np.full(rows, station[1])
    share[[0, -1]] *= 0.5
    barb_length = np.full((2, rows), 0.5 * width)
    cell = np.ones((2, rows - 1, columns, 2), dtype=np.bool_)
    return Feather(
        points=points,
        station=station,
        width=np.full(rows, NO_SHAFT),
        height=np.full(rows, NO_SHAFT),
        barb_length=barb_length,
        barb_share=np.stack([share, share]),
        cell=cell,
        surface=vane_surface(points, station, barb_length, cell),
    )
