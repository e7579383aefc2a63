"""Prim names from the users' ids."""

from __future__ import annotations

import re
from collections.abc import Sequence


def prim_name(text: str) -> str:
    """A valid ASCII prim name: every other character becomes "_"; never empty."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text) or "_"
    return f"_{name}" if name[0].isdigit() else name


def unique_prim_names(ids: Sequence[str]) -> list[str]:
    """One prim name per id, all different and the same for the same ids in the same order.

    Ids that are valid names keep them; where sanitised ids collide, the later ones get _2, _3...
    """
    names = [prim_name(text) for text in ids]
    taken = {name for name, text in zip(names, ids, strict=True) if name == text}
    for index, (name, text) in enumerate(zip(names, ids, strict=True)):
        if name == text:
            continue
        candidate, count = name, 1
        while candidate in taken:
            count += 1
            candidate = f"{name}_{count}"
        taken.add(candidate)
        names[index] = candidate
    return names
