"""USD stages that others made, as sources: opened as they stand on the disk, measured, and their
prims found by path. No output takes the place of a file that it is made from.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils

from featherfx.errors import InputError, InputWarning, Problem
from featherfx.groom.keys.values import Place
from featherfx.usd.types import OutputError

Array = NDArray[np.float64]

_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
DEFAULT, EARLIEST = Usd.TimeCode.Default(), Usd.TimeCode.EarliestTime()


@dataclass(frozen=True)
class SourceScene:
    """An open stage. path: its file. to_world: (3, 3), stage to world (metres, z up), row vectors.

    time_codes_per_second: of the stage.
    """

    path: Path
    stage: Any
    to_world: Array

    @property
    def time_codes_per_second(self) -> float:
        return float(self.stage.GetTimeCodesPerSecond())

    @property
    def meters_per_unit(self) -> float:
        return float(np.linalg.norm(self.to_world[0]))

    @property
    def space(self) -> tuple[float, str]:
        """Metres per unit and up axis of the stage."""
        return stage_space(self.stage)

    @property
    def files(self) -> tuple[Path, ...]:
        """Every file that the open stage is made of, clips included; no textures."""
        layers = {layer.realPath for layer in self.stage.GetUsedLayers()} | clip_files(self.stage)
        return tuple(Path(path) for path in sorted(layers) if path)

    def matrix(self, prim: Any, code: Any) -> Array:
        """(4, 4) local space of a prim to the world, row vectors, at a time code."""
        local = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(code))
        return in_world(local, self.to_world)


class ScenePrim:
    """A prim of a scene, as the base of what follows it in time. path: of the prim."""

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        self._scene, self._prim, self.path = scene, prim, str(prim.GetPath())

    @property
    def time_codes_per_second(self) -> float:
        return self._scene.time_codes_per_second

    @property
    def origin(self) -> tuple[str, tuple[Path, ...]]:
        return self.path, self._scene.files


def broken_files(stage: Any) -> dict[str, str]:
    """Layers that a stage names and that cannot be opened, and why."""
    found: dict[str, str] = {}
    for layer in stage.GetUsedLayers():
        for name in layer.GetCompositionAssetDependencies():
            path = Sdf.ComputeAssetPathRelativeToLayer(layer, name)
            found[path] = _why_not(path)
    return {path: reason for path, reason in found.items() if reason}


def broken_clips(stage: Any) -> dict[str, str]:
    """Value clips of a stage that are there and cannot be opened, and why."""
    found = {path: _why_not(path) for path in sorted(clip_files(stage))}
    return {path: reason for path, reason in found.items() if reason}


def _why_not(path: str) -> str:
    if os.path.isfile(path) and not os.access(path, os.R_OK):
        return "no permission to read it"
    try:
        return "" if Sdf.Layer.FindOrOpen(path) else "is missing"
    except Tf.ErrorException as error:
        # the last says only that the layer failed to open
        reasons = [str(part.commentary).strip() for part in error.args]
        return f"USD cannot open it: {reasons[0]}" if reasons else "USD cannot open it"


def clip_files(stage: Any) -> set[str]:
    """Value clips of a stage, and their manifests, that are there."""
    files: set[str] = set()
    for prim in stage.TraverseAll():
        api = Usd.ClipsAPI(prim)
        for name, values in (api.GetClips() or {}).items():
            assets = [*api.ComputeClipAssetPaths(name), values.get("manifestAssetPath")]
            files |= {each.resolvedPath for each in assets if each and each.resolvedPath}
    return files


def stage_space(stage: Any) -> tuple[float, str]:
    """Metres per unit and up axis of a stage."""
    return float(UsdGeom.GetStageMetersPerUnit(stage)), str(UsdGeom.GetStageUpAxis(stage))


def in_world(local_to_stage: Array, to_world: Array) -> Array:
    """(..., 4, 4) matrices to the stage's space continued to the world; row vectors."""
    whole = np.array(local_to_stage, dtype=np.float64)
    whole[..., :3] = whole[..., :3] @ to_world
    return whole


def transformed(points: Array, matrix: Array) -> Array:
    """(..., 3) points by a (4, 4) matrix, row vectors."""
    return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])


def open_stage(path: str | Path) -> Any:
    """Open a USD file with all payloads. Raises InputError if that fails."""
    if not Path(path).is_file():
        fault = "is a folder" if Path(path).is_dir() else "file does not exist"
        raise InputError(Problem(str(path), "", fault))
    if not os.access(path, os.R_OK):
        raise InputError(Problem(str(path), "", "no permission to read it"))
    opened = str(path)
    try:
        stage = Usd.Stage.Open(opened)
        # USD keeps layers that are open elsewhere in this process; the file may be newer. Layers
        # with edits that are not saved belong to the host, and are read as they stand there.
        for layer in stage.GetUsedLayers():
            if not layer.dirty:
                opened = layer.realPath or opened
                layer.Reload()
    except Tf.ErrorException as error:
        reason = "; ".join(str(part.commentary) for part in error.args)
        raise InputError(Problem(opened, "", f"USD cannot open it: {reason}")) from error
    return stage


def open_scene(path: Path, place: Place) -> SourceScene | None:
    """Open a stage with its payloads; None after adding a problem at the place that names it."""
    try:
        stage = open_stage(path)
    except InputError as error:
        for problem in error.problems:
            place.fail(f"{problem.source}: {problem.message}")
        return None
    clips = broken_clips(stage)
    for file, reason in clips.items():
        place.fail(f"{file}: {reason}")
    if clips:
        return None
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit):
        warnings.warn(
            f"{path}: metersPerUnit is not authored, which means centimetres", InputWarning, 2
        )
    scale = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not (np.isfinite(scale) and scale > 0.0):
        place.fail(f"{path}: metersPerUnit is {scale:g}, expects a number above 0")
        return None
    turn = np.eye(3)
    if str(UsdGeom.GetStageUpAxis(stage)) == "Y":
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return SourceScene(path, stage, scale * turn)


