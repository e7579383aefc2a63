"""Whole tasks from file to file: what the commands do, for programs that import featherfx."""

from __future__ import annotations

import json
import os
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from featherfx import __version__
from featherfx.api import read_groom, read_quality, read_shot, scene_readers
from featherfx.errors import InputError, Problem

if TYPE_CHECKING:
    from featherfx.feather.types import Feather
    from featherfx.groom.types import Groom
    from featherfx.shot.skin_motion import BoundSkin
    from featherfx.shot.types import Quality, Shot
    from featherfx.usd.types import FeatherEntry

Folders = Iterable[str | Path]
OnFrame = Callable[[int, int], None]


class StageOptions(TypedDict, total=False):
    """How a USD stage is written; the defaults are what is simulated.

    meters_per_unit: m, default 1. up_axis: "Y" or "Z", default "Z". layout: "flat" (default) or
    "payload". overwrite: whether an output that exists is replaced, default False.
    """

    meters_per_unit: float
    up_axis: str
    layout: str
    overwrite: bool


def bake(
    shot_path: str | Path,
    output: str | Path | None = None,
    *,
    frames: tuple[int, int] | None = None,
    jobs: int = 1,
    quality: str | None = None,
    preset_folders: Folders = (),
    report: str | Path | None = None,
    on_frame: OnFrame | None = None,
    **stage: Unpack[StageOptions],
) -> dict[str, Any]:
    """Simulate a shot, write it to USD and return the report.

    output: .usd, .usdc or .usda; None: the shot's name with .usdc, in the current folder. frames:
    first and last of those to write, inclusive; the frames before them are still simulated. jobs:
    threads. quality: name of a preset that replaces the shot's. report: JSON file for the report.
    on_frame: called with the frames done and their number, at first with 0.

    The output and the report appear complete or not at all. Raises InputError with every problem
    of shot, groom, presets and outputs before any work, SimulationError where a feather cannot be
    advanced.
    """
    begin = time.perf_counter()
    shot, path = _prepared(shot_path, output, frames, quality, tuple(preset_folders), report, stage)
    first, last = frames or (shot.first_frame, shot.last_frame)

    from featherfx.shot.simulate import simulate
    from featherfx.usd.write import CacheWriter

    notify = on_frame or (lambda done, total: None)
    total = last - first + 1
    notify(0, total)
    simulation = simulate(shot, jobs=jobs, frames=(first, last))
    entries = _entries(shot.groom, simulation.feathers, static=False, skin=shot.skin)
    metadata = _metadata(shot.groom, shot.quality) | {"shot": shot.name}
    rate = shot.frames_per_second
    with CacheWriter(path, entries, (first, last), rate, metadata=metadata, **stage) as writer:
        for done, frame in enumerate(simulation, start=1):
            writer.write(frame)
            notify(done, total)
    result = {
        "version": __version__,
        "shot": shot.name,
        "feathers": len(entries),
        "frames": total,
        "wall_seconds": time.perf_counter() - begin,
        "simulated_seconds": (last - shot.first_frame) / shot.frames_per_second,
        "peak_memory_bytes": _peak_memory_bytes(),
        **simulation.report,
    }
    if report is not None:
        _write_whole(Path(report), json.dumps(result, indent=2) + "\n")
    return result


def export_groom(
    groom_path: str | Path,
    output: str | Path,
    *,
    quality: str = "final",
    preset_folders: Folders = (),
    **stage: Unpack[StageOptions],
) -> int:
    """Write the rest feathers of a groom to USD, without time samples; return their number.

    quality: name of the preset that gives rows and columns. Raises InputError with every problem.
    """
    from featherfx.feather.build import build_feather
    from featherfx.usd.output import check_output

    folders = tuple(preset_folders)
    groom, grid, path = _all(
        lambda: read_groom(groom_path, folders),
        lambda: read_quality(quality, folders),
        lambda: check_output(output, stage.get("overwrite", False), stage.get("layout", "flat")),
    )
    feathers = _all(
        *(
            partial(build_feather, each.kind, grid.rows, grid.columns, each.mirrored)
            for each in groom.feathers
        )
    )
    entries = _entries(groom, feathers, static=True)

    from featherfx.usd.write import CacheWriter

    with CacheWriter(path, entries, None, metadata=_metadata(groom, grid), **stage):
        pass
    return len(entries)


