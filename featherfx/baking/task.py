"""What a bake is about to do: options, inputs, and all that can be wrong with them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TypeVar

from featherfx import usd
from featherfx._version import __version__
from featherfx.api import read_quality, shot_as_written
from featherfx.baking.entries import refuse_splits_elsewhere, refuse_too_large, refuse_unfit_form
from featherfx.baking.incremental import taken_over
from featherfx.baking.options import BakeOptions
from featherfx.baking.types import Dependences, Task
from featherfx.errors import InputError, Problem, all_of
from featherfx.files.content import program_digest
from featherfx.groom.read.read import SCENE_SUFFIXES
from featherfx.groom.types import Groom
from featherfx.shot.detail.guides import uses_guides
from featherfx.shot.fingerprint import shot_settings
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.placement import place_feathers
from featherfx.shot.share import part_of, share_numbers
from featherfx.shot.types import Shot
from featherfx.usd.installed import refuse_unfit_usd
from featherfx.usd.space import origin_for
from featherfx.usd.types import OutputError
from featherfx.usd.write.forms import chosen_group
from featherfx.usd.write.options import (
    CHUNK,
    PUSHING_CHUNK,
    StageOptions,
    WriteOptions,
    check_ranges,
)
from featherfx.usd.write.output import (
    check_output,
    file_problems,
    output_files,
    prim_name,
    refuse_inputs,
    unique_prim_names,
)
from featherfx.usd.write.parts import refuse_unfinished

Options = TypeVar("Options", bound=StageOptions)


def prepare(shot_path: str | Path, output: str | Path | None, options: BakeOptions) -> Task:
    """The bake to do, after all that can be known to be wrong."""
    refuse_unfit_usd()
    shot, target, path = _checked(shot_path, output, options)
    frames = options.frames or (shot.first_frame, shot.last_frame)
    every = unique_prim_names([p.id for p in shot.groom.feathers])
    options = in_space(options, shot.groom, shot.skin)
    options = replace(
        options,
        group=chosen_group(options.group, len(every)),
        chunk=options.chunk or (PUSHING_CHUNK if shot.contact else CHUNK),
    )
    settings = _settings(shot, frames, options)
    part, whole, numbers = _part(shot, options.feathers)
    refuse_too_large(part.groom, shot.quality, options, str(shot_path))
    refuse_unfit_form(part.groom, options, str(shot_path))
    refuse_splits_elsewhere(part.groom, shot.quality, options, str(shot_path))
    task = Task(
        shot=part,
        path=path,
        frames=frames,
        settings=settings,
        names=[every[k] for k in numbers],
        root=prim_name(target.stem),
        finished=False,
        options=options,
        whole=whole,
        wanted=None if whole is part else numbers,
        taken=None,
        origin=_origin(shot),
        dependences=Dependences(shot, numbers),
    )
    return _resumed(task, shot.inputs) if options.resume else task


def _checked(
    shot_path: str | Path, output: str | Path | None, options: BakeOptions
) -> tuple[Shot, Path, Path]:
    """The shot as it will be simulated, the output's name as asked for, and the file to write.

    Raises InputError with all that is wrong with the shot, what it names, output and report, before
    feathers are placed, which may take long.
    """
    read: list[Path] = []

    def checked(path: str | Path) -> Path:
        own = part_path(Path(path), options.feathers) if options.feathers else path
        kept = check_output(own, options.overwrite or options.resume, options.layout)
        if not (options.overwrite or options.resume):
            refuse_unfinished(kept)
        return kept

    shot, chosen, path, *_ = all_of(
        lambda: wanted_shot(shot_path, options, read.append),
        lambda: read_quality(options.quality, options.preset_folders) if options.quality else None,
        lambda: checked(output) if output is not None else None,
        lambda: check_report(options.report, True),
        lambda: check_ranges(options, "bake"),
    )
    target = Path(output) if output is not None else default_output(shot)
    path = path or checked(target)
    _refuse_inputs(path, options.report, [*read, shot.source, shot.groom.source])
    # a bake that goes on may replace the report of the one before
    check_report(options.report, options.overwrite or (options.resume and _is_report(options)))
    shot = place_feathers(shot)
    quality = chosen or shot.quality
    if options.error is not None:
        quality = quality.with_error(options.error)
    return replace(shot, quality=quality), target, path


def _resumed(task: Task, inputs: Mapping[str, str]) -> Task:
    """A task that goes on with what stands at its output. inputs: of the whole shot. Raises
    OutputError where nothing there can be gone on with."""
    try:
        previous, overwrite = usd.previous_cache, task.options.overwrite
        finished = previous.is_finished(task.path, task.settings, inputs, overwrite)
        return replace(task, finished=finished)
    except OutputError:
        if task.options.can_be_taken_over:
            taken = taken_over(task, inputs)
            if taken is not None:
                return replace(task, taken=taken)
        raise


def _origin(shot: Shot) -> tuple[float, float, float]:
    """The same for all shares of a shot."""
    return origin_for([each.position for each in shot.groom.feathers])


def _part(shot: Shot, feathers: tuple[int, int] | None) -> tuple[Shot, Shot, Sequence[int]]:
    """The shot of a share, what is simulated for it, and the share's numbers in the shot."""
    if feathers is None:
        return shot, shot, range(len(shot.groom.feathers))
    numbers = share_numbers(shot, *feathers)
    part = part_of(shot, numbers)
    # followers need guides, and layers what is beneath, that may be of another share; islands are
    # those of the whole
    shared = uses_guides(shot) or shot.layers is not None or shot.contact is not None
    return part, (shot if shared else part), numbers.tolist()


