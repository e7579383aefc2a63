"""Samples of a finished cache, value by value as they were written, for a bake that takes some."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pxr import Sdf

from featherfx.errors import Problem
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import clips_folder, output_files
from featherfx.usd.write.parts import chunk_files
from featherfx.usd.write.resume import (
    baked_inputs,
    baked_settings,
    layer_metadata,
    text_table,
)

if TYPE_CHECKING:
    from featherfx.usd.write.poses import WrittenPose


class EarlierCache:
    """A cache that a bake has finished; its layers are opened when they are first read.

    dependences: what each feather depended on (featherfx/shot/dependence.py), by prim name; empty
    where the file does not tell. inputs: what its files said (featherfx/groom/read/told.py).
    settings: that it was baked with. chunk: samples of each chunk.
    """

    def __init__(self, path: Path) -> None:
        found = layer_metadata(path)
        self._path, self._layout = path, str(found.get("layout", "flat"))
        self.settings, self.inputs = baked_settings(path), baked_inputs(path)
        self.dependences = text_table(found.get("dependences"))
        chunk = found.get("chunk")
        self.chunk = chunk if isinstance(chunk, int) else 0
        self._layers: dict[Path, Any] = {}
        self._sampled: tuple[list[float], list[Path]] | None = None

    def fill(self, paths: Mapping[Any, Any], code: float, pose: WrittenPose) -> None:
        """Write to a pose what the attributes at these paths hold at a time code.

        Raises OutputError where a value is missing or of another size.
        """
        sampled, constant = self._layer_at(code), self._layer(output_files(*self._where)[-1])
        if self._layout != "flat":
            constant = self._layer(output_files(*self._where)[-2])
        for key, path in paths.items():
            value = sampled.QueryTimeSample(path, code)
            if value is None:
                # a feather that keeps one pose has it as its default, and no rates
                attribute = constant.GetAttributeAtPath(path)
                value = attribute.default if attribute else None
            numbers = pose.values[key].numbers
            given = np.zeros_like(numbers) if value is None else np.asarray(value)
            if given.shape != numbers.shape:
                message = f"{path} is damaged; --overwrite bakes all anew"
                raise OutputError(Problem(str(self._path), "", message))
            numbers[...] = given
        pose.finite = True

    def close(self) -> None:
        """Let go of the files."""
        self._layers.clear()

    @property
    def _where(self) -> tuple[Path, str]:
        return self._path, self._layout

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
        return [0.0], [output_files(*self._where)[0]]

    def _layer(self, file: Path) -> Any:
        if file not in self._layers:
            self._layers[file] = Sdf.Layer.OpenAsAnonymous(str(file))
        return self._layers[file]
