"""The bake of a flock: caches of the birds that are near, replays of the others, and one stage.

    read -> write the shots of birds and replays -> bake each -> compare -> write the stage

Every cache is an ordinary bake of a shot file in the folder beside the stage, `OUT.birds`. A share
of a flock bakes some of the caches and writes no stage; a bake of the whole takes those that are
done.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from featherfx._version import __version__
from featherfx.algebra.types import Array
from featherfx.api import open_document, scene_readers
from featherfx.baking.bake import bake, peak_memory_bytes, store_report
from featherfx.baking.options import BakeOptions, FlockOptions, make_options, takes
from featherfx.baking.task import check_report, default_output
from featherfx.errors import InputError, Problem, as_figure, warn_input
from featherfx.files.atomic_write import standing, write_text
from featherfx.groom.document import Document
from featherfx.groom.read.toml_text import toml_text
from featherfx.shot.flock import (
    FAR_BIRD,
    MIDDLE_BIRD,
    NEAR_BIRD,
    WAYS,
    Bird,
    FlockShot,
    bird_poses,
    frame_times,
    near_tables,
    replay_tables,
)
from featherfx.shot.read.flock import read_flock
from featherfx.usd.read.cache import Cache
from featherfx.usd.types import OutputError, StageSpace
from featherfx.usd.write.layers import StageInfo
from featherfx.usd.write.options import AS_ONE
from featherfx.usd.write.output import check_output, prim_name
from featherfx.usd.write.stages import BirdAsset, Replay, StagedBird, write_flock, write_model

# grid of feathers that are far, at most; on fewer rows bent shafts are visibly shorter
_FAR_ROWS, _FAR_COLUMNS = 11, 1
# feathers that are compared, evenly chosen
_COMPARED = 200
# gap of a loop, of a feather's length, from which on it is a pop as of the judge (usd/check)
_MAX_GAP = 0.1
_BYTES = 24  # of a point in a sample: place and velocity


@dataclass(frozen=True)
class BirdCache:
    """A cache to bake. shot: its file. frames: first and last that are written. bird: that it is
    of, or the first of those that it is replayed for."""

    bird: Bird
    shot: Path
    cache: Path
    frames: tuple[int, int]
    options: Mapping[str, Any]


@takes(FlockOptions)
def bake_flock(
    flock: str | Path,
    output: str | Path | None = None,
    *,
    on_frame: Callable[[int, int], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Bake the birds of a flock file, write their stage and return the report.

    output: as of bake; the caches stand in a folder beside it, named after it, with `.birds`.
    options: fields of FlockOptions; those of a bake hold for each cache. feathers: (i, n), the i-th
    of n shares of the caches, without the stage. Caches that are done are taken. Raises InputError
    with every problem, SimulationError as bake does.
    """
    chosen, begun = make_options(FlockOptions, options), time.perf_counter()
    path, read = _checked(flock, output, chosen)
    before = standing(path)
    folder = path.with_name(f"{path.stem}.birds")
    caches = list_caches(read, folder, chosen)
    if chosen.feathers is not None:
        caches = caches[chosen.feathers[0] - 1 :: chosen.feathers[1]]
    _refuse_full_disk(caches, read, path)
    write_shots(caches, read, open_document("shot", flock, chosen.preset_folders))
    reports = _bake_caches(caches, on_frame or (lambda done, total: None))
    if chosen.feathers is None:
        assets = {each.cache: _asset(each, read, reports[each.cache]) for each in caches}
        shown = chosen.frames or read.frames
        staged = [_stage_bird(bird, read, folder, assets, shown) for bird in read.birds]
        write_flock(path, staged, _stage_info(path, read, chosen), before)
    first, last = chosen.frames or read.frames
    report = _report(read, path, caches, reports) | {
        "frames": last - first + 1,
        "wall_seconds": time.perf_counter() - begun,
        "peak_memory_bytes": peak_memory_bytes(),
    }
    if chosen.report is not None:
        store_report(report, Path(chosen.report), standing(Path(chosen.report)))
    return report


