"""Machine code that came with the program (ship.py), for processors that many have.

Entries are named and checked as in a user's own folder (cache.py, stored.py): by content of the
sources, the versions of numba, llvmlite and Python, the system and the processor. What does not fit
is not found, and is compiled.
"""

from __future__ import annotations

import platform
import sys
from functools import cache
from typing import NamedTuple

from featherfx.files.trust import distrust
from featherfx.jit import processor
from featherfx.jit.cache import ROOT, cache_folder

FOLDER = ROOT / "_machine_code"


class Processor(NamedTuple):
    """What machine code is for. name: LLVM's; needs: features that a processor must have."""

    name: str
    needs: tuple[str, ...]


# by architecture, the fastest first; x86-64-v3: Haswell, Zen and later (x86-64 psABI, table 3.1)
_V3 = ("avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2")
PROCESSORS = {
    "x86_64": (Processor("x86-64-v3", _V3),),
    "AMD64": (Processor("x86-64-v3", _V3),),
    "aarch64": (Processor("generic", ("neon",)),),
    "arm64": (Processor("generic", ("neon",)),),
}


def of_this_machine() -> tuple[Processor, ...]:
    """The kinds of machine code that this processor can run."""
    family = PROCESSORS.get(platform.machine(), ())
    return tuple(each for each in family if processor.has(each.needs))


@cache
def fitting() -> tuple[Processor, ...]:
    """The kinds of machine code to look for among what came with the program: none where there is
    nothing, or where the user has numba compile for another processor."""
    return of_this_machine() if FOLDER.is_dir() and not processor.asked_for() else ()


def unused() -> str:
    """Why nothing that came with the program is loaded, in words; empty if it is."""
    if not FOLDER.is_dir():
        return "none came with the program"
    if not fitting():
        return "for other processors than this one, or the one that numba is told of"
    if fault := distrust(FOLDER):
        return fault
    python = f"*.py{sys.version_info.major}{sys.version_info.minor}.*.code"
    folders = (FOLDER / cache_folder(each).name for each in ROOT.rglob("*_kernels.py"))
    if not any(any(each.glob(python)) for each in folders):
        return "of other sources, or for another Python, numba or llvmlite"
    return ""
