"""What a bake depends on, as short texts by key: equal texts, equal cache.

Values that fit on a line are kept as they are, so that a difference can be told; others as the
start of their SHA-256. Arrays count by their bytes, files that a shot names by their content, and
the shot, groom and preset files by their merged values only: a comment changes nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.shot.types import Shot

_LONGEST = 72
_DIGITS = 16
# Folders of the program whose code decides what a cache holds.
_CODE = ("algebra", "groom", "feather", "mechanics", "solver", "shot", "usd")


def shot_settings(shot: Shot) -> dict[str, str]:
    """Everything of a shot and its groom that its simulation depends on."""
    found: dict[str, str] = {}
    for name, value in _members(shot):
        if is_dataclass(value):
            for inner, part in _members(value):
                found[f"{name}.{inner}"] = _text(part)
        else:
            found[name] = _text(value)
    return found


@cache
def program_digest() -> str:
    """Digest of the program's own code."""
    package = Path(__file__).resolve().parent.parent
    digest = hashlib.sha256()
    for folder in _CODE:
        for file in sorted((package / folder).rglob("*.py")):
            digest.update(str(file.relative_to(package)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def settings_digest(settings: Mapping[str, str]) -> str:
    """One short name for all settings."""
    return _digest(json.dumps(dict(settings), sort_keys=True).encode())


def _members(record: Any) -> Iterator[tuple[str, Any]]:
    for entry in fields(record):
        value = getattr(record, entry.name)
        told_by_values = entry.name == "source" and isinstance(value, Path)
        if not told_by_values and not entry.name.startswith("_"):
            yield entry.name, value


def _text(value: Any) -> str:
    text = json.dumps(_plain(value, {}), sort_keys=True)
    return text if len(text) <= _LONGEST else f"sha256 {_digest(text.encode())}"


def _plain(value: Any, seen: dict[int, Any]) -> Any:
    """A value as JSON; seen: by identity, so that shared kinds are walked once."""
    if is_dataclass(value):
        if id(value) not in seen:
            inner = {name: _plain(part, seen) for name, part in _members(value)}
            seen[id(value)] = _digest(json.dumps(inner, sort_keys=True).encode())
        return seen[id(value)]
    if isinstance(value, np.ndarray):
        if value.size <= 4:
            return value.tolist()
        return _digest(f"{value.shape} {value.dtype.str}".encode() + value.tobytes())
    if isinstance(value, Mapping):
        return {str(key): _plain(part, seen) for key, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(part, seen) for part in value]
    if isinstance(value, Path):
        return _file_digest(value) if value.is_file() else str(value)
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if hasattr(value, "origin"):  # a mesh or wind of a scene
        return _plain([*value.origin, getattr(value, "knots", None)], seen)
    raise TypeError(f"a {type(value).__name__} has no fingerprint")


def _file_digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:_DIGITS]


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:_DIGITS]
