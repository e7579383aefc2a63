"""Layers to files: complete and as they are in memory, or not at all.

Each layer is exported beside its target, opened again and compared with what is in memory; then all
files take their names, the root last (featherfx/files/atomic_write.py).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf

from featherfx.errors import Problem
from featherfx.files.atomic_write import Standing, Store, WrittenFile, write_all, write_beside
from featherfx.usd.types import OutputError

LOOKED_AT = 16


def publish(
    layers: Sequence[tuple[Any, Path]],
    before: Mapping[Path, Standing] | None = None,
    others: Iterable[tuple[Path, Store]] = (),
) -> None:
    """Write layers to their files, in order; the last one is the root.

    before: what stood at the files when the work began, as of write_all. others: files that appear
    with them, as of write_all. Raises OutputError if any cannot be written in full, or another
    program has written it; then no target has changed.
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
    """Errors of the system that name a file, as OutputError."""
    try:
        yield
    except FileExistsError as error:
        message = f"{error.strerror}, and is left as it is; choose another name, or --overwrite"
        raise OutputError(Problem(str(error.filename), "", message)) from error
    except OSError as error:
        raise _failure(Path(error.filename), error.strerror or str(error)) from error


def _export(layer: Any, target: Path, temporary: Path) -> None:
    try:
        done = _store(layer, temporary)
    except Tf.ErrorException as error:
        raise _failure(target, _reason(error)) from error
    if not done:
        raise _failure(target, "USD could not write the file")
    difference = _difference(layer, temporary)
    if difference:
        reason = f"the file read back differs from what was written: {difference}"
        raise _failure(target, reason)


def _store(layer: Any, path: Path) -> bool:
    return bool(layer.Export(str(path)))


def _failure(target: Path, reason: str) -> OutputError:
    message = f"not written ({reason}); free space and permissions of the folder may tell why"
    return OutputError(Problem(str(target), "", message))


def _reason(error: Tf.ErrorException) -> str:
    # USD repeats itself, once for every block that it could not write.
    said = dict.fromkeys(str(part.commentary) for part in error.args)
    return "; ".join(said) or "unknown USD error"


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
