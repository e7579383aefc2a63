"""All files of an output appear complete, or none does.

Each layer is exported to a temporary name in the folder of its target, opened again and compared
with what is in memory, and forced to disk; then the files are renamed onto their targets, the root
last. Until the last rename the old root, if there was one, stays as it was.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from featherfx.errors import Problem
from featherfx.usd.types import OutputError

LOOKED_AT = 16


@dataclass(frozen=True)
class WrittenFile:
    """A file that stands complete beside its target, under a temporary name."""

    temporary: Path
    target: Path

    def flush(self) -> None:
        """Force it to disk. Raises OutputError, and removes it, where that fails."""
        try:
            _flush(self.temporary)
        except OSError as error:
            self.discard()
            raise _failure(self.target, _reason(error)) from error

    def publish(self) -> None:
        """Give it its name. Raises OutputError; then the target has not changed."""
        try:
            _replace_all([(self.temporary, self.target)])
        finally:
            self.discard()

    def discard(self) -> None:
        """Remove it if it still stands there."""
        self.temporary.unlink(missing_ok=True)


def write_beside(layer: Any, path: Path) -> WrittenFile:
    """Export a layer beside its target and compare the file with what is in memory.

    Raises OutputError if it cannot be written in full; then nothing is left.
    """
    file = WrittenFile(_beside(path, "tmp"), path)
    try:
        _export(layer, file)
    except BaseException:
        file.discard()
        raise
    return file


def publish(layers: Sequence[tuple[Any, Path]]) -> None:
    """Write layers to their files, in order; the last one is the root.

    Raises OutputError if any cannot be written in full; then no target has changed.
    """
    files: list[WrittenFile] = []
    try:
        for layer, path in layers:
            files.append(write_beside(layer, path))
            files[-1].flush()
        _replace_all([(file.temporary, file.target) for file in files])
    finally:
        for file in files:
            file.discard()


def _beside(path: Path, label: str) -> Path:
    # The suffix stays last: USD chooses the file format by it.
    return path.with_name(f".{path.stem}.{os.getpid()}.{label}{path.suffix}")


def _export(layer: Any, file: WrittenFile) -> None:
    try:
        done = _store(layer, file.temporary)
    except (OSError, Tf.ErrorException) as error:
        raise _failure(file.target, _reason(error)) from error
    if not done:
        raise _failure(file.target, "USD could not write the file")
    difference = _difference(layer, file.temporary)
    if difference:
        reason = f"the file read back differs from what was written: {difference}"
        raise _failure(file.target, reason)


def _store(layer: Any, path: Path) -> bool:
    return bool(layer.Export(str(path)))


def _failure(target: Path, reason: str) -> OutputError:
    message = f"not written ({reason}); free space and permissions of the folder may tell why"
    return OutputError(Problem(str(target), "", message))


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return error.strerror or str(error)
    # USD repeats itself, once for every block that it could not write.
    said = dict.fromkeys(str(part.commentary) for part in error.args)
    return "; ".join(said) or "unknown USD error"


def _flush(path: Path) -> None:
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def _difference(layer: Any, path: Path) -> str:
    """What a file on disk lacks against the layer in memory; empty if nothing.

    All time codes of the layer, and those and the last value of up to 2 * LOOKED_AT attributes,
    evenly taken from all that are sampled.
    """
    try:
        written = Sdf.Layer.OpenAsAnonymous(str(path))
    except Tf.ErrorException as error:
        return _reason(error)
    if written is None or written.defaultPrim != layer.defaultPrim:
        return "it cannot be opened"
    if written.ListAllTimeSamples() != layer.ListAllTimeSamples():
        return "it has other time codes"
    paths: list[Any] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    sampled = [each for each in paths if layer.ListTimeSamplesForPath(each)]
    for each in sampled[:: max(1, len(sampled) // LOOKED_AT)]:
        codes = layer.ListTimeSamplesForPath(each)
        values = (source.QueryTimeSample(each, codes[-1]) for source in (written, layer))
        if written.ListTimeSamplesForPath(each) != codes or next(values) != next(values):
            return str(each)
    return ""


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