def check(path: str | Path, preset_folders: Folders = ()) -> list[Problem]:
    """What is wrong with a groom, preset, shot or USD file; empty when nothing is.

    Grooms and shots without a wrong value are also tried: their feathers are built and the motion
    is fitted to the joints.
    """
    path, folders = Path(path), tuple(preset_folders)
    if not path.is_file():
        return [Problem(str(path), "", "is a folder" if path.is_dir() else "file does not exist")]
    if path.suffix in (".usd", ".usda", ".usdc"):
        from featherfx.usd.check import check_usd

        return check_usd(path)
    if path.suffix != ".toml":
        suffixes = ".toml, .usd, .usda and .usdc"
        return [Problem(str(path), "", f"suffix '{path.suffix}' is not one of {suffixes}")]

    from featherfx.shot.read import check_file

    return check_file(path, folders, scene_readers()) or _tried(path, folders)


def _prepared(
    shot_path: str | Path,
    output: str | Path | None,
    frames: tuple[int, int] | None,
    quality: str | None,
    folders: Sequence[str | Path],
    report: str | Path | None,
    stage: StageOptions,
) -> tuple[Shot, Path]:
    """The shot to bake and the path to write, after all that can be known to be wrong."""
    from featherfx.usd.output import check_output

    overwrite, layout = stage.get("overwrite", False), stage.get("layout", "flat")

    def wanted_shot() -> Shot:
        shot = read_shot(shot_path, folders)
        if frames and not shot.first_frame <= frames[0] <= frames[1] <= shot.last_frame:
            allowed = f"allowed {shot.first_frame} to {shot.last_frame}"
            message = f"{frames[0]}-{frames[1]} is out of range, {allowed}"
            raise InputError(Problem(str(shot_path), "frames", message))
        return shot

    shot, chosen, path, _ = _all(
        wanted_shot,
        lambda: read_quality(quality, folders) if quality else None,
        lambda: check_output(output, overwrite, layout) if output is not None else None,
        lambda: _check_report(report),
    )
    if path is None:
        path = check_output(re.sub(r"[^\w.-]+", "_", shot.name) + ".usdc", overwrite, layout)
    return (replace(shot, quality=chosen) if chosen else shot), path


def _all(*tasks: Callable[[], Any]) -> list[Any]:
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


def _tried(path: Path, folders: Sequence[str | Path]) -> list[Problem]:
    """Problems that show only when feathers are built and moved; path holds no wrong value."""
    import tomllib

    from featherfx.feather.build import build_feather
    from featherfx.shot.motion import root_motion

    keys = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    tasks: list[Callable[[], Any]] = []
    if "groom" in keys:
        shot = read_shot(path, folders)
        groom, grid = shot.groom, shot.quality
        tasks.append(lambda: root_motion(shot))
    elif {"feather", "row", "table", "usd"} & keys.keys():
        groom, grid = read_groom(path, folders), read_quality("final", folders)
    else:
        return []
    kinds = dict.fromkeys(feather.kind for feather in groom.feathers)
    tasks += [partial(build_feather, kind, grid.rows, grid.columns) for kind in kinds]
    try:
        _all(*tasks)
    except InputError as error:
        return list(error.problems)
    return []


def _entries(
    groom: Groom, feathers: Sequence[Feather], static: bool, skin: BoundSkin | None = None
) -> list[FeatherEntry]:
    from featherfx.shot.placement import place
    from featherfx.usd.types import FeatherEntry

    return [
        FeatherEntry(
            id=placement.id,
            kind=placement.kind.name,
            region=placement.region,
            feather=feather,
            rest_points=place(feather.points, placement.position, placement.rotation),
            static=static,
            root=None if skin is None else skin.roots[index],
        )
        for index, (placement, feather) in enumerate(zip(groom.feathers, feathers, strict=True))
    ]


def _metadata(groom: Groom, quality: Quality) -> dict[str, Any]:
    return {"featherfx": __version__, "groom": groom.name, "quality": quality.name}


def _check_report(report: str | Path | None) -> None:
    if report is None:
        return
    path = Path(report)
    if path.is_dir():
        raise InputError(Problem(str(path), "", "is a folder; give the name of a file"))
    if not os.access(path.absolute().parent, os.W_OK):
        raise InputError(Problem(str(path.parent), "", "is no folder that can be written to"))


def _write_whole(path: Path, text: str) -> None:
    """Write a file under a temporary name beside it, then rename it."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(text, encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _peak_memory_bytes() -> int | None:
    """Largest resident memory of this process so far; None where the system does not tell."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
