"""How many triangles of a cache's vanes pass through other vanes, or through a body.

A shaft counts as a line of its vane, as in contact: what its tube passes through is told apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import InputError, Problem
from featherfx.feather.crossings import (
    BODY,
    Crossings,
    crossed_triangles,
    crossings_of,
    patches_of,
)
from featherfx.feather.types import RACHIS
from featherfx.usd.read.read import Cache
from featherfx.usd.read.scenery import Scene, named_by

# pairs that are named
MOST_NAMED = 10


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
    scenes = scenes_of(cache, path)
    codes = chosen_frames(cache, str(path), frames)
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


class CrossedPoints:
    """Where the vanes of a cache pass through others or the body, as count_crossings counts them.

    path: where the cache was opened.
    """

    def __init__(self, cache: Cache, path: Path) -> None:
        self._scenes = scenes_of(cache, path)
        code = cache.whole_frames()[0] if cache.has_frames else None
        self._patches = patches_of(list(_meshes(self._scenes, code)))
        self._count = sum(map(len, self._scenes[0].points(code)))

    def at(self, code: float | None) -> Flags:
        """(V,) points of the cache's meshes, whether a triangle around passes through another."""
        points = np.concatenate([each for scene in self._scenes for each in scene.points(code)])
        crossed = crossed_triangles(points, self._patches)
        found = np.zeros(len(points), dtype=bool)
        found[self._patches.triangles[crossed]] = True
        return found[: self._count]


def scenes_of(cache: Cache, path: Path) -> list[Scene]:
    """A cache's own meshes, and the skins that it names."""
    whole = Scene(cache, range(len(cache.feathers)))
    return [whole, *named_by(cache, path, ["skin"], "looked at")]


def chosen_frames(
    cache: Cache, path: str, frames: tuple[int, int] | None
) -> Sequence[float | None]:
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
    scenes: Sequence[Scene], code: float | None
) -> Iterator[tuple[Array, Indices, Flags, int]]:
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
