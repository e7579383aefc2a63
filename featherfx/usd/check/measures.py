"""Measurements of a cache: intersections, and holes in its outline.

A rachis counts as a line of its vane, as in contact. Intersections of its tube are counted apart.
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
    Intersections,
    crossed_triangles,
    find_intersections,
    make_patches,
)
from featherfx.feather.types import RACHIS_PART
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.scenery import find_scenery

_AT_ONCE = 4_000_000  # nodes in boxes around triangles
_MARGIN = 1e-9  # share of a triangle, by which its rim counts as within


def _nodes_within(corners: Array, shape: tuple[int, int]) -> Iterator[tuple[Indices, Indices]]:
    """Yield nodes (i, j) of a lattice of a shape within triangles (T, 3, 2), in pieces.

    corners: in steps of the lattice, from its first node.
    """
    start = np.maximum(np.ceil(corners.min(axis=1) - 1e-6).astype(np.int64), 0)
    end = np.minimum(np.floor(corners.max(axis=1) + 1e-6).astype(np.int64) + 1, shape)
    wide = np.maximum(end - start, 0)
    ends = np.cumsum(wide.prod(axis=1))
    low = 0
    while low < len(corners):
        before = ends[low - 1] if low else 0
        high = max(int(np.searchsorted(ends, before + _AT_ONCE, "right")), low + 1)
        yield _within(corners[low:high], start[low:high], wide[low:high])
        low = high


def _within(corners: Array, start: Indices, wide: Indices) -> tuple[Indices, Indices]:
    """Return those nodes of the boxes around triangles that lie in these."""
    count = wide.prod(axis=1)
    t = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(t)) - np.repeat(np.cumsum(count) - count, count)
    i, j = start[t, 0] + number // wide[t, 1], start[t, 1] + number % wide[t, 1]
    sides = corners[:, 1:] - corners[:, :1]
    area = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    inverse = np.where(np.abs(area) < 1e-9, np.nan, 1.0 / np.where(area == 0.0, 1.0, area))
    away = np.stack([i, j], axis=1) - corners[t, 0]
    first, second = sides[t, 0], sides[t, 1]
    u = (away[:, 0] * second[:, 1] - away[:, 1] * second[:, 0]) * inverse[t]
    v = (first[:, 0] * away[:, 1] - first[:, 1] * away[:, 0]) * inverse[t]
    inside = (u >= -_MARGIN) & (v >= -_MARGIN) & (u + v <= 1.0 + _MARGIN)
    return i[inside], j[inside]


# pairs that are named
_MAX_PAIRS = 10


def count_crossings(
    path: str | Path,
    frames: tuple[int, int] | None = None,
    *,
    jobs: int = 1,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[dict[str, Any]]:
    """Yield the intersections of a cache, frame by frame, for whole frames in `frames`.

    Meshes without a feather's id count as one body, and so does the skin that the cache names, if
    its file is there; else a warning is given. Of each frame: `crossings` of triangles of vanes in
    so many `pairs`, of which `with_body`; `with_shafts`, of a rachis with a vane or rachis of
    another feather; and the `worst` pairs. on_frame: called with the frames done and their number.
    Raises InputError for files that hold no feather, and for frames that the cache does not have.
    """
    path = Path(path)
    cache = Cache(path)
    if not any(feather.is_feather for feather in cache.feathers):
        raise InputError(
            Problem(str(path), "", "holds no mesh with a feather's id. Give a cache of featherfx")
        )
    meshes = MeasuredMeshes(cache, path)
    codes = choose_frames(cache, str(path), frames)
    patches = meshes.patches(codes[0])
    names = [feather.id for feather in cache.feathers]
    on_frame(0, len(codes))

    # the next frame is read while one is looked at
    with ThreadPoolExecutor(1) as reader:
        following = reader.submit(meshes.points, codes[0])
        for done, code in enumerate(codes, 1):
            points = following.result()
            if done < len(codes):
                following = reader.submit(meshes.points, codes[done])
            found = find_intersections(np.concatenate(points), patches, jobs)
            on_frame(done, len(codes))
            yield _frame_report(found, names, code)


class CrossedPoints:
    """Points of vanes that intersect others or the body, as count_crossings counts them.

    path: of the cache.
    """

    def __init__(self, cache: Cache, path: Path) -> None:
        self._meshes, self._feathers = MeasuredMeshes(cache, path), len(cache.feathers)
        code = cache.whole_frames()[0] if cache.has_frames else None
        self._patches = self._meshes.patches(code)

    def at(self, code: float | None) -> Flags:
        """Return (V,) whether a triangle around a point intersects another feather or the body."""
        parts = self._meshes.points(code)
        points = np.concatenate(parts)
        crossed = crossed_triangles(points, self._patches)
        found = np.zeros(len(points), dtype=bool)
        found[self._patches.triangles[crossed]] = True
        return found[: sum(map(len, parts[: self._feathers]))]


class MeasuredMeshes:
    """A cache's own meshes, then the skins that it names. triangles: (T, 3) of each. owner: number
    of each feather, BODY of others."""

    def __init__(self, cache: Cache, path: Path) -> None:
        self._cache = cache
        self._skins = list(find_scenery(cache.scenery, path, ["skin"], "looked at"))
        skins = [each.surface.triangles for each in self._skins]
        self.triangles = [each.triangles for each in cache.feathers] + skins
        own = [k if each.is_feather else BODY for k, each in enumerate(cache.feathers)]
        self.owner = own + [BODY] * len(skins)

    def points(self, code: float | None) -> list[Array]:
        """Return (V, 3) m of each at a time code of the cache; None: at rest."""
        every = self._cache.points_of(range(len(self._cache.feathers)), code)
        skins = [each.points(code) for each in self._skins]
        return [each @ self._cache.to_world for each in every] + skins

    def patches(self, code: float | None) -> Any:
        """Return the patches of all meshes, at a time code."""
        found, feathers = [], self._cache.feathers
        each = zip(self.points(code), self.triangles, self.owner, strict=True)
        for points, triangles, owner in each:
            is_rachis = np.zeros(len(triangles), dtype=np.bool_)
            if owner != BODY:
                is_rachis = np.asarray(feathers[owner].side == RACHIS_PART)
            found.append((points, triangles, is_rachis, owner))
        return make_patches(found)


def choose_frames(
    cache: Cache, path: str, frames: tuple[int, int] | None
) -> Sequence[float | None]:
    """Return time codes to measure; [None], the rest pose, where nothing moves."""
    if not cache.has_frames:
        if frames is not None:
            raise InputError(Problem(path, "frames", "has no frames. Leave out --frames"))
        return [None]
    every = cache.whole_frames()
    if frames is None:
        return every
    first, last = frames
    if not every[0] <= first <= last <= every[-1]:
        message = f"{first}-{last} is out of range. Give {every[0]:g} to {every[-1]:g}"
        raise InputError(Problem(path, "frames", message))
    return [float(code) for code in range(first, last + 1)]


def _frame_report(found: Intersections, names: Sequence[str], code: float | None) -> dict[str, Any]:
    """Return the figures of one frame."""
    body = (found.owners == BODY).any(axis=1)
    crossed = found.vanes > 0
    worst = np.argsort(-found.vanes, kind="stable")[:_MAX_PAIRS]
    return {
        "frame": code,
        "crossings": int(found.vanes.sum()),
        "pairs": int(crossed.sum()),
        "with_body": int(found.vanes[body].sum()),
        "with_shafts": int(found.rachises[~body].sum()),
        "worst": [
            {
                "feathers": ["body" if f == BODY else names[f] for f in found.owners[k].tolist()],
                "crossings": int(found.vanes[k]),
            }
            for k in worst.tolist()
            if crossed[k]
        ],
    }


OUTLINE_VIEWS = {"top": (0, 1), "side": (0, 2), "front": (1, 2)}  # axes of a picture, z up
_PIXEL = 1e-4  # m
_MAX_PIXELS = 6000  # along the longer side of an outline
_LEGS = "thigh"  # the part of a [bird] that grows on legs
# shares of a gap's rim: of bare skin, and of the feathers of legs as of others; by eye
_BARE, _BOTH = 0.4, 0.2
_RIM = np.ones((3, 3), dtype=np.bool_)  # of nodes around another


def measure_holes(
    path: str | Path,
    view: str,
    frames: tuple[int, int] | None = None,
    *,
    on_frame: Callable[[int, int], None] = lambda done, total: None,
) -> Iterator[dict[str, Any]]:
    """Yield the holes in the outline of all that a file draws, its skin too, seen from far off.

    A hole is enclosed. Gaps that open to the outside, as between the tips of primaries, are none.
    Neither are gaps beside a leg, as between leg, belly and tail, or between toes: 0.4 of the rim
    is skin without feathers, or a fifth is feathers of thighs and a fifth others'.

    view: of OUTLINE_VIEWS. Of each frame: `holes` wider than a pixel, the `widest` (m), the largest
    circle that fits into any, and `place` (2,) m of its middle in the image; `gaps` and
    `widest_gap`, likewise of those beside legs. Widths are exact to a `pixel` (m). Raises
    InputError as count_crossings does.
    """
    cache = Cache(path)
    meshes, chosen = MeasuredMeshes(cache, Path(path)), list(OUTLINE_VIEWS[view])
    codes = choose_frames(cache, str(path), frames)
    on_frame(0, len(codes))
    for done, code in enumerate(codes, 1):
        skin: list[Array] = []
        coat: list[Array] = []
        legs: list[Array] = []
        each = zip(meshes.points(code), meshes.triangles, meshes.owner, strict=True)
        for points, triangles, owner in each:
            is_leg = owner != BODY and cache.feathers[owner].region == _LEGS
            sort = skin if owner == BODY else legs if is_leg else coat
            sort.append(points[triangles][:, :, chosen])
        none = np.zeros((0, 3, 2))
        found = _holes([np.concatenate([none, *each]) for each in (skin, coat, legs)])
        on_frame(done, len(codes))
        yield {"frame": code, **found}


def _holes(sorts: list[Array]) -> dict[str, Any]:
    """Return the holes of triangles. sorts: (T, 3, 2) m, corners of skin, coat and legs."""
    from scipy import ndimage  # heavy, and only for this

    corners = np.concatenate(sorts)
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    pixel = max(_PIXEL, float((high - low).max()) / _MAX_PIXELS)
    rows, columns = (np.ceil((high - low) / pixel).astype(int) + 3).tolist()
    drawn = np.zeros((3, rows, columns), dtype=np.bool_)
    for own, each in zip(drawn, sorts, strict=True):
        for nodes in _nodes_within((each - low) / pixel + 1.0, (rows, columns)):
            own[nodes] = True
    covered = drawn.any(axis=0)
    parts, count = ndimage.label(~covered)
    # from the nearest covered node, as far as the middle between it and the one before
    depth = np.where(parts == parts[0, 0], 0.0, ndimage.distance_transform_edt(~covered))
    wide = ndimage.maximum(depth, parts, np.arange(1, count + 1)) > 1.0
    beside = np.zeros(count + 1, dtype=np.bool_)
    for number, box in enumerate(ndimage.find_objects(parts), 1):
        if wide[number - 1]:
            around = tuple(slice(each.start - 1, each.stop + 1) for each in box)
            beside[number] = _beside_a_leg(parts[around] == number, drawn[:, *around])
    gaps = np.where(beside[parts], depth, 0.0)
    depth[beside[parts]] = 0.0
    at = np.array(np.unravel_index(depth.argmax(), depth.shape))
    place = (low + pixel * (at - 1.0)).tolist()
    width = [pixel * max(2.0 * float(each.max()) - 1.0, 0.0) for each in (depth, gaps)]
    own = int((wide & ~beside[1:]).sum())
    of_gaps = {"gaps": int(beside.sum()), "widest_gap": width[1]}
    return {"holes": own, "widest": width[0], "place": place, "pixel": pixel, **of_gaps}


def _beside_a_leg(hole: Flags, drawn: Flags) -> bool:
    """Return whether a hole lies beside a leg.

    hole: (I, J) nodes. drawn: (3, I, J), covered by skin, coat and the feathers of legs.
    """
    from scipy import ndimage

    rim = ndimage.binary_dilation(hole, _RIM) & ~hole & drawn.any(axis=0)
    _, coat, legs = drawn[:, rim]
    bare = float((~coat & ~legs).mean())
    return bare >= _BARE or min(float(coat.mean()), float(legs.mean())) >= _BOTH
