"""Caches that are corrected by hand: feathers are brought to drawn poses at some frames.

At a frame that holds a pose, the deviation from the cache is taken apart into small turns, as
followers are (shot/detail/guided.py): w of the root, k and c from row to row, b of each segment of
a barb. Between held frames each component follows a monotone cubic (Fritsch and Carlson 1980),
before the first and after the last it fades to 0. At any frame the chain of the cache's own chords
and segments is put together again with these turns,

    A_0' = A_0 exp(w),   A_(i+1)' = A_i' A_i^T A_(i+1) exp(k_i),
    r_(i+1)' = r_i' + A_i' exp(c_i) A_i^T (r_(i+1) - r_i),

from the cache's own root. So rachises and barbs keep the lengths that they have there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import UsdGeom
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import arc_lengths, rotation_vectors, vectors_to_frames
from featherfx.errors import InputError, Problem, as_figure, require_type, warn_input
from featherfx.feather.types import RowPoints, both, turned
from featherfx.groom.course import along_polyline
from featherfx.groom.keys.problems import Place, Problems, nearest
from featherfx.phases import Progress, counted, tells_progress
from featherfx.shot.detail.guided import INSTANT, Chains, Turns, row_frames
from featherfx.shot.direction.targets import along_line, why_no_shaft
from featherfx.usd.arrays import vec3f
from featherfx.usd.check.measures import find_intersecting
from featherfx.usd.convert.condensed import (
    MeshRows,
    MovedRows,
    carry_barbs,
    carry_directions,
    carry_rachis,
    find_grid,
    find_normals,
)
from featherfx.usd.convert.merge import begin_export, copy_layer, flatten_stage, notes_of
from featherfx.usd.convert.rigid import FeatherPrim, extent_of, find_prims
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import read_members
from featherfx.usd.read.scenes import read_poses
from featherfx.usd.read.values import open_stage, read_text, read_times
from featherfx.usd.types import ACCELERATIONS, BARB_DIRECTION, DIAGNOSTICS, RATES
from featherfx.usd.write.layers import SCOPES

_OFF_TOLERANCE = 0.01  # of a feather's length, from which on a pose is told as not reached
_DIAGNOSED = tuple(name for names in DIAGNOSTICS.values() for name in names)


class HeldPoses(NamedTuple):
    """Poses of one feather by time code: (V, 3) of its mesh or (k, 3) of its rachis."""

    meshes: dict[float, Array]
    lines: dict[float, Array]


class _Pose(NamedTuple):
    """A feather of the cache at one time. origin: (3,), frame: (3, 3) of its first row. local: its
    rows seen from there."""

    origin: Array
    frame: Array
    local: RowPoints


def _seen_from_root(rows: RowPoints) -> _Pose:
    frame = row_frames(rows.directors[None])[0, 0]
    origin = rows.nodes[0, 0]
    return _Pose(origin, frame, turned(frame, rows.shifted(-origin)))


class Deviation(NamedTuple):
    """Turns of one feather against its pose in the cache. root: (3,) rad."""

    root: Array
    turns: Turns

    def flat(self) -> Array:
        return np.concatenate([self.root, *(each.ravel() for each in self.turns)])

    @classmethod
    def from_flat(cls, values: Array, rows: int, columns: int) -> Deviation:
        along, barbs = np.split(values[3:], [6 * (rows - 1)])
        turns = Turns(along.reshape(1, rows - 1, 6), barbs.reshape(1, 2, rows, columns, 3))
        return cls(values[:3], turns)

    @classmethod
    def between(cls, rows: RowPoints, aim: RowPoints) -> Deviation:
        """Find the turns from rows of the cache to those of a pose."""
        own, other = _seen_from_root(rows), _seen_from_root(aim)
        turns = _chains(own.local).turns(both(lambda part: part[None], other.local))
        return cls(rotation_vectors((own.frame.T @ other.frame)[None])[0], turns)

    def posed(self, rows: RowPoints) -> RowPoints:
        """Return rows of the cache as they deviate."""
        own = _seen_from_root(rows)
        frame = own.frame @ vectors_to_frames(self.root[None])[0]
        found = _chains(own.local).posed(self.turns).at(0)
        return turned(frame.T, found).shifted(own.origin)


def _chains(local: RowPoints) -> Chains:
    return Chains(both(lambda part: part[None], local), [False])


@dataclass(frozen=True)
class SculptedFeather:
    """A feather that is corrected. index: in the cache. deviations: of its poses by time code.
    fade: frames before the first and after the last."""

    id: str
    index: int
    mesh: MeshRows
    deviations: Mapping[float, Deviation]
    fade: float

    @cached_property
    def _course(self) -> CubicHermiteSpline:
        codes = list(self.deviations)
        values = [each.flat() for each in self.deviations.values()]
        if self.fade:
            codes = [codes[0] - self.fade, *codes, codes[-1] + self.fade]
            values = [np.zeros_like(values[0]), *values, np.zeros_like(values[0])]
        elif len(codes) == 1:
            codes, values = [codes[0], codes[0] + 1.0], values * 2
        slopes = PchipInterpolator(codes, values)(codes, 1)
        slopes[[0, -1]] = 0.0
        return CubicHermiteSpline(codes, values, slopes)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time code of what changes; without a fade there is none."""
        codes = list(self.deviations)
        return (codes[0] - self.fade, codes[-1] + self.fade) if self.fade else (-np.inf, np.inf)

    def deviation(self, code: float) -> Deviation:
        """Return the deviation at a time code."""
        first, last = self._course.x[[0, -1]]
        size = self.mesh.grid.nodes.shape
        return Deviation.from_flat(self._course(min(max(code, first), last)), size[1], size[2] - 1)


