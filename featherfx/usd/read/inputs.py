"""An output never takes the place of a file that it is made from."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from featherfx.errors import Problem
from featherfx.usd.types import OutputError

_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


def refuse_inputs(outputs: Sequence[Path], inputs: Iterable[Path]) -> None:
    """Raise OutputError for every output that is an input, or a layer that one is made of.

    inputs: files that were read, USD or not.
    """
    existing = [path for path in outputs if path.is_file()]
    if not existing:
        return
    files = [file for path in dict.fromkeys(inputs) for file in _files_of(path) if file.is_file()]
    problems = [
        Problem(str(path), "", "is an input of this work; choose another name")
        for path in existing
        if any(os.path.samefile(path, file) for file in files)
    ]
    if problems:
        raise OutputError(*problems)


def _files_of(path: Path) -> list[Path]:
    """A file, and what it names if it is a USD file: layers at any depth, clips, textures."""
    if path.suffix.lower() not in _SUFFIXES:
        return [path]
    from pxr import Tf, UsdUtils

    try:
        layers, assets, _ = UsdUtils.ComputeAllDependencies(str(path))
    except Tf.ErrorException:
        return [path]  # what a broken file names is not read either
    return [path, *(Path(layer.realPath) for layer in layers), *map(Path, assets)]
