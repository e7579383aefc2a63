"""Layers of a cache: their metadata and arrangement, and their publication as files.

    flat     one file
    payload  root -> payload (topology), with the animation as its sublayer
    clips    root, which holds the metadata of the clips -> payload (topology); value clips

The metadata of the clips stands on the scopes below the default prim. Where others make an instance
of the default prim, clips on that prim would not reach the prims in its prototype.

A stronger default hides samples of weaker layers and of clips. So animated attributes have their
default in the animation layer of the payload layout. In the clips layout it is in the payload,
which is weaker than the root that names the clips.

Each layer is exported beside its target, opened again and compared with the layer in memory. Then
all files take their names, the root last (featherfx/files/atomic_write.py).
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom

from featherfx.errors import Problem
from featherfx.files.atomic_write import Standing, Store, WrittenFile, write_all, write_beside
from featherfx.usd import arrays
from featherfx.usd.types import BARB_PRIM, MESH_PRIM, RACHIS_PRIM, OutputError, StageSpace
from featherfx.usd.write.output import output_files

# characters of a text; other readers refuse files with a string of more than 65,536 bytes
_MAX_TEXT = 60_000
FEATHERS_SCOPE, RACHISES_SCOPE, BARBS_SCOPE = "feathers", "rachises", "barbs"
MATERIALS_SCOPE = "materials"
# where the prims of feathers stand, and what their names end with
SCOPES = {
    MESH_PRIM: (FEATHERS_SCOPE, ""),
    RACHIS_PRIM: (RACHISES_SCOPE, "_rachis"),
    BARB_PRIM: (BARBS_SCOPE, "_barbs"),
}


@dataclass(frozen=True)
class StageInfo:
    """Metadata of every layer of a cache.

    root: name of the root prim. frames: first and last frame (None: no time). metadata: custom data
    of the root layer. time_codes_per_second: None: frames_per_second.
    """

    root: str
    space: StageSpace
    frames: tuple[float, float] | None
    frames_per_second: float
    metadata: Mapping[str, Any] = field(default_factory=dict)
    time_codes_per_second: float | None = None

    @property
    def root_path(self) -> Any:
        return Sdf.Path.absoluteRootPath.AppendChild(self.root)


def new_layer(info: StageInfo) -> Any:
    """Return an empty layer in memory with the stage metadata and the root prim as an over."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.defaultPrim = info.root
    world = layer.pseudoRoot
    world.SetInfo(UsdGeom.Tokens.upAxis, info.space.up_axis)
    world.SetInfo(UsdGeom.Tokens.metersPerUnit, info.space.meters_per_unit)
    layer.framesPerSecond = info.frames_per_second
    layer.timeCodesPerSecond = info.time_codes_per_second or info.frames_per_second
    if info.frames is not None:
        layer.startTimeCode, layer.endTimeCode = map(float, info.frames)
    Sdf.CreatePrimInLayer(layer, info.root_path)
    return layer


def author_metadata(layer: Any, metadata: Mapping[str, Any]) -> None:
    """Custom layer data under the key "featherfx"."""
    if metadata:
        layer.customLayerData = {"featherfx": dict(metadata)}


def format_table(table: Mapping[str, str]) -> Any:
    """Return texts by name as JSON for metadata, in pieces where the text is long."""
    text = json.dumps(dict(table), separators=(",", ":"))
    if len(text) <= _MAX_TEXT:
        return text
    return arrays.strings(*(text[k : k + _MAX_TEXT] for k in range(0, len(text), _MAX_TEXT)))


def define_root(stage: Any, info: StageInfo) -> Any:
    """Define the root prim, a model, at its origin."""
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

    root: the file that users open. topology: takes the prims and all constant values. animation:
    takes the samples, and the default values of sampled attributes. In the flat layout all three
    are one layer; with clips the last two are.
    """

    layout: str
    root: Any
    topology: Any
    animation: Any


@dataclass(frozen=True)
class ValueClips:
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
    """Return empty layers of a layout ("flat", "payload" or "clips")."""
    if layout == "flat":
        layer = new_layer(info)
        return CacheLayers(layout, layer, layer, layer)
    topology = new_layer(info)
    animation = topology if layout == "clips" else new_layer(info)
    return CacheLayers(layout, new_layer(info), topology, animation)


def finish_layers(
    layers: CacheLayers, info: StageInfo, path: Path, extent: Any, clips: ValueClips | None
) -> list[Any]:
    """Connect the layers and pair each with its file, in the order of publication.

    extent: (2, 3) stage units, of everything at all times; tools place an unloaded payload by it.
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