@tells_progress
def sculpt(
    path: str | Path,
    output: str | Path,
    *,
    poses: str | Path,
    fade: float = 6.0,
    overwrite: bool = False,
    progress: Progress = False,
) -> Path:
    """Write a cache whose feathers are brought to drawn poses as one plain USD file.

    poses: USD file with meshes or curves named by feather id, whose time samples are the frames
    that they hold. fade: frames before the first and after the last pose within which the
    correction comes and goes; 0: it holds. Velocities, accelerations, normals and extents are those
    of the new motion. progress: as of featherfx.phases.tells_progress. Warns of poses that are not
    reached. Raises InputError where cache or poses cannot be read, or the output not be written.
    """
    require_type("path", path, str | Path, "the path of a cache, such as cache.path")
    require_type("poses", poses, str | Path, "the path of a USD file with poses")
    require_type("fade", fade, Real, "a number of frames, such as 6")
    if not 0.0 <= fade < np.inf:
        raise InputError(Problem("sculpt", "fade", f"is {fade:g}. Give 0 or more frames"))
    stage, written = begin_export(path, output, overwrite)
    cache = Cache(path)
    if not cache.has_frames:
        raise InputError(Problem(str(path), "", "has no frames to correct. Give a baked cache"))
    held = read_held_poses(Path(poses), cache)
    feathers = {
        name: _fit(cache, name, poses, own, float(fade))
        for name, own in counted("building", held.items(), len(held))
    }
    layer = copy_layer(flatten_stage(stage))
    root = stage.GetDefaultPrim().GetPath()
    prims = {name: list(find_prims(layer, root.AppendChild(name))) for name, _ in SCOPES.values()}
    writer = _Writer(layer, feathers, cache, stage.GetTimeCodesPerSecond())
    corners = writer.write(prims)
    hint = layer.GetAttributeAtPath(root.AppendProperty("extentsHint"))
    if hint and np.shape(hint.default) == (2, 3):
        every = np.array([hint.default, *corners])
        hint.default = vec3f([every[:, 0].min(axis=0), every[:, 1].max(axis=0)])
    layer.customLayerData = {"featherfx": {**notes_of(stage), "sculpted": Path(path).name}}
    made = written(layer)
    _warn_of_order(cache, Cache(made), feathers, str(poses))
    return made


