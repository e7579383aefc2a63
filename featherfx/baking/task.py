"""Preparation of a bake: options and inputs are read, and all their problems reported."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from featherfx import usd
from featherfx._version import __version__
from featherfx.api import open_document, read_quality, shot_as_written
from featherfx.baking.entries import refuse_splits_elsewhere, refuse_too_large, refuse_unfit_form
from featherfx.baking.options import BakeOptions
from featherfx.errors import InputError, Problem, all_of, as_figure, warn_input
from featherfx.files.disk_cache import program_digest
from featherfx.groom.read.read import SCENE_SUFFIXES
from featherfx.groom.types import Groom
from featherfx.shot.loop.placement import place_feathers
from featherfx.shot.types import Shot
from featherfx.usd.types import choose_origin, refuse_unfit_usd
from featherfx.usd.write.options import (
    CHUNK_FRAMES,
    CONTACT_CHUNK_FRAMES,
    StageOptions,
    WriteOptions,
    check_ranges,
)
from featherfx.usd.write.output import (
    check_output,
    choose_group,
    find_file_problems,
    output_files,
    prim_name,
    refuse_inputs,
    unique_prim_names,
)
from featherfx.usd.write.unfinished_cache import refuse_unfinished

if TYPE_CHECKING:
    from featherfx.shot.flock import FlockShot
    from featherfx.shot.options import ShotOptions
    from featherfx.shot.skin import BoundSkin
    from featherfx.usd.write.previous_cache import PreviousCache
    from featherfx.usd.write.stages import Bodies

# of the shortest feather, what single precision may miss of a point
_MAX_COARSENESS = 1e-3

Options = TypeVar("Options", bound=StageOptions)


class Dependences:
    """Texts that name all inputs of some feathers of a shot, by their numbers; computed once.

    options: of the shot's feathers, once a simulation has resolved them.
    """

    options: ShotOptions | None = None

    def __init__(self, shot: Shot, numbers: Sequence[int]) -> None:
        self.shot, self._numbers = shot, numbers

    @cached_property
    def texts(self) -> list[str]:
        """Texts of the feathers' motion."""
        # loads compiled code, which a finished cache does without
        from featherfx.shot.motion.motion import motion_dependences

        every = motion_dependences(self.shot, self.options)
        return [every[k] for k in self._numbers]


@dataclass(frozen=True)
class ReusedFeathers:
    """Feathers whose samples a bake takes from an earlier cache at its output.

    cache: the earlier one. feathers: numbers among the bake's of those whose samples are taken.
    changed: differences, in words.
    """

    cache: PreviousCache
    feathers: tuple[int, ...]
    changed: tuple[str, ...]


