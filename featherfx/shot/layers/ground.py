"""The skin beneath the feathers as layers see it: how high each node is to stay above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from featherfx.shot.contact.skin_binding import NEAR, SkinBeneath, surfaces_under
from featherfx.shot.layers.types import Array, Indices, SkinBelow, Vanes
from featherfx.shot.skin import BoundSkin
from featherfx.shot.sources import TimedSurface


class GroundBeneath(NamedTuple):
    """The surfaces of a skin, and what nodes keep of them."""

    skins: list[SkinBeneath]
    ground: SkinBelow

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
        height = np.full(shape, -np.inf)
        height[own] = beneath.height
        lack = _between(surface, vanes, rest, height)
        clear = np.where(lack > 0.0, np.maximum(clear, height + lack), clear)
        triangle[own] = np.where(over, beneath.triangle + faces, -1)
        skins.append(beneath)
        triangles.append(beneath.mesh.triangles + points)
        beside.append(np.where(beneath.mesh.beside < 0, -1, beneath.mesh.beside + faces))
        faces, points = faces + len(beneath.mesh.triangles), points + len(surface.surface.rest)
    joined = np.concatenate(triangles), np.concatenate(beside)
    return GroundBeneath(skins, SkinBelow(triangle, clear, *joined))


def _between(surface: TimedSurface, vanes: Vanes, rest: Array, height: Array) -> Array:
    """(F, n, 2 m + 1) m, by how much nodes that are above a skin at rest have to rise so that it
    does not pass through the middles of their edges along the shaft and the barbs. height: m, of
    nodes; -inf: not looked at."""
    lack = np.zeros(height.shape)
    size = np.broadcast_to(vanes.row.sum(axis=1)[:, None, None], height.shape)
    for ends in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:, :, :-1], np.s_[:, :, 1:])):
        one, other = ends
        way = np.linalg.norm(rest[other] - rest[one], axis=-1)
        low = np.minimum(height[one], height[other])
        near = (low >= 0.0) & (low < 0.5 * way)
        if not near.any():
            continue
        beneath = SkinBeneath(surface, 0.5 * (rest[one] + rest[other])[near]).height
        through = (beneath < 0.0) & (beneath > -NEAR * size[one][near])
        own = np.zeros(low.shape)
        own[near] = np.where(through, -beneath, 0.0)
        for end in ends:
            lack[end] = np.maximum(lack[end], own)
    return np.where(lack > 0.0, lack + vanes.half[:, None, None], 0.0)