def _checked(
    flock: str | Path, output: str | Path | None, options: FlockOptions
) -> tuple[Path, FlockShot]:
    """Return the stage's file, and the flock with the frames that are asked for."""
    read = read_flock(flock, options.preset_folders, scene_readers(), options.birds)
    path = Path(output) if output is not None else default_output(read)
    check_output(path, options.overwrite or options.resume or options.feathers is not None)
    check_report(options.report, options.overwrite or options.resume)
    if options.frames is not None:
        first, last = read.frames
        if not first <= options.frames[0] <= options.frames[1] <= last:
            told = f"{options.frames[0]}-{options.frames[1]} is out of range. Give frames from"
            raise InputError(Problem(str(flock), "frames", f"{told} {first} to {last}"))
    return path, read


def list_caches(flock: FlockShot, folder: Path, options: FlockOptions) -> list[BirdCache]:
    """List the caches of a flock, each once: replays, then birds that are near."""
    passed = {
        each.name: getattr(options, each.name)
        for each in fields(BakeOptions)
        if each.name not in ("frames", "feathers", "report", "overwrite", "resume")
    }
    passed |= _space(flock, options) | {"overwrite": options.overwrite, "resume": True}
    found: dict[Path, BirdCache] = {}
    for bird in sorted(flock.birds, key=lambda each: each.way == NEAR_BIRD):
        loop, own = flock.groups[bird.group].loop, passed
        frames = (loop.first, loop.first + loop.frames)
        if bird.way == NEAR_BIRD:
            frames = options.frames or flock.frames
        else:
            own = passed | {"layout": "flat"}
        if bird.way == FAR_BIRD:
            rows = min(_FAR_ROWS, flock.groups[bird.group].shot.quality.rows)
            own = own | {"render_rows": rows, "render_columns": _FAR_COLUMNS}
            own = own | {"group": AS_ONE, "barbs": None, "barbules": None, "textures": None}
        cache = _cache_path(bird, flock, folder)
        if cache not in found:
            found[cache] = BirdCache(bird, cache.with_suffix(".toml"), cache, frames, own)
    return list(found.values())


def _cache_path(bird: Bird, flock: FlockShot, folder: Path) -> Path:
    """Name the cache that a bird shows."""
    if bird.way == NEAR_BIRD:
        return folder / f"{bird.name}.usdc"
    name = f"{Path(flock.groups[bird.group].keys.shot).stem}_{bird.group + 1}_{bird.way}"
    return folder / f"{prim_name(name)}{'' if bird.way == FAR_BIRD else f'_{bird.gust + 1}'}.usdc"


def _space(flock: FlockShot, options: FlockOptions) -> dict[str, Any]:
    """Return units and axis of all caches: as given, else those of the first skin."""
    surfaces = flock.groups[0].shot.surfaces
    unit, axis = surfaces.surfaces[0].space if surfaces is not None else (1.0, "Z")
    return {"meters_per_unit": options.meters_per_unit or unit, "up_axis": options.up_axis or axis}


def write_shots(caches: Sequence[BirdCache], flock: FlockShot, file: Document) -> None:
    """Write the shot files of caches. file: of the flock."""
    for each in caches:
        group = flock.groups[each.bird.group]
        document = open_document("shot", group.shot.source, file.preset_folders)
        own = document.seen_from(each.shot.parent)
        if each.bird.way == NEAR_BIRD:
            changes = near_tables(flock, each.bird, own, file.tables.get("wind", "calm"))
        else:
            changes = replay_tables(flock, each.bird) | {"name": each.cache.stem}
        tables = replace(document, tables=own).with_tables(changes).tables
        each.shot.parent.mkdir(parents=True, exist_ok=True)
        write_text(each.shot, toml_text(tables))


def _bake_caches(
    caches: Sequence[BirdCache], notify: Callable[[int, int], None]
) -> dict[Path, dict[str, Any]]:
    """Bake each cache; return the reports, with the processor time of each."""
    total = sum(each.frames[1] - each.frames[0] + 1 for each in caches)
    reports, done = {}, 0
    for each in caches:
        began = time.process_time()

        def tell(own: int, _: int, before: int = done) -> None:
            notify(before + own, total)

        reports[each.cache] = bake(
            each.shot, each.cache, frames=each.frames, on_frame=tell, **each.options
        )
        reports[each.cache]["processor_seconds"] = time.process_time() - began
        done += each.frames[1] - each.frames[0] + 1
    return reports


