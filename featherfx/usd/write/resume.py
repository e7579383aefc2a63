"""What an earlier bake left at an output: nothing, part of this bake, all of it, or another one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf

from featherfx.errors import Problem
from featherfx.usd.read.values import USD_ERRORS
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import clips_folder, output_files, parts_folder
from featherfx.usd.write.parts import (
    Parts,
    lock_file,
    unfinished_samples,
    unfinished_settings,
)

_MOST_DIFFERENCES = 12


def is_finished(path: Path, settings: Mapping[str, str], overwrite: bool) -> bool:
    """Whether the cache at path is complete and was baked with these settings.

    Raises OutputError where a cache, or an unfinished one, of other settings is there, unless
    overwrite: settings are never mixed.
    """
    if path.exists():
        earlier = baked_settings(path)
        if earlier == settings:
            return _is_whole(path, settings)
        if not overwrite:
            raise _refused(path, "exists already", earlier, settings)
        return False
    for layout in ("flat", "clips"):
        unfinished = unfinished_settings(parts_folder(path, layout))
        if unfinished and settings not in unfinished and not overwrite:
            raise _refused(path, "was begun", unfinished[0], settings)
    return False


def refuse_unfinished(path: Path) -> None:
    """Raise OutputError where an interrupted bake has left samples that a new one would remove."""
    kept = sum(unfinished_samples(parts_folder(path, layout)) for layout in ("flat", "clips"))
    if kept and not path.exists():
        message = (
            f"holds {kept} sample{'s' * (kept > 1)} of a bake that did not come to its end; "
            "--resume goes on after them, --overwrite removes them and bakes anew"
        )
        raise OutputError(Problem(str(path), "", message))


def tidy(path: Path, settings: Mapping[str, str]) -> None:
    """Remove what a bake left that was killed when its cache, now complete, had its name.

    Raises OutputError where another bake is writing it.
    """
    if lock_file(path).exists():
        layout = layer_metadata(path).get("layout", "flat")
        parts = Parts(path, layout, settings, keep=True, finished=True)
        parts.finish(keep_chunks=layout == "clips")


def baked_settings(path: Path) -> dict[str, str]:
    """Settings that a cache was baked with; empty where its file does not tell."""
    found = layer_metadata(path).get("settings")
    known = found if isinstance(found, dict) else {}
    return {str(key): str(value) for key, value in known.items()}


def layer_metadata(path: Path) -> dict[str, Any]:
    """What featherfx wrote of itself into a root file; empty where there is none."""
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
        found = layer.customLayerData.get("featherfx") if layer else None
    except USD_ERRORS:
        return {}
    return dict(found) if isinstance(found, dict) else {}


def _is_whole(path: Path, settings: Mapping[str, str]) -> bool:
    folder = clips_folder(path)
    layout = layer_metadata(path).get("layout", "flat")
    sound = all(file.is_file() for file in output_files(path, layout))
    return sound and (layout != "clips" or Parts.are_whole(folder, settings))


def _refused(
    path: Path, what: str, earlier: Mapping[str, str], settings: Mapping[str, str]
) -> OutputError:
    advice = "choose another name, or --overwrite to bake it anew"
    if not earlier:
        message = f"{what}, and does not tell with which settings; {advice}"
        return OutputError(Problem(str(path), "", message))
    problems = [Problem(str(path), "", f"{what} with other settings; {advice}")]
    keys = [key for key in {**settings, **earlier} if settings.get(key) != earlier.get(key)]
    for key in keys[:_MOST_DIFFERENCES]:
        before, now = (each.get(key, "not set") for each in (earlier, settings))
        problems.append(Problem(str(path), key, f"was {before}, is {now} now"))
    if len(keys) > _MOST_DIFFERENCES:
        more = len(keys) - _MOST_DIFFERENCES
        problems.append(Problem(str(path), "", f"and {more} more settings differ"))
    return OutputError(*problems)
