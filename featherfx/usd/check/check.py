"""Checks of USD files beyond those of the USD validators.

Caches are checked for values that contradict each other. Other stages are checked as inputs of a
bake: feathers, skins, colliders.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdUtils

from featherfx.errors import InputError, Problem, require, warn_input
from featherfx.groom.keys.groom import USD_KEYS
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import Table
from featherfx.groom.read.read import SCENE_SUFFIXES
from featherfx.phases import counted
from featherfx.usd.check.geometry import geometry_problems
from featherfx.usd.read.curves import CURVE_KINDS
from featherfx.usd.read.groom import read_feathers
from featherfx.usd.read.stage import SourceScene, broken_clips, list_broken, open_scene, prims_below
from featherfx.usd.read.surface import MeshOptions, open_mesh
from featherfx.usd.read.values import (
    EARLIEST_TIME,
    INTEGER_ARRAY,
    QUATERNION_ARRAY,
    USD_ERRORS,
    VECTOR_ARRAY,
    collect_errors,
    compute,
    describe_error,
    describe_range,
    open_stage,
    read_array,
    read_sized_array,
    read_targets,
    usd_errors,
)
from featherfx.usd.write.previous_cache import read_metadata


def check_file(path: str | Path) -> list[Problem]:
    """Return every problem of a USD file, checked as a cache of featherfx or as an input."""
    path = Path(path)
    return check_usd(path) if is_cache(path) else check_scene(path)


def is_cache(path: Path) -> bool:
    """Return whether a file is a cache, by its metadata or by feather ids on its meshes."""
    if read_metadata(path):
        return True
    try:
        stage = open_stage(path)
    except InputError:
        return False
    return any(
        prim.IsA(UsdGeom.Mesh) and prim.HasAttribute("primvars:featherId")
        for prim in stage.Traverse()
    )


def judge_complete_cache(path: Path) -> dict[str, Any]:
    """Return the measures of a cache; InputError where files are missing or values do not fit."""
    from featherfx.usd.check.judge import judge_cache  # scenes are checked without it

    require(*missing_files(open_stage(path), path))
    return judge_cache(path)


def check_usd(path: str | Path) -> list[Problem]:
    """Return every problem of a cache: source is the file, key is prim and attribute.

    Checked are the files that it refers to, clips included, and the default prim, its kind, units,
    up axis and time metadata. Of every mesh and curve: changing point counts, topology that does
    not fit, indices out of range, values that are not finite, extents that do not fit the points,
    sizes of velocities, normals, widths and primvars, sample times that differ or lie outside the
    stage's range, time samples on constant attributes, subsets, and windings against the normals. A
    problem names the first time code and counts the others.
    """
    try:
        stage = open_stage(path)
    except InputError as error:
        return list(error.problems)
    problems = missing_files(stage, Path(path))
    if problems:
        return problems  # what is in them would be missed everywhere
    try:
        with usd_errors(stage.GetPseudoRoot()):
            found = list(stage_problems(stage))
        problems += [Problem(str(path), key, message) for key, message in found]
        prims = list(stage.Traverse())
        for prim in counted("checking", prims, len(prims)):
            for name, message in prim_problems(prim):
                problems.append(Problem(str(path), f"{prim.GetPath()}.{name}", message))
    except InputError as error:
        problems += error.problems
    return problems


def prim_problems(prim: Any) -> Iterator[tuple[str, str]]:
    """Yield (attribute, message) of all problems of a prim of a cache."""
    if prim.IsA(UsdGeom.PointInstancer):
        try:
            yield from _instancer_problems(prim)
        except InputError as error:
            start = len(str(prim.GetPath())) + 1
            yield from ((problem.key[start:], problem.message) for problem in error.problems)
    if prim.IsA(UsdGeom.PointBased):
        for found in geometry_problems(prim):
            yield from found


def stage_problems(stage: Any) -> Iterator[tuple[str, str]]:
    """Yield (metadata, message) of the problems of a cache's stage."""
    root = stage.GetDefaultPrim()
    if not root:
        yield "defaultPrim", "missing, or names no prim"
    elif not Usd.ModelAPI(root).GetKind():
        yield f"{root.GetPath()}.kind", "missing. A default prim has one, such as component"
    for name in (UsdGeom.Tokens.metersPerUnit, UsdGeom.Tokens.upAxis):
        if not stage.HasAuthoredMetadata(name):
            yield str(name), "missing. Readers differ in what they assume"
    has_samples = any(
        compute(attribute, attribute.GetNumTimeSamples)
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
    """Return every problem that keeps a stage, or its prims, from being used.

    Meshes are opened as skins and colliders are; curves and instancers are read as feathers. Of
    every point set sizes, indices and values are checked. Promises that only caches make (extents
    that fit, a kind, the range of time codes) are InputWarnings.
    """
    problems = Problems()
    place = Place(str(path), "", problems)
    try:
        scene = open_scene(path, place)
    except InputError as error:
        return list(error.problems)
    for each in missing_files(scene.stage, path):
        place.child(each.key).fail(each.message)
    with collect_errors(place):
        bad = _meshes(scene, place)
        with collect_errors(place):
            _feathers(scene, path, place)
        prims = list(prims_below(scene.stage.GetPseudoRoot()))
        for prim in counted("checking", prims, len(prims)):
            if prim.IsA(UsdGeom.PointBased) and str(prim.GetPath()) not in bad:
                faults, habits = geometry_problems(prim)
                for attribute, message in faults:
                    place.child(f"{prim.GetPath()}.{attribute}").fail(message)
                for attribute, message in habits:
                    text = f"{place.source}: {prim.GetPath()}.{attribute}: {message}"
                    warn_input(text)
    return problems.listed()


def _meshes(scene: SourceScene, place: Place) -> set[str]:
    """Return paths of the meshes that cannot be followed, after adding their problems."""
    bad = set()
    for prim in prims_below(scene.stage.GetPseudoRoot()):
        if prim.IsA(UsdGeom.Mesh) and prim.IsDefined() and not prim.IsAbstract():
            path = str(prim.GetPath())
            bad.add(path)
            with collect_errors(place):
                open_mesh(scene, path, MeshOptions(subdivision=False), place)
                bad.remove(path)
    return bad


def _feathers(scene: SourceScene, path: Path, place: Place) -> None:
    kinds = (*CURVE_KINDS, UsdGeom.PointInstancer)
    prims = list(prims_below(scene.stage.GetPseudoRoot()))
    if not any(prim.IsA(kind) for prim in prims for kind in kinds):
        return
    entry = Table(USD_KEYS).check({"file": path.name}, place, False)
    _, found = read_feathers(entry, path.parent, place)
    ids = Counter(feather.id for feather in found if feather.id)
    for name, count in ids.items():
        if count > 1:
            labels = ", ".join(feather.label for feather in found if feather.id == name)
            place.child(labels).fail(f"featherId '{name}' is used {count} times. Ids are unique")


def missing_files(stage: Any, path: Path) -> list[Problem]:
    """Return a problem for each sublayer, payload, reference, clip or image that is missing."""
    named = (*SCENE_SUFFIXES, ".png")
    found = list_broken(stage) | broken_clips(stage)
    if not found:  # USD 24.3 ends the process where it looks into a file that it cannot open
        try:
            _, _, unresolved = UsdUtils.ComputeAllDependencies(str(path))
            names = [str(each) for each in unresolved]
        except USD_ERRORS as error:
            reason = f"USD cannot open a file that it names: {describe_error(error)}"
            return [Problem(str(path), "", reason)]
        found = {name: "is missing" for name in names if Path(name).suffix in named}
    return [Problem(str(path), name, message) for name, message in sorted(found.items())]


_PER_INSTANCE = {
    "positions": VECTOR_ARRAY,
    "orientations": QUATERNION_ARRAY,
    "orientationsf": QUATERNION_ARRAY,
    "scales": VECTOR_ARRAY,
    "velocities": VECTOR_ARRAY,
    "ids": INTEGER_ARRAY,
}


def _instancer_problems(prim: Any) -> Iterator[tuple[str, str]]:
    instancer = UsdGeom.PointInstancer(prim)
    indices = read_sized_array(instancer.GetProtoIndicesAttr(), EARLIEST_TIME, INTEGER_ARRAY)
    targets = read_targets(instancer.GetPrototypesRel())
    for target in targets:
        if not prim.GetStage().GetPrimAtPath(target):
            yield "prototypes", f"names {target}, which does not exist"
    wrong = indices[(indices < 0) | (indices >= len(targets))]
    if len(wrong):
        yield "protoIndices", f"{wrong[0]} {describe_range(len(targets))}"
    for name, kind in _PER_INSTANCE.items():
        value = read_array(prim.GetAttribute(name), EARLIEST_TIME, kind)
        if value is None:
            if name == "positions" and len(indices):
                yield name, "has no value"
            continue
        if len(value) != len(indices):
            yield name, f"{len(value)} values for {len(indices)} instances"
        if name == "ids" and len(np.unique(value)) < len(value):
            yield name, f"{len(value)} values, {len(np.unique(value))} different. Ids are unique"
        elif not np.isfinite(value).all():
            yield name, "holds values that are not finite"