def _warn_of_order(
    before: Cache, after: Cache, feathers: Mapping[str, SculptedFeather], source: str
) -> None:
    """Warn of feathers that pass through others at held frames, and did not in the cache."""
    own = [each.index for each in feathers.values()]
    for code in sorted({code for each in feathers.values() for code in each.deviations}):
        points = after.points_of(range(len(after.feathers)), code)
        boxes = np.array([[each.min(axis=0), each.max(axis=0)] for each in points])
        low, high = boxes[:, None, 0], boxes[:, None, 1]
        near = ((low <= boxes[own, 1]) & (high >= boxes[own, 0])).all(axis=2)
        chosen: list[int] = np.flatnonzero(near.sum(axis=1)).tolist()
        was, now = (set(find_intersecting(each, code, chosen)) for each in (before, after))
        if pairs := sorted(now - was):
            names = [after.feathers[k].id for k in pairs[0]]
            more = f", and {len(pairs) - 1} more pairs" if len(pairs) > 1 else ""
            told = f"'{names[0]}' and '{names[1]}' intersect at frame {code:g} and did not before"
            warn_input(f"{source}: {told}{more}. Pose both", 3)


def read_held_poses(path: Path, cache: Cache) -> dict[str, HeldPoses]:
    """Read the poses that a file holds of feathers of a cache, by id, in its units and axes.

    Raises InputError for feathers that the cache lacks, and for frames that it does not have.
    """
    times: dict[str, list[float]] = {}
    stage = open_stage(path)
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh) or prim.IsA(UsdGeom.BasisCurves):
            codes = read_times(UsdGeom.PointBased(prim).GetPointsAttr())
            label = UsdGeom.PrimvarsAPI(prim).GetPrimvar("featherId").GetAttr()
            ids = [each.id for each in read_members(prim)]
            for name in ids or [(read_text(label) if label else "") or prim.GetName()]:
                times[name] = sorted({*times.get(name, ()), *codes})
    every = sorted({code for codes in times.values() for code in codes})
    if not every:
        message = "holds no time samples of points of meshes or curves. Give poses at frames"
        raise InputError(Problem(str(path), "", message))
    first, last = cache.frames
    for code in every:
        if not first <= code <= last:
            message = f"holds a pose at frame {code:g}, the cache has {first:g} to {last:g}"
            raise InputError(Problem(str(path), "", message))
    found: dict[str, HeldPoses] = {}
    known, place = {each.id for each in cache.feathers}, Place(str(path), "", Problems())
    back = np.linalg.inv(cache.to_world)
    for code in every:
        for which, table in enumerate(read_poses(path, code, place)):
            for name, points in table.items():
                if name not in known:
                    message = f"holds '{name}', {nearest(name, known)}"
                    raise InputError(Problem(str(path), "", message))
                if code in times.get(name, ()):
                    own = found.setdefault(name, HeldPoses({}, {}))
                    own[which][code] = points @ back
    return found


