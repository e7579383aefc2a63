"""The bake, from a shot file to a USD cache; pipeline.py offers it to the outside."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from featherfx._version import __version__
from featherfx.api import Folders
from featherfx.baking.task import BakeOptions, Drawn, Task, all_of, prepare, sample_count

if TYPE_CHECKING:
    from featherfx.feather.types import Feather, PointMap
    from featherfx.groom.types import FeatherKind, Groom, Placement
    from featherfx.shot.motion.skin import BoundSkin
    from featherfx.shot.types import Quality
    from featherfx.usd.types import FeatherEntry

OnFrame = Callable[[int, int], None]
NOTHING_DONE = {"mean": 0.0, "max": 0.0}


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
    resume: bool = False,
    feathers: tuple[int, int] | None = None,
    render_rows: int | None = None,
    render_columns: int | None = None,
    barbs: int | None = None,
    **options: Unpack[BakeOptions],
) -> dict[str, Any]:
    """Simulate a shot, write it to USD and return the report.

    output: .usd, .usdc or .usda; None: the shot's name with .usdc, in the current folder. frames:
    first and last of those to write, inclusive; the frames before them are still simulated. jobs:
    threads. quality: name of a preset that replaces the shot's. report: JSON file for the report.
    on_frame: called with the samples done and their number, at first with those taken over.
    resume: continue after the chunks that an earlier bake of this shot and these options left;
    a finished cache is left as it is. feathers: (i, n), the i-th of n shares of the feathers, to
    the file that part_path names; see join_parts. render_rows, render_columns: of the meshes,
    at least 3 and 1; default: as simulated. barbs: along each vane, written as curves besides.

    The output and the report appear complete or not at all; after a failure or a kill the chunks
    that were done stay beside the output for resume. Raises InputError with every problem of
    shot, groom, presets and outputs before any work, SimulationError where a feather cannot be
    advanced.
    """
    begin = time.perf_counter()
    notify = on_frame or (lambda done, total: None)
    folders = tuple(preset_folders)
    drawn = Drawn(render_rows, render_columns, barbs)
    task = prepare(
        shot_path, output, frames, quality, folders, report, resume, feathers, options, drawn
    )
    samples = sample_count(task.frames, options)
    if task.finished:
        notify(samples, samples)
        figures: dict[str, Any]
        done, figures = samples, {"newton_iterations": NOTHING_DONE, "substeps": NOTHING_DONE}
        figures |= {"worst_residual": 0.0, "skipped": {}, "seconds": {}}
    else:
        done, figures = _simulate(task, jobs, resume, samples, notify)
    first, last = task.frames
    result = {
        "version": __version__,
        "shot": task.shot.name,
        "feathers": len(task.names),
        "frames": last - first + 1,
        "samples": samples,
        "samples_taken_over": done,
        "wall_seconds": time.perf_counter() - begin,
        "simulated_seconds": (last - task.shot.first_frame) / task.shot.frames_per_second,
        "peak_memory_bytes": peak_memory_bytes(),
        **figures,
    }
    if report is not None:
        from featherfx.files.whole import write_text

        write_text(Path(report), json.dumps(result, indent=2) + "\n")
    return result


def entries_of(
    groom: Groom, feathers: Sequence[Feather], static: bool, skin: BoundSkin | None = None
) -> list[FeatherEntry]:
    """What the writer takes, for every feather of a groom."""
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
            vane_stiffness=_vane_stiffness(placement.kind),
        )
        for index, (placement, feather) in enumerate(zip(groom.feathers, feathers, strict=True))
    ]


def _vane_stiffness(kind: FeatherKind) -> tuple[float, float]:
    """N/m, thickness times modulus across the barbs and in shear."""
    vane = kind.vane_material
    return vane.thickness * vane.across, vane.thickness * vane.shear


def drawn_entries(
    groom: Groom, quality: Quality, drawn: Drawn, names: Sequence[str], skin: BoundSkin | None
) -> list[FeatherEntry]:
    """What the writer takes of a bake: feathers as they are drawn, and how they follow.

    quality: of the simulation. names: prim name per feather.
    """
    from featherfx.feather.render import barb_curves

    grid, count = (quality.rows, quality.columns), drawn.barbs
    meshes = drawn.grid(quality)
    built = all_of(
        *(partial(_drawn_feather, placement, grid, meshes) for placement in groom.feathers)
    )
    entries = entries_of(groom, [feather for feather, _ in built], static=False, skin=skin)
    for index, placement in enumerate(groom.feathers):
        barbs = None
        if count:
            barbs = barb_curves(placement.kind, grid, count, placement.mirrored)
            points = barbs.points @ placement.rotation.T + placement.position
            barbs = replace(barbs, points=points)
        entries[index] = replace(
            entries[index], name=names[index], points_map=built[index][1], barbs=barbs
        )
    return entries


def _drawn_feather(
    placement: Placement, grid: tuple[int, int], meshes: tuple[int, int]
) -> tuple[Feather, PointMap | None]:
    """The feather to draw, and the map to it from a simulated one of another grid."""
    from featherfx.feather.render import render_feather
    from featherfx.feather.scaled import feather_of

    if grid == meshes:
        return feather_of(placement, *grid), None
    return render_feather(placement.kind, grid, meshes, placement.mirrored)


def metadata_of(groom: Groom, quality: Quality) -> dict[str, Any]:
    """What a cache tells of where it comes from."""
    return {"featherfx": __version__, "groom": groom.name, "quality": quality.name}


def _simulate(
    task: Task,
    jobs: int,
    resume: bool,
    samples: int,
    notify: OnFrame,
) -> tuple[int, dict[str, Any]]:
    """Run the frame loop beside the writer; returns the samples taken over and the figures."""
    from featherfx.files.background import Background
    from featherfx.shot.checkpoint import Checkpoint
    from featherfx.shot.simulate import simulate
    from featherfx.usd.write.write import CacheWriter

    shot, quality, options = task.shot, task.shot.quality, task.options
    writer = CacheWriter(
        task.path,
        drawn_entries(shot.groom, quality, task.drawn, task.names, shot.skin),
        task.frames,
        shot.frames_per_second,
        metadata=metadata_of(shot.groom, quality) | {"shot": shot.name, "settings": task.settings},
        settings=task.settings,
        resume=resume,
        root=task.root,
        **(options | {"overwrite": True}),
    )
    seconds = {"simulating": 0.0, "waiting": 0.0, "writing": 0.0, "finishing": 0.0}
    with writer:
        done = taken_over = writer.samples_done
        notify(done, samples)
        start = Checkpoint.load(writer.state) if writer.state else None
        subframes = options.get("subframes", 1)
        simulation = simulate(task.whole, jobs, task.frames, subframes, start, task.wanted)
        sink, mark = Background(writer.write), time.perf_counter()
        try:
            with sink:
                for frame in simulation if done < samples else ():
                    mark = _spent(seconds, "simulating", mark)
                    sink(frame, simulation.checkpoint().save)
                    mark = _spent(seconds, "waiting", mark)
                    done += 1
                    notify(done, samples)
        except KeyboardInterrupt as error:
            kept = writer.samples_done
            if kept:
                message = f"interrupted: {kept} of {samples} samples are kept for --resume"
                raise KeyboardInterrupt(message) from error
            raise
        seconds["writing"] = sink.seconds
    _spent(seconds, "finishing", mark)
    return taken_over, simulation.report | {"seconds": seconds}


def _spent(seconds: dict[str, float], what: str, since: float) -> float:
    """Add the time since then to what; returns now."""
    now = time.perf_counter()
    seconds[what] += now - since
    return now


def peak_memory_bytes() -> int | None:
    """Largest resident memory of this process so far; None where the system does not tell."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
