"""Files that are either as they were or complete."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import BinaryIO


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Write one file; see write_all."""
    write_all([(path, write)])


def write_all(files: Iterable[tuple[Path, Callable[[BinaryIO], object]]]) -> None:
    """Write files under temporary names beside them, force them to disk, then rename them all.

    files: names, each with what is called with the open file. Raises what that raises, or the
    system, as an OSError that names the file; then nothing of any is left and older ones under
    their names are unchanged.
    """
    written: list[tuple[Path, Path]] = []
    path = Path()
    try:
        for path, write in files:
            written.append((path.with_name(f".{path.name}.{os.getpid()}.tmp"), path))
            with written[-1][0].open("wb") as file:
                write(file)
                file.flush()
                os.fsync(file.fileno())
        for temporary, path in written:
            os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        for temporary, _ in written:
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """A whole text file in UTF-8."""
    write_whole(path, lambda file: file.write(text.encode()))
