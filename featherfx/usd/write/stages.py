"""Stages around caches: layers that move a body as its act does, and flocks.

A body's layer has the file of the skin as its sublayer. Where the act carries the body, the root of
the model moves by a transform, with all that stands below it; what moves there by itself is held as
it is at the first frame. Skeletons whose joints the act drives are bound to an animation of their
own.

A flock is one stage of many birds, which names the caches of those that are near, and replays.

    /flock/bird_1_0001      a bird, which a transform over time moves along its path
        feathers, body      references to a cache, and to the layer of the body or the skin's file
    /flock_replays/...      classes, one for each replay at each phase, whose instances birds are

A replay is value clips of one cache, whose times run through its loop again and again.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdSkel, Vt

from featherfx.algebra.types import Array
from featherfx.files.atomic_write import Standing, standing
from featherfx.shot.motion.body import BodySurface
from featherfx.shot.types import Shot
from featherfx.usd import arrays
from featherfx.usd.read.values import USD_ERRORS, open_stage
from featherfx.usd.types import OutputError, StageSpace
from featherfx.usd.write.layers import StageInfo, new_layer, publish
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


_FEATHERS, _BODY, _REPLAYS = "feathers", "body", "replays"


@dataclass(frozen=True)
class BirdAsset:
    """Files that a bird shows.

    cache: its feathers. body: layer of its body, or the skin's file, and the path of its prim
    there; None: it has no skin.
    """

    cache: Path
    body: tuple[Path, str] | None


def write_model(source: Path, model: str, codes: tuple[float, float], path: Path) -> None:
    """Write the model of a body as meshes whose points move, without skeletons and other layers.

    Instances and clips of these are drawn alike everywhere. source, model: file of the body, and
    path of its root there. codes: first and last time code. Raises OutputError.
    """
    before, stage = standing(path), open_stage(source)
    interval = Gf.Interval(*codes)
    for prim in Usd.PrimRange(stage.GetPrimAtPath(model)):
        if prim.IsA(UsdSkel.Root):
            with Usd.EditContext(stage, stage.GetSessionLayer()):
                UsdSkel.BakeSkinning(UsdSkel.Root(prim), interval)
    layer = stage.Flatten()
    for each in list(layer.rootPrims):
        if str(each.path) != model:
            del layer.rootPrims[each.name]
    layer.defaultPrim = model[1:]
    layer.startTimeCode, layer.endTimeCode = codes
    publish([(layer, path)], {path: before})


@dataclass(frozen=True)
class Replay:
    """A loop of an asset. first, frames: of the loop, frames of its shot. phase: frames by which it
    is ahead at the first frame of the stage."""

    asset: BirdAsset
    first: int
    frames: int
    phase: int

    def times(self, frames: tuple[int, int]) -> list[tuple[float, float]]:
        """Return (frame of the flock, frame of the loop) where the loop begins and ends."""
        begin = frames[0] - self.phase % self.frames - self.frames
        rounds = math.ceil((frames[1] + 1 - begin) / self.frames)
        found: list[tuple[float, float]] = []
        for k in range(rounds):
            start = float(begin + k * self.frames)
            found += [(start, self.first), (start + self.frames, self.first + self.frames)]
        return found


@dataclass(frozen=True)
class StagedBird:
    """A bird on the stage. matrices: (K, 4, 4) of its prim at each frame, row vectors, world; None
    where its cache is in the world. what: an asset of its own, or a replay. facts: custom data."""

    name: str
    matrices: Array | None
    what: BirdAsset | Replay
    facts: dict[str, Any]


def write_flock(path: Path, birds: Sequence[StagedBird], info: StageInfo, before: Standing) -> None:
    """Write the stage of a flock. info: of its root. Raises OutputError."""
    layer = new_layer(info)
    assert info.frames is not None
    frames = int(info.frames[0]), int(info.frames[1])
    root = layer.GetPrimAtPath(info.root_path)
    root.specifier, root.typeName = Sdf.SpecifierDef, "Xform"
    root.SetInfo("kind", Kind.Tokens.assembly)
    replays: dict[tuple[Path, int], Any] = {}
    with Sdf.ChangeBlock():
        for bird in birds:
            prim = _prim(layer, info.root_path.AppendChild(bird.name), Sdf.SpecifierDef)
            prim.SetInfo("customData", {"featherfx": bird.facts})
            if isinstance(bird.what, BirdAsset):
                _show(layer, prim.path, bird.what, info.space, path.parent)
            else:
                key = bird.what.asset.cache, bird.what.phase % bird.what.frames
                if key not in replays:
                    replays[key] = _define_replay(layer, info, bird.what, frames, path.parent)
                prim.SetInfo("instanceable", True)
                prim.referenceList.prependedItems = [Sdf.Reference("", replays[key])]
            if bird.matrices is not None:
                _move(layer, prim.path, bird.matrices, frames[0], info.space)
    publish([(layer, path)], {path: before})


def _prim(layer: Any, path: Any, specifier: Any) -> Any:
    prim = Sdf.CreatePrimInLayer(layer, path)
    prim.specifier, prim.typeName = specifier, "Xform"
    return prim


def _define_replay(
    layer: Any, info: StageInfo, replay: Replay, frames: tuple[int, int], folder: Path
) -> Any:
    """Define the class of a replay at a phase, and return its path."""
    name = f"{replay.asset.cache.stem}_{replay.phase % replay.frames}".replace(".", "_")
    top = Sdf.Path.absoluteRootPath.AppendChild(f"{info.root}_{_REPLAYS}")
    _prim(layer, top, Sdf.SpecifierClass)
    prim = _prim(layer, top.AppendChild(name), Sdf.SpecifierClass)
    times = replay.times(frames)
    for shown, file, source in _show(layer, prim.path, replay.asset, info.space, folder):
        if not Sdf.Layer.FindOrOpen(str(file)).ListAllTimeSamples():
            continue
        clips = {
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(_seen_from(folder, file))]),
            "active": arrays.vec2d([(times[0][0], 0.0)]),
            "times": arrays.vec2d(times),
            "primPath": source,
        }
        shown.SetInfo("clips", {"loop": clips})
    return prim.path


def _show(
    layer: Any, path: Any, asset: BirdAsset, space: StageSpace, folder: Path
) -> list[tuple[Any, Path, str]]:
    """Reference feathers and body of a bird below its prim; return prims, files and paths there."""
    root = Sdf.Layer.FindOrOpen(str(asset.cache)).defaultPrim
    shown = [(_prim(layer, path.AppendChild(_FEATHERS), Sdf.SpecifierDef), asset.cache, f"/{root}")]
    if asset.body is not None:
        file, source = asset.body
        body = _prim(layer, path.AppendChild(_BODY), Sdf.SpecifierDef)
        own = open_stage(file)
        there = StageSpace(UsdGeom.GetStageMetersPerUnit(own), UsdGeom.GetStageUpAxis(own))
        change = there.to_world @ np.linalg.inv(space.to_world)
        if not np.allclose(change, np.eye(3), atol=1e-9):
            _move(layer, body.path, _as_matrix(change)[None], 0, StageSpace())
            # the model's own transforms come first, in the space of its file
            body = _prim(layer, body.path.AppendChild("model"), Sdf.SpecifierDef)
        shown.append((body, file, source))
    for prim, file, source in shown:
        prim.referenceList.prependedItems = [Sdf.Reference(_seen_from(folder, file), source)]
    return shown


def _as_matrix(turn: Array) -> Array:
    found = np.eye(4)
    found[:3, :3] = turn
    return found


def _move(layer: Any, path: Any, matrices: Array, first: int, space: StageSpace) -> None:
    """Write a transform over time; one matrix alone stands still. matrices: (K, 4, 4), world."""
    to_world = _as_matrix(space.to_world)
    back = np.linalg.inv(to_world)
    op = path.AppendProperty("xformOp:transform")
    order = path.AppendProperty("xformOpOrder")
    Sdf.JustCreatePrimAttributeInLayer(layer, op, Sdf.ValueTypeNames.Matrix4d)
    uniform = Sdf.VariabilityUniform
    Sdf.JustCreatePrimAttributeInLayer(layer, order, Sdf.ValueTypeNames.TokenArray, uniform)
    layer.GetAttributeAtPath(order).default = Vt.TokenArray(["xformOp:transform"])
    found = [Gf.Matrix4d((to_world @ each @ back).tolist()) for each in matrices]
    if len(found) == 1:
        layer.GetAttributeAtPath(op).default = found[0]
        return
    for k, each in enumerate(found):
        layer.SetTimeSample(op, float(first + k), each)


def _seen_from(folder: Path, file: Path) -> str:
    found = Path(os.path.relpath(file, folder)).as_posix()
    return found if found.startswith(".") else f"./{found}"
