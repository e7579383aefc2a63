"""Triangles of vanes that pass through other vanes, or through a body.

Meshes are cut into patches of few triangles that lie together; boxes around a mesh's patches, then
around patches, then around triangles, say which are compared. Threads share the work, and do not
change the counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.feather.crossing_kernels import crossings_between, fit_boxes, near_patches

# triangles of a patch (63 is what the kernel can take) and patches of a cluster at most; pieces of
# work for each thread, few at a time in memory
_PATCH_SIZE, _CLUSTER_SIZE, _PIECES = 48, 16, 16
# number of the body among the owners; feathers count from 0
BODY = -1


class TrianglePatches(NamedTuple):
    """T triangles in P patches. triangles: (T, 3) points; rachis: (T,) whether it is of a rachis;
    first: (P + 1,) first triangle of each patch; owner: (P,) feather, or BODY."""

    triangles: Indices
    rachis: Flags
    first: Indices
    owner: Indices


class PatchClusters(NamedTuple):
    """C runs of patches of one owner each. first: (C + 1,) first patch, owner: (C,), around: (C, 6)
    box, asked: (C,) whether its crossings are asked for."""

    first: Indices
    owner: Indices
    around: Array
    asked: Flags


class Intersections(NamedTuple):
    """Intersections in one frame. owners: (K, 2) feathers that cross, the lower number first, BODY
    for the body. vanes, rachises: (K,) pairs of triangles that do, both of vanes, or one at least
    of a rachis."""

    owners: Indices
    vanes: Indices
    rachises: Indices

    @property
    def total(self) -> int:
        """All triangles that cross."""
        return int(self.vanes.sum() + self.rachises.sum())


def make_patches(meshes: Sequence[tuple[Array, Indices, Flags, int]]) -> TrianglePatches:
    """Patches of meshes: points (V, 3), triangles (T, 3), rachis (T,) and owner of each; points
    are counted on through all meshes."""
    triangles, rachises, sizes, owners = [], [], [], []
    offset, cuts = 0, dict[bytes, list[Indices]]()
    for points, corners, rachis, owner in meshes:
        # what is faced alike is cut alike
        key = corners.tobytes()
        if key not in cuts:
            cuts[key] = list(_cut(points[corners].mean(axis=1), np.arange(len(corners))))
        for part in cuts[key]:
            triangles.append(corners[part] + offset)
            rachises.append(rachis[part])
            sizes.append(len(part))
            owners.append(owner)
        offset += len(points)
    return TrianglePatches(
        np.ascontiguousarray(np.concatenate(triangles), dtype=np.int64),
        np.concatenate(rachises),
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.array(owners, dtype=np.int64),
    )


def _cut(middles: Array, some: Indices) -> Iterator[Indices]:
    """Triangles in halves along their longest extent, until few are left."""
    if len(some) <= _PATCH_SIZE:
        if len(some):
            yield some
        return
    own = middles[some]
    order = np.argsort(own[:, np.ptp(own, axis=0).argmax()], kind="stable")
    for half in np.array_split(some[order], 2):
        yield from _cut(middles, half)


def find_intersections(
    points: Array, patches: TrianglePatches, jobs: int = 1, asked: Flags | None = None
) -> Intersections:
    """Crossings of all meshes. points: (V, 3) m or any unit, of all of them. asked: (F,) feathers
    with which others' crossings are looked for; None: all."""
    pairs, counts, _ = _crossed_patches(points, patches, jobs, asked)
    owners = np.sort(patches.owner[pairs], axis=1)
    each, place = np.unique(owners, axis=0, return_inverse=True)
    vanes, rachises = (
        np.bincount(place.ravel(), counts[:, k], len(each)).astype(np.int64) for k in (0, 1)
    )
    return Intersections(each.reshape(-1, 2), vanes, rachises)


