"""This installation: samples and plugins copied from it, its self-test and description.

A plugin is a folder `featherfx_HOST` with the host's files and those that all share; Houdini and
Maya find it by a small file beside it. The folder appears in one step, the small file after it, and
where that fails the folder is gone again.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import platformdirs
from packaging.requirements import Requirement

from featherfx._version import __version__
from featherfx.errors import InputError, Problem, SimulationError
from featherfx.files.atomic_write import write_text
from featherfx.files.folders import cache_folder, distrust, shipped

_SHIPPED = Path(__file__).resolve().parent.parent / "plugins"
_MARK = "featherfx_plugin.json"
_COMMAND = "featherfx_command.json"


class Host(NamedTuple):
    """A program with a plugin. finder: its file that is filled in and stands beside the folder, ""
    for none. folder: where the program looks, None where that cannot be known. then: what is still
    to be done, with FOLDER for where the plugin is."""

    name: str
    title: str
    finder: str
    folder: Callable[[], Path | None]
    then: str


def _houdini() -> Path | None:
    """The folder of packages of the user's newest Houdini."""
    if given := os.environ.get("HOUDINI_USER_PREF_DIR"):
        return Path(given) / "packages"
    places = {
        "darwin": (Path.home() / "Library/Preferences/houdini", "[0-9]*"),
        "win32": (Path.home() / "Documents", "houdini[0-9]*"),
    }
    above, pattern = places.get(sys.platform, (Path.home(), "houdini[0-9]*"))

    def version(path: Path) -> list[int]:
        parts = path.name.removeprefix("houdini").split(".")
        return [int(part) if part.isdigit() else -1 for part in parts]

    found = sorted((each for each in above.glob(pattern) if each.is_dir()), key=version)
    return found[-1] / "packages" if found else None


def _maya() -> Path | None:
    """The user's folder of modules, for all versions."""
    if given := os.environ.get("MAYA_APP_DIR"):
        return Path(given) / "modules"
    above = {"darwin": "Library/Preferences/Autodesk/maya", "win32": "Documents/maya"}
    folder = Path.home() / above.get(sys.platform, "maya")
    return folder / "modules" if folder.is_dir() else None


def _own() -> Path:
    return platformdirs.user_data_path("featherfx", appauthor=False) / "plugins"


HOSTS = {
    each.name: each
    for each in (
        Host("houdini", "Houdini", "featherfx.json", _houdini, "start Houdini; tab menu featherfx"),
        Host("maya", "Maya", "featherfx.mod", _maya, "start Maya; menu featherfx"),
        Host(
            "usdvalidation",
            "USD's validators",
            "",
            _own,
            "add FOLDER to PXR_PLUGINPATH_NAME and PYTHONPATH of a Python that has featherfx",
        ),
        Host("usdview", "usdview", "", _own, "add FOLDER to PXR_PLUGINPATH_NAME and PYTHONPATH"),
    )
}


def listed() -> list[dict[str, Any]]:
    """All plugins: host, title, folder (null where none is found), the version that is shipped, and
    the one that is installed there (null for none)."""
    found = []
    for host in HOSTS.values():
        folder = host.folder()
        version = None if folder is None else _version(folder / f"featherfx_{host.name}")
        told: dict[str, Any] = {"host": host.name, "title": host.title, "shipped": __version__}
        found.append(told | {"folder": folder and str(folder), "installed": version})
    return found


def install(name: str, into: str | Path | None = None, overwrite: bool = False) -> tuple[Path, str]:
    """Install the plugin of a host; returns its folder and what is left to do.

    into: the folder that the host searches, default: the one that it has. Raises InputError for a
    host that there is none of, a folder that is not found or not ours to replace, and where
    something cannot be written; then nothing is left behind.
    """
    if name not in HOSTS:
        raise InputError(Problem("plugins", "", f"'{name}' is not one of {', '.join(HOSTS)}"))
    host = HOSTS[name]
    folder = host.folder() if into is None else Path(into).absolute()
    if folder is None:
        told = f"no folder of {host.title} was found. Name one with --into"
        raise InputError(Problem("plugins", name, told))
    target = folder / f"featherfx_{name}"
    finder = folder / host.finder if host.finder else None
    _refuse(target, finder, overwrite)
    try:
        _put(host, folder, target, finder)
    except OSError as error:
        # of a folder that is copied: source, target and reason of each file
        reason = error.args[0][0][2] if isinstance(error, shutil.Error) else error.strerror
        told = f"cannot be written ({reason or error}). Nothing was installed"
        raise InputError(Problem(str(folder), "", told)) from error
    return target, host.then.replace("FOLDER", str(target))


