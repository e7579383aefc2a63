"""Earlier bakes at an output: recognised, compared, and their samples reused.

An output may hold nothing, part of this bake, all of it, or another bake.
"""

from __future__ import annotations

import json
import math
from bisect import bisect_right
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pxr import Sdf, Vt

from featherfx.errors import Problem
from featherfx.files.disk_cache import DIGEST_KEY
from featherfx.groom.read.toml_text import changes
from featherfx.usd.read.values import USD_ERRORS
from featherfx.usd.types import MESH_PRIM, PER_FACE_PRIMVARS, RANGES_PREFIX, RATES, OutputError
from featherfx.usd.write.layers import SCOPES
from featherfx.usd.write.output import clips_folder, output_files, parts_folder
from featherfx.usd.write.unfinished_cache import (
    Parts,
    list_chunk_files,
    list_unfinished_bakes,
    lock_file,
)

if TYPE_CHECKING:
    from featherfx.usd.write.poses import Written


_MAX_DIFFERENCES = 12


def is_finished(
    path: Path, settings: Mapping[str, str], inputs: Mapping[str, str], overwrite: bool
) -> bool:
    """Return whether the cache at path is complete and was baked with these settings.

    inputs: texts of the bake's files. Raises OutputError where a cache, or an unfinished one, of
    other settings is there, unless overwrite: settings are never mixed.
    """
    if path.exists():
        earlier = read_settings(path)
        if earlier == settings:
            layout = read_metadata(path).get("layout", "flat")
            sound = all(file.is_file() for file in output_files(path, layout))
            return sound and (layout != "clips" or Parts.are_whole(clips_folder(path), settings))
        if not overwrite:
            told = describe_changes(earlier, read_inputs(path), settings, inputs)
            raise _settings_error(path, "exists already", told if earlier else {})
        return False
    for layout in ("flat", "clips"):
        begun = list_unfinished_bakes(parts_folder(path, layout))
        if begun and all(each != settings for each, _ in begun) and not overwrite:
            raise _settings_error(path, "was begun", describe_changes(*begun[0], settings, inputs))
    return False


def describe_changes(
    earlier: Mapping[str, str],
    earlier_inputs: Mapping[str, str],
    settings: Mapping[str, str],
    inputs: Mapping[str, str],
) -> dict[str, str]:
    """Return the differences between two bakes, by key, in words.

    Settings decide, and inputs explain: a setting that is too long to describe is only named where
    no input explains why it differs.
    """
    found = changes(earlier_inputs, inputs) if earlier_inputs else {}
    for key, change in changes(earlier, settings).items():
        texts = earlier.get(key, ""), settings.get(key, "")
        long = key == "program" or any(text.startswith(DIGEST_KEY) for text in texts)
        if not long:
            found.setdefault(key, change)
        elif key == "program" or not found:
            found[key] = "is another now"
    return found


def remove_finished_parts(path: Path, settings: Mapping[str, str]) -> None:
    """Remove leftovers of a bake that was killed after it had published its cache.

    Raises OutputError where another bake is writing the cache.
    """
    if lock_file(path).exists():
        layout = read_metadata(path).get("layout", "flat")
        parts = Parts(path, layout, settings, keep=True, finished=True)
        parts.finish(keep_chunks=layout == "clips")


def read_settings(path: Path) -> dict[str, str]:
    """Return the settings of a cache; empty where its metadata lack them."""
    found = read_metadata(path).get("settings")
    known = found if isinstance(found, dict) else {}
    return {str(key): str(value) for key, value in known.items()}


def read_inputs(path: Path) -> dict[str, str]:
    """Return the texts of the files of a cache's bake; empty where its metadata lack them."""
    return parse_table(read_metadata(path).get("inputs"))


def parse_table(text: Any) -> dict[str, str]:
    """Return texts by name from JSON (format_table); empty for any other value."""
    if isinstance(text, Vt.StringArray):
        text = "".join(text)
    try:
        found = json.loads(text) if isinstance(text, str) else {}
    except (ValueError, RecursionError):
        return {}
    return {str(k): str(v) for k, v in found.items()} if isinstance(found, dict) else {}


def read_metadata(path: Path) -> dict[str, Any]:
    """Return the metadata of featherfx in a root file; empty where there are none."""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
        found = layer.customLayerData.get("featherfx") if layer else None
    except USD_ERRORS:
        return {}
    return dict(found) if isinstance(found, dict) else {}


def _settings_error(path: Path, what: str, told: Mapping[str, str]) -> OutputError:
    """Return the error for an output of other settings. told: the differences by key."""
    advice = "Choose another name, or --overwrite to bake it anew"
    if not told:
        message = f"{what}, and does not tell with which settings. {advice}"
        return OutputError(Problem(str(path), "", message))
    problems = [Problem(str(path), "", f"{what} with other settings. {advice}")]
    problems += [Problem(str(path), key, told[key]) for key in list(told)[:_MAX_DIFFERENCES]]
    if len(told) > _MAX_DIFFERENCES:
        more = len(told) - _MAX_DIFFERENCES
        problems.append(Problem(str(path), "", f"and {more} more settings differ"))
    return OutputError(*problems)


