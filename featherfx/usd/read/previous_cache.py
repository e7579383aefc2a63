"""Samples of a finished cache, value by value as they were written, for a bake that takes some."""

from __future__ import annotations

import math
from bisect import bisect_right
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pxr import Sdf

from featherfx.errors import Problem
from featherfx.usd.types import MESH, PER_FACE, RANGES, RATES, OutputError
from featherfx.usd.write.layout import SCOPES
from featherfx.usd.write.output import clips_folder, output_files
from featherfx.usd.write.parts import chunk_files
from featherfx.usd.write.resume import (
    baked_inputs,
    baked_settings,
    layer_metadata,
    text_table,
)

if TYPE_CHECKING:
    from featherfx.usd.write.poses import Written


class _Part(NamedTuple):
    """Where a feather's values stand: path of the prim, its own points, faces or curves."""

    path: Any
    points: slice
    faces: slice


class EarlierCache:
    """A cache that a bake has finished; its layers are opened when they are first read.

    dependences: what each feather depended on (featherfx/shot/dependence.py), by name; motions:
    what its motion did, before it was laid over others, by id; empty where the file does not tell.
    inputs: what its files said (featherfx/groom/read/value_diff.py).
    settings: that it was baked with. chunk: samples of each chunk.
    """

    def __init__(self, path: Path) -> None:
        found = layer_metadata(path)
        self._path, self._layout = path, str(found.get("layout", "flat"))
        self.settings, self.inputs = baked_settings(path), baked_inputs(path)
        self.dependences = text_table(found.get("dependences"))
        self.motions = text_table(found.get("motions"))
        chunk = found.get("chunk")
        self.chunk = chunk if isinstance(chunk, int) else 0
        self._layers: dict[Path, Any] = {}
        self._sampled: tuple[list[float], list[Path]] | None = None
        self._prims: dict[str, dict[str, _Part]] = {}
        # arrays at the last time code that was asked for, which feathers may share
        self._code, self._values = math.nan, dict[Any, Any]()

    def fill(self, feather: str, code: float, out: Written) -> None:
        """Write what is there of a feather, by its id, at a time code.

        Raises OutputError where a value is missing or of another size.
        """
        if not self._prims:
            self._prims = _prims(self._constant)
        prims, sampled = self._prims.get(feather, {}), self._layer_at(code)
        for (part, name), numbers in out.items():
            given = self._value(prims[part], name, sampled, code) if part in prims else None
            if given is None and name in RATES:
                given = np.zeros_like(numbers)  # what keeps one pose has none
            if given is None or given.shape != numbers.shape:
                message = f"is damaged: {name} of '{feather}'; --overwrite bakes all anew"
                raise OutputError(Problem(str(self._path), "", message))
            numbers[...] = given

    def _value(self, part: _Part, name: str, sampled: Any, code: float) -> Any:
        """A feather's elements of an attribute; None where it has no value."""
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
        own = part.faces if name in PER_FACE else part.points
        return None if found is None else found[own]

    def close(self) -> None:
        """Let go of the files."""
        self._layers.clear()
        self._values.clear()

    @property
    def _constant(self) -> Any:
        """The layer with all that has no samples."""
        files = output_files(self._path, self._layout)
        return self._layer(files[-1 if self._layout == "flat" else -2])

    def _layer_at(self, code: float) -> Any:
        if self._sampled is None:
            self._sampled = self._files()
        starts, files = self._sampled
        return self._layer(files[max(bisect_right(starts, code) - 1, 0)])

    def _files(self) -> tuple[list[float], list[Path]]:
        """The files that hold samples, and the first time code of each."""
        if self._layout == "clips":
            found = chunk_files(clips_folder(self._path), self.settings)
            return [codes[0] for codes, _ in found], [file for _, file in found]
        # animation first, or the one file
        return [0.0], [output_files(self._path, self._layout)[0]]

    def _layer(self, file: Path) -> Any:
        if file not in self._layers:
            self._layers[file] = Sdf.Layer.OpenAsAnonymous(str(file))
        return self._layers[file]


def _prims(layer: Any) -> dict[str, dict[str, _Part]]:
    """Where each feather's values stand, by its id and part (MESH, RACHIS, BARB)."""
    found: dict[str, dict[str, _Part]] = {}
    root = layer.GetPrimAtPath(Sdf.Path.absoluteRootPath.AppendChild(layer.defaultPrim))
    for part, (scope, _) in SCOPES.items():
        above = root.nameChildren.get(scope)
        for prim in above.nameChildren if above else ():
            ids = _default(prim, "primvars:featherId") or ()
            points = _default(prim, f"{RANGES}:points")
            faces = _default(prim, f"{RANGES}:{'faces' if part == MESH else 'curves'}")
            for k, id in enumerate(ids):
                own = _range(points, k), _range(faces, k)
                found.setdefault(id, {})[part] = _Part(prim.path, *own)
    return found


def _default(prim: Any, name: str) -> Any:
    attribute = prim.attributes.get(name)
    return attribute.default if attribute else None


def _range(table: Any, index: int) -> slice:
    """Of a prim without a table all is one feather's."""
    return slice(None) if table is None else slice(table[index][0], sum(table[index]))