def _author_clips(layer: Any, folder: Path, clips: ValueClips) -> None:
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
    """Author the extent (2, 3), stage units, of everything below the root prim."""
    path = root.AppendProperty(UsdGeom.Tokens.extentsHint)
    Sdf.JustCreatePrimAttributeInLayer(layer, path, Sdf.ValueTypeNames.Float3Array)
    layer.GetAttributeAtPath(path).default = arrays.vec3f(np.asarray(extent))
    schemas = Sdf.TokenListOp.Create(prependedItems=["GeomModelAPI"])
    layer.GetPrimAtPath(root).SetInfo("apiSchemas", schemas)


_COMPARED_ATTRIBUTES = 16


def publish(
    layers: Sequence[tuple[Any, Path]],
    before: Mapping[Path, Standing] | None = None,
    others: Iterable[tuple[Path, Store]] = (),
) -> None:
    """Write layers to their files, in order; the last one is the root.

    before: state of the files when the work began, as of write_all. others: files that appear with
    them, as of write_all. Raises OutputError if any cannot be written in full, or another program
    has written it; then no target has changed.
    """
    with output_errors():
        exported = ((path, partial(_export, layer, path)) for layer, path in layers)
        write_all(chain(others, exported), before)


def export_beside(layer: Any, path: Path) -> WrittenFile:
    """Export a layer beside its target.

    Raises OutputError if it cannot be written in full; then nothing is left.
    """
    with output_errors():
        return write_beside(path, partial(_export, layer, path))


@contextlib.contextmanager
def output_errors() -> Iterator[None]:
    """Turn errors of the system that name a file into OutputError."""
    try:
        yield
    except FileExistsError as error:
        message = f"{error.strerror}, and is left as it is. Choose another name, or --overwrite"
        raise OutputError(Problem(str(error.filename), "", message)) from error
    except OSError as error:
        raise _write_error(Path(error.filename), error.strerror or str(error)) from error


def _export(layer: Any, target: Path, temporary: Path) -> None:
    try:
        done = _store(layer, temporary)
    except Tf.ErrorException as error:
        raise _write_error(target, _describe_error(error)) from error
    if not done:
        raise _write_error(target, "USD could not write the file")
    difference = _find_difference(layer, temporary)
    if difference:
        reason = f"the file read back differs from what was written: {difference}"
        raise _write_error(target, reason)


def _store(layer: Any, path: Path) -> bool:
    return bool(layer.Export(str(path)))


def _write_error(target: Path, reason: str) -> OutputError:
    message = f"not written ({reason}). Free space and permissions of the folder may tell why"
    return OutputError(Problem(str(target), "", message))


def _describe_error(error: Tf.ErrorException) -> str:
    # USD repeats itself, once for every block that it could not write.
    said = dict.fromkeys(str(part.commentary) for part in error.args)
    return "; ".join(said) or "unknown USD error"


def _find_difference(layer: Any, path: Path) -> str:
    """Return the first difference of a file on disk to the layer in memory; empty if none.

    Compared are all time codes of the layer, and codes and the last value of up to 2 *
    _COMPARED_ATTRIBUTES attributes, evenly chosen among those with samples.
    """
    try:
        written = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as error:
        return _describe_error(error)
    if written is None or written.defaultPrim != layer.defaultPrim:
        return "it cannot be opened"
    times = layer.ListAllTimeSamples()
    if written.ListAllTimeSamples() != times:
        return "it has other time codes"
    paths: list[Any] = []
    if times:
        layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    sampled = [each for each in paths if layer.ListTimeSamplesForPath(each)]
    for each in sampled[:: max(1, len(sampled) // _COMPARED_ATTRIBUTES)]:
        codes = layer.ListTimeSamplesForPath(each)
        values = (source.QueryTimeSample(each, codes[-1]) for source in (written, layer))
        if written.ListTimeSamplesForPath(each) != codes or next(values) != next(values):
            return str(each)
    return ""
