"""Checks of files of every kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from featherfx.api import Folders, read_groom, read_quality, read_shot, scene_readers
from featherfx.baking.entries import refuse_too_large
from featherfx.baking.options import DrawnOptions
from featherfx.errors import InputError, Problem, all_of, require_type
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.shapes import distinct_shapes
from featherfx.groom.read.toml_file import load_toml
from featherfx.groom.types import Groom
from featherfx.limits import MAX_TRIED, irregular
from featherfx.phases import Progress, tells_progress
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.loop.skin_stages import CutStage
from featherfx.shot.motion.joint_tracks import find_tracks, rate_lines
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import ShotOptions
from featherfx.shot.read.read import check_file
from featherfx.shot.types import Shot

Explained = dict[str, dict[str, dict[str, Any]]]
JointRates = dict[str, dict[str, float]]

# units of options that have one
_UNITS = {
    "tolerance": "m", "newton_tolerance": "m", "contact_tolerance": "m",
    "unpressed_newton_tolerance": "m", "max_substeps": "a frame",
}  # fmt: skip
# ids that a line of like feathers names
_MAX_NAMED = 3


def explain_options(
    path: str | Path, preset_folders: Folders = (), feather: str | None = None
) -> tuple[Explained, JointRates]:
    """Return how the feathers of a shot are simulated: by id, by option, `value` and `from`; and
    the largest speed (m/s), turn (rad/s) and acceleration (m/s2) of its joints, none where a skin
    alone moves it.

    feather: id of one of them; default: all. Raises InputError for what is wrong with the shot, and
    where it has no such feather.
    """
    shot = read_shot(path, preset_folders)
    run = ShotRun(shot, 1, 1, None)
    if shot.has_moving_roots:
        CutStage(run)  # options follow the roots as a bake moves them
    found = explained_options(shot, run.options)
    moves = shot.skin is None or shot.motion.of_limbs
    rates = find_tracks(shot).largest_rates() if moves else {}
    if feather is None:
        return found, rates
    if feather not in found:
        some = ", ".join(list(found)[:_MAX_NAMED])
        message = f"The shot has no feather '{feather}'. Give one of its ids, such as {some}."
        raise InputError(Problem(str(path), "", message))
    return {feather: found[feather]}, rates


def explained_options(shot: Shot, options: ShotOptions) -> Explained:
    """Return resolved options of a shot by id, by option, `value` and `from`."""
    return {
        placement.id: {
            name: {"value": value, "from": own.sources.get(name, "default")}
            for name, value in own.values().items()
            if value is not None
        }
        for placement, own in zip(shot.groom.feathers, options.feathers, strict=True)
    }


def explained_lines(found: Explained, rates: JointRates) -> Iterator[str]:
    """Yield explained options for people: a line for feathers with the same ones, or of a single
    feather a line for each option; and a line for each joint that moves."""
    yield from rate_lines(rates)
    if len(found) == 1:
        ((name, options),) = found.items()
        yield name
        yield from (f"  {_text(option, each)}" for option, each in options.items())
        return
    alike: dict[str, list[str]] = {}
    for name, options in found.items():
        line = "; ".join(_text(option, each) for option, each in options.items())
        alike.setdefault(line, []).append(name)
    for line, names in alike.items():
        yield f"{_named(names)}: {line}"


def _text(option: str, each: dict[str, Any]) -> str:
    value = each["value"]
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    unit = _UNITS.get(option, "")
    return f"{option} {text}{unit and ' '}{unit} ({each['from']})"


def _named(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    more = ", ..." if len(names) > _MAX_NAMED else ""
    return f"{len(names)} feathers ({', '.join(names[:_MAX_NAMED])}{more})"


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
    from featherfx.shot.direction.channels import FELT, warn_of_unfelt
    from featherfx.shot.direction.targets import refuse_other_shapes
    from featherfx.shot.loop.run import drawn_feathers
    from featherfx.shot.options import resolve_options

    felt = any(channel.name in FELT for channel in shot.channels)
    drawn = drawn_feathers(shot) if shot.targets or felt else ()
    refuse_other_shapes(shot, drawn, motion)
    if felt:
        warn_of_unfelt(shot, resolve_options(shot, drawn, motion).feathers)