def crossed_triangles(points: Array, patches: TrianglePatches) -> Flags:
    """(T,) whether each triangle of the patches, in their order, passes through one of another
    mesh, neither of them of a rachis. points: as of find_intersections."""
    near, counts, boxes = _crossed_patches(points, patches, 1, None)
    count = len(patches.triangles)
    single = TrianglePatches(
        patches.triangles,
        patches.rachis,
        np.arange(count + 1),
        np.repeat(patches.owner, np.diff(patches.first)),
    )
    crossed = np.zeros(count, dtype=bool)
    for p, q in near[counts[:, 0] > 0].tolist():
        mine, others = (np.arange(*patches.first[[k, k + 1]]) for k in (p, q))
        one, other = boxes[mine, None], boxes[None, others]
        meet = (one[..., :3] <= other[..., 3:]) & (other[..., :3] <= one[..., 3:])
        first, second = np.nonzero(meet.all(axis=-1))
        pairs = np.stack([mine[first], others[second]], axis=1)
        found = np.zeros((len(pairs), 2), dtype=np.int64)
        span = (0, len(pairs))
        crossings_between(points, single, boxes, boxes, pairs, span, np.empty((2, 3)), found)
        crossed[pairs[found[:, 0] > 0]] = True
    return crossed


def _crossed_patches(
    points: Array, patches: TrianglePatches, jobs: int, asked: Flags | None
) -> tuple[Indices, Indices, Array]:
    """(K, 2) patches of different owners that cross, (K, 2) how often, as of crossings_between, and
    boxes (T, 6) of all triangles."""
    count = len(patches.owner)
    boxes, bounds = np.empty((len(patches.triangles), 6)), np.empty((count, 6))
    with ThreadPoolExecutor(jobs) as pool:
        _in_pieces(pool, count, jobs, lambda a, b: fit_boxes(points, patches, boxes, bounds, a, b))
        clusters = _clusters(patches.owner, bounds, asked)
        search = _search(bounds, clusters)

        def look(low: int, high: int) -> tuple[Indices, Indices]:
            pairs, corners = search(low, high), np.empty((2, 3))
            counts, span = np.zeros((len(pairs), 2), dtype=np.int64), (0, len(pairs))
            crossings_between(points, patches, boxes, bounds, pairs, span, corners, counts)
            crossed = np.flatnonzero(counts.any(axis=1))
            return pairs[crossed], counts[crossed]

        found = _in_pieces(pool, len(clusters.owner), jobs, look)
    pairs, counts = (np.concatenate(each) for each in zip(*found, strict=True))
    return pairs, counts, boxes


def _clusters(owner: Indices, bounds: Array, asked: Flags | None) -> PatchClusters:
    """Patches of one owner that follow each other, a few at a time."""
    begin = np.flatnonzero(np.diff(owner, prepend=owner[0] - 1))
    within = np.arange(len(owner)) - np.repeat(begin, np.diff(begin, append=len(owner)))
    first = np.flatnonzero(within % _CLUSTER_SIZE == 0)
    around = np.concatenate(
        [np.minimum.reduceat(bounds[:, :3], first), np.maximum.reduceat(bounds[:, 3:], first)],
        axis=1,
    )
    whose = owner[first]
    wanted = np.ones(len(first), dtype=np.bool_) if asked is None else asked[whose]
    return PatchClusters(np.append(first, len(owner)), whose, around, wanted)


def _search(bounds: Array, clusters: PatchClusters) -> Callable[[int, int], Indices]:
    """Find (K, 2) patches of different owners whose bounds meet, of a piece of the clusters, in an
    order of its own."""
    axis = int(np.ptp(clusters.around[:, :3], axis=0).argmax())
    order = np.argsort(clusters.around[:, axis], kind="stable")

    def search(low: int, high: int) -> Indices:
        found = np.empty((256 * (high - low) + 64, 2), dtype=np.int64)
        while True:
            count = int(near_patches(order, axis, clusters, bounds, low, high, found))
            if count <= len(found):
                return found[:count]
            found = np.empty((count, 2), dtype=np.int64)

    return search


def _in_pieces(
    pool: ThreadPoolExecutor, count: int, jobs: int, work: Callable[[int, int], Any]
) -> list[Any]:
    """Work on the numbers below a count, piece by piece; what it returned, in their order."""
    ends = np.linspace(0, count, _PIECES * jobs + 1).astype(int).tolist()
    return list(pool.map(work, ends[:-1], ends[1:]))
