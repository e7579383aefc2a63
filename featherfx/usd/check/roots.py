"""Distances of a cache's roots from the mesh that they ride on, as USD itself evaluates it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdSkel

from featherfx.algebra.types import Array
from featherfx.usd.read.stage import read_stage_space, transform_points
from featherfx.usd.types import StageSpace


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
