"""Levels of detail of a cache, of which renderers choose one by its size on the screen.

Coarser levels have fewer of the points: first the tubes of rachises are left out, then rows and
barbs. The kept points stand where the cache has them.

The exported file refers to the cache as its finest level, and holds the others: one mesh of all
feathers each, with normals and velocities at all samples. Only the finest is visible; the variant
set `levelOfDetail` shows another one instead. Where the installed USD has UsdLod (26.11 has it,
24.3 has not), the levels are its items besides. Renderers that know it choose by the fraction of
the view that a sphere around the feathers covers, and ignore visibility.
"""

from __future__ import annotations

import importlib.util
import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade, Vt

from featherfx.algebra.types import Array, Floats, Indices
from featherfx.errors import InputError, Problem
from featherfx.feather.types import RACHIS_PART
from featherfx.phases import counted
from featherfx.usd import arrays
from featherfx.usd.convert.merge import begin_export
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.read.values import EARLIEST_TIME
from featherfx.usd.write.layers import FEATHERS_SCOPE, MATERIALS_SCOPE
from featherfx.usd.write.prims import author_primvars, author_ranges

# rows of a thinned vane, tried one after another
_THINNED_ROWS = (11, 7, 5, 3)
# triangles of a level, at most a share of those of the one before
_MAX_LEVEL_RATIO = 0.75


class ThinnedMesh(NamedTuple):
    """Points and triangles that are kept of feathers.

    points: (P,) kept points of all feathers, ascending by feather. triangles: (T, 3) into these.
    starts: (N + 1,) first kept point of each feather, and P. told: description of what was left
    out, empty where nothing was.
    """

    points: Indices
    triangles: Indices
    starts: Indices
    told: str


def thin_feathers(feathers: Sequence[CachedFeather], starts: Indices, most: int) -> ThinnedMesh:
    """Return as much of feathers as has at most so many points, or the least that there is.

    starts: (N + 1,) first point of each feather, and all.
    """
    kept = _join_feathers([_compact(each.triangles) for each in feathers], starts, "")
    if len(kept.points) > most:
        parts = [_keep_vanes(each) for each in feathers]
        kept = _join_feathers(parts, starts, "without the tubes of rachises")
    for rows in _THINNED_ROWS:
        if len(kept.points) <= most:
            break
        told = f"vanes with at most {rows} rows and one barb segment a side, without rachises"
        kept = _join_feathers([_keep_rows(each, rows) for each in feathers], starts, told)
    return kept


def make_levels(
    feathers: Sequence[CachedFeather], starts: Indices, kept: ThinnedMesh
) -> list[tuple[Indices, Indices]]:
    """Return ever fewer points (P,) and triangles (T, 3) of a thinned mesh, for slow viewers.

    The levels lack rachises, then have fewer rows, and at last the outline alone. starts: as of
    thin_feathers.
    """
    cuts = [slice(*kept.starts[k : k + 2]) for k in range(len(feathers))]
    among = [kept.points[cut] - start for cut, start in zip(cuts, starts, strict=False)]
    found, last = [], len(kept.triangles)
    for rows, middle in (*((rows, True) for rows in _THINNED_ROWS), (_THINNED_ROWS[-1], False)):
        parts = [_keep_rows(f, rows, own, middle) for f, own in zip(feathers, among, strict=True)]
        made = _join_feathers(parts, starts, "")
        if len(made.triangles) <= _MAX_LEVEL_RATIO * last:
            found.append((np.searchsorted(kept.points, made.points), made.triangles))
            last = len(made.triangles)
    return found


def _join_feathers(
    parts: Sequence[tuple[Indices, Indices]], starts: Indices, told: str
) -> ThinnedMesh:
    own = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = [each + start for (each, _), start in zip(parts, starts, strict=False)]
    triangles = [each + start for (_, each), start in zip(parts, own, strict=False)]
    return ThinnedMesh(np.concatenate(points), np.concatenate(triangles), own, told)


def _compact(triangles: Indices) -> tuple[Indices, Indices]:
    """Return the points that triangles use, and the triangles by these."""
    points, places = np.unique(triangles, return_inverse=True)
    return points, places.reshape(-1, 3)