class _PrimRanges(NamedTuple):
    """Path of a prim with a feather's values, and its ranges of points, faces or curves."""

    path: Any
    points: slice
    faces: slice


class PreviousCache:
    """A finished cache at the output; its layers are opened when they are first read.

    dependences: of each feather, by name, empty where the file lacks them. inputs: texts of its
    files (featherfx/groom/read/toml_text.py). settings: of its bake. chunk: samples of each chunk.
    """

    def __init__(self, path: Path) -> None:
        found = read_metadata(path)
        self._path, self._layout = path, str(found.get("layout", "flat"))
        self.settings, self.inputs = read_settings(path), read_inputs(path)
        self.dependences = parse_table(found.get("dependences"))
        chunk = found.get("chunk")
        self.chunk = chunk if isinstance(chunk, int) else 0
        self._layers: dict[Path, Any] = {}
        self._prims: dict[str, dict[str, _PrimRanges]] = {}
        # arrays at the last time code that was asked for, which feathers may share
        self._code, self._values = math.nan, dict[Any, Any]()

    def fill(self, feather: str, code: float, out: Written) -> None:
        """Write the values of a feather, by its id, at a time code.

        Raises OutputError where a value is missing or of another size.
        """
        if not self._prims:
            self._prims = _find_ranges(self._constant)
        prims, (starts, files) = self._prims.get(feather, {}), self._sampled
        sampled = self._layer(files[max(bisect_right(starts, code) - 1, 0)])
        for (part, name), numbers in out.items():
            given = self._value(prims[part], name, sampled, code) if part in prims else None
            if given is None and name in RATES:
                given = np.zeros_like(numbers)  # what keeps one pose has none
            if given is None or given.shape != numbers.shape:
                message = f"is damaged: {name} of '{feather}'. --overwrite bakes all anew"
                raise OutputError(Problem(str(self._path), "", message))
            numbers[...] = given

    def _value(self, part: _PrimRanges, name: str, sampled: Any, code: float) -> Any:
        """Return a feather's elements of an attribute; None where it has no value."""
        if code != self._code:
            self._code, self._values = code, {}
        if (part.path, name) not in self._values:
            path = part.path.AppendProperty(name)
            value = sampled.QueryTimeSample(path, code)
            if value is None:
                # a prim that keeps one pose has it as its default
                attribute = self._constant.GetAttributeAtPath(path)
                value = attribute.default if attribute else None
            self._values[part.path, name] = None if value is None else np.asarray(value)
        found = self._values[part.path, name]
        own = part.faces if name in PER_FACE_PRIMVARS else part.points
        return None if found is None else found[own]

    def close(self) -> None:
        """Close the files."""
        self._layers.clear()
        self._values.clear()

    @property
    def _constant(self) -> Any:
        """Return the layer with the constant values."""
        files = output_files(self._path, self._layout)
        return self._layer(files[-1 if self._layout == "flat" else -2])

    @cached_property
    def _sampled(self) -> tuple[list[float], list[Path]]:
        """Return the files that hold samples, and the first time code of each."""
        if self._layout == "clips":
            found = list_chunk_files(clips_folder(self._path), self.settings)
            return [codes[0] for codes, _ in found], [file for _, file in found]
        # animation first, or the one file
        return [0.0], [output_files(self._path, self._layout)[0]]

    def _layer(self, file: Path) -> Any:
        if file not in self._layers:
            self._layers[file] = Sdf.Layer.OpenAsAnonymous(str(file))
        return self._layers[file]


def _find_ranges(layer: Any) -> dict[str, dict[str, _PrimRanges]]:
    """Return the ranges of each feather, by its id and prim (MESH_PRIM, RACHIS_PRIM, BARB_PRIM)."""
    found: dict[str, dict[str, _PrimRanges]] = {}
    root = layer.GetPrimAtPath(Sdf.Path.absoluteRootPath.AppendChild(layer.defaultPrim))
    for part, (scope, _) in SCOPES.items():
        above = root.nameChildren.get(scope)
        for prim in above.nameChildren if above else ():
            ids = _default_value(prim, "primvars:featherId") or ()
            points = _default_value(prim, f"{RANGES_PREFIX}:points")
            faces = _default_value(
                prim, f"{RANGES_PREFIX}:{'faces' if part == MESH_PRIM else 'curves'}"
            )
            for k, id in enumerate(ids):
                own = _feather_range(points, k), _feather_range(faces, k)
                found.setdefault(id, {})[part] = _PrimRanges(prim.path, *own)
    return found


def _default_value(prim: Any, name: str) -> Any:
    attribute = prim.attributes.get(name)
    return attribute.default if attribute else None


def _feather_range(table: Any, index: int) -> slice:
    """Return the range of a feather; a prim without a table is one feather."""
    return slice(None) if table is None else slice(table[index][0], sum(table[index]))
