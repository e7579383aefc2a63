"""TOML files in, with every way in which that can fail turned into one clear problem."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from featherfx.groom.keys.values import Problems

_POSITION = re.compile(r"^(?P<what>.*) \(at (?P<where>.*)\)$", re.DOTALL)


def load_toml(path: Path, problems: Problems, label: str = "") -> dict[str, Any] | None:
    """The file's tables, or None after adding a problem that names the file (and line).

    label: how the file is called in problems, its path where empty.
    """
    source = label or str(path)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        problems.add(source, "", "there is no such file")
    except IsADirectoryError:
        problems.add(source, "", "is a folder, expects a TOML file")
    except UnicodeDecodeError as error:
        problems.add(source, "", f"is not UTF-8 text (byte {error.start})")
    except tomllib.TOMLDecodeError as error:
        match = _POSITION.match(str(error))
        text = f"{match['where']}: {match['what']}" if match else str(error)
        problems.add(source, "", f"not valid TOML, {text}")
    except (ValueError, RecursionError) as error:  # integers or nesting beyond Python's limits
        problems.add(source, "", f"cannot be read: {error}")
    except OSError as error:
        problems.add(source, "", f"cannot be read: {error.strerror or error}")
    return None
