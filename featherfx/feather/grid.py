"""Cells of the barb grid: which triangles exist, and whether barbs cross or the vane folds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.feather.types import LEADING

Array = NDArray[np.float64]

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


def existing_cells(area: Array, first_vane_row: int, length: float) -> NDArray[np.bool_]:
    """(n - 1, m, 2) which triangles have an area and lie in the vane."""
    exists = area > _NO_AREA * length**2
    exists[:first_vane_row] = False
    return exists


def folded_rows(exists: NDArray[np.bool_], signed_area: Array) -> NDArray[np.bool_]:
    """(n - 1,) between which rows and the next a triangle that exists is folded over."""
    return np.any(exists & (signed_area <= 0.0), axis=(1, 2))


def barb_share(station: Array, barb_length: Array, first_vane_row: int) -> Array:
    """(n,) m, rachis length nearest to each row within the vane; zero where there is no barb."""
    reach = np.zeros(len(station))
    half = 0.5 * np.diff(station[first_vane_row:])
    reach[first_vane_row:-1] += half
    reach[first_vane_row + 1 :] += half
    return np.where(barb_length > 0.0, reach, 0.0)
