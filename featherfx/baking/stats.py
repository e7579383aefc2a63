"""Contents of a groom or shot, and the expected cost of its bake."""

from __future__ import annotations

import tomllib
import warnings
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.api import Folders, read_groom, read_quality, read_shot
from featherfx.baking.bake import in_parts, peak_memory_bytes
from featherfx.baking.entries import entries_of
from featherfx.baking.trial import (
    MAX_TRIAL_SECONDS,
    expected,
    has_time_for,
    require_time,
    resolve_in_time,
    sum_unknowns,
    time_of,
)
from featherfx.errors import InputWarning, all_of, require_type
from featherfx.feather.placed_feathers import build_feathers
from featherfx.feather.shapes import distinct_shapes
from featherfx.groom.types import Groom
from featherfx.jit.compile_workers import PROGRESS, working_time
from featherfx.phases import Progress, account, tells_progress
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.patterns import LEVELS
from featherfx.shot.types import Quality, Shot
from featherfx.usd.types import StageSpace
from featherfx.usd.write.cache_writer import chunk_bytes
from featherfx.usd.write.options import CHUNK_FRAMES, CONTACT_CHUNK_FRAMES
from featherfx.usd.write.poses import make_posed_feathers

# over the time that building the drawn feathers takes, what comes after the trials
_AFTER_TRIALS = 0.5
# over the time that reading takes, what drawing and resolving take at least
_RESOLVING = 0.5


@tells_progress
def stats(
    source: str | Path | Shot | Groom,
    *,
    quality: str | None = None,
    jobs: int = 1,
    preset_folders: Folders = (),
    budget: float | None = None,
    progress: Progress = False,
) -> dict[str, Any]:
    """Count feathers, overlap and penetration of a groom; of a shot also estimate its bake.

    source: a file, or a shot or groom in memory. quality: preset instead of the shot's; for a
    groom, that its meshes are counted at (default final). jobs: threads of the bake. Its cost is
    measured by bakes of a part of the shot, which take about budget seconds of CPU time with
    reading, without compiling, at most a minute for None. SI units, bytes.
    progress: as of featherfx.phases.tells_progress.
    Raises InputError, and SimulationError where one of these feathers cannot be simulated.
    """
    require_type("source", source, Shot | Groom | str | Path, "a Shot, a Groom, or a file's path")
    folders = tuple(preset_folders)
    until = working_time() + (MAX_TRIAL_SECONDS if budget is None else budget)
    if isinstance(source, Groom):
        return _of_groom(source, read_quality(quality or "final", folders))
    if not isinstance(source, Shot) and not _is_shot(Path(source)):
        groom, grid = all_of(
            lambda: read_groom(source, folders), lambda: read_quality(quality or "final", folders)
        )
        return _of_groom(groom, grid)
    read = partial(
        all_of,
        lambda: source if isinstance(source, Shot) else read_shot(source, folders),
        lambda: read_quality(quality, folders) if quality else None,
    )
    found: list[Any] = []
    first = time_of(lambda: found.extend(read()))
    shot, chosen = found
    shot = replace(shot, quality=chosen) if chosen else shot
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        reading = first
        if has_time_for(2.0 * first[1], until):
            reading = time_of(read)  # as the bake finds it, with what is kept of the first time
    cost = bake_cost(shot, jobs, _starting() + reading, until, budget)
    return _of_groom(shot.groom, shot.quality) | {"bake": cost}


def _is_shot(path: Path) -> bool:
    if path.suffix != ".toml":
        return False
    try:
        return "groom" in tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError):
        return False  # the reader of grooms tells what is wrong with it


