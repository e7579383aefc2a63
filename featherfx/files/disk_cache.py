"""Arrays that were computed once for the same content, in the user's cache folder.

Every entry is a file of its own: a checksum, then plain arrays (NPZ, nothing that is unpickled).
Its name holds a digest of all that it was computed from, the program's own code included. What is
damaged counts as missing. Nothing is loaded from a folder that others can write to (folders.py);
where nothing can be kept, all is computed anew, with the same result. Processes that want the same
entry at a time wait for the one that computes it. Entries that were used least lately are removed
where all together take more than MAX_KEPT_BYTES, or $FEATHERFX_CACHE_SIZE (GB).

Digests of values: the same for equal content, whatever object, file or process holds it.

The settings that a bake depends on are short texts by key: equal texts, equal cache. Values that
fit on a line are kept as they are, so that a difference can be told; others as the start of their
SHA-256. Arrays count by their bytes, files that a shot names by their content, and the shot, groom
and preset files by their merged values only: a comment changes nothing.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import weakref
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import MethodType
from typing import Any

import numpy as np
from filelock import FileLock
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.files.folders import (
    cache_folder,
    doubt,
    make_private_folder,
    read_trusted,
    write_private,
)
from featherfx.limits import MAX_KEPT_BYTES

DIGITS = 16
_SHORT = 128  # bytes of an array that stand for themselves
_PLAIN = frozenset((bool, int, float, str, type(None)))
_RECORDS: set[Any] = set()  # types of records that were met
# folders of the program whose code decides what it computes
_CODE = ("algebra", "groom", "coat", "feather", "mechanics", "solver", "shot", "usd")
# of a value that is told by its digest
DIGEST_KEY = "sha256"


def digest(*values: Any) -> str:
    """Return a digest of numbers, texts, arrays, records, and lists and tables of these.

    Records count by their fields, but those whose name begins with "_"; arrays by their bytes;
    paths by the content of their file. What has an `origin` (a mesh or wind of a scene) counts by
    that; methods count by their name and object. Raises TypeError for anything else.
    """
    return _digest(_Walk().of(values))


def digests(values: Iterable[Any]) -> list[str]:
    """Return a digest of each value; records that many of them share are digested once."""
    walk = _Walk()
    return [_digest(walk.of(value)) for value in values]


def stable_number(name: str) -> int:
    """A number from 0 to 2^63 - 1 made from an id, so that it stays when others come or go."""
    found = hashlib.blake2b(name.encode(), digest_size=8).digest()
    return int.from_bytes(found, "little") >> 1


@cache
def program_digest() -> str:
    """Return a digest of the program's own code, and of numpy, which it computes with."""
    package = Path(__file__).resolve().parent.parent
    found = hashlib.sha256(np.__version__.encode())
    for folder in _CODE:
        for file in sorted((package / folder).rglob("*.py")):
            found.update(str(file.relative_to(package)).encode())
            found.update(file.read_bytes())
    return found.hexdigest()[:DIGITS]


def members(record: Any) -> list[tuple[str, Any]]:
    """Names and values of a record's fields that count; not where it was read from."""
    kind: Any = type(record)
    names, values_of = _named(kind)
    found = list(zip(names, values_of(record), strict=True))
    if "source" in names:
        return [each for each in found if each[0] != "source" or not isinstance(each[1], Path)]
    return found


@cache
def _named(kind: Any) -> tuple[tuple[str, ...], Callable[[Any], tuple[Any, ...]]]:
    """Names of a record's fields, and what gets their values."""
    names = tuple(each.name for each in fields(kind) if not each.name.startswith("_"))
    if len(names) > 1:
        return names, attrgetter(*names)
    return names, lambda record: tuple(getattr(record, name) for name in names)