def find_prim(scene: SourceScene, path: str, place: Place) -> Any:
    """The prim at a path, also within an instance; None after adding a problem."""
    if not Sdf.Path.IsValidPathString(path) or not Sdf.Path(path).IsAbsolutePath():
        place.fail(f"'{path}' is no absolute prim path such as /Bird/body")
        return None
    prim = scene.stage.GetPrimAtPath(path)
    if not prim:
        place.fail(_absent(scene, Sdf.Path(path)) + broken_note(scene))
        return None
    if not prim.IsActive():
        place.fail(f"{path} is inactive in {scene.path}")
    elif not prim.IsDefined():
        place.fail(
            f"{path} is only an over in {scene.path}: nothing defines it{broken_note(scene)}"
        )
    elif prim.IsAbstract():
        place.fail(f"{path} is a class in {scene.path}, which stands for no prim by itself")
    else:
        return prim
    return None


def broken_note(scene: SourceScene) -> str:
    """What may be the reason that a prim is not there, as the end of a message."""
    return "".join(f"; {file}: {why}" for file, why in broken_files(scene.stage).items())


def _absent(scene: SourceScene, path: Any) -> str:
    parent = path.GetParentPath()
    while parent and not scene.stage.GetPrimAtPath(parent):
        parent = parent.GetParentPath()
    above = scene.stage.GetPrimAtPath(parent) if parent else None
    if above and not above.IsPseudoRoot() and not above.IsActive():
        return f"no prim {path} in {scene.path}: {parent} is inactive"
    if above:
        names = [child.GetName() for child in above.GetAllChildren()]
        known = ", ".join(names[:8]) + (", ..." if len(names) > 8 else "")
        return f"no prim {path} in {scene.path}; below {parent} there is {known or 'nothing'}"
    return f"no prim {path} in {scene.path}"


def prims_below(scene: SourceScene, prim: Any) -> Iterator[Any]:
    """A prim and all below it, also within instances, but not below point instancers."""
    walk = iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    for each in walk:
        if each.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
        yield each


def rest_code(attribute: Any) -> Any:
    """Default where the attribute has a default value, else its first sample's time."""
    return EARLIEST if attribute.Get(DEFAULT) is None else DEFAULT


def codes_of(attribute: Any) -> list[Any]:
    """Every time at which an attribute has a value of its own: its default, then its samples."""
    default = [] if attribute.Get(DEFAULT) is None else [DEFAULT]
    return default + [Usd.TimeCode(time) for time in attribute.GetTimeSamples()]


def transform_code(prim: Any, code: Any) -> Any:
    """The time to read transforms at: code, but the first samples where an op has no default."""
    if not code.IsDefault():
        return code
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable) and any(
            op.GetAttr().Get(DEFAULT) is None for op in UsdGeom.Xformable(prim).GetOrderedXformOps()
        ):
            return EARLIEST
        prim = prim.GetParent()
    return code


def sampled_range(prim: Any, attributes: Sequence[Any]) -> tuple[float, float] | None:
    """First and last time code with samples of attributes, or of any transform of a prim."""
    every = [each for each in (*attributes, *_transforms(prim)) if each]
    # a single sample is a constant
    moving = [each.GetTimeSamples() for each in every if each.GetNumTimeSamples() > 1]
    return (min(each[0] for each in moving), max(each[-1] for each in moving)) if moving else None


def transform_fault(scene: SourceScene, prim: Any) -> str:
    """Where the transforms of a prim are not finite, at any of their samples; empty if nowhere."""
    transforms = _transforms(prim)
    times = sorted({time for each in transforms for time in each.GetTimeSamples()})
    for code in (DEFAULT, *map(Usd.TimeCode, times)):
        if not np.isfinite(scene.matrix(prim, code)).all():
            where = "by default" if code.IsDefault() else f"at time code {code.GetValue():g}"
            return f"{prim.GetPath()} in {scene.path}: transforms are not finite {where}"
    return ""


def _transforms(prim: Any) -> list[Any]:
    """The attributes of the transforms of a prim and of all above it."""
    found: list[Any] = []
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            found += [op.GetAttr() for op in UsdGeom.Xformable(prim).GetOrderedXformOps()]
        prim = prim.GetParent()
    return found


def refuse_inputs(outputs: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Raise OutputError for every output that is an input, or a layer that one is made of.

    inputs: files that were read, USD or not.
    """
    existing = [path for path in outputs if path.is_file()]
    if not existing:
        return
    files = [file for path in dict.fromkeys(inputs) for file in _files_of(path) if file.is_file()]
    problems = [
        Problem(str(path), "", "is an input of this work; choose another name")
        for path in existing
        if any(os.path.samefile(path, file) for file in files)
    ]
    if problems:
        raise OutputError(*problems)


def _files_of(path: Path) -> list[Path]:
    """A file, and what it names if it is a USD file: layers at any depth, clips, textures."""
    if path.suffix.lower() not in _SUFFIXES:
        return [path]
    try:
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(path))
    except Tf.ErrorException:
        return [path]  # what a broken file names is not read either
    return [path, *(Path(layer.realPath) for layer in layers), *map(Path, assets)]