def _of_groom(groom: Groom, quality: Quality) -> dict[str, Any]:
    first, shapes = distinct_shapes(groom.feathers)
    lengths = [feather.kind.length for feather in groom.feathers]
    used = Counter(shapes)
    built = build_feathers([groom.feathers[k] for k in first], quality.rows, quality.columns)
    points = [len(feather.surface.row) for feather in built]
    return {
        "name": groom.name,
        "feathers": len(groom.feathers),
        "regions": dict(Counter(feather.region for feather in groom.feathers)),
        "kinds": dict(Counter(feather.kind.name for feather in groom.feathers)),
        "shapes": len(first),
        "most_of_one_shape": max(used.values()),
        "length": {"least": min(lengths), "greatest": max(lengths)},
        "quality": quality.name,
        "mesh_points": sum(points[shape] for shape in shapes),
        "mesh_points_of_shapes": sum(points),
        "layout": None if groom.coat is None else _layout_stats(groom),
    }


def _layout_stats(groom: Groom) -> dict[str, Any]:
    """Counts of a coat: feathers that overlap, and those with less than the gap asked for."""
    report = groom.coat.report
    count = len(report.shares)
    return {
        "feathers": count,
        "pairs": report.pairs,
        "neighbours_of_each": 2.0 * report.pairs / count,
        "feathers_with_smaller_gap": int((report.shares < 1.0).sum()),
        "feathers_without_gap": int((report.shares == 0.0).sum()),
    }


def _starting() -> Array:
    """(2,) s that this process took to start, on the clock and of the processors."""
    current = account()
    told = () if current is None else (current.seconds(), current.processor_seconds())
    return np.array([each.get("starting", 0.0) for each in told] or [0.0, 0.0])


def bake_cost(
    shot: Shot, jobs: int, read: Array, until: float, budget: float | None
) -> dict[str, Any]:
    """Estimate time and memory of a bake of a shot on this machine as it is now.

    read: (2,) s of starting and reading the shot, on the clock and of the processors. The rest of
    the time is what bakes of a part of it (trial.py) tell of all. until, budget: of these. Memory
    is that of the process so far and of what the bake adds; an estimate.
    """
    require_time(_RESOLVING * read[1], until)
    begin = working_time()
    drawn = drawn_feathers(shot)
    # what comes after the trials takes a part of that
    until -= _AFTER_TRIALS * (working_time() - begin)
    resolved = resolve_in_time(shot, drawn, until)
    options = resolved.options.feathers
    levels = Counter(each.level for each in options)
    frames = shot.last_frame - shot.first_frame + 1 + 2 * shot.handles
    total = len(shot.groom.feathers)
    learnt = expected(resolved, jobs, until, budget)
    entries = entries_of(shot.groom, drawn, static=False, skin=shot.skin)
    sample = sum(feather.bytes_per_sample for feather in make_posed_feathers(entries, StageSpace()))
    # frames of a chunk that the trial did not have
    chunk = min(
        frames, CONTACT_CHUNK_FRAMES if shot.contact else CHUNK_FRAMES, chunk_bytes(total) // sample
    )
    memory = learnt.memory + sample * max(chunk - learnt.trial.frames, 0)
    phases = {"reading": float(read[0]), **learnt.phases}
    seconds = in_parts(phases)
    whole = {
        "wall_seconds": sum(seconds.values()),
        "processor_seconds": float(read[1]) + learnt.processor,
    }
    return {
        "frames": frames,
        "tried_feathers": learnt.trial.feathers,
        "tried_frames": learnt.trial.frames,
        "trial_seconds": learnt.seconds,
        "compiling_seconds": PROGRESS.cpu_seconds(),
        "levels": {name: float(levels[name]) for name in LEVELS if levels[name]},
        "unknowns": round(sum_unknowns(options)),
        "seconds_of_a_feather_and_frame": phases["simulating"] * jobs / max(frames - 1, 1) / total,
        **whole,
        "low": {name: learnt.low * value for name, value in whole.items()},
        "high": {name: learnt.high * value for name, value in whole.items()},
        "cores": learnt.processor / sum(learnt.phases.values()),
        "seconds": seconds,
        "jobs": jobs,
        "memory_bytes": round(max(memory, peak_memory_bytes() or 0.0)),
        "bytes_of_a_frame": round(sample),
        "bytes_of_the_cache": round(sample * frames),
    }