def _keep_vanes(feather: CachedFeather) -> tuple[Indices, Indices]:
    vane = feather.triangles[feather.side != RACHIS_PART]
    return _compact(vane if len(vane) else feather.triangles)


def _keep_rows(
    feather: CachedFeather, most: int, among: Indices | None = None, middle: bool = True
) -> tuple[Indices, Indices]:
    """Return the ends of the barbs at some of the rows, and the rachis if `middle`, as strips.

    among: points that there are; None: all.
    """
    points, triangles = _keep_vanes(feather)
    if feather.st is None or not (feather.side != RACHIS_PART).any():
        return points, triangles
    if among is not None:
        points = np.intersect1d(points, among)
    across, along = feather.st[points, 0], np.round(feather.st[points, 1], 5)
    stations = np.unique(along)
    chosen = stations[np.unique(np.linspace(0, len(stations) - 1, most).round().astype(int))]
    corners = []
    for station in chosen:
        row = np.flatnonzero(along == station)
        ends = row[across[row].argmin()], row[across[row].argmax()]
        inner = (row[np.abs(across[row] - 0.5).argmin()],) if middle else ()
        corners.append((ends[0], *inner, ends[1]))
    low, high = np.array(corners[:-1]), np.array(corners[1:])
    columns = range(low.shape[1] - 1)
    strips = [(low[:, k], low[:, k + 1], high[:, k + 1]) for k in columns] + [
        (low[:, k], high[:, k + 1], high[:, k]) for k in columns
    ]
    made = points[np.concatenate([np.stack(each, axis=1) for each in strips])]
    real = (made[:, 0] != made[:, 1]) & (made[:, 1] != made[:, 2]) & (made[:, 2] != made[:, 0])
    made = made[real]
    # wound as the feather's own
    whole = _areas(feather.st, feather.triangles[feather.side != RACHIS_PART]).sum()
    turned = _areas(feather.st, made) * whole < 0.0
    made[turned] = made[turned][:, [0, 2, 1]]
    return _compact(made)


def _areas(st: Floats, triangles: Indices) -> Floats:
    """Return (T,) twice the signed areas in texture space."""
    first, second = (st[triangles[:, k]] - st[triangles[:, 0]] for k in (1, 2))
    return np.asarray(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])


LEVEL_SET, FULL_LEVEL = "levelOfDetail", "full"
# shares of the view, by eye: a bird 500, 160 and 50 pixels long in a picture of 1920 by 1080
LOD_THRESHOLDS = (0.1, 0.01, 0.001)


@dataclass(frozen=True)
class _CacheLevel:
    """A level of detail. points: (P,) ascending numbers of its points among those of all feathers.

    triangles: (T, 3) into these.
    """

    name: str
    points: Indices
    triangles: Indices


def has_usd_lod() -> bool:
    """Return whether the installed USD has UsdLod."""
    return importlib.util.find_spec("pxr.UsdLod") is not None