def _asset(cache: BirdCache, flock: FlockShot, report: Mapping[str, Any]) -> BirdAsset:
    """Write the body of a bird, and return what it shows of a cache."""
    surfaces = flock.groups[cache.bird.group].shot.surfaces
    if surfaces is None:
        return BirdAsset(cache.cache, None)
    first = surfaces.surfaces[0]
    model, path = "/" + first.path.split("/")[1], cache.cache.with_suffix(".model.usdc")
    source = Path(report["bodies"][0]) if report.get("bodies") else first.file
    if left := {each.path for each in surfaces.surfaces if not each.path.startswith(f"{model}/")}:
        told = f"of its skins only {model} is shown, without {', '.join(sorted(left))}"
        message = f"{cache.shot}: {told}. Give the bird one model"
        warn_input(message)
    write_model(source, model, cache.frames, path)
    return BirdAsset(cache.cache, (path, model))


def _stage_bird(
    bird: Bird,
    flock: FlockShot,
    folder: Path,
    assets: Mapping[Path, BirdAsset],
    frames: tuple[int, int],
) -> StagedBird:
    """Place a bird on the stage, which shows some frames of the flock."""
    group, asset = flock.groups[bird.group], assets[_cache_path(bird, flock, folder)]
    facts = {"shot": group.keys.shot, "way": bird.way, "phase": bird.phase, "pixels": bird.pixels}
    if bird.way == NEAR_BIRD:
        return StagedBird(bird.name, None, asset, facts)
    left = frames[0] - flock.frames[0]
    times = frame_times(flock)[left : frames[1] - flock.frames[0] + 1]
    forward = np.array(group.keys.forward)
    turns, ways = bird_poses(bird.path, forward, bird.size * group.middle, times)
    matrices = np.zeros((len(ways), 4, 4))
    matrices[:, :3, :3] = bird.size * turns.swapaxes(1, 2)
    matrices[:, 3, :3], matrices[:, 3, 3] = ways, 1.0
    replay = Replay(asset, group.loop.first, group.loop.frames, bird.phase + left)
    return StagedBird(bird.name, matrices, replay, facts)


def _stage_info(path: Path, flock: FlockShot, options: FlockOptions) -> StageInfo:
    space = StageSpace(*_space(flock, options).values())
    counts = {way: sum(each.way == way for each in flock.birds) for way in WAYS}
    metadata = {"version": __version__, "flock": flock.name, "birds": counts}
    frames = options.frames or flock.frames
    return StageInfo(prim_name(path.stem), space, frames, flock.frames_per_second, metadata)


def _refuse_full_disk(caches: Sequence[BirdCache], flock: FlockShot, path: Path) -> None:
    """Raise OutputError where the caches would not fit on the disk, by the points of their
    meshes."""
    needed = 0
    for each in caches:
        shot = flock.groups[each.bird.group].shot
        quality = shot.quality
        rows = each.options["render_rows"] or quality.rows
        columns = each.options["render_columns"] or quality.columns
        points = len(shot.groom.feathers) * rows * (2 * columns + 1)
        needed += points * _BYTES * (each.frames[1] - each.frames[0] + 1)
    free = shutil.disk_usage(path.absolute().parent).free
    if needed > free:
        told = f"{len(caches)} caches need some {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB"
        remedy = "are free. Raise near_above, lower the quality, or write to another disk"
        raise OutputError(Problem(str(path), "", f"{told} {remedy}"))


def _report(
    flock: FlockShot,
    path: Path,
    caches: Sequence[BirdCache],
    reports: Mapping[Path, Mapping[str, Any]],
) -> dict[str, Any]:
    """Sum up a flock's caches: birds by way, costs, and how far replays are from what they show."""
    counts = {way: sum(each.way == way for each in flock.birds) for way in WAYS}
    costs = {way: 0.0 for way in WAYS}
    for each in caches:
        costs[each.bird.way] += reports[each.cache]["processor_seconds"]
    return {
        "version": __version__,
        "shot": flock.name,
        "output": str(path),
        "birds": counts,
        "caches": {each.cache.name: reports[each.cache] for each in caches},
        "processor_seconds": sum(costs.values()),
        "processor_seconds_per_bird": {
            way: costs[way] / counts[way] for way in WAYS if counts[way]
        },
        "loop_gaps": _loop_gaps(caches, flock),
        "replay_error": _replay_error(caches, flock),
    }


