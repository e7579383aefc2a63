"""How much room there is above a skin: the largest ball that touches it from outside.

A ball with its middle at p + r n touches the skin at p; a point q of the skin within it forces the
radius down to |q - p|^2 / (2 n . (q - p)), where the ball passes through p and q. Repeated with
the point nearest to the middle until none lies inside (shrinking balls, Ma, Bae and Choi 2012).
It is half the distance of parts that face each other, and the radius of curvature of a hollow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MOST_ROUNDS = 60
_TOUCHING = 1e-6  # share of the radius by which a point may lie inside


def room_above(points: Array, normals: Array, most: float) -> Array:
    """(V,) m, radius of the largest ball outside a skin at each of its points, at most `most`.

    points: (V, 3) m, of the skin, dense enough to stand for it. normals: (V, 3) unit or zero,
    outwards; where zero the radius is 0.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    radius = np.where(normals.any(axis=1), most, 0.0)
    active = np.flatnonzero(radius > 0.0)
    for _ in range(_MOST_ROUNDS):
        start, normal = points[active], normals[active]
        distance, near = tree.query(start + radius[active, None] * normal, workers=-1)
        inside = (near != active) & (distance < (1.0 - _TOUCHING) * radius[active])
        active, near = active[inside], near[inside]
        if len(active) == 0:
            break
        way = points[near] - points[active]
        height = np.einsum("nc,nc->n", way, normals[active])
        # a point inside the ball lies above the tangent plane, so the height is positive
        radius[active] = 0.5 * np.einsum("nc,nc->n", way, way) / np.maximum(height, 1e-300)
    return radius
