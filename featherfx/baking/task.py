"""What a bake is about to do: options, inputs, and all that can be wrong with them."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from featherfx._version import __version__
from featherfx.api import read_quality, read_shot
from featherfx.errors import InputError, Problem

if TYPE_CHECKING:
    from featherfx.groom.types import Groom
    from featherfx.shot.motion.skin import BoundSkin
    from featherfx.shot.types import Quality, Shot


class StageOptions(TypedDict, total=False):
    """How a USD stage is written.

    meters_per_unit: m. up_axis: "Y" or "Z". Left out or None, each is that of the skin's stage,
    else of the stage that the groom is, else 1 and "Z", as simulated. layout: "flat", "payload",
    "clips", or "auto" (default), which takes flat for small caches and clips for large ones.
    overwrite: whether an output that exists is replaced, default False.
    """

    meters_per_unit: float | None
    up_axis: str | None
    layout: str
    overwrite: bool


class SampleOptions(TypedDict, total=False):
    """Which samples are written, and how.

    chunk: frames that go to a file of their own when they are done, default 24. subframes:
    samples a frame, default 1; those between two frames stand at fractional time codes.
    accelerations: whether they are written beside the velocities, default False. diagnostics:
    "strain", "energy" or both, written per face, default none.
    """

    chunk: int
    subframes: int
    accelerations: bool
    diagnostics: Sequence[str]


class BakeOptions(StageOptions, SampleOptions, total=False):
    """All options of the writer."""


@dataclass(frozen=True)
class Drawn:
    """What is drawn of the simulated feathers.

    rows, columns: of the meshes; None: as simulated. barbs: curves along each vane; None: none.
    """

    rows: int | None = None
    columns: int | None = None
    barbs: int | None = None

    def grid(self, quality: Quality) -> tuple[int, int]:
        """Rows and columns of the meshes."""
        return self.rows or quality.rows, self.columns or quality.columns

    def check(self) -> None:
        """Raise InputError for every number that is too small."""
        least = {
            "render_rows": (self.rows, 3),
            "render_columns": (self.columns, 1),
            "barbs": (self.barbs, 1),
        }
        problems = [
            Problem("bake", name, f"{value}; allowed: at least {low}")
            for name, (value, low) in least.items()
            if value is not None and value < low
        ]
        if problems:
            raise InputError(*problems)


@dataclass(frozen=True)
class Task:
    """A bake that can start: shot (reduced to its part of the feathers), output, frames, settings.

    whole, wanted: what is simulated for it, and the numbers of the task's feathers in that (None:
    all). names: prim name per feather. root: name of the root prim. finished: whether the output is
    there already. options: of the writer, units and axis included.
    """

    shot: Shot
    path: Path
    frames: tuple[int, int]
    settings: dict[str, str]
    names: Sequence[str]
    root: str
    finished: bool
    drawn: Drawn
    options: dict[str, Any]
    whole: Shot
    wanted: Sequence[int] | None


def prepare(
    shot_path: str | Path,
    output: str | Path | None,
    frames: tuple[int, int] | None,
    quality: str | None,
    folders: Sequence[str | Path],
    report: str | Path | None,
    resume: bool,
    feathers: tuple[int, int] | None,
    options: BakeOptions,
    drawn: Drawn,
) -> Task:
    """The bake to do, after all that can be known to be wrong."""
    from featherfx.usd.write.names import prim_name, unique_prim_names
    from featherfx.usd.write.output import check_output
    from featherfx.usd.write.resume import is_finished

    overwrite, layout = options.get("overwrite", False), options.get("layout", "auto")
    read: list[Path] = []

    def checked(path: str | Path) -> Path:
        own = part_path(Path(path), feathers) if feathers else path
        return check_output(own, overwrite or resume, layout)

    shot, chosen, path, *_ = all_of(
        lambda: wanted_shot(shot_path, frames, folders, read.append),
        lambda: read_quality(quality, folders) if quality else None,
        lambda: checked(output) if output is not None else None,
        lambda: _check_report(report),
        drawn.check,
    )
    target = Path(output) if output is not None else default_output(shot)
    path = path or checked(target)
    _refuse_inputs(path, report, [*read, shot.source, shot.groom.source])
    shot = replace(shot, quality=chosen) if chosen else shot
    frames = frames or (shot.first_frame, shot.last_frame)
    names: Sequence[str] = unique_prim_names([p.id for p in shot.groom.feathers])
    resolved = {**options, **stage_space(options, shot.groom, shot.skin)}
    settings = _settings(shot, frames, feathers, resolved, drawn)
    part, whole, wanted = _share(shot, feathers)
    if feathers:
        names = names[feathers[0] - 1 :: feathers[1]]
    finished = resume and is_finished(path, settings, overwrite)
    root = prim_name(target.stem)
    return Task(part, path, frames, settings, names, root, finished, drawn, resolved, whole, wanted)


def _share(shot: Shot, feathers: tuple[int, int] | None) -> tuple[Shot, Shot, Sequence[int] | None]:
    """The shot of a share, what is simulated for it, and the share's numbers in that."""
    from featherfx.shot.detail.guides import uses_guides
    from featherfx.shot.share import part_of, share_numbers

    if feathers is None:
        return shot, shot, None
    if shot.contact is not None:
        message = "feathers that touch cannot be baked in shares; leave out [contact]"
        raise InputError(Problem(str(shot.source), "contact", message))
    numbers = share_numbers(shot, *feathers)
    part = part_of(shot, numbers)
    # followers need guides that may be of another share
    return (part, shot, numbers.tolist()) if uses_guides(shot) else (part, part, None)