@dataclass(frozen=True)
class BakeTask:
    """Bake that can start: shot (reduced to its partition), output, frames, settings.

    whole, wanted: the shot that is simulated for it, and the numbers of the task's feathers in that
    (None: all). names: prim name per feather. root: name of the root prim. finished: the output is
    there already. taken: feathers that are reused of a cache of other settings at the output.
    origin: position of the root prim. options: with the final units and axis. dependences: texts of
    its feathers (featherfx/shot/motion/motion.py); None for a trial, which keeps nothing.
    frames_each: frames of a chunk, where it must be another cache's; else the writer's choice.
    bodies: that an act moves, by the files of their layers: those of all partitions are the same.
    """

    shot: Shot
    path: Path
    frames: tuple[int, int]
    settings: dict[str, str]
    names: Sequence[str]
    root: str
    finished: bool
    options: BakeOptions
    whole: Shot
    wanted: Sequence[int] | None
    taken: ReusedFeathers | None
    origin: tuple[float, float, float]
    dependences: Dependences | None
    frames_each: int | None = None
    bodies: Bodies = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of samples from the first frame to the last."""
        return (self.frames[1] - self.frames[0]) * self.options.subframes + 1


def prepare(given: str | Path | Shot, output: str | Path | None, options: BakeOptions) -> BakeTask:
    """Read and check all inputs of a bake; raises InputError with every problem.

    given: a shot, or its file.
    """
    refuse_unfit_usd()
    shot, target, path = _checked(given, output, options)
    name = str(shot.source)
    bodies: Bodies = {}
    if shot.motion.moves_skin and shot.skin is not None:
        from featherfx.usd.write.stages import check_bodies, list_bodies

        bodies = list_bodies(shot, target if options.feathers else path)
        check_bodies(bodies, options.overwrite or options.resume, options.feathers is not None)
    first, last = options.frames or (shot.first_frame, shot.last_frame)
    frames = first - shot.handles, last + shot.handles
    every = unique_prim_names([p.id for p in shot.groom.feathers])
    options = in_space(options, shot.groom, shot.skin)
    options = replace(
        options,
        group=choose_group(options.group, len(every)),
        chunk=options.chunk or (CONTACT_CHUNK_FRAMES if shot.contact else CHUNK_FRAMES),
    )
    origin = _find_origin(shot, frames)
    settings = _settings(shot, frames, options) | {"origin": json.dumps(origin)}
    part, whole, numbers = _part(shot, options.feathers)
    refuse_too_large(part.groom, shot.quality, options, name)
    refuse_unfit_form(part.groom, options, name)
    refuse_splits_elsewhere(part.groom, shot.quality, options, name)
    return BakeTask(
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
        origin=origin,
        dependences=Dependences(shot, numbers),
        bodies=bodies,
    )


def _checked(
    given: str | Path | Shot, output: str | Path | None, options: BakeOptions
) -> tuple[Shot, Path, Path]:
    """Return the shot as it will be simulated, the output's name as given, and the file to write.

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
        lambda: wanted_shot(given, options, read.append),
        lambda: read_quality(options.quality, options.preset_folders) if options.quality else None,
        lambda: checked(output) if output is not None else None,
        lambda: check_report(options.report, True),
        lambda: check_ranges(options),
    )
    target = Path(output) if output is not None else default_output(shot)
    path = path or checked(target)
    _refuse_inputs(path, options.report, [*read, shot.source, shot.groom.source])
    # a bake that goes on may replace the report of the one before
    check_report(options.report, options.overwrite or (options.resume and _is_report(options)))
    shot = shot if isinstance(given, Shot) else place_feathers(shot)
    quality = chosen or shot.quality
    if options.error is not None:
        quality = quality.with_error(options.error)
    return replace(shot, quality=quality), target, path


def _part(shot: Shot, feathers: tuple[int, int] | None) -> tuple[Shot, Shot, Sequence[int]]:
    """Return the shot of a partition, the shot simulated for it, and its numbers in the shot."""
    if feathers is None:
        return shot, shot, range(len(shot.groom.feathers))
    from featherfx.shot.contact.partition import share_numbers
    from featherfx.shot.detail.guides import uses_guides
    from featherfx.shot.types import part_of

    numbers = share_numbers(shot, *feathers)
    part = part_of(shot, numbers)
    # guides may be of another share; islands and measured errors are those of the whole
    shared = uses_guides(shot) or shot.contact is not None or shot.quality.promised is not None
    return part, (shot if shared else part), numbers.tolist()


def in_space(options: Options, groom: Groom, skin: BoundSkin | None) -> Options:
    """Return options with units and axis: as given, else those of the input stages."""
    unit, axis = 1.0, "Z"
    if skin is not None and skin.parts:
        unit, axis = skin.parts[0].surface.space
    else:
        stage = None if groom.skin_keys is None else groom.skin_keys["usd"]
        file = groom.source if stage is None else usd.values.locate_file(groom.source.parent, stage)
        if file.suffix.lower() in SCENE_SUFFIXES:
            unit, axis = usd.stage.read_stage_space(usd.values.open_stage(file))
    return replace(
        options,
        meters_per_unit=unit if options.meters_per_unit is None else options.meters_per_unit,
        up_axis=axis if options.up_axis is None else options.up_axis,
    )


