"""Samples copied to a user's folder, and plugins installed where a host looks for them.

A plugin is a folder `featherfx_HOST` with the host's files and those that all share; Houdini and
Maya find it by a small file beside it. The folder appears in one step, the small file after it, and
where that fails the folder is gone again.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import platformdirs

from featherfx._version import __version__
from featherfx.errors import InputError, Problem
from featherfx.files.atomic_write import write_text
from featherfx.files.folders import shipped

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
