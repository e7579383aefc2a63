"""Stages of others: opened from disk, measured, and their prims found by path."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Pcp, Sdf, Usd, UsdGeom, UsdSkel

from featherfx.algebra.types import Array
from featherfx.errors import InputError, some_of, warn_input
from featherfx.groom.keys.problems import Place, Problems, closest
from featherfx.phases import LeftOut
from featherfx.usd.read.values import (
    DEFAULT_TIME,
    EARLIEST_TIME,
    USD_ERRORS,
    compute,
    describe_error,
    describe_time,
    list_transforms,
    locate_package,
    open_stage,
    read_matrix,
    read_times,
    read_value,
)
from featherfx.usd.types import StageSpace

# what grooms and shots name in a stage
PRIM_KINDS = {
    "mesh": UsdGeom.Mesh,
    "skeleton": UsdSkel.Skeleton,
    "curves": UsdGeom.Curves,
    "camera": UsdGeom.Camera,
    "instancer": UsdGeom.PointInstancer,
    "points": UsdGeom.PointBased,
}

# paths that are listed: all where there are so few, else the nearest
_MAX_LISTED, _LISTED_NEAREST = 8, 3


@dataclass(frozen=True)
class SourceScene:
    """An open stage. path: its file. variant_sets: chosen in it, beside its own choices."""

    path: Path
    stage: Any
    variant_sets: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def to_world(self) -> Array:
        """Return (3, 3) from the stage to the world, metres and z up, for row vectors."""
        return StageSpace(*self.space).to_world

    @property
    def time_codes_per_second(self) -> float:
        return float(self.stage.GetTimeCodesPerSecond())

    @property
    def meters_per_unit(self) -> float:
        return self.space[0]

    @property
    def space(self) -> tuple[float, str]:
        """Return metres per unit and up axis of the stage."""
        return read_stage_space(self.stage)

    @property
    def files(self) -> tuple[Path, ...]:
        """Return every file that the open stage is made of, clips included; no textures."""
        layers = {layer.realPath for layer in self.stage.GetUsedLayers()} | clip_files(self.stage)
        return tuple(sorted({locate_package(Path(path))[0] for path in layers if path}))

    @cached_property
    def paths(self) -> dict[str, list[str]]:
        """Return paths of the prims of each of PRIM_KINDS."""
        found: dict[str, list[str]] = {kind: [] for kind in PRIM_KINDS}
        for prim in prims_below(self.stage.GetPseudoRoot()):
            if kind := prim_kind(prim):
                found[kind].append(str(prim.GetPath()))
        return found

    def matrix(self, prim: Any, code: Any) -> Array:
        """Return (4, 4) local space of a prim to the world, row vectors, at a time code."""
        return to_world_matrix(read_matrix(prim, code), self.to_world)


class ScenePrim:
    """A prim of a scene, as the base of readers of its motion.

    path: of the prim. left: prims that were not taken beside it.
    """

    left: tuple[LeftOut, ...] = ()
    sampled: tuple[float, float] | None

    def __init__(self, scene: SourceScene, prim: Any) -> None:
        self._scene, self._prim, self.path = scene, prim, str(prim.GetPath())

    @property
    def time_codes_per_second(self) -> float:
        return self._scene.time_codes_per_second

    @property
    def has_rate(self) -> bool:
        names = ("timeCodesPerSecond", "framesPerSecond")
        return any(self._scene.stage.HasAuthoredMetadata(name) for name in names)

    def describe_motion(self, codes: Sequence[float]) -> str:
        """Return how it changes over the time codes of a shot, in words."""
        if self.sampled is None:
            return "still"
        return f"changes from time code {self.sampled[0]:g} to {self.sampled[1]:g}"

    @property
    def origin(self) -> tuple[Any, ...]:
        return self.path, self._scene.files, dict(self.variant_sets)

    @property
    def file(self) -> Path:
        """Return the file of the scene."""
        return self._scene.path

    @property
    def variant_sets(self) -> Mapping[str, str]:
        """Return the variants that are chosen in the scene by the names of their sets."""
        return self._scene.variant_sets


def list_broken(stage: Any) -> dict[str, str]:
    """Return layers that a stage names and that cannot be opened, prims with missing or cyclic
    references, and why."""
    found: dict[str, str] = {}
    for layer in stage.GetUsedLayers():
        if fault := _variant_fault(layer):
            found[layer.realPath or layer.identifier] = fault
            continue
        # an arc within the layer has no name
        for name in filter(None, layer.GetCompositionAssetDependencies()):
            path = Sdf.ComputeAssetPathRelativeToLayer(layer, name)
            found[path] = _opening_fault(path)
    return {path: reason for path, reason in found.items() if reason} | _list_broken_arcs(stage)


def _variant_fault(layer: Any) -> str:
    """Return the fault of the variants of a layer; empty where there is none.

    USD ends the process where it meets a variant that is listed and not there.
    """
    prims = list(layer.rootPrims)
    while prims:
        prim = prims.pop()
        prims += prim.nameChildren
        for name, variants in prim.variantSets.items():
            if variants is None:  # its name is all that the file has
                return f"is damaged: {prim.path} has no variants of '{name}'"
            for variant, _ in variants.variants.items():
                at = prim.path.AppendVariantSelection(name, variant)
                if not variant or not layer.GetObjectAtPath(at):
                    return f"is damaged: {prim.path} has no variant '{variant}' of '{name}'"
    return ""


def broken_clips(stage: Any) -> dict[str, str]:
    """Return value clips of a stage that exist and cannot be opened, and why."""
    found = {path: _opening_fault(path) for path in sorted(clip_files(stage))}
    return {path: reason for path, reason in found.items() if reason}


def _opening_fault(path: str) -> str:
    if os.path.isfile(path) and not os.access(path, os.R_OK):
        return "no permission to read it"
    try:
        if Sdf.Layer.FindOrOpen(path):
            return ""
        is_turned = os.path.isfile(path.replace("\\", "/"))
        return "is missing; write / where its name has a backslash" if is_turned else "is missing"
    except USD_ERRORS as error:
        return f"USD cannot open it: {describe_error(error)}"


def _list_broken_arcs(stage: Any) -> dict[str, str]:
    return {
        str(prim.GetPath()): _arc_fault(error)
        for prim in stage.TraverseAll()
        for error in prim.GetPrimIndex().localErrors
        if not isinstance(error, Pcp.ErrorInvalidAssetPathBase)
    }


def _arc_fault(error: Any) -> str:
    if isinstance(error, Pcp.ErrorArcCycle):
        return "its references form a cycle"
    # layers of a session, which only this process has, are named with the stage's own
    text = re.sub(r",@anon:[^@]*@", "", " ".join(str(error).split()))
    found = re.match(r"Unresolved \w+ prim path (\S+)", text)
    return f"refers to {found[1]}, which is not there" if found else text


def clip_files(stage: Any) -> set[str]:
    """Return existing value clips of a stage, and their manifests."""
    files: set[str] = set()
    for prim in stage.TraverseAll():
        files |= compute(prim, _clip_files, Usd.ClipsAPI(prim))
    return files - {""}


def _clip_files(api: Any) -> set[str]:
    assets: list[Any] = []
    for name, values in (api.GetClips() or {}).items():
        assets += [*api.ComputeClipAssetPaths(name), values.get("manifestAssetPath")]
    return {each.resolvedPath for each in assets if isinstance(each, Sdf.AssetPath)}


def read_stage_space(stage: Any) -> tuple[float, str]:
    """Return metres per unit and up axis of a stage."""
    return float(UsdGeom.GetStageMetersPerUnit(stage)), str(UsdGeom.GetStageUpAxis(stage))


def to_world_matrix(local_to_stage: Array, to_world: Array) -> Array:
    """Return (..., 4, 4) matrices to the stage's space continued to the world; row vectors."""
    whole = np.array(local_to_stage, dtype=np.float64)
    whole[..., :3] = whole[..., :3] @ to_world
    return whole


