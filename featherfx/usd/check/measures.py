"""Measurements of a cache: intersections, and how its plumage lies.

A rachis counts as a line of its vane, as in contact. Intersections of its tube are counted apart.

Measures of a contour plumage over its skin, tract by tract.

Normals of the skin are averaged over the eight nearest of 200,000 samples, whose own are those of
its points, weighted by corner angles. Vanes of tails and their coverts carry what lies nearer to
them than to the skin. Contour feathers are those whose ids name neither wing nor
tail; a neighbour is one of the three nearest tips. Of each tract, and of `all`:

    angle_mid, angle_tip     of the rachis to the skin, at its middle and its tip, degrees
    tip_height               of tips over the skin, of the length
    neighbour_height         by which neighbouring tips differ in that, m
    overlap                  L sqrt(n / A): mean length, number, area of the skin, which is where a
                             root of the tract is the nearest, and nearer than its feather is long
    intersecting_pairs       of feathers whose vanes intersect, one of the tract; of `all`, any
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import arc_lengths, face_products, unit
from featherfx.errors import InputError, Problem
from featherfx.feather.crossings import (
    BODY,
    Intersections,
    crossed_triangles,
    find_intersections,
    make_patches,
)
from featherfx.feather.types import RACHIS_PART
from featherfx.usd.check.judge_kernels import find_nodes
from featherfx.usd.check.skins import point_normals, sample_triangles
from featherfx.usd.check.tracks import RACHIS, find_tracks
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.contents import find_scenery, open_scenery
from featherfx.usd.read.stage import to_world_matrix
from featherfx.usd.read.values import open_stage

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


_SAMPLES, _NEAREST, _NEIGHBOURS = 200_000, 8, 3
_FAN = "tail"  # in ids of feathers that carry others
_NO_AREA = 1e-12  # m^2
_SOFTEST = 1e-4  # m, added to the distances of samples by whose inverse they count
_INNER_PARTS = ("wing", "tail")  # in ids of feathers that are not of the contour plumage


class _Skin(NamedTuple):
    """Samples of a skin: (N, 3) m, unit normals, the area that each stands for, m^2, and a tree of
    the points. two_sided: whether normals may look either way."""

    points: Array
    normals: Array
    area: float
    tree: Any
    two_sided: bool = False

    def feet(self, points: Array) -> tuple[Array, Array, Array]:
        """Return distances (K,) m of points (K, 3), and their feet and normals (K, 3)."""
        distance, near = self.tree.query(points, k=_NEAREST)
        weights = 1.0 / (distance + _SOFTEST)
        weights /= weights.sum(axis=1, keepdims=True)
        normals = self.normals[near]
        if self.two_sided:
            side = np.sum((points[:, None] - self.points[near]) * normals, axis=2, keepdims=True)
            normals = np.where(side < 0.0, -normals, normals)
        normal = unit(np.einsum("nk,nkc->nc", weights, normals))
        foot = np.einsum("nk,nkc->nc", weights, self.points[near])
        return distance.mean(axis=1), foot, normal


def measure_plumage(
    path: str | Path, skin: str | Path, prim: str, frames: tuple[int, int] | None = None
) -> dict[str, dict[str, float]]:
    """Return the measures of each tract of a cache, and of `all`.

    frames: the first of them is measured; default: the first of the cache. Raises InputError where
    the skin has no such mesh, or the cache no contour feathers.
    """
    cache = Cache(path)
    code = choose_frames(cache, str(path), frames)[0]
    samples = _sample_skin(cache, Path(skin), prim, code)
    rachises = {
        id: (region, points) for id, region, points in _read_rachises(Path(path), cache, code)
    }
    contour = [id for id in rachises if not any(part in id for part in _INNER_PARTS)]
    if not contour:
        raise InputError(Problem(str(path), "", "holds no contour feathers. Give a plumage"))
    carriers = [samples, *_sample_fans(cache, code)]
    rows = [_measure_rachis(rachises[id][1], carriers) for id in contour]
    middle, tip, height, length = np.array(rows).T
    tips = np.stack([rachises[id][1][-1] for id in contour])
    count = min(_NEIGHBOURS, len(tips) - 1)
    _, near = cKDTree(tips).query(tips, k=count + 1)
    steps = np.abs(height[:, None] - height[near.reshape(len(tips), -1)[:, 1:]])
    far, owner = cKDTree(np.stack([rachises[id][1][0] for id in contour])).query(samples.points)
    areas = samples.area * np.bincount(owner[far < length[owner]], minlength=len(contour))
    regions = np.array([rachises[id][0] for id in contour])
    touching = find_intersecting(cache, code, range(len(cache.feathers)))
    pairs = [tuple(cache.feathers[k].region for k in pair) for pair in touching]
    found = {}
    for tract in ("all", *sorted({*regions.tolist()} - {""})):
        own = np.ones(len(contour), dtype=bool) if tract == "all" else regions == tract
        found[tract] = {
            "feathers": int(own.sum()),
            "angle_mid_p50": float(np.median(middle[own])),
            "angle_mid_p90": float(np.percentile(middle[own], 90)),
            "angle_tip_p50": float(np.median(tip[own])),
            "tip_height_p90": float(np.percentile(height[own] / length[own], 90)),
            "neighbour_height_p50": float(np.median(steps[own])) if count else 0.0,
            "overlap": measure_overlap(length[own], areas[own].sum()),
            "intersecting_pairs": sum(tract == "all" or tract in pair for pair in pairs),
        }
    return found


def measure_overlap(lengths: Array, area: float) -> float:
    """Return L sqrt(n / A) of feathers of lengths (n,) m on an area, m^2; 0 of none."""
    count = len(lengths)
    return float(lengths.mean() * np.sqrt(count / max(area, _NO_AREA))) if count else 0.0


def _measure_rachis(points: Array, carriers: list[_Skin]) -> tuple[float, float, float, float]:
    """Return angles at middle and tip, degrees, height of the tip and length, m."""
    distance, *found = map(np.stack, zip(*(each.feet(points) for each in carriers), strict=True))
    foot, normal = (each[distance.argmin(axis=0), np.arange(len(points))] for each in found)
    along = arc_lengths(points)
    rise = np.sum(unit(np.gradient(points, axis=0)) * normal, axis=1)
    angles = np.degrees(np.arcsin(np.clip(rise, -1.0, 1.0)))
    middle = np.interp(0.5 * along[-1], along, angles)
    height = np.sum((points[-1] - foot[-1]) * normal[-1])
    return abs(float(middle)), abs(float(angles[-1])), float(height), float(along[-1])


def _read_rachises(
    path: Path, cache: Cache, code: float | None
) -> Iterator[tuple[str, str, Array]]:
    """Yield id, region and points (n, 3) m of each rachis at a time code."""
    for track in find_tracks(open_stage(path)):
        strands, nodes = track.strands, np.empty((len(track.strands.node_first) - 1, 3))
        points = track.reader.read("points", code)
        find_nodes(points, strands, nodes)
        matrix = to_world_matrix(track.reader.at_rest, cache.to_world)
        for k in np.flatnonzero(strands.kind == RACHIS).tolist():
            own = slice(*strands.first[k : k + 2])
            chain = np.append(strands.start[own], strands.end[own][-1])
            feather = track.labels[strands.feather[k]]
            yield feather.id, feather.region, nodes[chain] @ matrix[:3, :3] + matrix[3, :3]


def _sample_skin(cache: Cache, file: Path, prim: str, code: float | None) -> _Skin:
    """Return samples of a skin at a time code of a cache, evenly by area."""
    usual = {"prim": prim, "role": "skin", "start": 0.0, "first": 0.0, "time_codes_per_frame": 1.0}
    known = [each for each in cache.scenery if each["prim"] == prim]
    skin = open_scenery(file, known[0] if known else usual)
    points, triangles = skin.points(code), skin.surface.triangles
    samples = sample_triangles(points[triangles], _SAMPLES)
    own = triangles[samples.face]
    normals = point_normals(points, triangles)
    places = np.einsum("nk,nkc->nc", samples.weights, points[own])
    return _Skin(
        places,
        unit(np.einsum("nk,nkc->nc", samples.weights, normals[own])),
        samples.area,
        cKDTree(places),
    )


def _sample_fans(cache: Cache, code: float | None) -> Iterator[_Skin]:
    """Yield samples of the vanes of tails at a time code of a cache, if it has any."""
    own = [k for k, each in enumerate(cache.feathers) if _FAN in each.id]
    if own:
        fans = [cache.feathers[k] for k in own]
        vanes = [each.triangles[each.side != RACHIS_PART] for each in fans]
        each = zip(cache.points_of(own, code), vanes, strict=True)
        corners = np.concatenate([points[triangles] for points, triangles in each])
        corners = corners @ cache.to_world
        samples = sample_triangles(corners, _SAMPLES)
        points = np.einsum("nk,nkc->nc", samples.weights, corners[samples.face])
        normals = unit(face_products(corners))[samples.face]
        yield _Skin(points, normals, samples.area, cKDTree(points), two_sided=True)


def find_intersecting(
    cache: Cache, code: float | None, chosen: Sequence[int]
) -> list[tuple[int, int]]:
    """Return every two of some feathers of a cache whose vanes intersect."""
    points, each = cache.points_of(chosen, code), [cache.feathers[k] for k in chosen]
    patches = make_patches(
        [
            (own, feather.triangles, feather.side == RACHIS_PART, k)
            for k, (own, feather) in enumerate(zip(points, each, strict=True))
        ]
    )
    found = find_intersections(np.concatenate(points), patches)
    return [(chosen[a], chosen[b]) for a, b in found.owners[found.vanes > 0].tolist()]