def _loop_gaps(caches: Sequence[BirdCache], flock: FlockShot) -> dict[str, float]:
    """Measure how far feathers are at the end of each loop from its start, percent of their length.

    The worst of each; a warning tells of what would pop.
    """
    gaps = {}
    for each in caches:
        if each.bird.way == NEAR_BIRD:
            continue
        cache = Cache(each.cache)
        ends = [_some_points(cache, frame) for frame in each.frames]
        worst = 100.0 * float(_distances(*ends).max())
        gaps[each.cache.name] = worst
        if worst > 100.0 * _MAX_GAP:
            told = f"feathers jump by {as_figure(worst)} % of their length where its loop of"
            frames = each.frames[1] - each.frames[0]
            remedy = (
                f"{frames} frames ends. Give `cycle` of {flock.groups[each.bird.group].keys.shot}"
            )
            message = f"{each.cache}: {told} {remedy} as many frames as its motion repeats after"
            warn_input(message)
    return gaps


def _replay_error(caches: Sequence[BirdCache], flock: FlockShot) -> dict[str, Any] | None:
    """Measure how far feathers of the replay are from those of the largest bird that is near, in
    the middle of the flight; None where no bird has both.

    `distance`: m, 99 % of the feathers are within it. `percent_p50`, `percent_p99`: of their
    length, after the rigid motion that fits best, so that of shapes alone.
    """
    near = [each for each in caches if each.bird.way == NEAR_BIRD]
    replays = {each.bird.group: each for each in caches if each.bird.way == MIDDLE_BIRD}
    both = [each for each in near if each.bird.group in replays]
    if not both:
        return None
    one = max(both, key=lambda each: each.bird.pixels)
    group, frame = flock.groups[one.bird.group], (one.frames[0] + one.frames[1]) // 2
    passed, loop = frame - flock.frames[0], group.loop
    shown = loop.first + (one.bird.phase + passed) % loop.frames
    (turn,), (way,) = bird_poses(
        one.bird.path,
        np.array(group.keys.forward),
        group.middle,
        np.array([passed / flock.frames_per_second]),
    )
    there = _some_points(Cache(replays[one.bird.group].cache), shown)
    flown, own = [each @ turn.T + way for each in there], _some_points(Cache(one.cache), frame)
    off = 100.0 * _distances(_aligned(flown, own), own)
    away = [np.linalg.norm(a - b, axis=1).max() for a, b in zip(flown, own, strict=True)]
    return {
        "bird": one.bird.name,
        "frame": frame,
        "distance": float(np.quantile(away, 0.99)),
        "percent_p50": float(np.median(off)),
        "percent_p99": float(np.quantile(off, 0.99)),
    }


def _aligned(points: Sequence[Array], others: Sequence[Array]) -> list[Array]:
    """Points of feathers, (V, 3) each, after the rigid motion that brings all nearest to others."""
    one, other = np.concatenate(points), np.concatenate(others)
    middles = one.mean(axis=0), other.mean(axis=0)
    turn, _ = Rotation.align_vectors(other - middles[1], one - middles[0])
    return [turn.apply(each - middles[0]) + middles[1] for each in points]


def _some_points(cache: Cache, frame: float) -> list[Array]:
    """(V, 3) m of some feathers of a cache at a frame, z up."""
    count = len(cache.feathers)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _COMPARED)).round().astype(int))
    found = cache.points_of(chosen.tolist(), float(frame))
    return [points @ cache.to_world for points in found]


def _distances(one: Sequence[Array], other: Sequence[Array]) -> Array:
    """(F,) farthest distance of the points of each feather, over its size."""
    return np.array(
        [
            np.linalg.norm(a - b, axis=1).max() / np.linalg.norm(np.ptp(a, axis=0))
            for a, b in zip(one, other, strict=True)
        ]
    )
