"""Checks of files of every kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from featherfx.api import Folders, read_groom, read_quality, read_shot, scene_readers
from featherfx.baking.entries import refuse_too_large
from featherfx.baking.options import DrawnOptions
from featherfx.errors import InputError, Problem, all_of, require_type
from featherfx.feather.build import distinct_shapes
from featherfx.feather.placed_feathers import build_feathers
from featherfx.groom.read.toml_file import load_toml
from featherfx.groom.types import Groom
from featherfx.limits import MAX_TRIED, irregular
from featherfx.phases import Progress, tells_progress
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.read.read import check_file
from featherfx.shot.types import Shot


@tells_progress
def check(
    source: str | Path | Shot | Groom, preset_folders: Folders = (), *, progress: Progress = False
) -> list[Problem]:
    """Find the problems of a groom, preset, shot or USD file, or of a groom or shot in memory.

    Grooms and shots without a wrong value are also tried: their feathers are built and the motion
    is fitted to the joints. progress: as of featherfx.phases.tells_progress. InputWarning for what
    of a shot's channels and targets is not felt.
    """
    folders = tuple(preset_folders)
    if isinstance(source, Shot | Groom):
        return _tried(source)
    require_type("source", source, str | Path, "a Shot, a Groom, or the path of a file")
    path = Path(source)
    if not path.is_file():
        odd = irregular(path)
        told = f"{odd}. Name a file" if odd else "there is no such file. Check the path"
        return [Problem(str(path), "", told)]
    if path.suffix in (".usd", ".usda", ".usdc"):
        # checks of other files do without USD
        from featherfx.usd.check.check import check_file as check_usd

        return check_usd(path)
    if path.suffix != ".toml":
        suffixes = ".toml, .usd, .usda and .usdc"
        return [Problem(str(path), "", f"suffix '{path.suffix}' is not one of {suffixes}")]
    if "flock" in load_toml(path):
        from featherfx.shot.read.flock import read_flock

        try:
            read_flock(path, folders, scene_readers())
        except InputError as error:
            return list(error.problems)
        return []
    try:
        given = _shot_or_groom(path, folders)
        tried = None if given is None else _tried(given)
    except InputError as error:
        # the reader finds all that is wrong in the files; what it does not, shows when it is tried
        return check_file(path, folders, scene_readers()) or list(error.problems)
    return check_file(path, folders, scene_readers()) if tried is None else tried


def _shot_or_groom(path: Path, folders: Sequence[str | Path]) -> Shot | Groom | None:
    """Read a shot or groom; None where the file is neither. Raises InputError."""
    keys = load_toml(path)
    if "groom" in keys:
        return read_shot(path, folders)
    if {"feather", "row", "table", "usd", "region"} & keys.keys():
        return read_groom(path, folders)
    return None


def _tried(given: Shot | Groom) -> list[Problem]:
    """Problems of a shot or groom that show only when feathers are built and moved."""
    tasks: list[Callable[[], Any]] = []
    if isinstance(given, Shot):
        groom, grid = given.groom, given.quality
        tasks.append(lambda: _try_motion(given))
    else:
        folders = given.document.preset_folders if given.document else ()
        groom, grid = given, read_quality("final", folders)
    refuse_too_large(groom, grid, DrawnOptions(), str(given.source))
    first, _ = distinct_shapes(groom.feathers)
    tried = first[:: 1 + len(first) // MAX_TRIED]
    some = [groom.feathers[k] for k in tried]
    tasks.append(lambda: build_feathers(some, grid.rows, grid.columns))
    try:
        all_of(*tasks)
    except InputError as error:
        return list(error.problems)
    return []


def _try_motion(shot: Shot) -> None:
    """Fit the motion of a shot to its joints, and files of its targets to its feathers; warn of
    channels that are not felt. Raises InputError."""
    motion = root_motion(shot)
    if not (shot.targets or shot.channels):
        return
    # what only directed shots load
    from featherfx.shot.direction.shapes import refuse_other_shapes
    from featherfx.shot.direction.unfelt_channels import FELT, warn_of_unfelt
    from featherfx.shot.loop.run import drawn_feathers
    from featherfx.shot.options.options import resolve_options

    felt = any(channel.name in FELT for channel in shot.channels)
    drawn = drawn_feathers(shot) if shot.targets or felt else ()
    refuse_other_shapes(shot, drawn, motion)
    if felt:
        warn_of_unfelt(shot, resolve_options(shot, drawn, motion).feathers)