def _fit(
    cache: Cache, name: str, source: str | Path, held: HeldPoses, fade: float
) -> SculptedFeather:
    """Fit the chain of a feather to its poses; warn where these are not reached."""
    index = next(k for k, each in enumerate(cache.feathers) if each.id == name)
    feather = cache.feathers[index]
    rest = cache.pose(index)
    grid = find_grid(cache.path, feather, rest)
    mesh = MeshRows(grid, feather.triangles)
    deviations, off = {}, {}
    for code in sorted({*held.meshes, *held.lines}):
        points = cache.points(index, code).astype(np.float64)
        rows = mesh.rows_of(points)
        station = arc_lengths(rows.nodes[:, 0])
        at = f"'{name}' at frame {code:g}"
        if (wanted := held.meshes.get(code)) is not None:
            if len(wanted) != len(points):
                told = f"{at} has {len(wanted)} points, its mesh in the cache {len(points)}"
                raise InputError(Problem(str(source), "", told))
            deviations[code] = Deviation.between(rows, mesh.rows_of(wanted))
            shown = mesh.moved(points, rows, deviations[code].posed(rows))
        else:
            line = held.lines[code]
            if why := why_no_shaft(line - rows.nodes[0, 0], station[-1]):
                raise InputError(Problem(str(source), "", f"the curve of {at} {why}"))
            deviations[code] = Deviation.between(rows, along_line(rows, station, line))
            shown = deviations[code].posed(rows).nodes[:, 0]
            wanted = along_polyline(line, station / station[-1])
        off[code] = float(np.linalg.norm(shown - wanted, axis=1).max() / station[-1])
    worst = max(off, key=lambda code: off[code])
    if off[worst] > _OFF_TOLERANCE:
        message = (
            f"'{name}' is {as_figure(100.0 * off[worst])} % of its length off its pose at frame"
        )
        message += f" {worst:g}: its root stays, and rachis and barbs keep their lengths"
        warn_input(f"{source}: {message}")
    return SculptedFeather(name, index, mesh, deviations, fade)


