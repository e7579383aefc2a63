r"""Rest geometry of one feather: the barb grid and the surface drawn on it.

    row i+1   o---o---o---*===*---o---o---o        * rachis node      o barb node
              | / | / | /   |   \ | \ | \ |
    row i     o---o---o---*===*---o---o---o        every triangle has one edge along a barb
            trailing      rachis      leading

Material points of a row, P = 3 + 2 m for m columns a side (all vectors of 3):
    0            rachis point r
    1, 2         directors d2 (to the leading side, within the vane; to the trailing side on a
                 mirrored feather) and d3 (dorsal); unit vectors, not positions; d1 = d2 x d3 is
                 normal to the shaft's section
    3 .. 2+m     leading barb nodes 1..m, root to end
    3+m .. 2+2m  trailing barb nodes 1..m, root to end
Every surface point is a fixed linear combination of the material points of its row, so that one
map serves positions, velocities and accelerations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LEADING, TRAILING, RACHIS = 0, 1, 2
# places of d2 and d3 in a row
DIRECTORS = (1, 2)


def without_directors(points: Array) -> Array:
    """Material points (..., P, 3), or their rates, without the directors: (..., P - 2, 3)."""
    return np.delete(points, DIRECTORS, axis=-2)


def shifted(points: Array, way: Array) -> Array:
    """Material points (..., n, P, 3), or their rates, moved by way (..., 3): directors stay."""
    moved = points + way[..., None, None, :]
    moved[..., DIRECTORS, :] = points[..., DIRECTORS, :]
    return moved


@dataclass(frozen=True)
class Surface:
    """The mesh of one feather (vanes and a rachis tube), V points, T triangles.

    row: (V,) row of each point.
    terms: (V, 3) material point indices, and weights: (V, 3): point = sum of weight * material
        point, over the point's row. Vane points use one term; tube points use r, d2 and d3.
    triangles: (T, 3) point indices, counter-clockwise seen from dorsal (vanes) or from outside
        (rachis tube, closed at both ends).
    part: (T,) LEADING, TRAILING or RACHIS.
    barb_direction: (T, 3) unit, rest direction of the triangle's barb, root to end, feather frame
        (rachis triangles: along the shaft).
    st: (V, 2) u from trailing edge (0) over the rachis (0.5) to the leading edge (1), v from
        base (0) to tip (1).
    """

    row: Indices
    terms: Indices
    weights: Array
    triangles: Indices
    part: Indices
    barb_direction: Array
    st: Array

    def points(self, material_points: Array) -> Array:
        """(..., n, P, 3) material points (or their rates) to (..., V, 3) surface points."""
        picked = material_points[..., self.row[:, None], self.terms, :]
        return np.einsum("vk,...vkc->...vc", self.weights, picked)


@dataclass(frozen=True)
class Feather:
    """Rest geometry of one feather, n rows, m columns a side, feather frame, metres.

    rows start at the follicle (row 0: root frame exactly at the origin, d1 = x, d2 = y, d3 = z)
    and end at the rachis tip. Barbs of the calamus and of an absent vane have length zero (all
    their nodes on the rachis); no triangle touches them. Within a vane a row may lack a barb too
    (at its base and tip); triangles then run in a fan to that row's rachis point.

    A mirrored feather is the exact mirror image in y. Its frames are right-handed all the same,
    with d2 = y at the root, so that its leading vane lies on the side of -d2 and -y; d3 is dorsal
    on both. Everything that says leading or trailing (columns, part, cell, st) holds unchanged.

    points: (n, P, 3) material points at rest (layout above).
    station: (n,) m, arc length of the rachis at the rows.
    width, height: (n,) m, outer section of the shaft along d2 and d3.
    barb_length: (2, n) m, leading and trailing, along the nodes: m segments of barb_length / m.
    barb_span: (2, n) m, length of rachis whose barbs the row's barb stands for (0 where there
        is no barb).
    cell: (2, n - 1, m, 2) bool, whether triangle A (i,j)(i,j+1)(i+1,j) [index 0], its edge on row
        i, and triangle B (i,j+1)(i+1,j+1)(i+1,j) [index 1], its edge on row i+1, exist (j = 0 is
        the rachis). Those that would have no area do not.
    """

    points: Array
    station: Array
    width: Array
    height: Array
    barb_length: Array
    barb_span: Array
    cell: NDArray[np.bool_]
    surface: Surface

    @property
    def rows(self) -> int:
        return self.points.shape[0]

    @property
    def columns(self) -> int:
        return (self.points.shape[1] - 3) // 2


@dataclass(frozen=True)
class PointMap:
    """A linear map of material points. matrix: (K, n P) sparse. shape: of the result, (..., 3).

    Values as they come are (n, P, 3) material points or their rates; K points result.
    """

    matrix: Any
    shape: tuple[int, ...]

    def __call__(self, values: Array) -> Array:
        return np.asarray(self.matrix @ np.reshape(values, (-1, 3))).reshape(self.shape)

    def picked(self, points: Indices) -> PointMap:
        """The map to some of the points alone. points: (k,) or (k, l), into the K points."""
        return PointMap(self.matrix[points.ravel()], (*points.shape, 3))


@dataclass(frozen=True)
class BarbCurves:
    """Barbs of a feather as B curves of K points, from base to tip, leading vane first.

    points: (B, K, 3) m, at rest, root first. widths: (B, K) m, diameters. side: (B,) LEADING or
    TRAILING. st: (B, K, 2) texture coordinates, those of the vane's surface. points_map: from the
    simulated feather's material points (or rates) to points.
    """

    points: Array
    widths: Array
    side: Indices
    st: Array
    points_map: PointMap
