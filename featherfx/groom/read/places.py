"""Lines of problems in TOML files, and the ids of their entries."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from featherfx.errors import Problem, as_sentence
from featherfx.limits import irregular

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
