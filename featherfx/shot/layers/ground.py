"""The skin beneath the feathers: which triangle each node is over at rest, and how high."""

from __future__ import annotations

import numpy as np

from featherfx.groom.skin.search import search_tree
from featherfx.shot.layers.lap_kernels import bind_nodes
from featherfx.shot.layers.types import Array, Ground, Indices, Vanes
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.read.sources import MovingSurface
from featherfx.solver.contact.wall import outward

# distance, over a feather's length, from which on a node is not held off the skin
NEAR = 0.3


class SkinBeneath:
    """One surface of a skin, under the feathers that grow on it.

    members: numbers of those. rest: (F, n, 2 m + 1, 3) m, nodes of all feathers at rest.
    """

    def __init__(
        self, surface: MovingSurface, start: float, members: Indices, vanes: Vanes, rest: Array
    ) -> None:
        self._surface, self._start = surface, start
        triangles = outward(surface.triangles, surface.rest).astype(np.int64)
        own = np.zeros(vanes.present.shape, dtype=bool)
        own[members] = vanes.present[members] != 0
        nodes, skin = rest[own], np.ascontiguousarray(surface.rest, dtype=np.float64)
        triangle = search_tree(skin[triangles].mean(axis=1)).query(nodes)[1].astype(np.int64)
        shape, height = own.shape, np.zeros(len(nodes))
        ground = Ground(np.full(shape, -1), np.zeros(shape), triangles, _beside(triangles))
        bind_nodes(nodes, skin, ground, triangle, height)
        feather = np.nonzero(own)[0]
        over = np.abs(height) < NEAR * vanes.row.sum(axis=1)[feather]
        ground.clear[own] = np.minimum(height, vanes.half[feather])
        ground.triangle[own] = np.where(over, triangle, -1)
        self.ground = ground

    def points(self, time: float) -> Array:
        """(V, 3) m, at a time in s since the first frame."""
        code = self._start + time * self._surface.time_codes_per_second
        return np.ascontiguousarray(self._surface.points(code), dtype=np.float64)


def skins_beneath(skin: BoundSkin, some: Indices, vanes: Vanes, rest: Array) -> list[SkinBeneath]:
    """The surfaces of a skin. some: numbers of the feathers that vanes and rest are of, ascending;
    rest: (F, n, 2 m + 1, 3) m, nodes at rest."""
    members: dict[int, list[Indices]] = {}
    surfaces = {id(part.surface): part.surface for part in skin.parts}
    for part in skin.parts:
        own = np.flatnonzero(np.isin(some, part.members))
        members.setdefault(id(part.surface), []).append(own)
    return [
        SkinBeneath(surface, skin.start, own, vanes, rest)
        for key, surface in surfaces.items()
        if len(own := np.concatenate(members[key]))
    ]


def _beside(triangles: Indices) -> Indices:
    """(T, 3) triangles across the edges opposite each corner, -1 where there is none."""
    count = len(triangles)
    edges = np.concatenate([triangles[:, [(k + 1) % 3, (k + 2) % 3]] for k in range(3)])
    edges = np.sort(edges, axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order][1:] == edges[order][:-1]).all(axis=1)
    first, second = order[:-1][same], order[1:][same]
    found = np.full(3 * count, -1, dtype=np.int64)
    found[first], found[second] = second % count, first % count
    return np.ascontiguousarray(found.reshape(3, count).T)
