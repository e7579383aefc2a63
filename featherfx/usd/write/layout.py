"""Layers: what each says of itself, and how a cache is spread over them.

    flat     one file
    payload  root -> payload (topology), with the animation as its sublayer
    clips    root, which holds the clips' metadata -> payload (topology); chunks as value clips

The metadata stands on the scopes below the default prim, not on that itself: where others make an
instance of the default prim, clips on it would not reach what is in its prototype.

A stronger default hides samples of weaker layers and of clips. So what moves has its default in
the animation layer of the payload layout, and in the clips layout in the payload, which is weaker
than the root that names the clips.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom

from featherfx.usd import arrays
from featherfx.usd.space import StageSpace
from featherfx.usd.types import BARB, MESH, RACHIS
from featherfx.usd.write.output import output_files

FEATHERS, RACHISES, BARBS = "feathers", "rachises", "barbs"
MATERIALS = "materials"
# where the prims of feathers stand, and what their names end with
SCOPES = {MESH: (FEATHERS, ""), RACHIS: (RACHISES, "_rachis"), BARB: (BARBS, "_barbs")}


@dataclass(frozen=True)
class StageInfo:
    """What every layer of a cache says of itself.

    root: name of the root prim. frames: first and last frame (None: no time). metadata: kept as
    the root layer's custom data.
    """

    root: str
    space: StageSpace
    frames: tuple[float, float] | None
    frames_per_second: float
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def root_path(self) -> Any:
        return Sdf.Path.absoluteRootPath.AppendChild(self.root)


def new_layer(info: StageInfo) -> Any:
    """An empty layer in memory with the stage's metadata and the root prim as an over."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.defaultPrim = info.root
    world = layer.pseudoRoot
    world.SetInfo(UsdGeom.Tokens.upAxis, info.space.up_axis)
    world.SetInfo(UsdGeom.Tokens.metersPerUnit, info.space.meters_per_unit)
    layer.framesPerSecond = layer.timeCodesPerSecond = info.frames_per_second
    if info.frames is not None:
        layer.startTimeCode, layer.endTimeCode = map(float, info.frames)
    Sdf.CreatePrimInLayer(layer, info.root_path)
    return layer


def author_metadata(layer: Any, metadata: Mapping[str, Any]) -> None:
    """Custom layer data under the key "featherfx"."""
    if metadata:
        layer.customLayerData = {"featherfx": dict(metadata)}


def define_root(stage: Any, info: StageInfo) -> Any:
    """The root prim, a model, at its origin."""
    form = UsdGeom.Xform.Define(stage, info.root_path)
    if info.space.is_moved:
        place = info.space.positions(np.array(info.space.origin))
        form.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
    root = form.GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
    return root


@dataclass(frozen=True)
class CacheLayers:
    """The layers of a cache in memory.

    root: what users open. topology: takes the prims and all that is constant. animation: takes
    the samples and the default values of what has samples. In the flat layout all three are one
    layer; with clips the last two are.
    """

    layout: str
    root: Any
    topology: Any
    animation: Any


@dataclass(frozen=True)
class Clips:
    """Chunks as value clips. manifest, files: in any folder at or below the root file's.

    starts: first time code of each. end: last code of all. scopes: prims below the root prim that
    hold all that moves.
    """

    name: str
    manifest: Path
    files: Sequence[Path]
    starts: Sequence[float]
    end: float
    scopes: Sequence[Any]


def new_layers(info: StageInfo, layout: str) -> CacheLayers:
    """Empty layers of a layout ("flat", "payload" or "clips")."""
    if layout == "flat":
        layer = new_layer(info)
        return CacheLayers(layout, layer, layer, layer)
    topology = new_layer(info)
    animation = topology if layout == "clips" else new_layer(info)
    return CacheLayers(layout, new_layer(info), topology, animation)


def finish_layers(
    layers: CacheLayers, info: StageInfo, path: Path, extent: Any, clips: Clips | None
) -> list[Any]:
    """Connect the layers and pair each with its file, in the order of publication.

    extent: (2, 3) stage units, of everything at all times: lets tools place an unloaded payload.
    """
    files = output_files(path, layers.layout)
    if len(files) > 1:
        stage = Usd.Stage.Open(layers.root, Usd.Stage.LoadNone)
        root = define_root(stage, info)
        # Sdf level: the file does not exist yet, and a composed stage would complain.
        del stage, root
        spec = layers.root.GetPrimAtPath(info.root_path)
        spec.payloadList.Prepend(Sdf.Payload(f"./{files[-2].name}"))
    if layers.layout == "payload":
        layers.topology.subLayerPaths.append(f"./{files[0].name}")
    if clips is not None:
        _author_clips(layers.root, path.parent, clips)
    author_extents_hint(layers.root, info.root_path, extent)
    author_metadata(layers.root, info.metadata)
    ordered = [layers.animation, layers.topology, layers.root][-len(files) :]
    return list(zip(ordered, files, strict=True))


def _author_clips(layer: Any, folder: Path, clips: Clips) -> None:
    def asset(file: Path) -> Any:
        return Sdf.AssetPath(f"./{file.relative_to(folder).as_posix()}")

    first = clips.starts[0]
    values = {
        "assetPaths": Sdf.AssetPathArray([asset(file) for file in clips.files]),
        "manifestAssetPath": asset(clips.manifest),
        "active": arrays.vec2d([(start, k) for k, start in enumerate(clips.starts)]),
        "times": arrays.vec2d([(first, first), (clips.end, clips.end)]),
    }
    for scope in clips.scopes:
        spec = Sdf.CreatePrimInLayer(layer, scope)
        spec.SetInfo("clips", {clips.name: values | {"primPath": str(scope)}})


def author_extents_hint(layer: Any, root: Any, extent: Any) -> None:
    """(2, 3) stage units, of everything below the root prim, in a layer that has it."""
    path = root.AppendProperty(UsdGeom.Tokens.extentsHint)
    Sdf.JustCreatePrimAttributeInLayer(layer, path, Sdf.ValueTypeNames.Float3Array)
    layer.GetAttributeAtPath(path).default = arrays.vec3f(np.asarray(extent))
    schemas = Sdf.TokenListOp.Create(prependedItems=["GeomModelAPI"])
    layer.GetPrimAtPath(root).SetInfo("apiSchemas", schemas)
