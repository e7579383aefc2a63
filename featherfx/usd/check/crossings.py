"""How many triangles of a cache's vanes pass through other vanes, or through a body.

A shaft counts as a line of its vane, as in contact: what its tube passes through is told apart.

Meshes are cut into patches of few triangles that lie together; boxes around patches, then around
triangles, say which are compared. Threads share the patches, and do not change the counts.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, InputWarning, Problem
from featherfx.feather.types import RACHIS
from featherfx.usd.check.crossing_kernels import crossings_between, fit_boxes, near_patches
from featherfx.usd.read.read import Cache
from featherfx.usd.read.resolve import located

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# triangles of a patch at most (63 is what the kernel can take); pieces of work for each thread
PATCH, PIECES = 48, 8
# pairs that are named
MOST_NAMED = 10
# number of the body among the owners; feathers count from 0
BODY = -1


class Patches(NamedTuple):
    """T triangles in P patches. triangles: (T, 3) points; shaft: (T,) whether it is of a shaft;
    first: (P + 1,) first triangle of each patch; owner: (P,) feather, or BODY."""

    triangles: Indices
    shaft: NDArray[np.bool_]
    first: Indices
    owner: Indices


class Crossings(NamedTuple):
    """Of one frame. owners: (K, 2) feathers that cross, the lower number first, BODY for the body.
    vanes, shafts: (K,) pairs of triangles that do, both of vanes, or one at least of a shaft."""

    owners: Indices
    vanes: Indices
    shafts: Indices

    @property
    def total(self) -> int:
        """All triangles that cross."""
        return int(self.vanes.sum() + self.shafts.sum())


def patches_of(meshes: Sequence[tuple[Array, Indices, NDArray[np.bool_], int]]) -> Patches:
    """Patches of meshes: points (V, 3), triangles (T, 3), shaft (T,) and owner of each; points
    are counted on through all meshes."""
    triangles, shafts, sizes, owners = [], [], [], []
    offset, cuts = 0, dict[bytes, list[Indices]]()
    for points, corners, shaft, owner in meshes:
        # what is faced alike is cut alike
        key = corners.tobytes()
        if key not in cuts:
            cuts[key] = list(_cut(points[corners].mean(axis=1), np.arange(len(corners))))
        for part in cuts[key]:
            triangles.append(corners[part] + offset)
            shafts.append(shaft[part])
            sizes.append(len(part))
            owners.append(owner)
        offset += len(points)
    return Patches(
        np.ascontiguousarray(np.concatenate(triangles), dtype=np.int64),
        np.concatenate(shafts),
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.array(owners, dtype=np.int64),
    )


def _cut(middles: Array, some: Indices) -> Iterator[Indices]:
    """Triangles in halves along their longest extent, until few are left."""
    if len(some) <= PATCH:
        if len(some):
            yield some
        return
    own = middles[some]
    order = np.argsort(own[:, np.ptp(own, axis=0).argmax()], kind="stable")
    for half in np.array_split(some[order], 2):
        yield from _cut(middles, half)


def crossings_of(points: Array, patches: Patches, jobs: int = 1) -> Crossings:
    """Crossings of all meshes. points: (V, 3) m or any unit, of all of them."""
    count = len(patches.owner)
    boxes, bounds = np.empty((len(patches.triangles), 6)), np.empty((count, 6))
    with ThreadPoolExecutor(jobs) as pool:
        _in_pieces(pool, count, jobs, lambda a, b: fit_boxes(points, patches, boxes, bounds, a, b))
        pairs = _near(pool, bounds, patches.owner, jobs)
        counts = np.zeros((len(pairs), 2), dtype=np.int64)

        def look(low: int, high: int) -> None:
            corners = np.empty((2, 3))
            crossings_between(points, patches, boxes, bounds, pairs, (low, high), corners, counts)

        _in_pieces(pool, len(pairs), jobs, look)
    crossed = np.flatnonzero(counts.any(axis=1))
    owners = np.sort(patches.owner[pairs[crossed]], axis=1)
    each, place = np.unique(owners, axis=0, return_inverse=True)
    vanes, shafts = (
        np.bincount(place.ravel(), counts[crossed, k], len(each)).astype(np.int64) for k in (0, 1)
    )
    return Crossings(each.reshape(-1, 2), vanes, shafts)


def _near(pool: ThreadPoolExecutor, bounds: Array, owner: Indices, jobs: int) -> Indices:
    """(K, 2) patches of different owners whose bounds meet."""
    order = np.argsort(bounds[:, 0], kind="stable")

    def search(low: int, high: int) -> Indices:
        found = np.empty((4 * (high - low) + 64, 2), dtype=np.int64)
        while (count := int(near_patches(order, bounds, owner, low, high, found))) > len(found):
            found = np.empty((count, 2), dtype=np.int64)
        return found[:count]

    return np.concatenate(_in_pieces(pool, len(order), jobs, search))


def _in_pieces(
    pool: ThreadPoolExecutor, count: int, jobs: int, work: Callable[[int, int], Any]
) -> list[Any]:
    """Work on the numbers below a count, piece by piece; what it returned, in their order."""
    ends = np.linspace(0, count, PIECES * jobs + 1).astype(int).tolist()
    return list(pool.map(work, ends[:-1], ends[1:]))


class _Scene(NamedTuple):
    """Meshes of a file. chosen: numbers of those. start, first: time code of the file at a time
    code of the cache; rate: time codes of the file in one of the cache."""

    cache: Cache
    chosen: Sequence[int]
    start: float = 0.0
    first: float = 0.0
    rate: float = 1.0

    def points(self, code: float | None) -> list[Array]:
        """(V, 3) m, of each mesh at a time code of the cache; None: at rest."""
        own = None if code is None else self.start + self.rate * (code - self.first)
        unit = self.cache.meters_per_unit
        return [unit * each for each in self.cache.points_of(self.chosen, own)]


def count_crossings(
    path: str | Path,
    frames: tuple[int, int] | None = None,
    *,
    jobs: int = 1,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[dict[str, Any]]:
    """Crossings of a cache, frame by frame: whole frames from the first to the last of `frames`.

    Meshes without a feather's id count as one body, and so does the skin that the cache names, if
    its file is there; a warning says if not. What each frame tells: `crossings` of triangles of
    vanes in so many `pairs`, of which `with_body`; `with_shafts`, of a shaft with a vane or shaft
    of another feather; and the `worst` pairs. on_frame: called with the frames done and their
    number. Raises InputError for files that hold no feather, and for frames
    that the cache does not have.
    """
    path = Path(path)
    cache = Cache(path)
    if not any(feather.is_feather for feather in cache.feathers):
        raise InputError(Problem(str(path), "", "holds no mesh with a feather's id"))
    scenes = [_Scene(cache, range(len(cache.feathers))), *_skins(cache, path)]
    codes = _chosen(cache, str(path), frames)
    patches = patches_of(list(_meshes(scenes, codes[0])))
    names = [feather.id for feather in cache.feathers]
    on_frame(0, len(codes))

    def read(code: float | None) -> Array:
        return np.concatenate([each for scene in scenes for each in scene.points(code)])

    # the next frame is read while one is looked at
    with ThreadPoolExecutor(1) as reader:
        following = reader.submit(read, codes[0])
        for done, code in enumerate(codes, 1):
            points = following.result()
            if done < len(codes):
                following = reader.submit(read, codes[done])
            found = crossings_of(points, patches, jobs)
            on_frame(done, len(codes))
            yield _told(found, names, code)


def _skins(cache: Cache, path: Path) -> Iterator[_Scene]:
    """The skins that a cache names."""
    for entry in cache.scenery:
        file = located(path.parent, entry["file"])
        if entry["role"] != "skin":
            continue
        chosen: list[int] = []
        if file.is_file():
            other = Cache(file)
            chosen = [k for k, each in enumerate(other.feathers) if each.path == entry["prim"]]
        if not chosen:
            message = f"{path}: its skin {entry['prim']} of {file} is not there and not looked at"
            warnings.warn(message, InputWarning, stacklevel=2)
            continue
        rate = other.frames_per_second / cache.frames_per_second
        yield _Scene(other, chosen, entry["start"], entry["first"], rate)


def _chosen(cache: Cache, path: str, frames: tuple[int, int] | None) -> Sequence[float | None]:
    """Time codes to look at; [None], the rest pose, where nothing moves."""
    if not cache.has_frames:
        if frames is not None:
            raise InputError(Problem(path, "frames", "has no frames; leave out --frames"))
        return [None]
    every = cache.whole_frames()
    if frames is None:
        return every
    first, last = frames
    if not every[0] <= first <= last <= every[-1]:
        message = f"{first}-{last} is out of range, allowed {every[0]:g} to {every[-1]:g}"
        raise InputError(Problem(path, "frames", message))
    return [float(code) for code in range(first, last + 1)]


def _meshes(
    scenes: Sequence[_Scene], code: float | None
) -> Iterator[tuple[Array, Indices, NDArray[np.bool_], int]]:
    for scene in scenes:
        for index, points in zip(scene.chosen, scene.points(code), strict=True):
            feather = scene.cache.feathers[index]
            own = scene is scenes[0] and feather.is_feather
            shaft = np.asarray((feather.side == RACHIS) & own)
            yield points, feather.triangles, shaft, index if own else BODY


def _told(found: Crossings, names: Sequence[str], code: float | None) -> dict[str, Any]:
    """One frame's figures."""
    body = (found.owners == BODY).any(axis=1)
    crossed = found.vanes > 0
    worst = np.argsort(-found.vanes, kind="stable")[:MOST_NAMED]
    return {
        "frame": code,
        "crossings": int(found.vanes.sum()),
        "pairs": int(crossed.sum()),
        "with_body": int(found.vanes[body].sum()),
        "with_shafts": int(found.shafts[~body].sum()),
        "worst": [
            {
                "feathers": ["body" if f == BODY else names[f] for f in found.owners[k].tolist()],
                "crossings": int(found.vanes[k]),
            }
            for k in worst.tolist()
            if crossed[k]
        ],
    }
