"""What an earlier bake left at an output: nothing, part of this bake, all of it, or another one."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pxr import Sdf, Vt

from featherfx.errors import Problem
from featherfx.files.lock import Lock
from featherfx.groom.read.value_diff import UNTOLD, changes
from featherfx.usd import arrays
from featherfx.usd.read.values import USD_ERRORS
from featherfx.usd.types import OutputError
from featherfx.usd.write.output import clips_folder, output_files, parts_folder
from featherfx.usd.write.parts import (
    Parts,
    lock_file,
    unfinished_bakes,
    unfinished_samples,
)

_MOST_DIFFERENCES = 12
_PIECE = 60_000


def is_finished(
    path: Path, settings: Mapping[str, str], inputs: Mapping[str, str], overwrite: bool
) -> bool:
    """Whether the cache at path is complete and was baked with these settings.

    inputs: what the bake's files say. Raises OutputError where a cache, or an unfinished one, of
    other settings is there, unless overwrite: settings are never mixed.
    """
    if path.exists():
        earlier = baked_settings(path)
        if earlier == settings:
            return _is_whole(path, settings)
        if not overwrite:
            told = difference(earlier, baked_inputs(path), settings, inputs)
            raise _refused(path, "exists already", told if earlier else {})
        return False
    for layout in ("flat", "clips"):
        begun = unfinished_bakes(parts_folder(path, layout))
        if begun and all(each != settings for each, _ in begun) and not overwrite:
            raise _refused(path, "was begun", difference(*begun[0], settings, inputs))
    return False


def difference(
    earlier: Mapping[str, str],
    earlier_inputs: Mapping[str, str],
    settings: Mapping[str, str],
    inputs: Mapping[str, str],
) -> dict[str, str]:
    """What differs between two bakes, by key, in words.

    Settings are what counts, and inputs what the files say: a setting that cannot be told in a few
    words is only named where no input tells why it is another.
    """
    found = changes(earlier_inputs, inputs) if earlier_inputs else {}
    for key, change in changes(earlier, settings).items():
        texts = earlier.get(key, ""), settings.get(key, "")
        long = key == "program" or any(text.startswith(UNTOLD) for text in texts)
        if not long:
            found.setdefault(key, change)
        elif key == "program" or not found:
            found[key] = "is another now"
    return found


def refuse_unfinished(path: Path) -> None:
    """Raise OutputError where an interrupted bake has left samples that a new one would remove.

    What another bake is writing just now is told when this one begins to.
    """
    kept = sum(unfinished_samples(parts_folder(path, layout)) for layout in ("flat", "clips"))
    if kept and not path.exists() and not _is_being_written(path):
        message = (
            f"holds {kept} sample{'s' * (kept > 1)} of a bake that did not come to its end; "
            "--resume goes on after them, --overwrite removes them and bakes anew"
        )
        raise OutputError(Problem(str(path), "", message))


def _is_being_written(path: Path) -> bool:
    try:
        if lock_file(path).exists():
            Lock(lock_file(path)).release()
    except (OSError, TimeoutError):
        return True
    return False


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


def baked_inputs(path: Path) -> dict[str, str]:
    """What the files of a cache's bake said; empty where its file does not tell."""
    return text_table(layer_metadata(path).get("inputs"))


def table_text(table: Mapping[str, str]) -> Any:
    """Texts by name as JSON for metadata; in pieces where it is long, since other readers of USD
    refuse files with a string of more than 65,536 bytes (tinyusdz 0.9.4)."""
    text = json.dumps(dict(table), separators=(",", ":"))
    if len(text) <= _PIECE:
        return text
    return arrays.strings(*(text[k : k + _PIECE] for k in range(0, len(text), _PIECE)))


def text_table(text: Any) -> dict[str, str]:
    """Texts by name from JSON (table_text); empty where it is none."""
    if isinstance(text, Vt.StringArray):
        text = "".join(text)
    try:
        found = json.loads(text) if isinstance(text, str) else {}
    except (ValueError, RecursionError):
        return {}
    return {str(k): str(v) for k, v in found.items()} if isinstance(found, dict) else {}


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


def _refused(path: Path, what: str, told: Mapping[str, str]) -> OutputError:
    """told: what differs, by key; empty where that is not known."""
    advice = "choose another name, or --overwrite to bake it anew"
    if not told:
        message = f"{what}, and does not tell with which settings; {advice}"
        return OutputError(Problem(str(path), "", message))
    problems = [Problem(str(path), "", f"{what} with other settings; {advice}")]
    problems += [Problem(str(path), key, told[key]) for key in list(told)[:_MOST_DIFFERENCES]]
    if len(told) > _MOST_DIFFERENCES:
        more = len(told) - _MOST_DIFFERENCES
        problems.append(Problem(str(path), "", f"and {more} more settings differ"))
    return OutputError(*problems)
