"""TOML files in, with every way in which that can fail turned into one clear problem.

Values of files, by key, to describe differences in words:

rows.right_primary.width = "1.5"      the key of a [[row]] whose id is right_primary
skin.usd (file) = "sha256 ..."        the content of a file that a value names
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.files.disk_cache import DIGEST_KEY, digest
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.values import Table
from featherfx.limits import MAX_NESTING, MAX_TOML_BYTES, irregular

_POSITION = re.compile(r"^(?P<what>.*) \(at (?P<where>.*)\)$", re.DOTALL)
# keys such as a.b.c with too many parts: tomllib takes the square of their number
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DEEP_KEY = re.compile(rf"(?m)(?:^[ \t\[]*|[{{,]\s*){_PART}(?:\.[ \t]*{_PART}){{{MAX_NESTING},}}")
# parts of tomllib's messages, and what to do
_ADVICE = {
    "Invalid value": "Put texts in quotes; numbers have a point, booleans are true and false",
    "Expected newline or end of document": "Write one key a line; numbers have a point, no comma",
    "Cannot declare": "Write the table once, or an array of tables in [[ ]]",
    "Cannot overwrite": "Write the key once",
    "Unclosed": "Close the bracket",
    "Illegal character": "Close the quotes",
    "Unterminated": "Close the quotes",
}
_TOO_DEEP = f"tables and arrays are nested deeper than {MAX_NESTING}"


def load_toml(path: Path, label: str = "") -> dict[str, Any]:
    """The file's tables. Raises InputError, which names the file (and line).

    label: how the file is called in it, its path where empty.
    """
    try:
        return _tables(path)
    except FileNotFoundError:
        fault = "there is no such file. Check the path"
    except RecursionError:
        fault = _TOO_DEEP
    except UnicodeDecodeError as error:
        fault = f"is not UTF-8 text (byte {error.start})"
    except tomllib.TOMLDecodeError as error:
        match = _POSITION.match(str(error))
        what, where = (match["what"], f"{match['where']}: ") if match else (str(error), "")
        fault = f"not valid TOML, {where}{what}{_advise(what, where, path)}"
    except _Unfit as error:
        fault = str(error)
    except ValueError as error:  # integers beyond Python's limits
        fault = f"cannot be read: {error}"
    except OSError as error:
        fault = f"cannot be read: {error.strerror or error}"
    raise InputError(Problem(label or str(path), "", fault))


def _advise(what: str, where: str, path: Path) -> str:
    """Return what to do about an error of syntax, by its line; empty where that is unknown."""
    text = path.read_text(encoding="utf-8-sig")
    number = re.search(r"line (\d+)", where)
    line = text.splitlines()[int(number[1]) - 1] if number else ""
    table = re.match(r"\s*\[(\w+)\]", line)
    if re.search("[\u2018-\u201f]", line):
        return ". Write straight quotes, \" or '"
    if table and f"[[{table[1]}]]" in text:
        return f". Write [[{table[1]}]] with two brackets, as above"
    if re.search(r"=\s*\[\s*\w+\s*=", line):
        return ". Write keys and their values in { }"
    return next((f". {each}" for part, each in _ADVICE.items() if part in what), "")


class _Unfit(ValueError):
    """File that is not TOML, or exceeds a limit."""


def _tables(path: Path) -> dict[str, Any]:
    if fault := irregular(path):
        raise _Unfit(f"{fault}, expects a TOML file")
    if (size := path.stat().st_size) > MAX_TOML_BYTES:
        sizes = f"has {size / 1e6:.3g} MB, more than {MAX_TOML_BYTES / 1e6:.3g} MB"
        raise _Unfit(f"{sizes}. Put thousands of feathers into a [[table]], a CSV or NPZ file")
    text = path.read_text(encoding="utf-8-sig")
    tables = None if _DEEP_KEY.search(text) else tomllib.loads(text)
    if tables is None or _is_deep(tables):
        raise _Unfit(_TOO_DEEP)
    return tables


def _is_deep(tables: dict[str, Any]) -> bool:
    """Return True if tables and arrays are nested deeper than allowed."""
    level: list[Any] = [tables]
    for _ in range(MAX_NESTING + 1):
        inner = [each.values() if isinstance(each, dict) else each for each in level]
        level = [part for each in inner for part in each if isinstance(part, dict | list)]
        if not level:
            return False
    return True


def file_kind(raw: dict[str, Any], path: Path, others: Mapping[str, Table]) -> str:
    """Return the best fit of the keys: "groom", a preset family, or one of some other tables by its
    name; "" where nothing does.

    A file in a folder named like a family is a preset of that family.
    """
    folder = path.absolute().parent.as_posix()
    for family in PRESET_FAMILIES:
        if folder.endswith(f"/{family}") and "name" not in raw:  # no preset has one
            return family
    tables = {**others, "groom": GROOM_FILE}
    tables |= {name: family.extended for name, family in PRESET_FAMILIES.items()}
    known = {name: sum(key in table.keys for key in raw) for name, table in tables.items()}
    best = max(known, key=lambda name: known[name])
    return best if known[best] else ""


# characters of a value that is told as it is, and values of one file
_LONGEST, _MOST = 72, 20_000


def told(tables: Mapping[str, Any], folder: Path) -> dict[str, str]:
    """Every value of a file's tables by its key, as JSON; long ones as a digest.

    folder: from which files that the tables name are seen.
    """
    found: dict[str, str] = {}
    for key, value in _leaves(tables, ""):
        found[key] = _text(value)
        # a groom's own values are told one by one
        if isinstance(value, str) and value[-5:] != ".toml" and (file := _named(value, folder)):
            found[f"{key} (file)"] = f"{DIGEST_KEY} {digest(file)}"
        if len(found) > _MOST:
            return {"values": f"{DIGEST_KEY} {digest(json.dumps(tables, default=str))}"}
    return found


def _leaves(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _leaves(part, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
        for number, each in enumerate(value):
            name = each.get("id", each.get("name"))
            at = f"{key}s.{name}" if isinstance(name, str) else f"{key}[{number}]"
            yield from _leaves(each, at)
    else:
        yield key, value


def _text(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= _LONGEST else f"{DIGEST_KEY} {digest(text)}"


def _named(value: str, folder: Path) -> Path | None:
    try:
        file = folder / value
        return file if value and file.is_file() else None
    except (OSError, ValueError):
        return None