def transform_points(points: NDArray[Any], matrix: Array) -> Array:
    """Return (..., 3) points transformed by a (4, 4) matrix, row vectors."""
    x, y, z = (np.asarray(points[..., k], dtype=np.float64) for k in range(3))
    moved = np.empty(points.shape)
    for k in range(3):  # ten times as fast as a product of so narrow matrices
        moved[..., k] = x * matrix[0, k] + y * matrix[1, k] + z * matrix[2, k] + matrix[3, k]
    return moved


def open_scene(path: Path, place: Place) -> SourceScene:
    """Open a stage with its payloads. Raises InputError at the place that names it.

    Layers that have other units than the stage are InputWarnings.
    """
    try:
        stage = open_stage(path)
        clips = broken_clips(stage)
    except InputError as error:
        own = (
            replace(each, source="") if each.source == place.source else each
            for each in error.problems
        )
        place.refuse(*map(str, own))
    if clips:
        place.refuse(*(f"{file}: {reason}" for file, reason in clips.items()))
    if not stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit):
        warn_input(f"{path}: metersPerUnit is not authored, which means centimetres")
    scene = SourceScene(path, stage)
    unit = scene.meters_per_unit
    for layer in stage.GetUsedLayers():
        own = layer.pseudoRoot.GetInfo("metersPerUnit")
        if layer.pseudoRoot.HasInfo("metersPerUnit") and own != unit:
            told = f"has {own:g} m per unit, the stage {unit:g}. USD does not convert"
            message = f"{path}: {layer.realPath} {told}: scale what it holds by {own / unit:g}"
            warn_input(message)
    return scene


