"""Folders of presets; importable without numpy."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from featherfx.errors import Problem, require, require_type
from featherfx.files.folders import shipped

_PRESETS_VARIABLE = "FEATHERFX_PRESETS"
# stands for the folder of shipped presets among folders that are given
SHIPPED_PRESETS = "shipped"


def shipped_folder() -> Path:
    """The presets that come with featherfx."""
    return shipped("presets")


def folders_of(preset_folders: Iterable[str | Path]) -> tuple[str | Path, ...]:
    """Return folders of presets. Raises TypeError for one path, InputError for those not there."""
    listed = not isinstance(preset_folders, str | Path)
    require_type("preset_folders", preset_folders, Iterable if listed else (), "a list of folders")
    found = tuple(preset_folders)
    told = "there is no such folder. Check the path"
    lacking = (each for each in found if each != SHIPPED_PRESETS and not Path(each).is_dir())
    require(*(Problem(str(each), "", told) for each in lacking))
    return found


def search_path(folders: Iterable[str | Path] = ()) -> tuple[Path, ...]:
    """Folders of presets, the strongest first: given ones, FEATHERFX_PRESETS, home, shipped.

    folders: SHIPPED among them is the folder of shipped presets; what comes after it matters no
    more.
    """
    listed = [shipped_folder() if folder == SHIPPED_PRESETS else Path(folder) for folder in folders]
    variable = os.environ.get(_PRESETS_VARIABLE, "")
    listed += [Path(part) for part in variable.split(os.pathsep) if part]
    home = os.environ.get("XDG_CONFIG_HOME") or str(Path("~/.config").expanduser())
    return (*listed, Path(home) / "featherfx" / "presets", shipped_folder())


def own_folders(folders: Iterable[str | Path] = ()) -> tuple[Path, ...]:
    """Folders of the search path that are there and are not the shipped ones, absolute."""
    found = [Path(os.path.abspath(folder)) for folder in search_path(folders) if folder.is_dir()]
    shipped = Path(os.path.abspath(shipped_folder()))
    return tuple(dict.fromkeys(folder for folder in found if folder != shipped))
