"""What is wrong with a USD file that the USD validators let pass.

Caches are looked through for values that contradict each other; stages that others made are checked
as what they may be to a bake: feathers, skins, colliders.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdUtils

from featherfx.errors import InputError, InputWarning, Problem
from featherfx.groom.keys.groom import USD
from featherfx.groom.keys.values import Place, Problems, Table
from featherfx.groom.read.read import SCENE_SUFFIXES
from featherfx.usd import arrays
from featherfx.usd.check.geometry import GeometryCheck
from featherfx.usd.read.animated_mesh import open_mesh
from featherfx.usd.read.groom import read_feathers
from featherfx.usd.read.stage import (
    SourceScene,
    broken_clips,
    broken_files,
    open_scene,
    open_stage,
    prims_below,
)
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


def check_scene(path: Path) -> list[Problem]:
    """Every problem that keeps a stage, or what is in it, from being used.

    Meshes are opened as skins and colliders are; curves and instancers are read as feathers; and
    of every point set sizes, indices and values are checked. What only caches promise (extents
    that fit, a kind, the range of time codes) is said as InputWarning where it is not so.
    """
    problems = Problems()
    place = Place(str(path), "", problems)
    scene = open_scene(path, place)
    if scene is None:
        return problems.listed()
    for each in missing_files(path):
        place.child(each.key).fail(each.message)
    bad = _meshes(scene, place)
    _feathers(scene, path, place)
    for prim in prims_below(scene, scene.stage.GetPseudoRoot()):
        if not prim.IsA(UsdGeom.PointBased) or str(prim.GetPath()) in bad:
            continue
        check = GeometryCheck(prim)
        for attribute, message in check.faults():
            place.child(f"{prim.GetPath()}.{attribute}").fail(message)
        for attribute, message in check.habits():
            text = f"{path}: {prim.GetPath()}.{attribute}: {message}"
            warnings.warn(text, InputWarning, stacklevel=2)
    return problems.listed()


def _meshes(scene: SourceScene, place: Place) -> set[str]:
    """Paths of the meshes that cannot be followed, after adding their problems."""
    bad = set()
    for prim in prims_below(scene, scene.stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.Mesh) and prim.IsDefined() and not prim.IsAbstract():
            path = str(prim.GetPath())
            if open_mesh(scene, path, None, place) is None:
                bad.add(path)
    return bad


def _feathers(scene: SourceScene, path: Path, place: Place) -> None:
    kinds = (UsdGeom.BasisCurves, UsdGeom.PointInstancer)
    prims = list(prims_below(scene, scene.stage.GetPseudoRoot()))
    if not any(prim.IsA(kind) for prim in prims for kind in kinds):
        return
    entry = Table(USD).check({"file": path.name}, place, False)
    found = read_feathers(entry, path.parent, place)
    if found is None:
        return
    ids = Counter(feather.id for feather in found[1] if feather.id)
    for name, count in ids.items():
        if count > 1:
            labels = ", ".join(feather.label for feather in found[1] if feather.id == name)
            place.child(labels).fail(f"featherId '{name}' is used {count} times; ids are unique")


def missing_files(path: Path) -> list[Problem]:
    """USD files that a stage names, as sublayer, payload or clip, and that are not to be had."""
    stage = Usd.Stage.Open(str(path))
    found = broken_files(stage) | broken_clips(stage)
    if not found:  # USD 24.3 ends the process where it looks into a file that it cannot open
        try:
            _, _, unresolved = UsdUtils.ComputeAllDependencies(str(path))
            names = [str(each) for each in unresolved]
        except Tf.ErrorException as error:
            reason = f"USD cannot open a file that it names: {_reason(error)}"
            return [Problem(str(path), "", reason)]
        found = {name: "is missing" for name in names if Path(name).suffix in SCENE_SUFFIXES}
    return [Problem(str(path), name, message) for name, message in sorted(found.items())]


def _reason(error: Any) -> str:
    return "; ".join(str(part.commentary) for part in error.args)


_PER_INSTANCE = ("positions", "orientations", "orientationsf", "scales", "velocities", "ids")


def instancer_problems(prim: Any) -> Iterator[tuple[str, str]]:
    """(attribute, message) of everything that is wrong at the first time."""
    instancer, first = UsdGeom.PointInstancer(prim), Usd.TimeCode.EarliestTime()
    indices = arrays.to_numpy(instancer.GetProtoIndicesAttr().Get(first)).astype(np.int64)
    targets = instancer.GetPrototypesRel().GetForwardedTargets()
    for target in targets:
        if not prim.GetStage().GetPrimAtPath(target):
            yield "prototypes", f"names {target}, which does not exist"
    wrong = indices[(indices < 0) | (indices >= len(targets))]
    if len(wrong):
        yield "protoIndices", f"{wrong[0]} is out of range, allowed 0 to {len(targets) - 1}"
    for name in _PER_INSTANCE:
        attribute = prim.GetAttribute(name)
        value = attribute.Get(first) if attribute else None
        if value is None:
            if name == "positions" and len(indices):
                yield name, "has no value"
            continue
        if len(value) != len(indices):
            yield name, f"{len(value)} values for {len(indices)} instances"
        if name == "ids" and len(set(value)) < len(value):
            yield name, f"{len(value)} values, {len(set(value))} different; ids are unique"
        if name in ("positions", "scales") and not np.isfinite(arrays.to_numpy(value)).all():
            yield name, "holds values that are not finite"