def open_chosen(path: Path, entry: Mapping[str, Any], file: Place, place: Place) -> SourceScene:
    """Open the stage of a table with the variants that it chooses.

    Layers that are missing are InputWarnings. entry: checked keys. file: of the key that names the
    stage. place: of the table.
    """
    scene = open_scene(path, file)
    for name, why in list_broken(scene.stage).items():
        told = "What it holds is not read: mend it, or remove what names it"
        warn_input(f"{path}: {name}: {why}. {told}")
    return choose_variants(scene, entry.get("variant_sets", {}), place.child("variant_sets"))


def choose_variants(scene: SourceScene, chosen: Mapping[str, str], place: Place) -> SourceScene:
    """Return a scene with variants chosen by the names of their sets, on every prim that has one.

    The stage's files stay as they are. Raises InputError at the place of the table.
    """
    variants: dict[str, set[str]] = {}
    is_open = bool(chosen)
    with Usd.EditContext(scene.stage, scene.stage.GetSessionLayer()):
        while is_open:  # a variant may hold prims with sets of their own
            is_open = False
            for prim in list(scene.stage.TraverseAll()):
                # it may have gone with another choice
                own_sets = prim.GetVariantSets().GetNames() if prim else ()
                for name in set(own_sets) & set(chosen):
                    own = prim.GetVariantSet(name)
                    variants.setdefault(name, set()).update(own.GetVariantNames())
                    wanted = chosen[name] in own.GetVariantNames()
                    if wanted and own.GetVariantSelection() != chosen[name]:
                        own.SetVariantSelection(chosen[name])
                        is_open = True
    problems = Problems()
    for name, variant in chosen.items():
        at = replace(place.child(name), problems=problems)
        if name not in variants:
            sets = describe_variants(scene) or "The stage has no variant sets"
            at.fail(f"no variant set '{name}' in {scene.path}. {sets}")
        elif variant not in variants[name]:
            at.unknown(f"'{name}' has no variant '{variant}'", variant, variants[name])
    problems.raise_any()
    return replace(scene, variant_sets=chosen)


def describe_variants(scene: SourceScene) -> str:
    """Return the variant sets of a stage in words; empty where it has none."""
    found: dict[str, list[str]] = {}
    for prim in scene.stage.TraverseAll():
        for name in prim.GetVariantSets().GetNames():
            own = prim.GetVariantSet(name)
            variants, chosen = ", ".join(own.GetVariantNames()), own.GetVariantSelection()
            told = f"variant set '{name}' of {prim.GetPath()} has {variants}"
            found.setdefault(name, []).append(f"{told} ('{chosen}' is chosen)")
    listed = [told for several in found.values() for told in several]
    named = some_of(listed, _MAX_LISTED, "; ")
    return f"Its {named}: variant_sets chooses others" if listed else ""


def prim_kind(prim: Any) -> str:
    """Return the key of PRIM_KINDS of a prim; empty for none."""
    return next((name for name, schema in PRIM_KINDS.items() if prim.IsA(schema)), "")


def describe_prims(scene: SourceScene, kinds: Sequence[str], path: str) -> str:
    """Return paths of the prims of some of PRIM_KINDS, as the end of a message.

    Of many the nearest to a path are listed. Empty where no kind is given.
    """
    return "".join(f". {_listed(kind, scene.paths[kind], path)}" for kind in kinds)


