"""Colliders, and the skin under the feathers: where their meshes are at both ends of a step.

Of the skin, points know which triangles they are over at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from featherfx.files.disk_cache import kept
from featherfx.groom.skin.field import search_tree
from featherfx.jit.compiled import KernelModule
from featherfx.shot.roots import NO_RUN_UP, RunUp
from featherfx.shot.skin import BoundSkin
from featherfx.shot.sources import TimedSurface
from featherfx.shot.types import Shot
from featherfx.solver.contact.surfaces import wall_of
from featherfx.solver.contact.types import Array, GroundSurface, Indices, SkinMesh, Wall
from featherfx.solver.state import State

wall_kernels = KernelModule("featherfx.solver.contact.wall_kernels")

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
    wall_kernels.bind_nodes(points, rest, mesh, triangle, height)
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


# times within a frame at which bodies are looked at, to tell whether they come near
_LOOKS = 5
# depth, over the longest feather's length, from which a node finds its way out of a body
DEPTH = 0.02


class FeathersOver(NamedTuple):
    """Feathers that may meet bodies. members: (B,) numbers in the groom. rest:
    (B, n, 1 + 2 m, 3) m, their nodes at rest, in the world. lengths: (B,) m. up: (B, 3), where the
    skin under a feather faces, 0 where only its nodes tell."""

    members: Indices
    rest: Array
    lengths: Array
    up: Array


class Bodies:
    """Meshes that feathers bump into.

    begun: whether the shot is under way; before, the points of vanes that are inside a body count
    as grown in and are left alone until they come out.
    """

    def __init__(self, shot: Shot, feathers: FeathersOver) -> None:
        longest = float(feathers.lengths.max())
        self._bodies = shot.colliders
        surfaces = [body.surface for body in shot.colliders]
        self._parts = [
            [
                (surface.triangles[own], is_open)
                for is_open in (False, True)
                if (own := surface.closed != is_open).any()
            ]
            for surface in surfaces
        ]
        self._depth = DEPTH * longest
        assert shot.contact is not None
        self._skins = _skins(shot, feathers) if shot.contact.skin else []
        self.count, self.begun = len(self._bodies) + len(self._skins), False

    def approach(self, states: Sequence[State], start: float, end: float, margin: float) -> bool:
        """Return whether a body that moves between start and end (s) comes near any feather at
        rest.

        margin: m, what counts as near. Told by boxes: never missed, at times said in vain. A skin
        counts by the roots on it.
        """
        if not self._bodies:
            return False
        nodes = [state.points.nodes for state in states]
        low = np.concatenate([each.min(axis=(1, 2)) for each in nodes]) - margin
        high = np.concatenate([each.max(axis=(1, 2)) for each in nodes]) + margin
        times = np.linspace(start, end, _LOOKS)
        for body in self._bodies:
            poses = np.stack([body.points(time) for time in times])
            if np.ptp(poses, axis=0).max(initial=0.0) == 0.0:
                continue
            near = (low <= poses.max(axis=(0, 1))) & (poses.min(axis=(0, 1)) <= high)
            if near.all(axis=1).any():
                return True
        return False

    def walls(
        self, states: Sequence[State], start: float, end: float, margin: float
    ) -> list[Wall | GroundSurface]:
        """The bodies from start to end, s since the first frame, for feathers in these states."""
        walls: list[Wall | GroundSurface] = [
            GroundSurface(
                _start_of(skin, start, end),
                _contiguous(skin.points(end)),
                *mesh,
                under,
                self._depth,
                int(not self.begun),
            )
            for skin, mesh, under in self._skins
        ]
        if not self._bodies:
            return walls
        fastest = max(float(np.abs(state.velocity.nodes).max()) for state in states)
        for body, parts in zip(self._bodies, self._parts, strict=True):
            cut = end > start and body.clock.begins(start)
            before, after = _start_of(body, start, end), body.points(end)
            own = float(np.abs(after - before).max(initial=0.0))
            way = np.sqrt(3.0) * (fastest * (end - start) + own)
            reach = margin + self._depth + float(way)
            # what a body lands on has grown into it as well
            grown_in = cut or not self.begun
            walls += [
                wall_of(before, after, own, reach, grown_in, is_open) for own, is_open in parts
            ]
        return walls


def _start_of(body: TimedSurface, start: float, end: float) -> Array:
    """(V, 3) m, where a body begins the way from start to end (s): at a cut, after it."""
    cut = end > start and body.clock.begins(start)
    return _contiguous(body.after(start) if cut else body.points(start))


def _contiguous(points: Array) -> Array:
    return np.ascontiguousarray(points, dtype=np.float64)


def _skins(shot: Shot, feathers: FeathersOver) -> list[tuple[TimedSurface, SkinMesh, Indices]]:
    """The surfaces of a shot's skin, and which triangle each node is over (Ground.under). Ribbons
    along bones are no bodies."""
    found = []
    if shot.skin is None:
        return []
    for surface, members in surfaces_under(shot.skin, feathers.members, shot.run_up):
        if surface.surface.bones is None:
            own = np.zeros(feathers.rest.shape[:3], dtype=bool)
            own[members] = feathers.rest[members].any(axis=3)
            feather = np.nonzero(own)[0]
            beneath = SkinBeneath(surface, feathers.rest[own], feathers.up[feather])
            under = np.full(own.shape, -1)
            near = np.abs(beneath.height) < NEAR * feathers.lengths[feather]
            under[own] = np.where(near, beneath.triangle, -1)
            found.append((surface, beneath.mesh, under))
    return found