def export_levels(
    path: str | Path,
    output: str | Path,
    thresholds: Sequence[float] = LOD_THRESHOLDS,
    overwrite: bool = False,
) -> list[tuple[str, int]]:
    """Write a file that names a cache and has coarser versions of it; return the names of all with
    their triangles, the finest first.

    thresholds: falling shares of the view, below which the next version is taken. The samples of
    the coarser versions are in memory. Raises InputError where the cache cannot be read or has no
    vanes, or the output not be written.
    """
    if not thresholds or any(not 0.0 < b < a for a, b in pairwise([np.inf, *thresholds])):
        given = ", ".join(f"{each:g}" for each in thresholds)
        told = f"{given} is not allowed. Give falling numbers above 0"
        raise InputError(Problem("lod", "", told))
    source, written = begin_export(path, output, overwrite)
    cache = Cache(path)
    if not source.GetDefaultPrim():
        raise InputError(
            Problem(str(path), "defaultPrim", "is missing. Write the default prim with a name")
        )
    codes: Sequence[float | None] = cache.codes() or [None]
    counts = [len(each) for each in cache.points_of(range(len(cache.feathers)), codes[0])]
    starts = np.cumsum([0, *counts])
    found = _levels(cache, starts, len(thresholds))
    if not found:
        raise InputError(
            Problem(
                str(path), "", "has no vanes that can do with fewer points. Bake with more rows"
            )
        )
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    group = _define_levels(stage, source)
    meshes = [_mesh(stage, group, each, cache, starts) for each in found]
    vane = f"{MATERIALS_SCOPE}/vane"
    if source.GetPrimAtPath(source.GetDefaultPrim().GetPath().AppendPath(vane)):
        for mesh in meshes:
            # bound by name, as the material of the cache is not in this file yet
            UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim())
            name = UsdShade.Tokens.materialBinding
            binding = mesh.GetPrim().CreateRelationship(name, False)
            binding.AddTarget(group.GetParent().GetPath().AppendPath(vane))
    place = UsdGeom.Xformable(source.GetDefaultPrim()).ComputeLocalToWorldTransform(EARLIEST_TIME)
    extent = _author_samples(meshes, found, cache, codes, np.array(place.ExtractTranslation()))
    _add_variants(group)
    if has_usd_lod():
        _choose_by_size(stage, group, extent, thresholds[: len(found)])
    full, root = group.GetPath().AppendChild(FULL_LEVEL), group.GetParent().GetPath()
    del stage, group, meshes  # a stage would complain of references of what has no file yet
    _name_cache(layer, full, root, source, f"./{os.path.relpath(path, Path(output).parent)}")
    layer.customLayerData = {
        "featherfx": {"lod": arrays.strings(FULL_LEVEL, *(e.name for e in found))}
    }
    written(layer)
    whole = sum(len(each.triangles) for each in cache.feathers)
    return [(FULL_LEVEL, whole), *((each.name, len(each.triangles)) for each in found)]


def _levels(cache: Cache, starts: Indices, most: int) -> list[_CacheLevel]:
    """Return up to so many levels, evenly chosen from those that there are."""
    kept = thin_feathers(cache.feathers, starts, int(starts[-1]))
    every = make_levels(cache.feathers, starts, kept)
    chosen = np.unique(np.linspace(0, len(every) - 1, min(most, len(every))).round().astype(int))
    return [
        _CacheLevel(f"coarse_{number}", kept.points[every[k][0]], every[k][1])
        for number, k in enumerate(chosen if every else (), 1)
    ]


def _define_levels(stage: Any, source: Any) -> Any:
    """Define root and finest level; return the prim that levels are children of."""
    default = source.GetDefaultPrim()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(source))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(source))
    stage.SetTimeCodesPerSecond(source.GetTimeCodesPerSecond())
    stage.SetFramesPerSecond(source.GetFramesPerSecond())
    if source.HasAuthoredTimeCodeRange():
        stage.SetStartTimeCode(source.GetStartTimeCode())
        stage.SetEndTimeCode(source.GetEndTimeCode())
    root = UsdGeom.Xform.Define(stage, f"/{default.GetName()}").GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    stage.SetDefaultPrim(root)
    group = UsdGeom.Xform.Define(stage, root.GetPath().AppendChild("levels")).GetPrim()
    full = UsdGeom.Xform.Define(stage, group.GetPath().AppendChild(FULL_LEVEL)).GetPrim()
    Usd.ModelAPI(full).SetKind(Kind.Tokens.subcomponent)  # a component has no components
    return group


def _name_cache(layer: Any, full: Any, root: Any, source: Any, asset: str) -> None:
    """Refer to the cache, and to its materials for the other levels."""
    layer.GetPrimAtPath(full).referenceList.Prepend(Sdf.Reference(asset))
    materials = source.GetDefaultPrim().GetPath().AppendChild(MATERIALS_SCOPE)
    if source.GetPrimAtPath(materials):
        own = Sdf.CreatePrimInLayer(layer, root.AppendChild(MATERIALS_SCOPE))
        own.specifier = Sdf.SpecifierDef
        own.referenceList.Prepend(Sdf.Reference(asset, materials))


