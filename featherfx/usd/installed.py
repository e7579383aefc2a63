"""The USD library of this process: a host's own, or the wheel `usd-core`."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from featherfx.errors import Problem, require
from featherfx.files.memory import refuse_small_address_space

MIN_USD_VERSION = (0, 24, 3)
# the library that every program with USD loads first; all in one, or with the others beside it
_LIBRARY = re.compile(r"lib(?:\w*_)?(?:usd|pxr)_(?:ms|tf)\b[^/]*\.so[^/]*")
_MAPS = Path("/proc/self/maps")


@cache
def refuse_unfit_usd() -> None:
    """Raise InputError for a USD that is too old, or that is loaded twice in this process.

    Two libraries of USD share neither layers nor types, and crash the process sooner or later. Only
    Linux lists the loaded libraries.
    """
    refuse_small_address_space()
    from pxr import Usd

    problems = []
    if (found := Usd.GetVersion()) < MIN_USD_VERSION:
        told = "is USD {}.{}, but 24.3 is the oldest that is read and written".format(*found[1:])
        problems.append(Problem(str(Path(Usd.__file__).parent.parent), "", told))
    if len(loaded := loaded_libraries()) > 1:
        told = f"is loaded beside {', '.join(loaded[1:])}: two installs of USD in one process"
        problems.append(Problem(loaded[0], "", f"{told}. Use the host's alone (docs/dcc.md)"))
    require(*problems)


def loaded_libraries() -> list[str]:
    """Return the files of USD's base library in this process; none where the system lists none."""
    try:
        lines = _MAPS.read_text(errors="replace").splitlines()
    except OSError:
        return []
    files = {line.split(maxsplit=5)[-1] for line in lines if line.count("/")}
    return sorted(file for file in files if _LIBRARY.fullmatch(file.rpartition("/")[2]))


def usd_version() -> tuple[str, Path]:
    """Return the version of USD, such as "26.11", and its folder.

    Raises ModuleNotFoundError where there is none.
    """
    from pxr import Usd

    return "{}.{:02}".format(*Usd.GetVersion()[1:]), Path(Usd.__file__).parents[2]
