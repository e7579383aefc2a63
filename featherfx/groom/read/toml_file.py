"""TOML files in, with every way in which that can fail turned into one clear problem."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from featherfx.groom.keys.values import Problems
from featherfx.limits import MOST_NESTING, MOST_TOML_BYTES, irregular

_POSITION = re.compile(r"^(?P<what>.*) \(at (?P<where>.*)\)$", re.DOTALL)
# keys such as a.b.c with too many parts: tomllib takes the square of their number
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_DEEP_KEY = re.compile(rf"(?m)(?:^[ \t\[]*|[{{,]\s*){_PART}(?:\.[ \t]*{_PART}){{{MOST_NESTING},}}")
_TOO_DEEP = f"tables and arrays are nested deeper than {MOST_NESTING}"


def load_toml(path: Path, problems: Problems, label: str = "") -> dict[str, Any] | None:
    """The file's tables, or None after adding a problem that names the file (and line).

    label: how the file is called in problems, its path where empty.
    """
    source = label or str(path)
    if fault := irregular(path):
        problems.add(source, "", f"{fault}, expects a TOML file")
        return None
    try:
        if (size := path.stat().st_size) > MOST_TOML_BYTES:
            problems.add(source, "", _too_large(size))
            return None
        text = path.read_text(encoding="utf-8-sig")
        tables = None if _DEEP_KEY.search(text) else tomllib.loads(text)
        if tables is not None and not _is_deep(tables):
            return tables
        problems.add(source, "", _TOO_DEEP)
    except FileNotFoundError:
        problems.add(source, "", "there is no such file")
    except RecursionError:
        problems.add(source, "", _TOO_DEEP)
    except UnicodeDecodeError as error:
        problems.add(source, "", f"is not UTF-8 text (byte {error.start})")
    except tomllib.TOMLDecodeError as error:
        match = _POSITION.match(str(error))
        text = f"{match['where']}: {match['what']}" if match else str(error)
        problems.add(source, "", f"not valid TOML, {text}")
    except ValueError as error:  # integers beyond Python's limits
        problems.add(source, "", f"cannot be read: {error}")
    except OSError as error:
        problems.add(source, "", f"cannot be read: {error.strerror or error}")
    return None


def _too_large(size: int) -> str:
    sizes = f"has {size / 1e6:.3g} MB, allowed {MOST_TOML_BYTES / 1e6:.3g} MB"
    return f"{sizes}; thousands of feathers stand in a [[table]], a CSV or NPZ file"


def _is_deep(tables: dict[str, Any]) -> bool:
    """Whether tables and arrays are nested beyond what is allowed."""
    level: list[Any] = [tables]
    for _ in range(MOST_NESTING + 1):
        inner = [each.values() if isinstance(each, dict) else each for each in level]
        level = [part for each in inner for part in each if isinstance(part, dict | list)]
        if not level:
            return False
    return True
