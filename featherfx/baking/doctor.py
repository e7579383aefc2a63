"""Self-test and description of this installation, for users and for problem reports."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

from featherfx._version import __version__
from featherfx.baking.bake import bake
from featherfx.baking.check import check
from featherfx.baking.install import sample_names
from featherfx.errors import InputError, SimulationError
from featherfx.files.folders import cache_folder, distrust, shipped

_NAME = "featherfx"
_SAMPLE, _FRAMES = "feather_pull", (1, 3)
# of the length: how far a base that is held moves in single precision, with a margin
_HELD = 1e-6


def examine(self_test: bool) -> dict[str, Any]:
    """Describe this installation, with its `problems`, one text each.

    version, python, platform, cores; packages: version by name of what is required, null where it
    is missing; extras: by name, whether it is there, and what is missing; usd: version and folder,
    null where there is none; cache: the folder for compiled code, whether it is used, its bytes and
    the processor seconds that a first bake still has to compile; presets, samples: how many, and
    their names. self_test: bake a sample for three frames, check the file and read it back;
    featherfx bakes, and compiles if need be. null where it is not run.
    """
    problems: list[str] = []
    found: dict[str, Any] = {
        "version": __version__,
        "python": platform.python_version(),
        "executable": sys.executable,
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "packages": {},
        "extras": {},
    }
    _packages(found, problems)
    found["usd"] = _usd(problems)
    found["cache"] = _cache(problems)
    found["presets"] = sum(1 for _ in shipped("presets").rglob("*.toml"))
    found["samples"] = list(sample_names())
    for kind in ("presets", "samples"):
        if not found[kind]:
            problems.append(f"{shipped(kind)}: holds no {kind}")
    found["self_test"] = _self_test(problems) if self_test and not problems else None
    return {**found, "problems": problems}


def _packages(found: dict[str, Any], problems: list[str]) -> None:
    """Add what is required, and by extra what is optional, as the package's metadata have it."""
    try:
        wanted = [Requirement(each) for each in importlib.metadata.requires(_NAME) or ()]
        extras = importlib.metadata.metadata(_NAME).get_all("Provides-Extra") or []
    except importlib.metadata.PackageNotFoundError:
        found["packages"] = found["extras"] = None  # runs from a checkout that is not installed
        return
    for each in _of(wanted, ""):
        version = found["packages"][each.name] = _version_of(each.name)
        if version is None and each.name == "usd-core":
            continue  # a host's own does as well
        if version is None:
            problems.append(f"{each.name}: is not installed, {each} is needed")
        elif not each.specifier.contains(version, prereleases=True):
            problems.append(f"{each.name}: is {version}, {each} is needed")
    for extra in extras:
        missing = [
            str(each).partition(";")[0].strip()
            for each in _of(wanted, extra)
            if not each.specifier.contains(_version_of(each.name) or "0.dev0", prereleases=True)
        ]
        found["extras"][extra] = {"installed": not missing, "missing": missing}


def _of(wanted: list[Requirement], extra: str) -> Iterator[Requirement]:
    """Yield requirements of an extra on this machine, other extras' included; "": of all."""
    for each in wanted:
        if each.marker is None:
            asked = not extra
        else:
            asked = each.marker.evaluate({"extra": extra})
            asked = asked and (not extra or not each.marker.evaluate({"extra": ""}))
        if not asked:
            continue
        if each.name == _NAME:
            for other in each.extras:
                yield from _of(wanted, other)
        else:
            yield each


def _version_of(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _usd(problems: list[str]) -> dict[str, Any] | None:
    try:
        from featherfx.usd.types import refuse_unfit_usd, usd_version

        version, folder = usd_version()
        refuse_unfit_usd()
    except ImportError as error:
        problems.append(f"USD: {error}; pip install usd-core, or use a host's")
        return None
    except InputError as error:
        problems += [str(each) for each in error.problems]
    return {"version": version, "folder": str(folder)}


def _cache(problems: list[str]) -> dict[str, Any]:
    """The folder of compiled code. One that cannot be used costs time, and is told as a problem."""
    from featherfx.jit.code_cache import explain_unloaded, explain_unsaved
    from featherfx.jit.compile_progress import predict_seconds

    wanted = cache_folder()
    used = not explain_unloaded(wanted)
    if fault := explain_unsaved():
        problems.append(f"{wanted}: {fault}")
    files = [each for each in wanted.rglob("*") if each.is_file()] if used else []
    return {
        "folder": str(wanted),
        "used": used,
        "files": len(files),
        "bytes": sum(each.stat().st_size for each in files if each.exists()),
        "shipped_code_unused": _explain_unshipped(),
        "seconds_to_compile": round(predict_seconds("bake"), 1),
    }


def _explain_unshipped() -> str:
    """Why no shipped machine code is loaded; empty if it is."""
    from featherfx.jit.code_cache import ROOT, SHIPPED, hash_source, shipped_target

    if not SHIPPED.is_dir():
        return "none came with the program"
    if not shipped_target():
        return "for other processors than this one, or the one that numba is told of"
    if fault := distrust(SHIPPED):
        return fault
    python = f"*.py{sys.version_info.major}{sys.version_info.minor}.*.code"
    folders = (SHIPPED / hash_source(each) for each in ROOT.rglob("*_kernels.py"))
    if not any(any(each.glob(python)) for each in folders):
        return "of other sources, or for another Python, numba or llvmlite"
    return ""


def _self_test(problems: list[str]) -> dict[str, Any]:
    """Bake a sample, check what was written, and read it back."""
    begin = time.perf_counter()
    shot, before = shipped("samples") / _SAMPLE / "shot.toml", len(problems)
    try:
        with tempfile.TemporaryDirectory(prefix="featherfx-") as folder:
            file = Path(folder) / "feather.usdc"
            bake(shot, file, frames=_FRAMES, quality="draft")
            problems += [f"self-test: {each}" for each in check(file)]
            problems += [f"self-test: {each}" for each in _read_back(file)]
    except (InputError, SimulationError, OSError) as error:
        problems += [f"self-test: {line}" for line in str(error).splitlines()]
    return {
        "ok": len(problems) == before,
        "sample": _SAMPLE,
        "seconds": round(time.perf_counter() - begin, 2),
    }


def _read_back(file: Path) -> Iterator[str]:
    """Yield problems of the motion of a pulled feather."""
    import numpy as np

    from featherfx.usd.read.cache import Cache

    cache = Cache(file)
    rest, last = cache.points(0), cache.points(0, _FRAMES[1])
    moved = float(np.abs(last - rest).max())
    length = float(np.ptp(rest, axis=0).max())
    if not 0.0 < moved < length:
        yield f"points moved by {moved:g} m, expected above 0 and below the length, {length:g} m"
    held = float(np.linalg.norm(last - rest, axis=1).min()) / length
    if held > _HELD:
        yield f"the base, which is held, moved by {held:g} of the length"
