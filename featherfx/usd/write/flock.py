"""Flocks: one stage of many birds, which names the caches of those that are near, and replays.

    /flock/bird_1_0001      a bird, which a transform over time moves along its path
        feathers, body      references to a cache, and to the layer of the body or the skin's file
    /flock_replays/...      classes, one for each replay at each phase, whose instances birds are

A replay is value clips of one cache, whose times run through its loop again and again.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdSkel, Vt

from featherfx.algebra.types import Array
from featherfx.files.atomic_write import Standing, standing
from featherfx.usd import arrays
from featherfx.usd.read.opening import open_stage
from featherfx.usd.types import StageSpace
from featherfx.usd.write.layers import StageInfo, new_layer, publish

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


def write_flock(
    path: Path,
    birds: Sequence[StagedBird],
    info: StageInfo,
    before: Standing,
) -> None:
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