def _listed(kind: str, paths: list[str], path: str) -> str:
    if len(paths) < 2:
        return f"The stage has one {kind}: {paths[0]}" if paths else f"The stage has no {kind}"
    if len(paths) <= _MAX_LISTED:
        return f"The stage has {len(paths)} of kind {kind}: {', '.join(paths)}"
    near = closest(path, paths, _LISTED_NEAREST) or paths[:_LISTED_NEAREST]
    return f"The stage has {len(paths)} of kind {kind}, the nearest {', '.join(near)}"


def find_prim(scene: SourceScene, path: str, place: Place, *kinds: str) -> Any:
    """Return the prim at a path, also within an instance. Raises InputError at the place.

    kinds: of PRIM_KINDS, that are listed where there is no prim at the path.
    """
    if not (
        Sdf.Path.IsValidPathString(path)
        and Sdf.Path(path).IsAbsolutePath()
        and Sdf.Path(path).IsAbsoluteRootOrPrimPath()
    ):
        there = describe_prims(scene, kinds, path)
        place.refuse(f"'{path}' is no absolute prim path such as /Bird/body{there}")
    prim = scene.stage.GetPrimAtPath(path)
    if not prim:
        there = describe_prims(scene, kinds, path)
        sets = describe_variants(scene)
        there = f"{there}. {sets}" if sets else there
        place.refuse(_absent(scene, Sdf.Path(path)) + there + describe_broken(scene))
    if not prim.IsActive():
        place.refuse(f"{path} is inactive in {scene.path}")
    if not prim.IsDefined():
        note = describe_broken(scene)
        place.refuse(f"{path} is only an over in {scene.path}: nothing defines it{note}")
    if prim.IsAbstract():
        place.refuse(f"{path} is a class in {scene.path}, which stands for no prim by itself")
    return prim


def describe_broken(scene: SourceScene) -> str:
    """Return broken files and arcs as the end of a message about a missing prim."""
    return "".join(f"; {what}: {why}" for what, why in list_broken(scene.stage).items())


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
        return f"no prim {path} in {scene.path}. Below {parent} there is {known or 'nothing'}"
    return f"no prim {path} in {scene.path}"


def prims_below(prim: Any) -> Iterator[Any]:
    """Yield a prim and all below it, also within instances, but not below point instancers."""
    walk = iter(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    for each in walk:
        if each.IsA(UsdGeom.PointInstancer):
            walk.PruneChildren()
        yield each


def rest_time(attribute: Any) -> Any:
    """Return the default time where the attribute has a default, else its first sample's."""
    return EARLIEST_TIME if read_value(attribute, DEFAULT_TIME) is None else DEFAULT_TIME


def list_times(attribute: Any) -> list[Any]:
    """Return every time at which an attribute has a value: its default, then its samples."""
    default = [] if read_value(attribute, DEFAULT_TIME) is None else [DEFAULT_TIME]
    return default + [Usd.TimeCode(time) for time in read_times(attribute)]


def list_motion_times(prim: Any, attributes: Sequence[Any]) -> list[float]:
    """Return all time codes with samples of attributes that vary, or transforms of a prim.

    None where all are constant, as one with a single sample is.
    """
    every = [each for each in (*attributes, *list_transforms(prim)) if each]
    varying = [read_times(each) for each in every if compute(each, each.ValueMightBeTimeVarying)]
    return sorted({code for times in varying if len(times) > 1 for code in times})


def sampled_range(prim: Any, attributes: Sequence[Any]) -> tuple[float, float] | None:
    """Return the first and the last of list_motion_times; None without any."""
    times = list_motion_times(prim, attributes)
    return (times[0], times[-1]) if times else None


def check_transforms(scene: SourceScene, prim: Any, place: Place) -> None:
    """Raise InputError where transforms of a prim are not finite at any of their samples."""
    times = sorted({time for each in list_transforms(prim) for time in read_times(each)})
    for code in (DEFAULT_TIME, *map(Usd.TimeCode, times)):
        if not np.isfinite(scene.matrix(prim, code)).all():
            where = f"{prim.GetPath()} in {scene.path}"
            place.refuse(f"{where}: transforms are not finite {describe_time(code)}")