class _Writer:
    """Corrected samples in a layer. rate: time codes per second."""

    def __init__(
        self, layer: Any, feathers: Mapping[str, SculptedFeather], cache: Cache, rate: float
    ) -> None:
        self._layer, self._feathers, self._cache, self._rate = layer, feathers, cache, rate
        self._step = INSTANT  # time codes, over which rates are found
        self._last: dict[Any, tuple[float, Any]] = {}  # values that were read, by path

    def write(self, prims: Mapping[str, Sequence[FeatherPrim]]) -> list[Array]:
        """Correct all prims; return the corners of what changes."""
        feathers, rachises, barbs = (prims[name] for name, _ in SCOPES.values())
        corners: list[Array] = []
        self._meshes = {
            prim.ids[k]: (prim, slice(a, a + n))
            for prim in feathers
            for k, (a, n) in enumerate(prim.points)
        }
        missing = [name for name in self._feathers if name not in self._meshes]
        if missing:
            told = f"'{missing[0]}' has no mesh of its own there. Give a cache of meshes of a bake"
            raise InputError(Problem(str(self._cache.path), "", told))
        # meshes last: the others read what they are before
        own = [
            (prim, kind) for kind, group in enumerate((rachises, barbs, feathers)) for prim in group
        ]
        for prim, kind in counted("writing", own, len(own)):
            chosen = [k for k, name in enumerate(prim.ids) if name in self._feathers]
            if chosen:
                corners += self._write_prim(prim, chosen, kind)
        return corners

    def _write_prim(self, prim: FeatherPrim, chosen: list[int], kind: int) -> Iterator[Array]:
        path = prim.spec.path
        if "xformOpOrder" in prim.spec.properties:
            told = "moves by a transform, as of `export --rigid`. Give the cache of the bake"
            raise InputError(Problem(str(self._cache.path), str(path), told))
        for name in _DIAGNOSED:
            if name in prim.spec.properties:
                told = f"{name} is that of the bake and left out"
                warn_input(f"{path}: {told}")
                prim.spec.RemoveProperty(prim.spec.properties[name])
        spans = [self._feathers[prim.ids[k]].span for k in chosen]
        low, high = min(a for a, _ in spans), max(b for _, b in spans)
        codes = self._layer.ListTimeSamplesForPath(path.AppendProperty("points"))
        own = [code for code in codes or self._cache.whole_frames() if low <= code <= high]
        for code in own:
            yield self._write_sample(prim, chosen, kind, code)

    def _write_sample(self, prim: FeatherPrim, chosen: list[int], kind: int, code: float) -> Array:
        names = ("points", *RATES, *(("normals", BARB_DIRECTION) if kind == 2 else ()))
        values = {
            name: self._read(prim, name, code) for name in names if name in prim.spec.properties
        }
        changed = {name: np.array(value, dtype=np.float64) for name, value in values.items()}
        for k in chosen:
            feather = self._feathers[prim.ids[k]]
            first, count = prim.points[k]
            cut = slice(first, first + count)
            faces = slice(prim.faces[k][0], prim.faces[k].sum())
            series = [self._series(prim, cut, code, step) for step in (-1, 0, 1)]
            meshes = [self._series(*self._meshes[feather.id], code, step) for step in (-1, 0, 1)]
            found = [
                self._moved(feather, kind, prim, faces, points, mesh, code + step * self._step)
                for points, mesh, step in zip(series, meshes, (-1, 0, 1), strict=True)
            ]
            seconds = self._step / self._rate
            changed["points"][cut] = found[1]
            for name in RATES:
                if name not in changed:
                    continue
                if name == ACCELERATIONS:
                    bend = found[2] - 2.0 * found[1] + found[0]
                    changed[name][cut] = bend / seconds**2
                else:
                    changed[name][cut] = (found[2] - found[0]) / (2.0 * seconds)
            if "normals" in changed:
                changed["normals"][cut] = find_normals(found[1], feather.mesh.triangles)
            if BARB_DIRECTION in changed:
                was = changed[BARB_DIRECTION][faces]
                changed[BARB_DIRECTION][faces] = carry_directions(
                    was, series[1], found[1], feather.mesh.triangles
                )
        for name, value in changed.items():
            kind_of = type(values[name])
            number = np.asarray(values[name]).dtype
            written = kind_of.FromNumpy(np.ascontiguousarray(value, dtype=number))
            self._layer.SetTimeSample(prim.spec.path.AppendProperty(name), code, written)
        extent = prim.spec.path.AppendProperty("extent")
        corners = extent_of(self._layer, prim.spec.path, np.float32(changed["points"]))
        self._layer.SetTimeSample(extent, code, corners)
        return np.asarray(corners)

    def _read(self, prim: FeatherPrim, name: str, code: float) -> Any:
        """Value of an attribute at a time code that has a sample, or its default."""
        path = prim.spec.path.AppendProperty(name)
        if self._last.get(path, (None, None))[0] != code:
            value = self._layer.QueryTimeSample(path, code)
            self._last[path] = code, prim.spec.properties[name].default if value is None else value
        return self._last[path][1]

    def _series(self, prim: FeatherPrim, cut: slice, code: float, step: int) -> Array:
        """(V, 3) points of a feather in a prim of the cache, some steps after a time code."""
        points = np.asarray(self._read(prim, "points", code), dtype=np.float64)[cut]
        for power, name in enumerate(RATES, 1):
            if step and name in prim.spec.properties:
                rate = np.asarray(self._read(prim, name, code), dtype=np.float64)[cut]
                points = points + (step * self._step / self._rate) ** power / power * rate
        return points

    def _moved(
        self,
        feather: SculptedFeather,
        kind: int,
        prim: FeatherPrim,
        curves: slice,
        points: Array,
        mesh: Array,
        code: float,
    ) -> Array:
        """Points of a prim carried by the rows of their feather. kind: rachis, barbs or mesh."""
        before = feather.mesh.rows_of(mesh)
        deviation = feather.deviation(code)
        after = deviation.posed(before)
        if kind == 2:
            return feather.mesh.moved(points, before, after)
        if kind == 0:
            return carry_rachis(points, before, after)
        counts = np.asarray(prim.spec.properties["curveVertexCounts"].default)[curves]
        sample = MovedRows(before, after, deviation.turns.barbs[0])
        return carry_barbs(points, counts, sample)