class _Walk:
    """Bytes that tell values apart; records that are there more than once are walked once."""

    def __init__(self) -> None:
        # the records themselves are held, so that no other takes the place of one
        self._known: dict[int, tuple[Any, bytes]] = {}
        self._changing = 0  # values met so far that may change while they are there

    def of(self, value: Any) -> bytes:
        """Bytes of a value, of its type and size first, so that two cannot be taken for one."""
        if type(value) in _PLAIN:
            return f"{type(value).__name__} {value!r};".encode()
        if type(value) in _RECORDS:
            return self._record(value)
        if isinstance(value, np.generic):
            return self.of(value.item())
        if isinstance(value, np.ndarray):
            self._changing += 1
            head = f"array {value.shape} {value.dtype.str} ".encode()
            # in C order; the head tells how many bytes follow
            content = value.tobytes()
            return head + (content if len(content) <= _SHORT else _hashed(content))
        if isinstance(value, (tuple, list)):
            self._changing += isinstance(value, list)
            if _PLAIN.issuperset(map(type, value)):
                return f"plain {tuple(value)!r};".encode()
            return f"list {len(value)} ".encode() + b"".join(map(self.of, value))
        if isinstance(value, frozenset):
            return self.of(sorted(value))
        if isinstance(value, Mapping):
            self._changing += 1
            pairs = sorted((str(key), part) for key, part in value.items())
            return self.of([part for pair in pairs for part in pair])
        if isinstance(value, Path):
            self._changing += 1
            return _file(value) if value.is_file() else self.of(str(value))
        return self._record(value)

    def _fields(self, record: Any) -> bytes:
        """Bytes of a record's members, by their names."""
        kind: Any = type(record)
        names, values_of = _named(kind)
        if "source" not in names and _PLAIN.issuperset(map(type, values := values_of(record))):
            return f"record {names!r} {values!r}".encode()
        plain: list[tuple[str, Any]] = []
        others: list[bytes] = []
        found = members(record)
        for name, value in found:
            if type(value) in _PLAIN:
                plain.append((name, value))
            else:
                others.append(name.encode() + b" " + self.of(value))
        return f"record {len(found)} {plain!r} ".encode() + b"".join(others)

    def _record(self, value: Any) -> bytes:
        if (known := _CONSTANT.get(id(value))) is not None and known[0]() is value:
            return b"record " + known[1]
        if id(value) not in self._known:
            before = self._changing
            if type(value) in _RECORDS or is_dataclass(value):
                _RECORDS.add(type(value))
                found = self._fields(value)
            elif hasattr(value, "origin"):
                found = self.of((*value.origin, getattr(value, "knots", None)))
                self._changing += 1
            elif isinstance(value, MethodType):
                found = self.of((value.__name__, value.__self__))
                self._changing += 1
            else:
                raise TypeError(f"a {type(value).__name__} has no digest")
            self._known[id(value)] = value, _hashed(found)
            if self._changing == before and value.__dataclass_params__.frozen:
                if len(_CONSTANT) >= _MAX_CONSTANT:
                    _CONSTANT.clear()
                _CONSTANT[id(value)] = weakref.ref(value), self._known[id(value)][1]
        return b"record " + self._known[id(value)][1]


# digests of records that hold numbers and texts only, such as kinds of feathers, which are asked
# for again and again; by identity, while they are there
_CONSTANT: dict[int, tuple[Any, bytes]] = {}
_MAX_CONSTANT = 200_000


def _file(path: Path) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def _hashed(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:DIGITS]


_LONGEST = 72
# members that say where values came from
_SOURCES = frozenset({"document", "inputs"})
# numbers of an array that are told one by one
_FEW = 4


def shot_settings(shot: Any) -> dict[str, str]:
    """Everything of a shot and its groom that its simulation depends on."""
    found: dict[str, str] = {}
    for name, value in members(shot):
        if name in _SOURCES:
            continue
        if is_dataclass(value):
            for inner, part in members(value):
                if inner in _SOURCES:
                    continue
                found[f"{name}.{inner}"] = _text(part)
        else:
            found[name] = _text(value)
    return found


def settings_digest(settings: Mapping[str, str]) -> str:
    """One short name for all settings."""
    text = json.dumps(dict(settings), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def _text(value: Any) -> str:
    short = _plain(value)
    return f"sha256 {digest(value)}" if short is None or len(short) > _LONGEST else short


def _plain(value: Any) -> str | None:
    """A value as JSON; None where it holds records, files or long arrays."""
    if isinstance(value, np.ndarray):
        return json.dumps(value.tolist()) if value.size <= _FEW else None
    try:
        return json.dumps(value, sort_keys=True)
    except TypeError:
        return None


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
    on, but the program: what digest takes. Arrays hold no objects. Raises
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