def stage_space(options: StageOptions, groom: Groom, skin: BoundSkin | None) -> dict[str, Any]:
    """Units and axis of the output: as asked for, else as the stages have them that came in."""
    from featherfx.groom.read.read import SCENE_SUFFIXES

    found: tuple[float, str] = (1.0, "Z")
    if skin is not None and skin.parts:
        found = skin.parts[0].surface.space
    elif groom.source.suffix.lower() in SCENE_SUFFIXES:
        from featherfx.usd.read.opening import open_stage
        from featherfx.usd.read.scene import stage_space as space_of

        found = space_of(open_stage(groom.source))
    unit, axis = options.get("meters_per_unit"), options.get("up_axis")
    return {
        "meters_per_unit": found[0] if unit is None else unit,
        "up_axis": found[1] if axis is None else axis,
    }


def _settings(
    shot: Shot,
    frames: tuple[int, int],
    feathers: tuple[int, int] | None,
    options: dict[str, Any],
    drawn: Drawn,
) -> dict[str, str]:
    """All that the frames depend on, as texts."""
    from featherfx.shot.fingerprint import program_digest, shot_settings

    plain = {key: value for key, value in options.items() if key != "overwrite"}
    return {
        "version": __version__,
        "program": program_digest(),
        "frames": f"{frames[0]}-{frames[1]}",
        "feathers": "{}/{}".format(*feathers) if feathers else "all",
        **{key: json.dumps(value) for key, value in sorted(plain.items())},
        "render grid": "{} x {}".format(*drawn.grid(shot.quality)),
        "barbs": str(drawn.barbs or "none"),
        **{f"shot.{key}": text for key, text in shot_settings(shot).items()},
    }


def sample_count(frames: tuple[int, int], options: BakeOptions) -> int:
    """Samples from the first frame to the last."""
    return (frames[1] - frames[0]) * options.get("subframes", 1) + 1


def part_path(path: Path, feathers: tuple[int, int]) -> Path:
    """File of one share of the feathers of a cache: wing.usdc gives wing.2of4.usdc."""
    return path.with_name(f"{path.stem}.{feathers[0]}of{feathers[1]}{path.suffix}")


def all_of(*tasks: Callable[[], Any]) -> list[Any]:
    """Results of all tasks; raises one InputError with the problems of all of them."""
    results: list[Any] = []
    problems: list[Problem] = []
    for task in tasks:
        try:
            results.append(task())
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(*dict.fromkeys(problems))
    return results


def default_output(shot: Shot) -> Path:
    """The shot's name with .usdc, in the current folder."""
    return Path(re.sub(r"[^\w.-]+", "_", shot.name) + ".usdc")


def wanted_shot(
    shot_path: str | Path,
    frames: tuple[int, int] | None,
    folders: Sequence[str | Path],
    note: Callable[[Path], object],
) -> Shot:
    """The shot. Raises InputError for it, its groom, and frames that it does not have.

    note: is told every scene that is read.
    """
    shot = read_shot(shot_path, folders, note)
    if frames and not shot.first_frame <= frames[0] <= frames[1] <= shot.last_frame:
        allowed = f"allowed {shot.first_frame} to {shot.last_frame}"
        message = f"{frames[0]}-{frames[1]} is out of range, {allowed}"
        raise InputError(Problem(str(shot_path), "frames", message))
    return shot


def _refuse_inputs(path: Path, report: str | Path | None, inputs: Sequence[Path]) -> None:
    """Raise InputError where the cache or its report would take the place of an input."""
    from featherfx.usd.read.inputs import refuse_inputs
    from featherfx.usd.write.output import output_files

    outputs = {file for layout in ("payload", "clips") for file in output_files(path, layout)}
    if report is not None and Path(report).absolute() in {file.absolute() for file in outputs}:
        raise InputError(Problem(str(report), "", "is the cache itself; choose another name"))
    refuse_inputs([*sorted(outputs), *([Path(report)] if report is not None else [])], inputs)


def _check_report(report: str | Path | None) -> None:
    if report is None:
        return
    path = Path(report)
    if path.is_dir():
        raise InputError(Problem(str(path), "", "is a folder; give the name of a file"))
    if not os.access(path.absolute().parent, os.W_OK):
        raise InputError(Problem(str(path.parent), "", "is no folder that can be written to"))
