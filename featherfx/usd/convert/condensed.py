"""Export to Houdini's condensed feathers: one polyline per rachis that carries its barbs.

Every point of a rachis has its two barbs as arrays, P_barbl and P_barbr, of equally many points,
root to end, without the root. featherfx reads this form back as a groom.

USD stores per-point arrays as primvars of elementSize m. displayColor_barbl and displayColor_barbr
are colours of these points. Left is as seen from dorsal with the tip ahead. Rows without a barb
have all its points on the rachis.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from featherfx.algebra.types import Array
from featherfx.files.atomic_write import standing
from featherfx.phases import counted
from featherfx.usd import arrays
from featherfx.usd.convert.barb_grid import BarbGrid, find_grid
from featherfx.usd.read.cache import Cache
from featherfx.usd.read.cached_feather import CachedFeather
from featherfx.usd.types import BARB_COLOUR_PRIMVARS, StageSpace
from featherfx.usd.write.layers import StageInfo, author_metadata, define_root, new_layer, publish
from featherfx.usd.write.output import check_output, prim_name, refuse_inputs
from featherfx.usd.write.previous_cache import read_metadata
from featherfx.usd.write.prims import author_primvars, define_polylines, label_primvars

_BARB_NAMES = ("P_barbl", "P_barbr")


def export_condensed(path: str | Path, output: str | Path, overwrite: bool = False) -> int:
    """Write a cache as condensed feathers and return their number.

    output: .usd, .usdc or .usda. What is written is in memory meanwhile. Raises InputError where
    the cache cannot be read, a mesh in it is not laid out on a barb grid, or the output not
    written.
    """
    target = check_output(output, overwrite)
    before = {target: standing(target)}
    cache = Cache(path)
    refuse_inputs([target], [Path(path)])
    grids = [find_grid(path, feather, cache.pose(k)) for k, feather in enumerate(cache.feathers)]
    frames = cache.frames if cache.has_frames else None
    space = StageSpace(cache.meters_per_unit, cache.up_axis)
    info = StageInfo(prim_name(target.stem), space, frames, cache.frames_per_second)
    layer, codes, root = new_layer(info), cache.codes(), info.root_path
    stage = Usd.Stage.Open(layer)
    define_root(stage, info)
    curves = [
        _define(stage, root.AppendChild(feather.name), feather, grid)
        for feather, grid in zip(cache.feathers, grids, strict=True)
    ]
    everyone = range(len(grids))
    rest = cache.points_of(everyone)
    for curve, grid, points in zip(curves, grids, rest, strict=True):
        _author_pose(curve, grid, points, None)
    moving: set[int] = set()
    # frame by frame, as many feathers share a mesh; what stands still has the rest pose alone
    for code in codes:
        still = [k for k in everyone if k not in moving]
        pairs = zip(still, cache.points_of(still, code), strict=True)
        moving |= {k for k, points in pairs if not np.array_equal(points, rest[k])}
    for code in counted("writing", codes, len(codes)):
        chosen = sorted(moving)
        for k, points in zip(chosen, cache.points_of(chosen, code), strict=True):
            _author_pose(curves[k], grids[k], points, code)
    author_metadata(layer, {**read_metadata(Path(path)), "layout": "condensed"})
    publish([(layer, target)], before)
    return len(cache.feathers)


def _define(stage: Any, path: Any, feather: CachedFeather, grid: BarbGrid) -> Any:
    rows, columns = grid.nodes.shape[1], grid.nodes.shape[2] - 1
    curve = define_polylines(stage, path, [rows])
    author_primvars(curve.GetPrim(), **label_primvars(feather.id, feather.kind, feather.region))
    primvars = UsdGeom.PrimvarsAPI(curve)
    curve.CreateExtentAttr()
    for name in _BARB_NAMES:
        kind = Sdf.ValueTypeNames.Point3fArray
        primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.vertex, columns)
    if feather.colour is not None:
        rachis, *sides = grid.values(feather.colour)
        shades = dict(
            zip(BARB_COLOUR_PRIMVARS, (side.reshape(-1, 3) for side in sides), strict=True)
        )
        shades["displayColor"] = rachis.mean(axis=0, keepdims=True)
        author_primvars(
            curve.GetPrim(), **{name: arrays.vec3f(each) for name, each in shades.items()}
        )
        for name in BARB_COLOUR_PRIMVARS:
            primvars.GetPrimvar(name).SetElementSize(columns)
    return curve


def _author_pose(curve: Any, grid: BarbGrid, points: Array, code: float | None) -> None:
    """Author a pose. code: of the sample, None: the default.

    Samples go through the layer, which is faster than attributes.
    """
    rachis, left, right = grid.values(points)
    values = {
        "points": rachis,
        "extent": np.array([rachis.min(axis=0), rachis.max(axis=0)]),
        "primvars:P_barbl": left.reshape(-1, 3),
        "primvars:P_barbr": right.reshape(-1, 3),
    }
    prim = curve.GetPrim()
    path, layer = prim.GetPath(), prim.GetStage().GetRootLayer()
    for name, value in values.items():
        if code is None:
            prim.GetAttribute(name).Set(arrays.vec3f(value))
        else:
            layer.SetTimeSample(path.AppendProperty(name), code, arrays.vec3f(value))
