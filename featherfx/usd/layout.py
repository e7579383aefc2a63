"""How a cache is spread over layers: one flat file, or root -> payload -> animation.

In the payload layout the animation is a sublayer of the payload. The payload layer is the
stronger one and a default there would hide the samples of the weaker layer, so everything that
moves (defaults included) stands in the animation layer only.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from featherfx.usd import arrays
from featherfx.usd.output import output_files
from featherfx.usd.stage import StageInfo, author_metadata, define_root, new_layer


@dataclass(frozen=True)
class CacheLayers:
    """The layers of a cache in memory.

    root: what users open. topology: takes the prims and all that is constant. animation: takes
    the samples. In the flat layout all three are one layer.
    """

    root: Any
    topology: Any
    animation: Any


def new_layers(info: StageInfo, layout: str) -> CacheLayers:
    """Empty layers of a layout ("flat" or "payload")."""
    if layout == "flat":
        layer = new_layer(info)
        return CacheLayers(layer, layer, layer)
    return CacheLayers(new_layer(info), new_layer(info), new_layer(info))


def finish_layers(layers: CacheLayers, info: StageInfo, path: Path, extent: Any) -> list[Any]:
    """Connect the layers and pair each with its file, in the order of publication.

    extent: (2, 3) stage units, of everything at all times: lets tools place an unloaded payload.
    """
    files = output_files(path, "flat" if layers.root is layers.topology else "payload")
    if len(files) > 1:
        animation, payload, _ = files
        stage = Usd.Stage.Open(layers.root, Usd.Stage.LoadNone)
        root = define_root(stage, info)
        # Sdf level: the file does not exist yet, and a composed stage would complain.
        del stage, root
        spec = layers.root.GetPrimAtPath(info.root_path)
        spec.payloadList.Prepend(Sdf.Payload(f"./{payload.name}"))
        layers.topology.subLayerPaths.append(f"./{animation.name}")
    _author_extents_hint(layers.root, info, extent)
    author_metadata(layers.root, info.metadata)
    ordered = [layers.animation, layers.topology, layers.root][-len(files) :]
    return list(zip(ordered, files, strict=True))


def _author_extents_hint(layer: Any, info: StageInfo, extent: Any) -> None:
    path = info.root_path.AppendProperty(UsdGeom.Tokens.extentsHint)
    Sdf.JustCreatePrimAttributeInLayer(layer, path, Sdf.ValueTypeNames.Float3Array)
    layer.GetAttributeAtPath(path).default = arrays.vec3f(np.asarray(extent))
    schemas = Sdf.TokenListOp.Create(prependedItems=["GeomModelAPI"])
    layer.GetPrimAtPath(info.root_path).SetInfo("apiSchemas", schemas)
