"""Files that appear complete, or stay as they were; several of them all at once.

Each is written under a temporary name in the folder of its target and forced to disk; then all are
renamed onto their targets, in order. Until the last rename a reader of that one sees the old set.

A lock lets one process at a time write an output.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import os
import re
import shutil
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

# writes a file of that name, checked if need be
Store = Callable[[Path], object]
# what tells a file from another one of its name; None: there is none
Standing = tuple[int, ...] | None

_TEMPORARY = re.compile(r"\.(?P<stem>.+)\.(?P<process>\d+)\.(?:tmp|old)(?P<suffix>(?:\.[^.]+)?)")
# of the same, while USD saves it: six random letters in place of the suffix
_SAVED_LAYER = re.compile(r"\.(?P<stem>.+)\.(?P<process>\d+)\.tmp\.[A-Za-z0-9]{6}")


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
        """Remove it if it still stands there, and what USD leaves where saving it fails."""
        self.temporary.unlink(missing_ok=True)
        with contextlib.suppress(OSError):
            for file in self.temporary.parent.glob(f"{glob.escape(self.temporary.stem)}.??????"):
                if _SAVED_LAYER.fullmatch(file.name):
                    file.unlink()


def write_beside(path: Path, store: Store) -> WrittenFile:
    """Have a file stored beside its target.

    Raises what store raises, an OSError so that it names the target; then nothing is left.
    """
    remove_leftovers(path, only_ended=True)
    file = WrittenFile(_beside(path, "tmp"), path)
    try:
        with _named(path):
            if not path.parent.is_dir():
                # USD would make it again
                raise FileNotFoundError(errno.ENOENT, "its folder is gone")
            store(file.temporary)
    except BaseException:
        file.discard()
        raise
    return file


def write_all(
    files: Iterable[tuple[Path, Store]], before: Mapping[Path, Standing] | None = None
) -> None:
    """Store files and publish them all, in order.

    before: what stood at each target when the work began (None: it may be replaced whatever it
    is). Raises what storing raises, FileExistsError where something else stands there now, or an
    OSError that names the target; then none has changed.
    """
    written: list[WrittenFile] = []
    try:
        for path, store in files:
            written.append(write_beside(path, store))
            written[-1].flush()
        _replace_all(written, before)
    finally:
        for file in written:
            file.discard()


def write_whole(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """A whole file; write is called with it, open. Raises as write_all."""
    write_all([(path, into(write))])


def write_text(path: Path, text: str) -> None:
    """A whole text file in UTF-8. Raises as write_all."""
    write_all([(path, into_text(text))])


def into_text(text: str) -> Store:
    """Return a function that stores a text, in UTF-8."""
    return into(lambda file: file.write(text.encode()))


def into(write: Callable[[BinaryIO], object]) -> Store:
    """Turn a writer to an open file into one that stores a file of a name."""

    def store(path: Path) -> None:
        with path.open("wb") as file:
            write(file)

    return store


def standing(path: Path) -> Standing:
    """Identify the file at a path, links not followed."""
    try:
        found = path.lstat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def temporary_of(name: str) -> str:
    """Name of the file that a temporary one of this name is for; empty where it is none. That of a
    layer which USD was saving ends with .usdc."""
    return _parse_temporary(name)[0]


def _parse_temporary(name: str) -> tuple[str, int]:
    """Return the target's name, as temporary_of, and the process that wrote it."""
    if match := _SAVED_LAYER.fullmatch(name):
        return match["stem"] + ".usdc", int(match["process"])
    match = _TEMPORARY.fullmatch(name)
    return (match["stem"] + match["suffix"], int(match["process"])) if match else ("", 0)


def remove_leftovers(path: Path, only_ended: bool = False) -> None:
    """Remove what killed processes left beside a target. Nobody else may be writing it.

    only_ended: what processes of this machine write stays.
    """
    names = {path.name, *([path.stem + ".usdc"] if path.suffix.startswith(".usd") else ())}
    with contextlib.suppress(OSError):
        for file in path.parent.iterdir():
            target, process = _parse_temporary(file.name)
            is_left = target in names and not (only_ended and _is_running(process))
            if is_left and file.is_file() and not file.is_symlink():
                file.unlink()


def _is_running(process: int) -> bool:
    """Return whether a process of this machine runs, or may run."""
    if os.name == "nt":
        return True  # no signal only asks
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


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


def _replace_all(
    files: Sequence[WrittenFile], before: Mapping[Path, Standing] | None = None
) -> None:
    """Rename each file onto its target; on failure the targets are as before."""
    if not files:
        return
    undo: list[tuple[Path, Path | None]] = []
    with _uninterrupted(files[-1].target):
        try:
            for number, file in enumerate(files):
                # what the last one replaces is never wanted back
                backed = number < len(files) - 1
                undo.append((file.target, _rename(file, backed, before)))
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


def _rename(file: WrittenFile, backed: bool, before: Mapping[Path, Standing] | None) -> Path | None:
    """Give a file its name; returns a second name of what it replaced, if that is wanted."""
    target = file.target
    with _named(target):
        if before is not None and standing(target) != before[target]:
            raise FileExistsError(errno.EEXIST, "another program has written it meanwhile")
        backup = _backup(target) if backed else None
        try:
            if before is None or before[target] is not None or not _link(file):
                os.replace(file.temporary, target)
        except BaseException:
            if backup is not None:
                backup.unlink(missing_ok=True)
            raise
        return backup


def _link(file: WrittenFile) -> bool:
    """Name a file unless another has that name by now; whether the file system can."""
    try:
        os.link(file.temporary, file.target)
    except FileExistsError:
        raise FileExistsError(errno.EEXIST, "another program has written it meanwhile") from None
    except OSError:
        return False
    return True


@contextlib.contextmanager
def _uninterrupted(target: Path) -> Iterator[None]:
    """An interrupt waits for the end of the block, so that a set of files is not left in parts.

    target: the last of them, which the interrupt then names as complete.
    """
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield
        return
    came: list[Any] = []
    signal.signal(signal.SIGINT, lambda *given: came.append(given))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
    if came:
        try:
            usual(*came[0])
        except KeyboardInterrupt as error:
            raise KeyboardInterrupt(f"interrupted, but {target} is complete") from error


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


class Lock:
    """A lock file that this process holds until release; the system drops it with the process.

    Raises TimeoutError at once where another holds it, OSError where it cannot be made or
    something else has its name.
    """

    def __init__(self, path: Path) -> None:
        if path.is_symlink() or (path.exists() and not (path.is_file() and _is_empty(path))):
            raise FileExistsError(errno.EEXIST, "is no lock of this program", str(path))
        from filelock import FileLock  # few commands lock

        self._path = path
        self._lock = FileLock(path, timeout=0, thread_local=False)
        self._lock.acquire()

    def release(self) -> None:
        """Remove the file and let go; nothing where that is done already."""
        if not self._lock.is_locked:
            return
        # While it is held, so that nobody locks a file without a name. Windows cannot remove an
        # open file, but nobody waits for this lock.
        if os.name != "nt":
            self._path.unlink(missing_ok=True)
        self._lock.release()
        if os.name == "nt":
            with contextlib.suppress(OSError):
                self._path.unlink()


def _is_empty(path: Path) -> bool:
    try:
        return path.stat().st_size == 0
    except FileNotFoundError:  # its holder has let go
        return True
