"""What machine code is compiled for, and what this processor can run, without asking LLVM."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from functools import cache
from pathlib import Path

_LINUX = Path("/proc/cpuinfo")
# lines of it that say what is compiled for
_MODEL = ("vendor_id", "cpu family", "model", "stepping", "flags")
_ARM = ("CPU implementer", "CPU part", "CPU variant", "Features")
# LLVM's names of features, and Linux's where they are others
_OTHERWISE = {"bmi": "bmi1", "lzcnt": "abm", "sse4.2": "sse4_2", "neon": "asimd"}


def asked_for() -> str:
    """The processor that the user has numba compile for, and its features; empty if none."""
    given = [os.environ.get(f"NUMBA_CPU_{each}") for each in ("NAME", "FEATURES")]
    return named(given[0] or "", given[1] or "") if any(given) else ""


def named(name: str, features: str = "") -> str:
    """What machine code is for: system, kind of machine, LLVM's name of a processor, features."""
    return " ".join((sys.platform, platform.machine(), name, features)).rstrip()


@cache
def this_one() -> str:
    """What machine code is for that is compiled here, unless the user asks for another."""
    if lines := _lines():
        told = repr([lines.get(each) for each in (*_MODEL, *_ARM)])
        return named(hashlib.sha256(told.encode()).hexdigest()[:16])
    from llvmlite import binding

    return named(binding.get_host_cpu_name(), str(binding.get_host_cpu_features()))


def has(needs: tuple[str, ...]) -> bool:
    """Whether this processor has features, by LLVM's names."""
    if lines := _lines():
        flags = (lines.get("flags") or lines.get("Features", "")).split()
        return all(_OTHERWISE.get(each, each) in flags for each in needs)
    from llvmlite import binding

    found = binding.get_host_cpu_features()
    return all(found.get(each) for each in needs)


@cache
def _lines() -> dict[str, str]:
    """What Linux tells of the first processor; nothing elsewhere."""
    try:
        first = _LINUX.read_text(encoding="utf-8").split("\n\n")[0]
    except OSError:
        return {}
    pairs = (line.partition(":") for line in first.splitlines())
    return {key.strip(): value.strip() for key, _, value in pairs}
