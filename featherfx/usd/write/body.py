"""Layers beside a cache that move a body as its act does, over the file of the skin.

The layer has that file as its sublayer. The root of the model is carried by a transform, with all
that stands below it; what moves there by itself is held as it is at the first frame.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from featherfx.files.atomic_write import standing
from featherfx.shot.motion.body import BodySurface
from featherfx.shot.types import Shot
from featherfx.usd.read.opening import open_stage
from featherfx.usd.types import StageSpace
from featherfx.usd.write.layers import publish
from featherfx.usd.write.output import check_output, refuse_inputs

_OP = "xformOp:transform:act"
_METADATA = ("metersPerUnit", "upAxis", "timeCodesPerSecond", "framesPerSecond", "defaultPrim")


def list_bodies(shot: Shot, output: Path) -> dict[Path, BodySurface]:
    """Return the bodies that the act of a shot carries, by the files of their layers beside a
    cache."""
    parts = () if shot.skin is None else shot.skin.parts
    surfaces: dict[Path, Any] = {part.surface.file: part.surface for part in parts}
    found = [each for each in surfaces.values() if isinstance(each, BodySurface)]
    names = [f"{output.stem}.body{k if k > 1 else ''}.usda" for k in range(1, len(found) + 1)]
    return {output.with_name(name): each for name, each in zip(names, found, strict=True)}


def check_bodies(shot: Shot, output: Path, overwrite: bool) -> None:
    """Raise InputError where layers of bodies are there already, or are a file of the skin."""
    for path, body in list_bodies(shot, output).items():
        refuse_inputs([path], [body.file])
        check_output(path, overwrite)


def write_bodies(shot: Shot, output: Path, frames: tuple[int, int]) -> list[Path]:
    """Write the layers of the bodies of a shot beside a cache, and return their paths.

    Raises OutputError where one cannot be written.
    """
    found = list_bodies(shot, output)
    for path, body in found.items():
        publish([(_make_layer(shot, body, path, frames), path)], {path: standing(path)})
    return list(found)


def _make_layer(shot: Shot, body: BodySurface, path: Path, frames: tuple[int, int]) -> Any:
    assert shot.skin is not None
    clock, stage = shot.skin.clock, open_stage(body.file)
    layer, source = Sdf.Layer.CreateAnonymous(".usda"), stage.GetRootLayer()
    layer.subLayerPaths = [Path(os.path.relpath(body.file, path.parent)).as_posix()]
    for name in _METADATA:
        if source.pseudoRoot.HasInfo(name):
            layer.pseudoRoot.SetInfo(name, source.pseudoRoot.GetInfo(name))
    codes = [clock.code(shot.time_of(frame)) for frame in range(frames[0], frames[1] + 1)]
    layer.startTimeCode, layer.endTimeCode = codes[0], codes[-1]
    root = stage.GetPrimAtPath(Sdf.Path(body.path).GetPrefixes()[0])
    for prim in Usd.PrimRange(root):
        for attribute in prim.GetAttributes():
            if attribute.GetNumTimeSamples():
                _author(
                    layer, attribute.GetPath(), attribute.GetTypeName(), attribute.Get(clock.start)
                )
    op = root.GetPath().AppendProperty(_OP)
    _author(layer, op, Sdf.ValueTypeNames.Matrix4d, Gf.Matrix4d(1.0))
    to_world = StageSpace(*body.space).to_world
    back = np.linalg.inv(to_world)
    for code in codes:
        turn, way = body.carriers(code)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[3, :3] = to_world @ turn.T @ back, way @ back
        layer.SetTimeSample(op, code, Gf.Matrix4d(matrix.tolist()))
    order = list(UsdGeom.Xformable(root).GetXformOpOrderAttr().Get() or [])
    _author(
        layer,
        root.GetPath().AppendProperty("xformOpOrder"),
        Sdf.ValueTypeNames.TokenArray,
        Vt.TokenArray(
            [
                *(name for name in order if name.startswith("!")),
                _OP,
                *(name for name in order if not name.startswith("!")),
            ]
        ),
        Sdf.VariabilityUniform,
    )
    return layer


def _author(
    layer: Any, path: Any, kind: Any, value: Any, variability: Any = Sdf.VariabilityVarying
) -> None:
    Sdf.JustCreatePrimAttributeInLayer(layer, path, kind, variability)
    layer.GetAttributeAtPath(path).default = value
