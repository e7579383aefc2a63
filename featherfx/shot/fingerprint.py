"""Settings that a bake depends on, as short texts by key: equal texts, equal cache.

Values that fit on a line are kept as they are, so that a difference can be told; others as the
start of their SHA-256. Arrays count by their bytes, files that a shot names by their content, and
the shot, groom and preset files by their merged values only: a comment changes nothing.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

from featherfx.files.content import DIGITS, digest, members

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
