"""Telling what a TOML file is meant to be, from its keys and the folder that it lies in."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from featherfx.groom.preset_keys import FAMILIES, extended
from featherfx.groom.schema import Table


def file_kind(raw: dict[str, Any], path: Path, others: Mapping[str, Table]) -> str:
    """A preset family or a name of `others`: the one that knows most of the keys; "" for none.

    A file in a folder named like a family is a preset of that family.
    """
    folder = path.absolute().parent.as_posix()
    for family in FAMILIES:
        if folder.endswith(f"/{family}"):
            return family
    tables = dict(others) | {family: extended(family) for family in FAMILIES}
    known = {name: sum(key in table.keys for key in raw) for name, table in tables.items()}
    best = max(known, key=lambda name: known[name])
    return best if known[best] else ""
