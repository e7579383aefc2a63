"""Caches merged to one file: layers flattened, shares joined under one root."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from featherfx.errors import Problem
from featherfx.files.atomic_write import standing
from featherfx.usd.read.cached_feather import has_faces, read_members
from featherfx.usd.read.mesh_topology import check_points
from featherfx.usd.read.values import compute, fault, open_stage
from featherfx.usd.types import OutputError
from featherfx.usd.write.layers import author_extents_hint, publish
from featherfx.usd.write.output import check_output, refuse_inputs
from featherfx.usd.write.previous_cache import read_metadata

Publish = Callable[[Any], Path]


def begin_export(path: str | Path, output: str | Path, overwrite: bool) -> tuple[Any, Publish]:
    """Open a cache for export; return its stage, and a function that publishes a layer.

    The function returns the path of the output. Raises InputError where the cache cannot be read,
    points are not finite or change their number, or the output cannot be written.
    """
    target = check_output(output, overwrite)
    before = {target: standing(target)}
    stage = open_stage(path)
    refuse_inputs([target], [Path(path)])
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointBased):
            attribute = UsdGeom.PointBased(prim).GetPointsAttr()
            message, _ = check_points(attribute)
            if message:
                raise fault(attribute, f"{message}. Bake the cache again")
        if prim.IsA(UsdGeom.Mesh):
            has_faces(UsdGeom.Mesh(prim))

    def written(layer: Any) -> Path:
        publish([(layer, target)], before)
        return target

    return stage, written


def flatten_stage(stage: Any) -> Any:
    """Return the composed stage as one layer in memory."""
    return compute(stage.GetPseudoRoot(), stage.Flatten, False)


def copy_layer(layer: Any) -> Any:
    """Return a copy of a layer to change and to write."""
    # Export goes by the suffix of the layer's own name; a plain copy has the right one.
    copy = Sdf.Layer.CreateAnonymous(".usda")
    copy.TransferContent(layer)
    return copy


def notes_of(stage: Any) -> dict[str, Any]:
    """Return what a cache says of itself, without what is true of its bake alone."""
    told = stage.GetRootLayer().customLayerData.get("featherfx")
    return {k: v for k, v in told.items() if k not in _OF_BAKE} if isinstance(told, dict) else {}


def flatten(path: str | Path, output: str | Path, overwrite: bool = False) -> Path:
    """Write a cache of any layout as one file without references, clips or sublayers.

    output: .usd, .usdc or .usda. The samples of the whole cache are in memory meanwhile. Raises
    InputError where one cannot be read or the other not be written.
    """
    stage, written = begin_export(path, output, overwrite)
    layer = copy_layer(flatten_stage(stage))
    if source := stage.GetRootLayer().customLayerData:
        layer.customLayerData = source
    return written(layer)


# notes of a bake, which a cache in another form is not
_OF_BAKE = ("settings", "inputs", "dependences", "layout", "chunk")
_DIFFERING = "feathers"  # the only setting in which shares of one cache differ
_METADATA = (
    "metersPerUnit", "upAxis", "timeCodesPerSecond", "framesPerSecond", "startTimeCode",
    "endTimeCode", "defaultPrim",
)  # fmt: skip


def join_shares(path: str | Path, shares: Sequence[Path], overwrite: bool = False) -> int:
    """Write the root file of a cache over its shares, and return the number of feathers.

    shares: one file each, in the folder of path. Raises OutputError, with everything that is
    wrong, where a share is missing, cannot be read, or was baked with other settings than the
    first; then nothing is written.
    """
    path = check_output(path, overwrite)
    before = {path: standing(path)}
    problems = [
        Problem(str(each), "", "is missing. Bake this share first")
        for each in shares
        if not each.is_file()
    ]
    if problems:
        raise OutputError(*problems)
    metadata = [read_metadata(each) for each in shares]
    for share, each in zip(shares, metadata, strict=True):
        problems += _settings_differences(
            share, each.get("settings", {}), metadata[0].get("settings", {})
        )
    if problems:
        raise OutputError(*problems)
    layers = []
    for share in shares:
        try:
            layers.append(Sdf.Layer.OpenAsAnonymous(str(share)))
        except Tf.ErrorException as error:
            raise OutputError(
                Problem(str(share), "", "USD cannot open it. Bake it again")
            ) from error
    root = _root_layer(layers, shares, metadata[0])
    publish([(root, path)], before)
    stage = Usd.Stage.Open(str(path))
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    return sum(len(read_members(prim)) or 1 for prim in meshes)


def _settings_differences(share: Path, settings: Any, first: Any) -> list[Problem]:
    if not settings:
        return [
            Problem(str(share), "", "does not say with which settings it was baked. Bake it again")
        ]
    return [
        Problem(
            str(share), key, f"was {settings.get(key)}, but {first.get(key)} in the first share"
        )
        for key in {**first, **settings}
        if key != _DIFFERING and settings.get(key) != first.get(key)
    ]


def _root_layer(layers: Sequence[Any], shares: Sequence[Path], metadata: Any) -> Any:
    first, root = layers[0], Sdf.Layer.CreateAnonymous(".usda")
    for name in _METADATA:
        root.pseudoRoot.SetInfo(name, first.pseudoRoot.GetInfo(name))
    root.subLayerPaths = [f"./{share.name}" for share in shares]
    settings = {**metadata["settings"], _DIFFERING: "all"}
    root.customLayerData = {"featherfx": {**metadata, "settings": settings, "layout": "shares"}}
    prim = Sdf.Path.absoluteRootPath.AppendChild(first.defaultPrim)
    name = prim.AppendProperty(UsdGeom.Tokens.extentsHint)
    hints = np.stack([np.asarray(layer.GetAttributeAtPath(name).default) for layer in layers])
    author_extents_hint(root, prim, [hints[:, 0].min(axis=0), hints[:, 1].max(axis=0)])
    return root
