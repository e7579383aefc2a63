"""Kinds of TOML files, recognised by their keys."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.values import Table


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
