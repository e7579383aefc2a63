"""Arrays that were computed once for the same content, in the user's cache folder.

Every entry is a file of its own: a checksum, then plain arrays (NPZ, nothing that is unpickled).
Its name holds a digest of all that it was computed from, the program's own code included. What is
damaged counts as missing. Nothing is loaded from a folder that others can write to (folders.py);
where nothing can be kept, all is computed anew, with the same result. Processes that want the same
entry at a time wait for the one that computes it. Entries that were used least lately are removed
where all together take more than MAX_KEPT_BYTES, or $FEATHERFX_CACHE_SIZE (GB).
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import re
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.files.content import digest, program_digest
from featherfx.files.folders import (
    cache_folder,
    doubt,
    make_private_folder,
    read_trusted,
    write_private,
)
from featherfx.limits import MAX_KEPT_BYTES

Arrays = dict[str, NDArray[Any]]

SIZE_VARIABLE = "FEATHERFX_CACHE_SIZE"
_FOLDER = "content"
_ENTRY = re.compile(r"[a-z-]+\.[0-9a-f]+\.arrays")
_CHECKSUM_BYTES = hashlib.sha256().digest_size
# s that a process waits for another that computes the same, before it does so itself
_PATIENCE = 300.0
# part of the limit that is left after the oldest entries were removed
_LEFT = 0.8
# part of the limit that a process saves before it looks through all entries once more
_UNSEEN_RATIO = 0.05
# bytes that this process has saved in a folder since it looked through it
_unseen_bytes: dict[Path, float] = {}
_keeps: ContextVar[bool] = ContextVar("keeps", default=True)


@contextlib.contextmanager
def nothing_kept() -> Iterator[None]:
    """Within it, by this thread, all is computed anew and nothing kept: for what is wanted once."""
    before = _keeps.set(False)
    try:
        yield
    finally:
        _keeps.reset(before)


class Aside:
    """Within it, this thread keeps in memory what is not on disk yet, for what changes again and
    again: what was asked for since it was entered last, or between then and the time before."""

    def __init__(self) -> None:
        self._before: dict[str, Arrays] = {}
        self._asked: dict[str, Arrays] = {}

    def __enter__(self) -> None:
        self._before, self._asked = self._asked, {}
        self._token = _aside.set(self)

    def __exit__(self, *_: object) -> None:
        _aside.reset(self._token)

    def find(self, file: Path) -> Arrays | None:
        """The arrays of an entry, to be written over as one likes; None where none is known."""
        found = self._asked.get(file.name) or self._before.get(file.name) or _load(file)
        return None if found is None else self.keep(file, found)

    def keep(self, file: Path, arrays: Arrays) -> Arrays:
        """Keep arrays as they are now, and return them."""
        self._asked[file.name] = {name: value.copy() for name, value in arrays.items()}
        return arrays


_aside: ContextVar[Aside | None] = ContextVar("aside", default=None)


def kept(what: str, inputs: Sequence[Any], compute: Callable[[], Mapping[str, Any]]) -> Arrays:
    """The arrays that compute gives, from the store where they were computed before.

    what: names the computation, in small letters and hyphens. inputs: all that the result depends
    on, but the program: what featherfx.files.content.digest takes. Arrays hold no objects. Raises
    what compute raises, and InputError for a size of the store that is none.
    """
    file = _file_of(what, inputs)
    if file is None:
        return _arrays(compute())
    if aside := _aside.get():
        return aside.find(file) or aside.keep(file, _arrays(compute()))
    found = _load(file)
    if found is None:
        with _alone(file):
            # another process may have made it meanwhile
            found = _load(file)
            if found is None:
                found = _arrays(compute())
                _save(file, found)
    return found


def kept_before(what: str, inputs: Sequence[Any]) -> Arrays | None:
    """The arrays that `keep` was given, or `kept` computed; None where they are not there."""
    file = _file_of(what, inputs)
    aside = _aside.get()
    return None if file is None else aside.find(file) if aside else _load(file)


def keep(what: str, inputs: Sequence[Any], arrays: Mapping[str, Any]) -> None:
    """Keep arrays, if the system lets us."""
    file = _file_of(what, inputs)
    if file is not None and (aside := _aside.get()):
        aside.keep(file, _arrays(arrays))
    elif file is not None:
        _save(file, _arrays(arrays))


def _arrays(values: Mapping[str, Any]) -> Arrays:
    return {name: np.asarray(value, order="C") for name, value in values.items()}


def _file_of(what: str, inputs: Sequence[Any]) -> Path | None:
    """Return the path of an entry; None where nothing is cached."""
    try:
        if not _keeps.get() or room() <= 0.0 or doubt(folder := cache_folder() / _FOLDER):
            return None
        with contextlib.suppress(OSError):
            make_private_folder(folder)
        if not folder.is_dir():
            return None
    except OSError:
        return None
    return folder / f"{what}.{digest(program_digest(), what, *inputs)}.arrays"


def room() -> float:
    """Bytes that all entries together may take. Raises InputError for what is no such number."""
    given = os.environ.get(SIZE_VARIABLE, "")
    if not given:
        return MAX_KEPT_BYTES
    try:
        limit = 1e9 * float(given)
    except ValueError:
        limit = -1.0
    if not limit >= 0.0:
        message = f"'{given}' is no number of GB. Give 0 (keeps nothing) and more"
        raise InputError(Problem(SIZE_VARIABLE, "", message))
    return limit


def _load(file: Path) -> Arrays | None:
    """The arrays of an entry; None where none is sound."""
    try:
        stored = read_trusted(file.parents[1], (file.parent.name, file.name))
    except OSError:
        return None
    content = memoryview(stored)[_CHECKSUM_BYTES:]
    if hashlib.sha256(content).digest() != stored[:_CHECKSUM_BYTES]:
        return None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    with contextlib.suppress(OSError):
        os.utime(file)  # used lately
    return found


def _save(file: Path, arrays: Arrays) -> None:
    """Keep an entry if the system lets us. Not forced to disk: a checksum tells what is damaged."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)  # type: ignore[arg-type]
    content = stream.getbuffer()
    if len(content) > 0.5 * room():
        return
    temporary = file.with_name(f".{file.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as out:
            write_private(out, hashlib.sha256(content).digest(), content)
        os.replace(temporary, file)
        _limit(file.parent, len(content))
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Let no other process compute the same entry; without that where no lock can be made."""
    lock = FileLock(file.with_name(f".{file.name}.lock"))
    if not os.access(file.parent, os.W_OK):
        yield
        return
    try:
        lock.acquire(timeout=_PATIENCE)
    except (OSError, NotImplementedError):
        yield
        return
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            # who waits for it holds a file without a name, and computes once more at worst
            os.unlink(lock.lock_file)
        lock.release()


def _limit(folder: Path, saved: int) -> None:
    """Hold a folder near its limit; all its files are looked through only now and then."""
    unseen = _unseen_bytes.get(folder, room()) + saved
    if unseen > _UNSEEN_RATIO * room():
        unseen = 0.0
        _remove_oldest(folder)
    _unseen_bytes[folder] = unseen


def _remove_oldest(folder: Path) -> None:
    """Keep to the limit: entries that were used least lately go, and what killed processes left."""
    entries = []
    with os.scandir(folder) as files:
        for file in files:
            if _ENTRY.fullmatch(file.name.strip(".").partition(".arrays")[0] + ".arrays"):
                with contextlib.suppress(OSError):
                    found = file.stat(follow_symlinks=False)
                    entries.append((found.st_mtime_ns, found.st_size, file.path))
    total, limit = sum(size for _, size, _ in entries), room()
    if total <= limit:
        return
    for _, size, path in sorted(entries):
        if total <= _LEFT * limit:
            break
        with contextlib.suppress(OSError):
            os.unlink(path)
            total -= size
