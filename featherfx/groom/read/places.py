"""Where the key of a problem stands in its TOML file: the line, and the id of its entry."""

from __future__ import annotations

import re
from pathlib import Path

from featherfx.errors import Problem
from featherfx.limits import irregular

_KEY = re.compile(r"(?P<table>\w+)(?:\[(?P<number>\d+)\])?(?:\.(?P<leaf>\w+))?")
_MOST_BYTES = 1_000_000  # of a file that is looked through once more for each of its problems
_HEADER = re.compile(r"\s*\[")


def located(problem: Problem) -> str:
    """A problem in one line, with the line of its key and the id of its entry where these are told.

    As it is where the file does not hold the key in a line of its own, as `[[row]]` and `count =`.
    """
    told, match = str(problem), _KEY.match(problem.key)
    path = Path(problem.source)
    if match is None or path.suffix != ".toml" or irregular(path):
        return told
    try:
        if path.stat().st_size > _MOST_BYTES:
            return told
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, ValueError):
        return told
    table, number, leaf = match["table"], match["number"], match["leaf"]
    found = _entry(lines, table, number)
    if found is None:
        line = None if number else _assigned(lines, 0, table)
        return told if line is None else f"{told} (line {line + 1})"
    line = _assigned(lines, found + 1, leaf) if leaf else None
    where = f"line {(found if line is None else line) + 1}"
    name = _name(lines, found + 1)
    return f"{told} ({where}, {table} '{name}')" if name else f"{told} ({where})"


def _entry(lines: list[str], table: str, number: str | None) -> int | None:
    """The line, from 0, of the header of a table, or of one of an array."""
    opening, closing = (r"\[\[", r"\]\]") if number else (r"\[", r"\]")
    header = re.compile(rf"\s*{opening}\s*{table}\s*{closing}\s*(#.*)?")
    found = [k for k, line in enumerate(lines) if header.fullmatch(line)]
    index = int(number or 0)
    return found[index] if index < len(found) else None


def _assigned(lines: list[str], start: int, key: str) -> int | None:
    """The line, from 0, in which a key is set, before the next header."""
    assigned = re.compile(rf"\s*{key}\s*[=.]")
    for k in range(start, len(lines)):
        if _HEADER.match(lines[k]) and "=" not in lines[k]:
            return None
        if assigned.match(lines[k]):
            return k
    return None


def _name(lines: list[str], start: int) -> str:
    """What an entry is called by; empty where it does not say."""
    for key in ("id", "name"):
        line = _assigned(lines, start, key)
        if line is not None and (match := re.match(r"[^=]*=\s*\"([^\"]*)\"", lines[line])):
            return match[1]
    return ""
