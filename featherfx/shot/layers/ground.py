"""The skin beneath the feathers as layers see it: how high each node is to stay above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.shot.contact.beneath import NEAR, SkinBeneath, surfaces_under
from featherfx.shot.layers.types import Array, Ground, Indices, Vanes
from featherfx.shot.motion.skin import BoundSkin


class GroundBeneath(NamedTuple):
    """The surfaces of a skin, and what nodes keep of them."""

    skins: list[SkinBeneath]
    ground: Ground

    def points(self, time: float) -> Array:
        """(V, 3) m, of all surfaces, at a time in s since the first frame."""
        return np.concatenate([np.zeros((0, 3)), *(skin.points(time) for skin in self.skins)])


def ground_beneath(
    skin: BoundSkin | None, some: Indices, vanes: Vanes, rest: Array
) -> GroundBeneath:
    """The surfaces of a skin under feathers. some: numbers of those that vanes and rest are of,
    ascending; rest: (F, n, 2 m + 1, 3) m, nodes at rest."""
    shape, skins, faces, points = vanes.present.shape, list[SkinBeneath](), 0, 0
    triangle, clear = np.full(shape, -1), np.zeros(shape)
    triangles, beside = [np.zeros((0, 3), dtype=np.int64)], [np.zeros((0, 3), dtype=np.int64)]
    for surface, members in surfaces_under(skin, some) if skin is not None else ():
        own = np.zeros(shape, dtype=bool)
        own[members] = vanes.present[members] != 0
        beneath, feather = SkinBeneath(surface, rest[own]), np.nonzero(own)[0]
        over = np.abs(beneath.height) < NEAR * vanes.row.sum(axis=1)[feather]
        clear[own] = np.minimum(beneath.height, (vanes.half + vanes.clear)[feather])
        triangle[own] = np.where(over, beneath.triangle + faces, -1)
        skins.append(beneath)
        triangles.append(beneath.mesh.triangles + points)
        beside.append(np.where(beneath.mesh.beside < 0, -1, beneath.mesh.beside + faces))
        faces, points = faces + len(beneath.mesh.triangles), points + len(surface.surface.rest)
    joined = np.concatenate(triangles), np.concatenate(beside)
    return GroundBeneath(skins, Ground(triangle, clear, *joined))
