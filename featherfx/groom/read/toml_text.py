"""TOML out: values, and whole files of tables."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import write_text

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_of(value: Any, digits: int = 0) -> str:
    """A value as TOML writes it in one line. digits: of numbers; 0: all that they have."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        given = {key: each for key, each in value.items() if each is not None}
        return (
            "{ " + ", ".join(f"{_key(k)} = {toml_of(v, digits)}" for k, v in given.items()) + " }"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_of(each, digits) for each in value) + "]"
    if isinstance(value, int):
        return str(value)
    short = f"{value:.{digits or 12}g}"
    return short if digits or float(short) == value else repr(float(value))


def toml_text(tables: Mapping[str, Any]) -> str:
    """Write tables as the text of a file: values first, then each table under its header."""
    return "\n".join(_lines(tables, "")) + "\n"


def save_toml(tables: Mapping[str, Any], path: Path, overwrite: bool) -> None:
    """Write tables to a file, which appears whole.

    Raises InputError where it is no .toml, exists and may not be overwritten, or cannot be written.
    """
    fault = ""
    if path.suffix != ".toml":
        fault = f"has the suffix '{path.suffix}'. Give a name that ends in .toml"
    elif path.exists() and not overwrite:
        fault = "exists already. Choose another name, or overwrite=True"
    try:
        if not fault:
            write_text(path, toml_text(tables))
    except OSError as error:
        fault = f"cannot be written: {error.strerror or error}. Check the folder"
    if fault:
        raise InputError(Problem(str(path), "", fault))


def _lines(tables: Mapping[str, Any], header: str) -> Iterator[str]:
    below = {name: each for name, each in tables.items() if _is_below(each)}
    for name, value in tables.items():
        if name not in below:
            yield f"{_key(name)} = {toml_of(value)}"
    for name, value in below.items():
        title = f"{header}.{_key(name)}" if header else _key(name)
        for each in value if isinstance(value, list) else (value,):
            if isinstance(value, list):
                yield f"\n[[{title}]]"
            elif not each or not all(map(_is_below, each.values())):
                yield f"\n[{title}]"
            yield from _lines(each, title)


def _is_below(value: Any) -> bool:
    """Return True if a value stands under a header of its own."""
    several = isinstance(value, list) and bool(value)
    return isinstance(value, Mapping) or (several and all(isinstance(x, Mapping) for x in value))


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
