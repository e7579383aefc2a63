"""All files of an output appear complete, or none does.

Each layer is exported to a temporary name in the folder of its target, forced to disk, opened
again and compared with what is in memory; then the files are renamed onto their targets, the root
last. Until the last rename the old root, if there was one, stays as it was.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from featherfx.errors import Problem
from featherfx.usd.types import OutputError


def publish(layers: Sequence[tuple[Any, Path]]) -> None:
    """Write layers to their files, in order; the last one is the root.

    Raises OutputError if any cannot be written in full; then no target has changed.
    """
    temporaries = [(_beside(path, "tmp"), path) for _, path in layers]
    try:
        for (layer, path), (temporary, _) in zip(layers, temporaries, strict=True):
            _export(layer, temporary, path)
        _replace_all(temporaries)
    finally:
        for temporary, _ in temporaries:
            temporary.unlink(missing_ok=True)


def _beside(path: Path, label: str) -> Path:
    # The suffix stays last: USD chooses the file format by it.
    return path.with_name(f".{path.stem}.{os.getpid()}.{label}{path.suffix}")


def _export(layer: Any, temporary: Path, target: Path) -> None:
    try:
        done = layer.Export(str(temporary))
        if done:
            _flush(temporary)
    except (OSError, Tf.ErrorException) as error:
        raise _failure(target, _reason(error)) from error
    if not done:
        raise _failure(target, "USD could not write the file")
    difference = _difference(layer, temporary)
    if difference:
        raise _failure(target, f"the file read back differs from what was written: {difference}")


def _failure(target: Path, reason: str) -> OutputError:
    message = f"not written ({reason}); free space and permissions of the folder may tell why"
    return OutputError(Problem(str(target), "", message))


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    return "; ".join(str(part.commentary) for part in error.args) or "unknown USD error"


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _difference(layer: Any, path: Path) -> str:
    """What a file on disk lacks against the layer in memory; empty if nothing."""
    try:
        written = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as error:
        return _reason(error)
    if written is None or written.defaultPrim != layer.defaultPrim:
        return "it cannot be opened"
    found: list[str] = []

    def compare(prim_path: Any) -> None:
        if found or not prim_path.IsPropertyPath():
            return
        codes = layer.ListTimeSamplesForPath(prim_path)
        last = codes[-1] if codes else None
        if written.ListTimeSamplesForPath(prim_path) != codes or (
            last is not None
            and written.QueryTimeSample(prim_path, last) != layer.QueryTimeSample(prim_path, last)
        ):
            found.append(str(prim_path))

    layer.Traverse(Sdf.Path.absoluteRootPath, compare)
    return found[0] if found else ""


def _replace_all(pairs: Sequence[tuple[Path, Path]]) -> None:
    """Rename each temporary onto its target; on failure the targets are as before."""
    undo: list[tuple[Path, Path | None]] = []
    target = pairs[0][1]
    try:
        for temporary, target in pairs[:-1]:
            undo.append((target, _backup(target)))
            os.replace(temporary, target)
        temporary, target = pairs[-1]
        os.replace(temporary, target)
    except BaseException as error:
        for changed, backup in reversed(undo):
            if backup is None:
                changed.unlink(missing_ok=True)
            else:
                os.replace(backup, changed)
                # Renaming one name of a file onto another of the same file keeps both.
                backup.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise _failure(target, _reason(error)) from error
        raise
    for _, backup in undo:
        if backup is not None:
            backup.unlink(missing_ok=True)
    _flush_folder(target.parent)


def _backup(path: Path) -> Path | None:
    """A second name for a file that is about to be replaced (None: there is no such file)."""
    if not path.exists():
        return None
    copy = _beside(path, "old")
    copy.unlink(missing_ok=True)
    try:
        os.link(path, copy)
    except OSError:
        # Some network file systems have no hard links.
        shutil.copy2(path, copy)
    return copy


def _flush_folder(folder: Path) -> None:
    """Make the renames durable where the system lets a folder be flushed."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
