"""Layers beside a cache that move a body as its act does, over the file of the skin.

The layer has that file as its sublayer. Where the act carries the body, the root of the model moves
by a transform, with all that stands below it; what moves there by itself is held as it is at the
first frame. Skeletons whose joints the act drives are bound to an animation of their own.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from featherfx.files.atomic_write import standing
from featherfx.shot.motion.body import BodySurface
from featherfx.shot.types import Shot
from featherfx.usd.read.opening import open_stage
from featherfx.usd.read.values import USD_ERRORS
from featherfx.usd.types import OutputError, StageSpace
from featherfx.usd.write.layers import publish
from featherfx.usd.write.output import check_output, refuse_inputs

# surfaces that an act moves, by the file of the layer that shows them
Bodies = Mapping[Path, Sequence[BodySurface]]
# attributes of an animation, in the order in which USD takes transforms apart
_ANIMATED = {"translations": "Float3Array", "rotations": "QuatfArray", "scales": "Half3Array"}
_OP = "xformOp:transform:act"
_METADATA = ("metersPerUnit", "upAxis", "timeCodesPerSecond", "framesPerSecond", "defaultPrim")


def list_bodies(shot: Shot, output: Path) -> Bodies:
    """Return the bodies that the act of a shot moves, by the files of their layers beside a
    cache."""
    parts = () if shot.skin is None else shot.skin.parts
    surfaces: dict[Path, list[Any]] = {}
    for part in parts:
        surfaces.setdefault(part.surface.file, []).append(part.surface)
    # a file's surfaces of which one is moved
    moved = [[each for each in own if isinstance(each, BodySurface)] for own in surfaces.values()]
    found = [own for own in moved if own]
    names = [f"{output.stem}.body{k if k > 1 else ''}.usda" for k in range(1, len(found) + 1)]
    return {output.with_name(name): each for name, each in zip(names, found, strict=True)}


def check_bodies(bodies: Bodies, overwrite: bool, is_share: bool) -> None:
    """Raise InputError where layers of bodies are there already, or are a file of the skin.

    is_share: another share of the bake may have written them.
    """
    for path, own in bodies.items():
        refuse_inputs([path], [own[0].file])
        check_output(path, overwrite or (is_share and _is_body(path)))


def _is_body(path: Path) -> bool:
    with contextlib.suppress(*USD_ERRORS):
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
        return bool(layer) and "body" in layer.customLayerData.get("featherfx", {})
    return False


def write_bodies(
    bodies: Bodies, shot: Shot, frames: tuple[int, int], subframes: int, is_share: bool
) -> list[Path]:
    """Write the layers of the bodies of a shot beside a cache, and return their paths.

    subframes: samples a frame. is_share: all shares of a bake write the same, and any may come
    first. Raises OutputError where one cannot be written.
    """
    assert shot.skin is not None
    count = (frames[1] - frames[0]) * subframes + 1
    start, rate = shot.time_of(frames[0]), shot.frames_per_second * subframes
    codes = [shot.skin.clock.code(start + k / rate) for k in range(count)]
    for path, own in bodies.items():
        layer = _make_layer(own, path, codes, shot.skin.clock.start)
        try:
            publish([(layer, path)], {path: standing(path)})
        except OutputError:
            if not (is_share and _is_body(path)):
                raise
    return list(bodies)


def _make_layer(
    bodies: Sequence[BodySurface], path: Path, codes: Sequence[float], start: float
) -> Any:
    """The layer of the bodies of a file. codes: time codes of its samples. start: of the shot."""
    body = bodies[0]
    stage = open_stage(body.file)
    layer, source = Sdf.Layer.CreateAnonymous(".usda"), stage.GetRootLayer()
    layer.subLayerPaths = [Path(os.path.relpath(body.file, path.parent)).as_posix()]
    for name in _METADATA:
        if source.pseudoRoot.HasInfo(name):
            layer.pseudoRoot.SetInfo(name, source.pseudoRoot.GetInfo(name))
    layer.customLayerData = {"featherfx": {"body": body.path}}
    layer.startTimeCode, layer.endTimeCode = codes[0], codes[-1]
    if body.body_path is not None:
        _carry_model(layer, stage, body, codes, start)
    skeletons = {each.drive.tree.skeleton: each for each in bodies if each.drive is not None}
    for skeleton, each in skeletons.items():
        _drive_skeleton(layer, stage.GetPrimAtPath(skeleton), each, codes)
    return layer


def _carry_model(
    layer: Any, stage: Any, body: BodySurface, codes: Sequence[float], start: float
) -> None:
    """Move the root of the model of a body; hold what moves below it by itself."""
    root = stage.GetPrimAtPath(Sdf.Path(body.path).GetPrefixes()[0])
    for prim in Usd.PrimRange(root):
        for attribute in prim.GetAttributes():
            if attribute.GetNumTimeSamples():
                kind, value = attribute.GetTypeName(), attribute.Get(start)
                _author(layer, attribute.GetPath(), kind, value)
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


def _drive_skeleton(layer: Any, prim: Any, body: BodySurface, codes: Sequence[float]) -> None:
    """Write an animation below a skeleton, and bind the skeleton to it."""
    assert body.drive is not None
    tree = body.drive.tree
    above = prim
    while not above.IsPseudoRoot():  # nothing can be written below an instance
        if above.IsInstance():
            Sdf.CreatePrimInLayer(layer, above.GetPath()).instanceable = False
        above = above.GetParent()
    names = (f"act{k or ''}" for k in count())
    path = prim.GetPath().AppendChild(next(each for each in names if not prim.GetChild(each)))
    binding = Sdf.CreatePrimInLayer(layer, prim.GetPath())
    schemas = Sdf.TokenListOp()
    schemas.prependedItems = ["SkelBindingAPI"]
    binding.SetInfo("apiSchemas", schemas)
    Sdf.RelationshipSpec(binding, "skel:animationSource").targetPathList.explicitItems = [path]
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, "SkelAnimation"
    types, uniform = Sdf.ValueTypeNames, Sdf.VariabilityUniform
    joints = path.AppendProperty("joints")
    _author(layer, joints, types.TokenArray, Vt.TokenArray(tree.names), uniform)
    written = []
    for name, kind in _ANIMATED.items():
        written.append(path.AppendProperty(name))
        _author(layer, written[-1], getattr(types, kind), None)
    for code in codes:
        stands = body.joints(code)
        local = stands[:-1] @ np.linalg.inv(stands[tree.parents])
        values = UsdSkel.DecomposeTransforms(Vt.Matrix4dArray.FromNumpy(local))
        for attribute, value in zip(written, values, strict=True):
            layer.SetTimeSample(attribute, code, value)
    _keep_shapes(layer, path, prim, [body.own_code(code) for code in codes], codes)


def _keep_shapes(
    layer: Any, path: Any, prim: Any, own: Sequence[float], codes: Sequence[float]
) -> None:
    """Keep the weights of blend shapes of the animation that a skeleton had. own: its time codes at
    those of the layer."""
    cache, root = UsdSkel.Cache(), UsdSkel.Root.Find(prim)
    if root:
        cache.Populate(root, Usd.TraverseInstanceProxies())
    query = cache.GetSkelQuery(UsdSkel.Skeleton(prim)).GetAnimQuery()
    if not query or not query.GetBlendShapeOrder():
        return
    types, shapes = Sdf.ValueTypeNames, path.AppendProperty("blendShapes")
    _author(layer, shapes, types.TokenArray, query.GetBlendShapeOrder(), Sdf.VariabilityUniform)
    weights = path.AppendProperty("blendShapeWeights")
    _author(layer, weights, types.FloatArray, None)
    for code, at in zip(codes, own, strict=True):
        layer.SetTimeSample(weights, code, query.ComputeBlendShapeWeights(at))


def _author(
    layer: Any, path: Any, kind: Any, value: Any, variability: Any = Sdf.VariabilityVarying
) -> None:
    Sdf.JustCreatePrimAttributeInLayer(layer, path, kind, variability)
    if value is not None:
        layer.GetAttributeAtPath(path).default = value
