"""Sizes beyond which an input is refused, and how an option declares what it may be; each size is
declared here once, docs/reference.md lists them.

They lie far above what films use and below what makes a machine swap or a run last for hours. A
message says the value, the limit, and what to do instead or how to raise it.
"""

from __future__ import annotations

import math
import os
import shutil
import stat
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from featherfx.errors import InputError, Problem

MAX_TOML_BYTES = 8_000_000
MAX_NESTING = 64  # tables and arrays within each other, and parts of a dotted key
MAX_BASES = 64  # presets that extend each other
MAX_FEATHERS = 1_000_000
MAX_BIRDS = 100_000  # of a flock
CROWD_PAIRS, MAX_NEIGHBOURS = 500_000, 200  # of feathers that stand at one place
MAX_ARRAY_BYTES = 500_000_000  # of one in an NPZ file
MAX_TRIED = 4000  # shapes that `featherfx check` builds, feathers read of a groom with faults
MAX_PATTERNS = 10_000  # of [overrides]
MAX_CHARACTERS = 1000  # of a text: a name, a path, a pattern
MAX_LISTED = 100  # problems of one file that are told one by one
MAX_SEARCHES = 100  # names for which the likeliest meant one is looked for
MAX_COMPARED = 1000  # names that one is compared with
MAX_JOBS = 1024
MAX_ROWS, MAX_COLUMNS, MAX_BARBS = 5000, 500, 10_000  # of what is drawn of a feather
MAX_BARBULES = 1000  # that are drawn on either side of a barb; real ones have up to 600
MAX_CLUMPS = 1000  # of the barbs of a vane that is wet
MAX_SUBFRAMES = 1000
MAX_FRAMES = 1_000_000  # that are written at a time
MAX_SHARES = 10_000  # of the feathers of a bake
TASK_HOURS = 24.0  # after which a scheduler stops a task of a plan, where none are given
MAX_SHEET = 400  # pictures on a contact sheet
MAX_SIDE = 8192  # pixels of a side of a picture
MAX_FILM_RATE = 50  # pictures a second of a film; browsers show none shorter of a GIF
MIN_LARGE_OUTPUT = 5e8  # bytes of a cache whose size is told before the work
MAX_KEPT_BYTES = 2e9  # of layouts, models and the like in the cache folder (files/disk_cache.py)
MAX_PIXELS = 100_000_000  # of all pictures that are drawn at a time

MEMORY_VARIABLE = "FEATHERFX_MEMORY"
# of a bake of one feather, bytes; OpenUSD alone reserves 0.8 GB for names of prims and properties
MIN_ADDRESS_SPACE = 1.25e9


def option(default: Any, text: str, **limits: Any) -> Any:
    """A field of a class of options.

    text: its meaning with unit, for help. limits: least, most, above: what a number is at least, at
    most, or more than; allowed: names; form: of two numbers in one text, "A-B", "I/N" or "WxH";
    several: of a sequence, one a flag; reads: a file; there: one that is there; metavar: in help;
    flag: on the command line, where it is not the name; several with blanks between.
    """
    return field(default=default, metadata={"text": text, **limits})


def irregular(path: Path) -> str:
    """Why a path is nothing to read from: a folder, or a pipe or device that may never end.

    Empty for a regular file, and where there is nothing.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return ""
    if stat.S_ISDIR(mode):
        return "is a folder"
    return "" if stat.S_ISREG(mode) else "is not a regular file"


def memory_limit() -> tuple[float, str]:
    """Bytes that a command may plan to use, and what says so.

    Those of the environment variable FEATHERFX_MEMORY (GB), else the machine's or process's. Raises
    InputError for a variable that is no number above 0.
    """
    given = os.environ.get(MEMORY_VARIABLE, "")
    if given:
        try:
            limit = 1e9 * float(given)
        except ValueError:
            limit = 0.0
        if not limit > 0.0:
            raise InputError(Problem(MEMORY_VARIABLE, "", f"'{given}' is no number of GB above 0"))
        return limit, f"that {MEMORY_VARIABLE} allows"
    return _memory_there(), f"that are there ({MEMORY_VARIABLE}, in GB, sets another limit)"


def _memory_there() -> float:
    """Bytes of the machine, or that the process may have; infinite where neither is told."""
    if os.name != "posix":
        return math.inf
    machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(machine, process_limit("RLIMIT_AS"), process_limit("RLIMIT_DATA"))


def process_limit(name: str) -> float:
    """Return a limit of this process by its name in `resource`; infinite where there is none."""
    try:
        # not on Windows
        import resource
    except ImportError:
        return math.inf
    limit = resource.getrlimit(getattr(resource, name))[0]
    return math.inf if limit == resource.RLIM_INFINITY else float(limit)


def refuse_beyond_memory(needed: float, source: str, key: str, what: str) -> None:
    """Raise InputError where something needs more bytes than there are.

    needed: estimate in bytes. source, key: of the problem. what: that needs it, in words.
    """
    limit, whose = memory_limit()
    if needed > limit:
        sizes = f"about {as_size(needed)} of memory, more than the {as_size(limit)} {whose}"
        raise InputError(Problem(source, key, f"{what} would need {sizes}"))


def describe_large_output(needed: float, samples: int, path: Path, smaller: Sequence[str]) -> str:
    """Describe an output of so many bytes that is large; empty for others.

    smaller: options that would make it so. Raises InputError where the disk of its folder has no
    room for it.
    """
    free = shutil.disk_usage(path.parent).free
    each = f"about {as_size(needed)}, {as_size(needed / samples)} a sample"
    less = f"give {' or '.join(smaller)}" if smaller else "bake fewer frames"
    if needed > free:
        told = f"takes {each}, but its disk has {as_size(free)} left. Make room, or {less}"
        raise InputError(Problem(str(path), "", told))
    if needed <= MIN_LARGE_OUTPUT:
        return ""
    return f"{path}: takes {each}. {less[0].upper()}{less[1:]} for less"


def as_size(size: float) -> str:
    """Write a number of bytes with its unit."""
    power = min(max(int(math.log10(max(size, 1.0)) // 3), 1), 5)
    return f"{size / 1000.0**power:.3g} {' kMGTP'[power]}B"
