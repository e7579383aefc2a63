"""Layers, their metadata and the prims that everything else stands under."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom

from featherfx.usd.space import StageSpace
from featherfx.usd.types import BARB, MESH, RACHIS

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


def define_root(stage: Any, info: StageInfo, kind: str = Kind.Tokens.component) -> Any:
    """The root prim, a model, at its origin."""
    form = UsdGeom.Xform.Define(stage, info.root_path)
    if info.space.is_moved:
        place = info.space.positions(np.array(info.space.origin))
        form.AddTranslateOp().Set(Gf.Vec3d(*place.tolist()))
    root = form.GetPrim()
    Usd.ModelAPI(root).SetKind(kind)
    return root
