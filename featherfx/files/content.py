"""Digests of values: the same for equal content, whatever object, file or process holds it.

The settings that a bake depends on are short texts by key: equal texts, equal cache. Values that
fit on a line are kept as they are, so that a difference can be told; others as the start of their
SHA-256. Arrays count by their bytes, files that a shot names by their content, and the shot, groom
and preset files by their merged values only: a comment changes nothing.
"""

from __future__ import annotations

import hashlib
import json
import weakref
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from operator import attrgetter
from pathlib import Path
from types import MethodType
from typing import Any

import numpy as np

DIGITS = 16
_SHORT = 128  # bytes of an array that stand for themselves
_PLAIN = frozenset((bool, int, float, str, type(None)))
_RECORDS: set[Any] = set()  # types of records that were met
# folders of the program whose code decides what it computes
_CODE = ("algebra", "groom", "coat", "feather", "mechanics", "solver", "shot", "usd")


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
