"""What the USD validators let pass: values that contradict each other, on any USD file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pxr import Usd, UsdGeom

from featherfx.errors import InputError, Problem
from featherfx.usd.check.geometry import GeometryCheck
from featherfx.usd.check.scene import check_scene, instancer_problems, missing_files
from featherfx.usd.read.opening import open_stage
from featherfx.usd.write.resume import layer_metadata


def check_file(path: str | Path) -> list[Problem]:
    """Every problem of a USD file, checked as what it is: a cache of featherfx, or an input."""
    path = Path(path)
    return check_usd(path) if is_cache(path) else check_scene(path)


def is_cache(path: Path) -> bool:
    """Whether a file is a cache: it says so itself, or its meshes carry feather ids."""
    if layer_metadata(path):
        return True
    try:
        stage = open_stage(path)
    except InputError:
        return False
    return any(
        prim.IsA(UsdGeom.Mesh) and prim.HasAttribute("primvars:featherId")
        for prim in stage.Traverse()
    )


def check_usd(path: str | Path) -> list[Problem]:
    """Every problem of a USD file: source is the file, key is prim and attribute.

    Checked: files that it refers to, clips included; default prim and its kind, units, up axis
    and time metadata; and of every mesh and curve: point counts that change, topology that does
    not fit, indices out of range, values that are not finite, extents that do not fit the points,
    sizes of velocities, normals, widths and primvars, sample times that differ or lie outside the
    stage's range, time samples on what never changes, subsets, and windings against the normals.
    At one attribute and kind of
    problem the first time code is named and the others are counted.
    """
    try:
        stage = open_stage(path)
    except InputError as error:
        return list(error.problems)
    problems = missing_files(Path(path))
    if problems:
        return problems  # what is in them would be missed everywhere
    problems += [Problem(str(path), key, message) for key, message in _stage_problems(stage)]
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer):
            for attribute, message in instancer_problems(prim):
                problems.append(Problem(str(path), f"{prim.GetPath()}.{attribute}", message))
        if prim.IsA(UsdGeom.PointBased):
            for attribute, message in GeometryCheck(prim).problems():
                key = f"{prim.GetPath()}.{attribute}"
                problems.append(Problem(str(path), key, message))
    return problems


def _stage_problems(stage: Any) -> Iterator[tuple[str, str]]:
    root = stage.GetDefaultPrim()
    if not root:
        yield "defaultPrim", "missing, or names no prim"
    elif not Usd.ModelAPI(root).GetKind():
        yield f"{root.GetPath()}.kind", "missing; a default prim has one, such as component"
    for name in (UsdGeom.Tokens.metersPerUnit, UsdGeom.Tokens.upAxis):
        if not stage.HasAuthoredMetadata(name):
            yield str(name), "missing; readers differ in what they assume"
    has_samples = any(
        attribute.GetNumTimeSamples()
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
    )
    if not has_samples:
        return
    for name in ("timeCodesPerSecond", "framesPerSecond", "startTimeCode", "endTimeCode"):
        if not stage.HasAuthoredMetadata(name):
            yield name, "missing, but the stage has time samples"
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if first > last:
        yield "startTimeCode", f"{first:g} is after endTimeCode {last:g}"