def _mesh(stage: Any, group: Any, level: _CacheLevel, cache: Cache, starts: Indices) -> Any:
    """Define a level's mesh with its constant attributes."""
    own = UsdGeom.Xform.Define(stage, group.GetPath().AppendChild(level.name))
    mesh = UsdGeom.Mesh.Define(stage, own.GetPath().AppendChild(FEATHERS_SCOPE))
    mesh.CreateFaceVertexCountsAttr(arrays.ints(np.full(len(level.triangles), 3)))
    mesh.CreateFaceVertexIndicesAttr(arrays.ints(level.triangles.ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    firsts = np.searchsorted(level.points, starts)
    faces = np.searchsorted(level.triangles[:, 0], firsts)
    author_ranges(mesh.GetPrim(), cache.feathers, points=firsts, faces=faces)
    for name, primvar, kind in (
        ("st", "st", arrays.vec2f),
        ("colour", "displayColor", arrays.vec3f),
    ):
        values = [getattr(each, name) for each in cache.feathers]
        if all(value is not None for value in values):
            sizes = np.diff(starts)[:, None]
            whole = [
                np.broadcast_to(v, (int(n), v.shape[1]))
                for v, (n,) in zip(values, sizes, strict=True)
            ]
            usual = UsdGeom.Tokens.vertex
            author_primvars(
                mesh.GetPrim(), usual, **{primvar: kind(np.concatenate(whole)[level.points])}
            )
    return mesh


def _author_samples(
    meshes: Sequence[Any],
    found: Sequence[_CacheLevel],
    cache: Cache,
    codes: Sequence[float | None],
    place: Array,
) -> Array:
    """Author the animated attributes at all samples, and return their bounding box (2, 3).

    place: (3,) position of the meshes, so that their numbers are small.
    """
    every, chosen = [], range(len(cache.feathers))
    for mesh in meshes:
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        if place.any():
            mesh.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
    for code in counted("writing", codes, len(codes)):
        points = np.concatenate(cache.points_of(chosen, code))
        velocities, normals = cache.directions_of(chosen, code)
        every.append([points.min(axis=0), points.max(axis=0)])
        time = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
        for mesh, level in zip(meshes, found, strict=True):
            own = points[level.points] - place
            mesh.GetPointsAttr().Set(arrays.vec3f(own), time)
            box = arrays.vec3f(np.array([own.min(axis=0), own.max(axis=0)]))
            mesh.GetExtentAttr().Set(box, time)
            if normals is not None:
                mesh.GetNormalsAttr().Set(arrays.vec3f(normals[level.points]), time)
            if velocities is not None and code is not None:
                mesh.GetVelocitiesAttr().Set(arrays.vec3f(velocities[level.points]), time)
    boxes = np.array(every)
    return np.array([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _add_variants(group: Any) -> None:
    """Show one level, by default the finest; readers without UsdLod draw it alone."""
    root, names = group.GetParent(), [each.GetName() for each in group.GetChildren()]
    variants = root.GetVariantSets().AddVariantSet(LEVEL_SET)
    for name in names:
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            for each in group.GetChildren():
                shown = (
                    UsdGeom.Tokens.inherited if each.GetName() == name else UsdGeom.Tokens.invisible
                )
                UsdGeom.Imageable(each).CreateVisibilityAttr(shown)
    variants.SetVariantSelection(FULL_LEVEL)


def _choose_by_size(stage: Any, group: Any, extent: Array, thresholds: Sequence[float]) -> None:
    """Make the levels items of UsdLod."""
    from pxr import UsdLod

    by_size = UsdLod.ScreenSizeHeuristic.Define(
        stage, group.GetParent().GetPath().AppendChild("bySize")
    )
    by_size.CreateLodDomainAttr(UsdLod.Tokens.imaging)
    by_size.CreateExtentAttr(arrays.vec3f(extent))
    by_size.CreateThresholdsAttr(Vt.FloatArray([*thresholds]))
    UsdLod.RootAPI.Apply(group).CreateLodHeuristicsRel().AddTarget(by_size.GetPath())