def _settings(shot: Shot, frames: tuple[int, int], options: BakeOptions) -> dict[str, str]:
    """Return all that the frames depend on but the origin, as texts."""
    written = {each.name for each in fields(WriteOptions)} - {"overwrite", "resume"}
    return {
        "version": __version__,
        "program": program_digest(),
        "frames": f"{frames[0]}-{frames[1]}",
        "feathers": "{}/{}".format(*options.feathers) if options.feathers else "all",
        **{name: json.dumps(getattr(options, name)) for name in sorted(written)},
        "render grid": "{} x {}".format(*options.grid(shot.quality)),
        "barbs": f"{options.barbs or 0} with {options.barbules or 0} barbules",
        **{f"shot.{key}": text for key, text in shot.settings.items()},
    }


def _find_origin(shot: Shot, frames: tuple[int, int]) -> tuple[float, float, float]:
    """Return the origin of the root prim, beside the feathers from the first frame to the last.

    Warns where single precision is too coarse for the shortest feather even from there.
    """
    places = np.array([each.position for each in shot.groom.feathers]).reshape(-1, 3)
    if shot.skin is not None:
        ends = [shot.skin.frames(shot.time_of(frame)).positions for frame in frames]
        places = np.concatenate(ends)
    origin = choose_origin(places)
    away = float(np.linalg.norm(places - origin, axis=1).max(initial=0.0))
    shortest = min((each.kind.length for each in shot.groom.feathers), default=np.inf)
    coarse = float(np.finfo(np.float32).eps) * away / shortest
    if coarse > _MAX_COARSENESS:
        warn_input(
            f"{shot.source}: feathers are up to {away:.3g} m from the origin of the cache, where "
            f"single precision misses {as_figure(100.0 * coarse)} % of a feather of"
            f" {shortest:.2g} m. Divide the shot, or move its scene nearer"
        )
    return origin


def part_path(path: Path, feathers: tuple[int, int]) -> Path:
    """Name the file of one share of the feathers of a cache: wing.usdc gives wing.2of4.usdc."""
    return path.with_name(f"{path.stem}.{feathers[0]}of{feathers[1]}{path.suffix}")


def default_output(shot: Shot | FlockShot) -> Path:
    """Name the output after the shot, with .usdc, in the current folder."""
    return Path(re.sub(r"[^\w.-]+", "_", shot.name) + ".usdc")


def wanted_shot(
    given: str | Path | Shot, options: BakeOptions, note: Callable[[Path], object]
) -> Shot:
    """Read a shot's file without placing its feathers; a shot is there already.

    note: is told every scene that is read. Raises InputError for it, its groom, and frames that it
    does not have.
    """
    frames = options.frames
    if isinstance(given, Shot):
        shot = given
        for file in shot.document.files if shot.document else ():
            note(file)
    else:
        shot = shot_as_written(open_document("shot", given, options.preset_folders), note)
    if frames and not shot.first_frame <= frames[0] <= frames[1] <= shot.last_frame:
        allowed = f"Give frames from {shot.first_frame} to {shot.last_frame}"
        message = f"{frames[0]}-{frames[1]} is out of range. {allowed}"
        raise InputError(Problem(str(shot.source), "frames", message))
    return shot


def _refuse_inputs(path: Path, report: str | Path | None, inputs: Sequence[Path]) -> None:
    """Raise InputError where the cache or its report would take the place of an input."""
    outputs = {file for layout in ("payload", "clips") for file in output_files(path, layout)}
    if report is not None and Path(report).absolute() in {file.absolute() for file in outputs}:
        raise InputError(Problem(str(report), "", "is the cache itself. Choose another name"))
    refuse_inputs([*sorted(outputs), *([Path(report)] if report is not None else [])], inputs)


def check_report(report: str | Path | None, overwrite: bool) -> None:
    """Raise InputError where a report cannot be written there."""
    if report is not None and (problems := find_file_problems([Path(report)], overwrite)):
        raise InputError(*problems)


def _is_report(options: BakeOptions) -> bool:
    """Check that the report's file holds the report of a bake."""
    path = Path(options.report or "")
    try:
        found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and {"shot", "samples", "samples_taken_over"} <= found.keys()
