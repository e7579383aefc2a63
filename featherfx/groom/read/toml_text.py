"""TOML as text: values and whole files out, differences in words, and lines of problems."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem, as_sentence
from featherfx.files.atomic_write import write_text
from featherfx.files.disk_cache import DIGEST_KEY
from featherfx.limits import irregular

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


# the part of a key that is a preset, or a row, region and the like, by its id
_THING = re.compile(r"(presets\.[^.]+|(?:shot\.)?(?!overrides\.)\w+s\.[^.]+)\.")


def changes(before: Mapping[str, str], now: Mapping[str, str]) -> dict[str, str]:
    """Describe differences by key: `1.5 -> 1.6`; of a row, a preset and the like that is on one
    side alone, that it is."""
    there, found = (_things(before), _things(now)), {}
    for key in {**now, **before}:
        thing = _thing(key)
        if before.get(key) == now.get(key):
            continue
        if thing and sum(thing in each for each in there) == 1:
            found[thing] = "was not there" if thing in there[1] else "is not there any more"
        else:
            found[key] = _change(before.get(key), now.get(key))
    return found


def _thing(key: str) -> str:
    found = _THING.match(key)
    return found[1] if found else ""


def _things(values: Mapping[str, str]) -> set[str]:
    return {_thing(key) for key in values}


def _change(before: str | None, now: str | None) -> str:
    if any(each is not None and each.startswith(DIGEST_KEY) for each in (before, now)):
        if before is None or now is None:
            return "was not there" if before is None else "is not there any more"
        return "is another now"
    return " -> ".join("not set" if each is None else each for each in (before, now))


_KEY = re.compile(r"(?P<table>\w+)(?:\[(?P<number>\d+)\])?(?P<below>.*)", re.DOTALL)
_BELOW = re.compile(r'\.(?:"([^"]*)"|([\w-]+))')
_MAX_BYTES = 1_000_000  # of a file that is looked through once more for each of its problems
_HEADER = re.compile(r"\s*\[")


def located(problem: Problem) -> str:
    """Print a problem in one line, with the line of its key and the id of its entry if found.

    Keys are found where a line of their own holds them, as `[[row]]`, `[bird.tail]` and `count =`.
    """
    match, path = _KEY.match(problem.key), Path(problem.source)
    if match is None or path.suffix != ".toml" or irregular(path):
        return as_sentence(str(problem))
    try:
        if path.stat().st_size > _MAX_BYTES:
            return as_sentence(str(problem))
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError):
        return as_sentence(str(problem))
    table, number = match["table"], match["number"]
    line = found = _entry(lines, table, number)
    name = None
    if found is not None:
        below = [quoted or bare for quoted, bare in _BELOW.findall(match["below"])]
        line, name = _deepest(lines, found, table, below), _name(lines, found + 1)
    else:  # a value, or a part of one
        line = _assigned(lines, 0, table)
    if line is None:
        return as_sentence(str(problem))
    key = f"{problem.key} ('{name}')" if name else problem.key
    return as_sentence(str(replace(problem, source=f"{problem.source}:{line + 1}", key=key)))


def _entry(lines: list[str], table: str, number: str | None) -> int | None:
    """The line, from 0, of the header of a table, or of one of an array."""
    opening, closing = (r"\[\[", r"\]\]") if number else (r"\[", r"\]")
    header = re.compile(rf"\s*{opening}\s*{table}\s*{closing}\s*(#.*)?")
    found = [k for k, line in enumerate(lines) if header.fullmatch(line)]
    index = int(number or 0)
    return found[index] if index < len(found) else None


def _deepest(lines: list[str], start: int, table: str, below: list[str]) -> int:
    """The line, from 0, of the last key below a table at a line that is set or heads a table."""
    line, title = start, table
    own = re.compile(rf"\s*\[\[\s*{table}\s*\]\]")
    last = next((k for k in range(start + 1, len(lines)) if own.match(lines[k])), len(lines))
    for key in below:
        title += rf'\s*\.\s*"?{re.escape(key)}"?'
        if (found := _assigned(lines, line + 1, key)) is not None:
            return found
        header = re.compile(rf"\s*\[\s*{title}\s*\]\s*(#.*)?")
        heads = [k for k in range(start + 1, last) if header.fullmatch(lines[k])]
        if not heads:
            return line
        line = heads[0]
    return line


def _assigned(lines: list[str], start: int, key: str) -> int | None:
    """The line, from 0, in which a key is set, before the next header."""
    assigned = re.compile(rf'\s*"?{re.escape(key)}"?\s*[=.]')
    for k in range(start, len(lines)):
        if _HEADER.match(lines[k]) and "=" not in lines[k]:
            return None
        if assigned.match(lines[k]):
            return k
    return None


def _name(lines: list[str], start: int) -> str:
    """Return the name of an entry; empty if it has none."""
    for key in ("id", "name"):
        line = _assigned(lines, start, key)
        if line is not None and (match := re.match(r"[^=]*=\s*\"([^\"]*)\"", lines[line])):
            return match[1]
    return ""
