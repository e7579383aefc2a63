"""A skin in a space that follows its shape: what is drawn in it stays when the mesh is edited.

The space is the mesh's own, in metres and z up, so that transforms do not matter. Its origin is the
skin's farthest point in one direction. The order, size and corners of faces do not matter there;
points that move together take it along, and an edit anywhere else leaves it where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import face_products

# along no axis, edge or diagonal of usual meshes, so that one point is farthest
_DIRECTION = np.array([0.617, -0.523, -0.588])


@dataclass(frozen=True)
class SkinDomain:
    """A skin of T triangles in its domain.

    corners: (T, 3, 3) m. normals: (T, 3) unit. area: m^2, of the whole, to a power of two.
    """

    corners: Array
    normals: Array
    area: float


def make_domain(corners: Array, own: Array, stage: Array) -> SkinDomain:
    """Return the domain of triangles (T, 3, 3) m.

    own, stage: (4, 4) matrices that lead here from the mesh's own space and from its stage's.
    """
    scales = [np.cbrt(abs(np.linalg.det(each[:3, :3]))) for each in (own, stage)]
    # up is up in the domain, whatever axis and unit the stage has
    turn = np.linalg.inv(own[:3, :3]) @ stage[:3, :3] * scales[0] / scales[1]
    placed = (corners - own[3, :3]) @ turn
    points = placed.reshape(-1, 3)
    origin = points[np.argmax(points @ _DIRECTION)]
    products = face_products(placed)
    sizes = np.linalg.norm(products, axis=1)
    area = 2.0 ** np.floor(np.log2(0.5 * sizes.sum()))
    return SkinDomain(np.ascontiguousarray(placed - origin), products / sizes[:, None], float(area))
