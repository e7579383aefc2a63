"""Leaves of feathers on a skin: where their nodes are over it at rest, and poses drawn there."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.coat.carrier import CoatMesh, make_mesh
from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.files.background import limit_threads
from featherfx.groom.skin.skin import closest, crushed, may_be_crushed
from featherfx.groom.types import Placement
from featherfx.shot.coat import leaf_kernels as kernels
from featherfx.shot.frames import place
from featherfx.shot.roots import RootFrames
from featherfx.shot.sources import TimedSurface

# of its length, height of a feather's nodes over the skin up to which it is on a leaf
MAX_HEIGHT_RATIO = 0.3
# cosine of the angle between a feather's dorsal side and the skin's normal, at least, on a leaf
_MIN_FACING = 0.5
# of the diagonal of the skin's box, reach of the smoothing of the skin that images stand on
_REACH_RATIO = 0.008
# of the time between two samples, by which the times are apart from which rates are found
_STEP_RATIO = 0.02


class Feet(NamedTuple):
    """Feet of F feathers' nodes. triangle: (F, n, 1 + 2 m) of the skin. weight: (F, n, 1 + 2 m, 2)
    of its second and third corner. height: (F, n, 1 + 2 m) m over it."""

    triangle: NDArray[np.int32]
    weight: NDArray[np.float32]
    height: NDArray[np.float32]

    def some(self, chosen: Flags) -> Feet:
        """Those of some feathers, (F,)."""
        return Feet(self.triangle[chosen], self.weight[chosen], self.height[chosen])


class DrawnRachis(NamedTuple):
    """A feather over a skin. image: (n, 1 + 2 m, 3) m, of its nodes. up: (n, 3) normals at the
    rachis. rachis: (n, 3) m, in its own lengths. row: (n,) image before each row, and part: (n,)
    how far on to the next one it is."""

    image: Array
    up: Array
    rachis: Array
    row: Indices
    part: Array


class Room(NamedTuple):
    """Scratch memory of one thread: a feather's nodes, directors and root at one time, and what was
    drawn at three times."""

    drawn: DrawnRachis
    nodes: Array
    directors: Array
    root: Array
    made: Array
    turned: Array


class SkinLeaves:
    """Feathers on leaves of one surface.

    members: (K,) their numbers in the groom, ascending. placements, drawn: of the feathers that may
    be, given: (F,) their numbers.
    """

    def __init__(
        self,
        surface: TimedSurface,
        placements: Sequence[Placement],
        drawn: Sequence[Feather],
        given: Indices,
    ) -> None:
        self._surface = surface
        lengths = np.array([feather.station[-1] for feather in drawn])
        rest, faces = surface.surface.rest, surface.surface.triangles
        self._mesh = make_mesh(
            rest, faces, _REACH_RATIO * float(np.linalg.norm(np.ptp(rest, axis=0)))
        )
        points, normals = self._carrier(rest)
        local = stacked([feather.rest for feather in drawn]).nodes
        nodes = stacked(
            [
                place(feather.rest, own.position, own.rotation)
                for feather, own in zip(drawn, placements, strict=True)
            ]
        ).nodes
        feet, found = _feet_of(nodes, points, normals, self._mesh)
        dorsal = np.array([own.rotation[:, 2] for own in placements]).reshape(-1, 3)
        found &= _lies(feet, lengths, dorsal, normals, self._mesh)
        self.members: Indices = given[found]
        self._feet, self._rest = feet.some(found), np.ascontiguousarray(local[found])
        self._rows, self._width = local.shape[1:3]
        rotations = np.array([own.rotation for own in placements]).reshape(-1, 3, 3)[found]
        self._turns = np.empty((len(rotations), self._rows, 3, 3))
        skin = points, normals, self._mesh.faces
        room = self._room().drawn
        kernels.find_rest_turns(self._feet, skin, self._rest, rotations, room, self._turns)

    def follow(
        self,
        given: Sequence[RowPoints],
        roots: Sequence[RootFrames],
        span: tuple[float, float],
        jobs: int,
    ) -> Sequence[RowPoints]:
        """Poses of the members on their leaves at a time, with their rates.

        given: points of the members, as they would be on roots that the skin carries rigidly, and
        their two rates; roots: those, and their two rates. span: s, time of the sample before, and
        the time. jobs: threads. Where faces below a leaf collapse, its feather passes to the given
        points.
        """
        start, end = span
        step = _STEP_RATIO * (end - start)
        times = [end - q * step for q in range(3 if step > 0.0 else 1)]
        skin = [self._surface.points(time) for time in times]
        carriers = [self._carrier(each) for each in skin]
        points, normals = (np.stack(each) for each in zip(*carriers, strict=True))
        skins, own = (points, normals, self._mesh.faces), (self._rest, self._turns)
        nodes, directors = (
            tuple(np.ascontiguousarray(each[k]) for each in given) for k in range(2)
        )
        share = self._share(skin[0])
        before = [] if share is None else [each.copy() for each in (*nodes, *directors)]
        turns = tuple(np.ascontiguousarray(each.rotations) for each in roots)

        def draw(part: tuple[int, int]) -> None:
            kernels.follow_skin(
                self._feet, own, skins, (nodes, directors), turns, step, self._room(), part
            )

        threads = limit_threads(jobs)
        parts = pairwise(np.linspace(0, len(self.members), threads + 1).astype(int).tolist())
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(draw, parts))
        if share is not None:
            for now, then in zip((*nodes, *directors), before, strict=True):
                part = share.reshape(-1, *[1] * (now.ndim - 1))
                now[...] = part * now + (1.0 - part) * then
        return [RowPoints(*each) for each in zip(nodes, directors, strict=True)]

    def _share(self, points: Array) -> Array | None:
        """(K,) of feathers that their leaves draw on a skin with points (V, 3) m; None: all."""
        triangles = self._surface.surface.triangles
        corners = points[triangles]
        if not may_be_crushed(corners):
            return None
        sound = crushed(corners, self._surface.surface.rest[triangles])
        return np.asarray(sound[self._feet.triangle].min(axis=(1, 2)))

    def _carrier(self, points: Array) -> tuple[Array, Array]:
        """Points and normals (V, 3) of a skin (V, 3) m that is smoothed (coat/carrier.py)."""
        soft = self._mesh.smooth(self._mesh.masses[:, None] * points)
        normals = np.empty_like(soft)
        kernels.average_normals(soft, self._mesh.faces, normals)
        return soft, normals

    def _room(self) -> Room:
        rows, width = self._rows, self._width
        drawn = DrawnRachis(
            image=np.empty((rows, width, 3)),
            up=np.empty((rows, 3)),
            rachis=np.empty((rows, 3)),
            row=np.zeros(rows, dtype=np.int64),
            part=np.empty(rows),
        )
        return Room(
            drawn=drawn,
            nodes=np.empty((rows, width, 3)),
            directors=np.empty((rows, 2, 3)),
            root=np.empty((3, 3)),
            made=np.empty((3, rows, width, 3)),
            turned=np.empty((3, rows, 2, 3)),
        )


def _feet_of(nodes: Array, points: Array, normals: Array, mesh: CoatMesh) -> tuple[Feet, Flags]:
    """Feet of nodes (F, n, 1 + 2 m, 3) m, and (F,) of which feathers all nodes have one."""
    shape = nodes.shape[:3]
    feet = Feet(
        np.empty(shape, dtype=np.int32),
        np.empty((*shape, 2), dtype=np.float32),
        np.empty(shape, dtype=np.float32),
    )
    found = np.zeros(len(nodes), dtype=np.int64)
    if len(nodes):
        starts, _ = closest(np.ascontiguousarray(nodes[:, 0, 0]), points[mesh.faces])
        skin = points, normals, mesh.faces, mesh.neighbours
        kernels.find_feet(nodes, starts, skin, feet, found)
    return feet, found == 1


def _lies(feet: Feet, lengths: Array, dorsal: Array, normals: Array, mesh: CoatMesh) -> Flags:
    """(F,) which feathers lie on the skin, face up."""
    height = np.abs(feet.height).max(axis=(1, 2))
    up = normals[mesh.faces[feet.triangle[:, 0, 0], 0]]
    facing = np.einsum("fk,fk->f", up, dorsal)
    return np.asarray((height < MAX_HEIGHT_RATIO * lengths) & (facing > _MIN_FACING))