def in_space(options: Options, groom: Groom, skin: BoundSkin | None) -> Options:
    """Options with units and axis: as asked for, else as the stages have them that came in."""
    unit, axis = 1.0, "Z"
    if skin is not None and skin.parts:
        unit, axis = skin.parts[0].surface.space
    elif groom.source.suffix.lower() in SCENE_SUFFIXES:
        unit, axis = usd.stage.stage_space(usd.opening.open_stage(groom.source))
    return replace(
        options,
        meters_per_unit=unit if options.meters_per_unit is None else options.meters_per_unit,
        up_axis=axis if options.up_axis is None else options.up_axis,
    )


def _settings(shot: Shot, frames: tuple[int, int], options: BakeOptions) -> dict[str, str]:
    """All that the frames depend on, as texts."""
    written = {each.name for each in fields(WriteOptions)} - {"overwrite", "resume"}
    return {
        "version": __version__,
        "program": program_digest(),
        "frames": f"{frames[0]}-{frames[1]}",
        "feathers": "{}/{}".format(*options.feathers) if options.feathers else "all",
        **{name: json.dumps(getattr(options, name)) for name in sorted(written)},
        "render grid": "{} x {}".format(*options.grid(shot.quality)),
        "barbs": str(options.barbs or "none"),
        "origin": json.dumps(_origin(shot)),
        **{f"shot.{key}": text for key, text in shot_settings(shot).items()},
    }


def part_path(path: Path, feathers: tuple[int, int]) -> Path:
    """File of one share of the feathers of a cache: wing.usdc gives wing.2of4.usdc."""
    return path.with_name(f"{path.stem}.{feathers[0]}of{feathers[1]}{path.suffix}")


def default_output(shot: Shot) -> Path:
    """The shot's name with .usdc, in the current folder."""
    return Path(re.sub(r"[^\w.-]+", "_", shot.name) + ".usdc")


def wanted_shot(
    shot_path: str | Path, options: BakeOptions, note: Callable[[Path], object]
) -> Shot:
    """The shot as it is written. Raises InputError for it, its groom, and frames that it does not
    have.

    note: is told every scene that is read.
    """
    frames = options.frames
    shot = shot_as_written(shot_path, options.preset_folders, note)
    if frames and not shot.first_frame <= frames[0] <= frames[1] <= shot.last_frame:
        allowed = f"allowed {shot.first_frame} to {shot.last_frame}"
        message = f"{frames[0]}-{frames[1]} is out of range, {allowed}"
        raise InputError(Problem(str(shot_path), "frames", message))
    return shot


def _refuse_inputs(path: Path, report: str | Path | None, inputs: Sequence[Path]) -> None:
    """Raise InputError where the cache or its report would take the place of an input."""
    outputs = {file for layout in ("payload", "clips") for file in output_files(path, layout)}
    if report is not None and Path(report).absolute() in {file.absolute() for file in outputs}:
        raise InputError(Problem(str(report), "", "is the cache itself; choose another name"))
    refuse_inputs([*sorted(outputs), *([Path(report)] if report is not None else [])], inputs)


def check_report(report: str | Path | None, overwrite: bool) -> None:
    """Raise InputError where a report cannot be written there."""
    if report is not None and (problems := file_problems([Path(report)], overwrite)):
        raise InputError(*problems)


def _is_report(options: BakeOptions) -> bool:
    """Whether the report's file holds the report of a bake."""
    path = Path(options.report or "")
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and {"shot", "samples", "samples_taken_over"} <= found.keys()
