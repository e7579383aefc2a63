"""Depths of vanes in the skins that a cache names, and distances of roots from their skin.

The depth of a point is its distance to the nearest of some faces, where it lies behind that face;
by the mean normal of the corners where the nearest place is on an edge. A point that is nearest to
a border of an open skin has none. Faces are those of the eight nearest samples of the skin; these
are sought anew every sixteenth frame, and wherever a point seems deep.

Roots are measured from the mesh that they ride on, as USD itself evaluates it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel
from scipy.spatial import cKDTree

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.usd.check.judge_kernels import find_depths, find_nodes, find_normals
from featherfx.usd.check.tracks import BARB, USUAL_THICKNESS, Track
from featherfx.usd.read.contents import find_scenery
from featherfx.usd.read.stage import read_stage_space, to_world_matrix, transform_points
from featherfx.usd.read.values import read_scenery
from featherfx.usd.types import StageSpace

_NEAREST, _RENEWED_AFTER = 8, 16
# places on a skin of many triangles; on one of few each has so many that neighbours meet at edges
_MAX_SAMPLES, _MAX_FACE_SAMPLES = 100_000, 300
# of a feather's length from its root, where barbs may be under the skin as its calamus is
_BASE = 0.2


class SkinSamples(NamedTuple):
    """Places on triangles, evenly by area. face: (N,), weights: (N, 3) of its corners.

    area: of a place.
    """

    face: Indices
    weights: Array
    area: float


def sample_triangles(corners: Array, count: int) -> SkinSamples:
    """Return places on triangles (T, 3, 3)."""
    sides = corners[:, 1:] - corners[:, :1]
    sizes = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    random = np.random.default_rng(1)
    face = np.searchsorted(np.cumsum(sizes), random.random(count) * sizes.sum())
    first, second = np.sqrt(random.random(count)), random.random(count)
    weights = np.stack([1.0 - first, first * (1.0 - second), first * second], axis=1)
    return SkinSamples(np.minimum(face, len(sizes) - 1), weights, float(sizes.sum()) / count)


def point_normals(points: Array, triangles: Indices) -> Array:
    """Return (V, 3) unit normals, the mean of those of faces, by their angles at a point."""
    normals = np.empty_like(points)
    find_normals(points, triangles, normals)
    return normals


class SkinDepths:
    """Depths of the vanes of tracks in skins, frame by frame.

    max_frames: how many are measured at most, evenly; 0: all.
    """

    def __init__(
        self, stage: Any, path: Path, tracks: Sequence[Track], max_frames: int = 0
    ) -> None:
        entries = tuple(read_scenery(stage))
        self._skins = list(find_scenery(entries, path, ["skin"], "looked at"))
        to_world = StageSpace(*read_stage_space(stage)).to_world
        self._probes = [_Probe(track, to_world) for track in tracks]
        self._codes = sorted({code for each in tracks for code in each.reader.codes})
        self._codes = [code for code in self._codes if code == round(code)] if self._skins else []
        if max_frames:
            self._codes = self._codes[:: -(-len(self._codes) // max_frames) or 1]
        self.count = len(self._codes)

    def frames(self) -> Iterator[tuple[float, list[tuple[Track, Array]]]]:
        """Yield time codes with the depths (F,) m of the feathers of each track."""
        triangles = [each.surface.triangles for each in self._skins]
        counts: list[int] = []
        for number, code in enumerate(self._codes):
            parts = [each.points(code) for each in self._skins]
            if number == 0:
                counts = [0, *np.cumsum([len(each) for each in parts]).tolist()]
                joined = np.concatenate([t + k for t, k in zip(triangles, counts, strict=False)])
                border = _border_points(joined, counts[-1])
            points = np.concatenate(parts)
            if number % _RENEWED_AFTER == 0:
                count = min(_MAX_SAMPLES, _MAX_FACE_SAMPLES * len(joined))
                samples = sample_triangles(points[joined], count)
            skin = _Skin(points, joined, border, samples)
            found = []
            for probe in self._probes:
                places = probe.places(code)
                if number % _RENEWED_AFTER == 0:
                    probe.faces = skin.near(places)
                depths = skin.depths(places, probe.faces)
                if len(seems := np.flatnonzero(depths > 0.5 * USUAL_THICKNESS)):
                    probe.faces[seems] = skin.near(places[seems])
                    depths[seems] = skin.depths(places[seems], probe.faces[seems])
                deepest = np.zeros(len(probe.track.labels))
                np.maximum.at(deepest, probe.feather, depths)
                found.append((probe.track, deepest))
            yield code, found


class _Skin:
    """A skin at one time. points: (V, 3) m. border: (V,) of points. samples: of its triangles."""

    def __init__(
        self, points: Array, triangles: Indices, border: Flags, samples: SkinSamples
    ) -> None:
        self._points, self._triangles, self._border = points, triangles, border
        self._samples = samples

    @cached_property
    def _tree(self) -> Any:
        corners = self._points[self._triangles[self._samples.face]]
        places = np.einsum("nk,nkc->nc", self._samples.weights, corners)
        # of most poses few places are sought, so that building it counts
        return cKDTree(places, compact_nodes=False, balanced_tree=False)

    @cached_property
    def _normals(self) -> Array:
        return point_normals(self._points, self._triangles)

    def near(self, places: Array) -> Indices:
        """Return (P, 8) faces near places (P, 3)."""
        return np.asarray(self._samples.face[self._tree.query(places, k=_NEAREST)[1]])

    def depths(self, places: Array, faces: Indices) -> Array:
        """Return (P,) depths of places, 0 for those that are outside."""
        depths = np.zeros(len(places))
        skin = self._points, self._triangles, self._normals, self._border
        find_depths(places, faces, *skin, depths)
        return depths


class _Probe:
    """Ends of the barbs of a track, and where they begin, without those at the base."""

    def __init__(self, track: Track, to_world: Array) -> None:
        strands, rest = track.strands, track.rest
        barbs = np.flatnonzero(strands.kind == BARB)
        ends = [strands.end[strands.first[barbs]], strands.end[strands.first[barbs + 1] - 1]]
        node, feather = np.concatenate(ends), np.tile(strands.feather[barbs], 2)
        self._nodes = np.empty((len(strands.node_first) - 1, 3))
        find_nodes(rest, strands, self._nodes)
        away = np.linalg.norm(self._nodes[node] - self._nodes[strands.root][feather], axis=1)
        longest = np.zeros(len(track.labels))
        np.maximum.at(longest, feather, away)
        chosen = away > _BASE * longest[feather]
        self.track, self._node, self.feather = track, node[chosen], feather[chosen]
        self._matrix = to_world_matrix(track.reader.at_rest, to_world)
        self.faces = np.zeros((0, _NEAREST), dtype=np.int64)

    def places(self, code: float) -> Array:
        """Return (P, 3) m, at a time code."""
        track = self.track
        find_nodes(track.reader.read("points", code), track.strands, self._nodes)
        moved = self._nodes[self._node] @ self._matrix[:3, :3] + self._matrix[3, :3]
        return np.ascontiguousarray(moved)


def _border_points(triangles: Indices, count: int) -> Flags:
    """Return (V,) whether a point is on an edge of one face only."""
    edges = np.sort(np.concatenate([triangles[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    each, times = np.unique(edges @ [count, 1], return_counts=True)
    border = np.zeros(count, dtype=np.bool_)
    border[np.stack(np.divmod(each[times == 1], count))] = True
    return border


def measure_roots(cache: Path, file: Path) -> float | None:
    """Return the largest distance (m) of roots of a cache from their places on their meshes."""
    own, other = Usd.Stage.Open(str(cache)), _bake_skinning(file)
    codes = range(int(own.GetStartTimeCode()), int(own.GetEndTimeCode()) + 1)
    largest, every = None, [UsdGeom.PrimvarsAPI(prim) for prim in own.Traverse()]
    rachises = {
        each.GetPrimvar("featherId").Get()[0]: str(each.GetPrim().GetPath())
        for each in every
        if each.GetPrim().IsA(UsdGeom.BasisCurves)
    }
    for each in every:
        if not each.HasPrimvar("skinPrim"):
            continue
        names = ("featherId", "skinPrim", "skinPoints", "skinBarycentric")
        (id,), (path,), corners, weights = (each.GetPrimvar(name).Get() for name in names)
        for code in codes:
            root = _world_points(own, rachises[id], code)[0]
            place = np.array(weights) @ _world_points(other, path, code)[np.array(corners)]
            largest = max(largest or 0.0, float(np.linalg.norm(root - place)))
    return largest


def _world_points(stage: Any, path: str, code: float) -> Array:
    """Return (V, 3) m, as USD has the points of a prim at a time code."""
    prim = UsdGeom.PointBased(stage.GetPrimAtPath(path))
    matrix = np.array(prim.ComputeLocalToWorldTransform(code))
    points = np.array(prim.GetPointsAttr().Get(code), dtype=float)
    to_world = StageSpace(*read_stage_space(stage)).to_world
    return np.asarray(transform_points(points, matrix) @ to_world)


def _bake_skinning(file: Path) -> Any:
    """Return a stage whose skinned meshes have the points that USD itself computes."""
    stage = Usd.Stage.Open(str(file))
    stage.SetEditTarget(stage.GetSessionLayer())
    while instances := [each for each in stage.TraverseAll() if each.IsInstance()]:
        for each in instances:
            each.SetInstanceable(False)
    for prim in list(stage.Traverse()):
        if prim.IsA(UsdSkel.Root):
            UsdSkel.BakeSkinning(UsdSkel.Root(prim), Gf.Interval(-1e6, 1e6))
    return stage
