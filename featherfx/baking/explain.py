"""Options of a shot's feathers, with the source of each, and rates of its joints."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from featherfx.api import Folders, read_shot
from featherfx.errors import InputError, Problem
from featherfx.shot.loop.cut_stage import CutStage
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.motion.joint_tracks import find_tracks, rate_lines
from featherfx.shot.options.options import ShotOptions
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
    the largest speed (m/s), turn (rad/s) and acceleration (m/s2) of its joints, none on a skin.

    feather: id of one of them; default: all. Raises InputError for what is wrong with the shot, and
    where it has no such feather.
    """
    shot = read_shot(path, preset_folders)
    run = ShotRun(shot, 1, 1, None)
    if shot.has_moving_roots:
        CutStage(run)  # options follow the roots as a bake moves them
    found = explained_options(shot, run.options)
    rates = {} if shot.skin is not None else find_tracks(shot).largest_rates()
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