def _put(host: Host, folder: Path, target: Path, finder: Path | None) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(dir=folder, prefix=".featherfx_"))
    try:
        made, before = _made(host, beside / "new"), beside / "old"
        if target.exists():
            os.rename(target, before)
        try:
            os.rename(made, target)
            if finder is not None:
                text = (_SHIPPED / host.name / host.finder).read_text(encoding="utf-8")
                text = text.replace("@VERSION@", __version__)
                write_text(finder, text.replace("@FOLDER@", target.as_posix()))
        except BaseException:  # what was is put back
            shutil.rmtree(target, ignore_errors=True)
            if before.exists():
                os.rename(before, target)
            raise
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _refuse(target: Path, finder: Path | None, overwrite: bool) -> None:
    """Raise InputError where something stands that is not to be replaced."""
    if target.exists() and _version(target) is None:
        told = "stands where the plugin goes, and is none of featherfx. Move it away"
        raise InputError(Problem(str(target), "", told))
    if target.exists() and not overwrite:
        told = f"is there already, version {_version(target)}. --overwrite replaces it"
        raise InputError(Problem(str(target), "", told))
    if finder is not None and finder.exists() and not target.exists():
        told = "stands where the plugin is named, and is not of this plugin. Move it away"
        raise InputError(Problem(str(finder), "", told))


def _made(host: Host, folder: Path) -> Path:
    """The plugin's folder, complete, at a temporary place."""
    ignored = shutil.ignore_patterns("__pycache__", *([host.finder] if host.finder else []))
    for part in (host.name, "shared"):
        shutil.copytree(_SHIPPED / part, folder, ignore=ignored, dirs_exist_ok=True)
    mark = {"host": host.name, "version": __version__}
    for name, content in ((_MARK, mark), (_COMMAND, [sys.executable, "-m", "featherfx"])):
        (folder / name).write_text(json.dumps(content) + "\n", encoding="utf-8")
    return folder


def _version(folder: Path) -> str | None:
    """Version of the plugin in a folder; None where there is none."""
    try:
        found = json.loads((folder / _MARK).read_text(encoding="utf-8"))
        return str(found["version"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def sample_names() -> tuple[str, ...]:
    """Names of all samples."""
    folder = shipped("samples")
    return tuple(sorted(each.parent.name for each in folder.glob("*/shot.toml")))


def copy_sample(name: str, folder: str | Path) -> list[Path]:
    """Copy the files of a sample into a folder that is new or empty; returns them, sorted.

    The folder appears complete or not at all. Raises InputError for a name that there is none of
    and for a folder that holds something or is a file.
    """
    folder = Path(folder)
    if name not in sample_names():
        known = ", ".join(sample_names()) or "none, since this install has no samples"
        raise InputError(Problem("sample", "", f"'{name}' is not one of {known}"))
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(Problem(str(folder), "", "is not empty. Name a new folder with -o"))
    if folder.exists() and not folder.is_dir():
        raise InputError(Problem(str(folder), "", "is a file. Name a new folder with -o"))
    above = folder.absolute().parent
    above.mkdir(parents=True, exist_ok=True)
    beside = Path(tempfile.mkdtemp(dir=above, prefix=f".{folder.name}."))
    try:
        copy = shutil.copytree(
            shipped("samples") / name,
            beside / name,
            copy_function=shutil.copyfile,  # what is installed may be for reading only
            ignore=shutil.ignore_patterns("__pycache__"),
        )
        if folder.is_dir():
            folder.rmdir()  # it is empty; not everywhere does a rename replace one
        os.rename(copy, folder)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    return sorted(each for each in folder.rglob("*") if each.is_file())


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
    from featherfx.jit.compile_workers import predict_seconds

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
    from featherfx.baking.bake import bake
    from featherfx.baking.check import check

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
