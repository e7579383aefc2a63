"""Pairs of feathers that may overlap at rest, and triangles of vanes that pass through others.

For overlaps feathers are strips about their shafts: what is found may meet, what is left out
cannot. Vanes may pass through other vanes, or through a body.

Meshes are cut into patches of few triangles that lie together; boxes around a mesh's patches, then
around patches, then around triangles, say which are compared. Threads share the work, and do not
change the counts.

Two triangles cross where each has corners strictly on both sides of the other's plane and an edge
of one whose ends are so meets the other, its rim included. What only touches, with a corner, an
edge or in a plane, does not cross. The side of a plane on which a point lies is the sign of

    orient(a, b, c, d) = (b - a) x (c - a) . (d - a),

0 where the determinant is within the rounding of its own evaluation (Shewchuk 1997, bound A): then
the point counts as in the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vector_kernels import sub
from featherfx.algebra.vectors import dots
from featherfx.groom.course import shaft, turn
from featherfx.groom.skin.field import search_tree
from featherfx.groom.types import Placement, RachisShape
from featherfx.jit.compiled import kernel

# cosine of the angle between two dorsal sides from which on feathers do not count as layered
_MIN_FACING = 0.5


@dataclass(frozen=True)
class Strips:
    """F feathers as straight strips.

    root: (F, 3) m. shaft: (F, 3) m, root to tip. dorsal: (F, 3) unit. reach: (F,) m, how far the
    vanes go from the straight line to the tip.
    """

    root: Array
    shaft: Array
    dorsal: Array
    reach: Array


def _ends(shapes: Sequence[RachisShape]) -> tuple[Array, Array]:
    """(F, 3) mean tangents of shafts, root to tip, and (F,) how far they leave the line to their
    end, in lengths."""
    total = np.radians([(s.twist, s.camber, -s.sweep) for s in shapes]).reshape(-1, 3)
    _, straight = turn(total)
    # an arc leaves the line to its end by an eighth of its turning
    bow = 0.125 * np.linalg.norm(total[:, 1:], axis=1)
    along = np.linspace(0.0, 1.0, 33)
    for k, shape in enumerate(shapes):
        if shape.course:
            mean = shaft(shape, along)[1]
            straight[k] = mean[-1]
            bow[k] = np.linalg.norm(along[:, None] * (mean - mean[-1]), axis=1).max()
    return straight, bow


def strips_of(placements: Sequence[Placement]) -> Strips:
    """The feathers of a groom as strips."""
    kinds = [p.kind for p in placements]
    outlines = [k.leading.outline + k.trailing.outline for k in kinds]
    widest = [max((y for _, y in outline), default=0.0) for outline in outlines]
    straight, bow = _ends([k.rachis for k in kinds])
    straight[:, 1] *= [-1.0 if p.mirrored else 1.0 for p in placements]
    length = np.array([k.length for k in kinds])
    rotation = np.array([p.rotation for p in placements]).reshape(-1, 3, 3)
    return Strips(
        root=np.array([p.position for p in placements]).reshape(-1, 3),
        shaft=length[:, None] * np.einsum("fij,fj->fi", rotation, straight),
        dorsal=rotation[:, :, 2],
        reach=length * (np.array(widest) + bow),
    )


def near_pairs(strips: Strips) -> Indices:
    """(K, 2) feathers that may meet, in no order of theirs.

    Neighbours come from search trees by classes of length, so that the work grows with the number
    of pairs.
    """
    pairs = _near(strips)
    first, second = pairs.T
    cosine = dots(strips.dorsal[first], strips.dorsal[second])
    pairs = pairs[cosine > _MIN_FACING]
    first, second = pairs.T
    shaft = strips.shaft
    distance = segment_distance(
        strips.root[first], shaft[first], strips.root[second], shaft[second]
    )
    return np.asarray(pairs[distance <= strips.reach[first] + strips.reach[second]])


def _near(strips: Strips) -> Indices:
    """(K, 2) pairs, the smaller number first, whose bounding spheres meet."""
    middle = strips.root + 0.5 * strips.shaft
    radius = 0.5 * np.linalg.norm(strips.shaft, axis=1) + strips.reach
    sizes = np.floor(2.0 * np.log2(radius))
    members = [np.flatnonzero(sizes == size) for size in np.unique(sizes)]
    trees = [search_tree(middle[each]) for each in members]
    found = [np.zeros((0, 2), dtype=np.int64)]
    for i, larger in enumerate(members):
        for j, smaller in enumerate(members[: i + 1]):
            reach = float(radius[larger].max() + radius[smaller].max())
            near = trees[i].sparse_distance_matrix(trees[j], reach, output_type="ndarray")
            a, b = larger[near["i"]], smaller[near["j"]]
            kept = (near["v"] <= radius[a] + radius[b]) & ((i != j) | (a < b))
            found.append(np.sort(np.stack([a[kept], b[kept]], axis=1), axis=1))
    return np.concatenate(found)


def segment_distance(first: Array, along: Array, second: Array, across: Array) -> Array:
    """(K,) distance of segments from first to first + along and from second to second + across."""

    gap = first - second
    aa, bb, ab = dots(along, along), dots(across, across), dots(along, across)
    ag, bg = dots(along, gap), dots(across, gap)
    determinant = aa * bb - ab * ab
    slanted = determinant > 1e-12 * aa * bb
    s = np.where(slanted, (ab * bg - bb * ag) / np.where(slanted, determinant, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((ab * s + bg) / bb, 0.0, 1.0)
    s = np.clip((ab * t - ag) / aa, 0.0, 1.0)
    apart = gap + s[:, None] * along - t[:, None] * across
    return np.sqrt(dots(apart, apart))


# over the sum of the moduli of a determinant's terms
_FLAT_TOLERANCE = 1e-15


@kernel
def orient(a, b, c, d):
    """1 where d is on the side of (b - a) x (c - a), -1 on the other, 0 in the plane of a, b, c."""
    u, v, w = sub(b, a), sub(c, a), sub(d, a)
    first, second = u[1] * v[2], u[2] * v[1]
    third, fourth = u[2] * v[0], u[0] * v[2]
    fifth, sixth = u[0] * v[1], u[1] * v[0]
    value = (first - second) * w[0] + (third - fourth) * w[1] + (fifth - sixth) * w[2]
    size = (abs(first) + abs(second)) * abs(w[0]) + (abs(third) + abs(fourth)) * abs(w[1])
    size += (abs(fifth) + abs(sixth)) * abs(w[2])
    if abs(value) <= _FLAT_TOLERANCE * size:
        return 0
    return 1 if value > 0.0 else -1


@kernel
def _pierces(p, q, a, b, c):
    """Return whether a line through p and q, on either side of a triangle's plane, meets the
    triangle."""
    first, second, third = orient(p, q, a, b), orient(p, q, b, c), orient(p, q, c, a)
    above = first >= 0 and second >= 0 and third >= 0
    return above or (first <= 0 and second <= 0 and third <= 0)


@kernel
def _any_edge(p, sides, q):
    """Return whether an edge of triangle p pierces triangle q. sides: of q's plane, of p's
    corners."""
    for k in range(3):
        after = (k + 1) % 3
        if sides[k] * sides[after] < 0 and _pierces(p[k], p[after], q[0], q[1], q[2]):
            return True
    return False


@kernel
def triangles_cross(p, q):
    """Return whether two triangles, three points each, intersect."""
    a, b, c = orient(*q, p[0]), orient(*q, p[1]), orient(*q, p[2])
    if min(a, min(b, c)) >= 0 or max(a, max(b, c)) <= 0:
        return False
    d, e, f = orient(*p, q[0]), orient(*p, q[1]), orient(*p, q[2])
    if min(d, min(e, f)) >= 0 or max(d, max(e, f)) <= 0:
        return False
    return _any_edge(p, (a, b, c), q) or _any_edge(q, (d, e, f), p)


@kernel
def _corners(points, triangle):
    a, b, c = points[triangle[0]], points[triangle[1]], points[triangle[2]]
    return (a[0], a[1], a[2]), (b[0], b[1], b[2]), (c[0], c[1], c[2])


@kernel
def fit_boxes(points, patches, boxes, bounds, low, high):
    """Boxes (T, 6) of the triangles, and bounds (P, 6) of the patches from low to high - 1."""
    for patch in range(low, high):
        for k in range(3):
            bounds[patch, k], bounds[patch, 3 + k] = 1e300, -1e300
        for t in range(patches.first[patch], patches.first[patch + 1]):
            p, q, r = _corners(points, patches.triangles[t])
            for k in range(3):
                boxes[t, k] = min(p[k], min(q[k], r[k]))
                boxes[t, 3 + k] = max(p[k], max(q[k], r[k]))
                bounds[patch, k] = min(bounds[patch, k], boxes[t, k])
                bounds[patch, 3 + k] = max(bounds[patch, 3 + k], boxes[t, 3 + k])


@kernel
def _meet(first, second):
    """Return whether two boxes (6,) have a point in common."""
    for k in range(3):
        least, greatest = max(first[k], second[k]), min(first[3 + k], second[3 + k])
        if least > greatest:
            return False
    return True


@kernel
def near_patches(order, axis, clusters, bounds, low, high, found):
    """Pairs of patches of different owners whose bounds meet; returns how many there are.

    order: (C,) clusters by the least coordinate along an axis; those from low to high - 1 are
    paired with all behind them. found: (K, 2), written as far as there is room.
    """
    count, around, starts = 0, clusters.around, clusters.first
    for place in range(low, high):
        first = order[place]
        for other in range(place + 1, order.shape[0]):
            second = order[other]
            if around[second, axis] > around[first, 3 + axis]:
                break
            if clusters.owner[first] == clusters.owner[second]:
                continue
            if not _meet(around[first], around[second]):
                continue
            for p in range(starts[first], starts[first + 1]):
                if not _meet(bounds[p], around[second]):
                    continue
                for q in range(starts[second], starts[second + 1]):
                    if _meet(bounds[p], bounds[q]):
                        if count < found.shape[0]:
                            found[count, 0], found[count, 1] = p, q
                        count += 1
    return count


@kernel
def _common(first, second, low, high):
    """Corners low and high (3,) of what two boxes (6,) have in common."""
    for k in range(3):
        low[k], high[k] = max(first[k], second[k]), min(first[3 + k], second[3 + k])


@kernel
def _chosen(boxes, start, end, low, high):
    """Bits, from 0, of the boxes from start to end - 1 that meet the one from low to high."""
    bits = 0
    for t in range(start, end):
        apart = False
        for k in range(3):
            apart = apart or boxes[t, k] > high[k] or boxes[t, 3 + k] < low[k]
        if not apart:
            bits |= 1 << (t - start)
    return bits


@kernel
def crossings_between(points, patches, boxes, bounds, pairs, span, corners, counts):
    """Triangles that cross, of the pairs of patches in a span (first, last + 1).

    boxes, bounds: of fit_boxes. corners: (2, 3), overwritten. counts: (K, 2), by pair: those
    between vanes, and those of which one at least is of a rachis. A patch has 63 triangles at most.
    """
    for k in range(span[0], span[1]):
        first, second = pairs[k, 0], pairs[k, 1]
        counts[k, 0] = counts[k, 1] = 0
        # only triangles where both patches are may meet
        _common(bounds[first], bounds[second], corners[0], corners[1])
        start, end = patches.first[first], patches.first[first + 1]
        other = patches.first[second], patches.first[second + 1]
        mine = _chosen(boxes, start, end, corners[0], corners[1])
        others = _chosen(boxes, other[0], other[1], corners[0], corners[1])
        if mine == 0 or others == 0:
            continue
        for t in range(start, end):
            if not mine >> (t - start) & 1:
                continue
            p = _corners(points, patches.triangles[t])
            for s in range(other[0], other[1]):
                if not others >> (s - other[0]) & 1 or not _meet(boxes[t], boxes[s]):
                    continue
                if triangles_cross(p, _corners(points, patches.triangles[s])):
                    rachis = patches.rachis[t] or patches.rachis[s]
                    counts[k, 1 if rachis else 0] += 1


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
    box."""

    first: Indices
    owner: Indices
    around: Array


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


