"""Files that appear complete, or stay as they were; several of them all at once.

Each is written under a temporary name in the folder of its target and forced to disk; then all are
renamed onto their targets, in order. Until the last rename a reader of that one sees the old set.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

# writes a file of that name, checked if need be
Store = Callable[[Path], object]


@dataclass(frozen=True)
class WrittenFile:
    """A file that stands complete beside its target, under a temporary name.

    Its methods raise OSError that names the target.
    """

    temporary: Path
    target: Path

    def flush(self) -> None:
        """Force it to disk; removes it where that fails."""
        try:
            with _named(self.target):
                flush(self.temporary)
        except OSError:
            self.discard()
            raise

    def publish(self) -> None:
        """Give it its name; where that fails the target has not changed."""
        try:
            _replace_all([self])
        finally:
            self.discard()

    def discard(self) -> None:
        """Remove it if it still stands there."""
        self.temporary.unlink(missing_ok=True)


def write_beside(path: Path, store: Store) -> WrittenFile:
    """Have a file stored beside its target.

    Raises what store raises, an OSError so that it names the target; then nothing is left.
    """
    file = WrittenFile(_beside(path, "tmp"), path)
    try:
        with _named(path):
            store(file.temporary)
    except BaseException:
        file.discard()
        raise
    return file


def write_all(files: Iterable[tuple[Path, Store]]) -> None:
    """Store files and publish them all, in order.

    Raises what storing raises, or an OSError that names the target; then none has changed.
    """
    written: list[WrittenFile] = []
    try:
        for path, store in files:
            written.append(write_beside(path, store))
            written[-1].flush()
        _replace_all(written)
    finally:
        for file in written:
            file.discard()


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """A whole file; write is called with it, open. Raises as write_all."""
    write_all([(path, into(write))])


def write_text(path: Path, text: str) -> None:
    """A whole text file in UTF-8. Raises as write_all."""
    write_whole(path, lambda file: file.write(text.encode()))


def into(write: Callable[[BinaryIO], object]) -> Store:
    """What writes to an open file, as what stores a file of a name."""

    def store(path: Path) -> None:
        with path.open("wb") as file:
            write(file)

    return store


def flush(path: Path) -> None:
    """Force a file to disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Errors of the system name this file."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


def _beside(path: Path, label: str) -> Path:
    # The suffix stays last: libraries choose the format by it.
    return path.with_name(f".{path.stem}.{os.getpid()}.{label}{path.suffix}")


def _replace_all(files: Sequence[WrittenFile]) -> None:
    """Rename each file onto its target; on failure the targets are as before."""
    undo: list[tuple[Path, Path | None]] = []
    try:
        for number, file in enumerate(files):
            with _named(file.target):
                # what the last one replaces is never wanted back
                if number < len(files) - 1:
                    undo.append((file.target, _backup(file.target)))
                os.replace(file.temporary, file.target)
    except BaseException:
        for changed, backup in reversed(undo):
            if backup is None:
                changed.unlink(missing_ok=True)
            else:
                os.replace(backup, changed)
                # Renaming one name of a file onto another of the same file keeps both.
                backup.unlink(missing_ok=True)
        raise
    for _, backup in undo:
        if backup is not None:
            backup.unlink(missing_ok=True)
    for folder in dict.fromkeys(file.target.parent for file in files):
        _flush_folder(folder)


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
