"""Keys of earlier versions: what an unknown key is called now, or what to write instead.

A name is matched with the end of a dotted key, so "level_of_detail.fade" is about that table only.
CHANGELOG.md lists the same.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

# old name, new name
RENAMED: Mapping[str, str] = {}
# old name, what to do instead
REMOVED: Mapping[str, str] = {
    "coast": "delete it: feathers that move evenly with their roots are simulated like all others",
    "twins": "delete it: feathers that move alike are simulated one by one",
    "level_of_detail.fade": "delete it: the largest size of a feather in the frames of the shot "
    "chooses one level for the whole shot",
}


def find_replacement(key: str) -> str:
    """Return what to write instead of an unknown dotted key, as half a sentence; empty where it
    was never known."""
    path = re.sub(r"\[\d+\]", "", key).split(".")
    ends = [".".join(path[k:]) for k in range(len(path))]
    for name in ends:
        if name in RENAMED:
            return f"was renamed; write '{RENAMED[name]}' instead"
        if name in REMOVED:
            return f"was removed; {REMOVED[name]}"
    return ""