def find_intersections(points: Array, patches: TrianglePatches, jobs: int = 1) -> Intersections:
    """Crossings of all meshes. points: (V, 3) m or any unit, of all of them."""
    pairs, counts, _ = _crossed_patches(points, patches, jobs)
    owners = np.sort(patches.owner[pairs], axis=1)
    each, place = np.unique(owners, axis=0, return_inverse=True)
    vanes, rachises = (
        np.bincount(place.ravel(), counts[:, k], len(each)).astype(np.int64) for k in (0, 1)
    )
    return Intersections(each.reshape(-1, 2), vanes, rachises)


def crossed_triangles(points: Array, patches: TrianglePatches) -> Flags:
    """(T,) whether each triangle of the patches, in their order, passes through one of another
    mesh, neither of them of a rachis. points: as of find_intersections."""
    near, counts, boxes = _crossed_patches(points, patches, 1)
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
    points: Array, patches: TrianglePatches, jobs: int
) -> tuple[Indices, Indices, Array]:
    """(K, 2) patches of different owners that cross, (K, 2) how often, as of crossings_between, and
    boxes (T, 6) of all triangles."""
    count = len(patches.owner)
    boxes, bounds = np.empty((len(patches.triangles), 6)), np.empty((count, 6))
    with ThreadPoolExecutor(jobs) as pool:
        _in_pieces(pool, count, jobs, lambda a, b: fit_boxes(points, patches, boxes, bounds, a, b))
        clusters = _clusters(patches.owner, bounds)
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


def _clusters(owner: Indices, bounds: Array) -> PatchClusters:
    """Patches of one owner that follow each other, a few at a time."""
    begin = np.flatnonzero(np.diff(owner, prepend=owner[0] - 1))
    within = np.arange(len(owner)) - np.repeat(begin, np.diff(begin, append=len(owner)))
    first = np.flatnonzero(within % _CLUSTER_SIZE == 0)
    around = np.concatenate(
        [np.minimum.reduceat(bounds[:, :3], first), np.maximum.reduceat(bounds[:, 3:], first)],
        axis=1,
    )
    return PatchClusters(np.append(first, len(owner)), owner[first], around)


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
