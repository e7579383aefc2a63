"""The skin under feathers: which of its triangles points are over at rest, and where it is."""

from __future__ import annotations

from typing import Any

import numpy as np

from featherfx.files.disk_cache import kept
from featherfx.groom.skin.field import search_tree
from featherfx.jit.compiled import KernelModule
from featherfx.shot.roots import NO_RUN_UP, RunUp
from featherfx.shot.skin import BoundSkin
from featherfx.shot.sources import TimedSurface
from featherfx.solver.contact.types import Array, Indices, SkinMesh

ground_kernels = KernelModule("featherfx.solver.contact.ground_kernels")

# distance at rest, over a feather's length, from which on a node is not held off the skin
NEAR = 0.3
# triangles among which one that faces as asked for is looked for
MAX_NEAR = 16


class SkinBeneath:
    """One surface of a skin under points (N, 3) m of feathers that grow on it, at rest.

    mesh: its triangles, seen from outside. triangle: (N,) that each point is over; height: (N,) m,
    of the point over it. up: (N, 3), where the triangle has to face, 0 where that is all one: a
    point may be nearer to the middle of one on the other side of something thin.
    """

    def __init__(self, surface: TimedSurface, points: Array, up: Array | None = None) -> None:
        self._surface, rest = surface, np.ascontiguousarray(surface.surface.rest, dtype=np.float64)
        given = surface.surface.triangles
        up = np.zeros((1, 3)) if up is None else up
        found = kept("beneath", [rest, given, points, up], lambda: _over(rest, given, points, up))
        self.mesh = SkinMesh(found["triangles"], found["beside"])
        self.triangle, self.height = found["triangle"], found["height"]

    def points(self, time: float) -> Array:
        """(V, 3) m, at a time in s since the first frame."""
        return np.ascontiguousarray(self._surface.points(time), dtype=np.float64)


def surfaces_under(
    skin: BoundSkin, some: Indices, run_up: RunUp = NO_RUN_UP
) -> list[tuple[TimedSurface, Indices]]:
    """The surfaces of a skin, and which of some feathers (F,), by their places in it, grow on
    each; those on which none does are left out. run_up: of the surfaces."""
    members: dict[int, list[Indices]] = {}
    for part in skin.parts:
        own = np.flatnonzero(np.isin(some, part.members))
        members.setdefault(id(part.surface), []).append(own)
    surfaces = {id(part.surface): part.surface for part in skin.parts}
    return [
        (TimedSurface(surface, skin.clock, run_up), own)
        for key, surface in surfaces.items()
        if len(own := np.concatenate(members[key]))
    ]


def _over(rest: Array, given: Indices, points: Array, up: Array) -> dict[str, Any]:
    mesh = connect_skin(given)
    triangles = mesh.triangles
    tree = search_tree(rest[triangles].mean(axis=1))
    triangle, height = tree.query(points)[1].astype(np.int64), np.zeros(len(points))
    facing = np.flatnonzero(np.broadcast_to(up.any(axis=1), len(points)))
    if len(facing):
        near = tree.query(points[facing], k=min(MAX_NEAR, len(triangles)))[1]
        near = near.reshape(len(facing), -1).astype(np.int64)
        a, b, c = (rest[triangles[near, k]] for k in range(3))
        fits = np.einsum("pik,pk->pi", np.cross(b - a, c - a), up[facing]) > 0.0
        triangle[facing] = near[np.arange(len(facing)), fits.argmax(axis=1)]
    ground_kernels.bind_nodes(points, rest, mesh, triangle, height)
    return {**mesh._asdict(), "triangle": triangle, "height": height}


def connect_skin(triangles: Indices) -> SkinMesh:
    """Triangles (T, 3) of a skin with those across their edges."""
    own = np.ascontiguousarray(triangles, dtype=np.int64)
    return SkinMesh(own, _beside(own))


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
