"""The bake, from a shot file to a USD cache."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from featherfx import usd
from featherfx._version import __version__
from featherfx.baking.options import BakeOptions, make_options, takes
from featherfx.baking.task import BakeTask, prepare
from featherfx.files.atomic_write import Standing, into, remove_leftovers, standing, write_all
from featherfx.files.process import seldom_collected
from featherfx.jit.compiled import request_expected
from featherfx.phases import Account, StageRead, account, list_entries, listen_to_reads, phase
from featherfx.shot.frames import StageClock
from featherfx.shot.types import Shot

# frames that depths in the skin are measured in, of the hundredths of a bake that judging may take
_MAX_SKIN_FRAMES = 24
_NONE = {"mean": 0.0, "max": 0.0}
# phases in the seconds of a report; setting_up is all the rest
_PHASES = {
    "settling": ("settling",),
    "simulating": ("preroll", "earlier", "simulating"),
    "writing": ("writing",),
    "finishing": ("finishing", "judging"),
}


@takes(BakeOptions)
def bake(
    shot: str | Path | Shot,
    output: str | Path | None = None,
    *,
    on_frame: Callable[[int, int], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Simulate a shot, write it to USD and return the report.

    shot: its file, or in memory. output: .usd, .usdc or .usda; None: the shot's name with .usdc, in
    the current folder. on_frame: called with the samples done and their number, at first with
    those taken over. options: fields of featherfx.baking.options.BakeOptions. frames: first and
    last of those to write, inclusive;
    the frames before them are still simulated. jobs: threads. quality: name of a preset that
    replaces the shot's. error: percent of a feather's length, by which is chosen what is
    simulated. report: JSON file for the report. resume: continue after the chunks that an earlier
    bake of this shot and these options left; a finished cache is left as it is.
    feathers: (i, n), the i-th of n shares of the feathers, to the file that part_path names; see
    join. render_rows, render_columns: of the meshes, at least 3 and 1; default: as simulated.
    barbs: along each vane, written as curves besides. barbules: on either side of each of these.
    meters_per_unit: m. up_axis: "Y" or "Z".
    layout: "flat", "payload", "clips", or "auto", which takes flat for small caches and clips for
    large ones. chunk: frames that go to a file of their own when they are done. subframes: samples
    a frame; those between two frames stand at fractional time codes. accelerations: whether they
    are written beside the velocities. diagnostics: "strain", "energy" or both, written per face.

    The output and the report appear complete or not at all; after a failure or a kill the chunks
    that were done stay beside the output for resume. Raises InputError with every problem of
    shot, groom, presets and outputs before any work, SimulationError where a feather cannot be
    advanced.
    """
    notify = on_frame or (lambda done, total: None)
    current = account()
    with nullcontext(current) if current else Account() as timed, seldom_collected():
        return _bake(shot, output, notify, make_options(BakeOptions, options), timed)


def _bake(
    shot: str | Path | Shot,
    output: str | Path | None,
    notify: Callable[[int, int], None],
    options: BakeOptions,
    timed: Account,
) -> dict[str, Any]:
    """Read, check, simulate, write, report."""
    document = shot.document if isinstance(shot, Shot) else None
    reads: list[StageRead] = [] if document is None else [*document.reads]
    try:
        with listen_to_reads(reads.append):
            request_expected("bake", package="featherfx.solver")  # it is read meanwhile
            task = open_task(shot, output, options)
    except KeyboardInterrupt as error:
        during = timed.failed or "checking what is to be done"
        raise KeyboardInterrupt(f"interrupted during {during}: nothing was written") from error
    path = None if options.report is None else Path(options.report)
    before = standing(path) if path else None
    is_complete = False
    try:
        report = carry_out(task, notify)
        report["read"] = list_entries(reads)
        if path is not None and report.get("contact"):
            from featherfx.shot.loop.window_runs import add_contact_error

            with phase("comparing", silent=True):
                report = add_contact_error(task.whole, report)
        is_complete = True
        with phase("finishing", silent=True):
            report |= _seconds(timed)
            if path is not None:
                store_report(report, path, before)
    except KeyboardInterrupt as error:
        message = str(error) or "interrupted before the first frame: nothing new was written"
        if is_complete and not str(error):
            lost = "" if path is None else f"; {path} was not written"
            message = f"interrupted, but {task.path} is complete{lost}"
        raise KeyboardInterrupt(message) from error
    return report


def open_task(shot: str | Path | Shot, output: str | Path | None, options: BakeOptions) -> BakeTask:
    """Prepare a bake; with resume, as it goes on from the cache at its output.

    Raises InputError with every problem.
    """
    task = prepare(shot, output, options)
    if options.resume:
        from featherfx.baking.reuse import resume_task

        return resume_task(task)
    return task


def carry_out(task: BakeTask, notify: Callable[[int, int], None]) -> dict[str, Any]:
    """Simulate and write a task, unless it is finished; return its report without times.

    notify: as on_frame of bake.
    """
    if task.finished:
        usd.previous_cache.remove_finished_parts(task.path, task.settings)
        notify(task.samples, task.samples)
        done = task.samples
        figures: dict[str, Any] = {"newton_iterations": _NONE, "substeps": _NONE}
        figures |= {"worst_residual": 0.0, "skipped": {}}
    else:
        # the solver takes its time to load, which a finished cache does without
        from featherfx.baking.frame_loop import simulate_and_write

        done, figures = simulate_and_write(task, notify)
    if task.bodies:
        figures["bodies"] = write_bodies(task)
    stepped = figures.pop("stepped", ())
    judged = usd.judge.judge_cache(task.path, stepped, _MAX_SKIN_FRAMES)
    if "contact" in figures:
        figures["contact"]["written_depth"] = judged["skin_depth"]
    figures |= judged
    groom = task.shot.groom
    grown = sum(each.grown for each in groom.feathers)
    figures["skin_depth"]["unlaid"] = grown if groom.coat is None else 0
    if groom.coat is not None:
        from featherfx.feather.leaves import measure_cut_variation

        figures["variation_cut"] = measure_cut_variation(groom)
    first, last = task.frames
    return {
        "version": __version__,
        "shot": task.shot.name,
        "output": str(task.path),
        "feathers": len(task.names),
        "frames": last - first + 1,
        "samples": task.samples,
        "samples_taken_over": done,
        "wall_seconds": 0.0,
        "simulated_seconds": (last - task.shot.first_frame) / task.shot.frames_per_second,
        "peak_memory_bytes": peak_memory_bytes(),
        "time": _time(task.shot, first),
        **figures,
    }


def write_bodies(task: BakeTask) -> list[str]:
    """Write the layers of the bodies that a task's act moves, and return their paths."""
    from featherfx.usd.write import stages

    written = stages.write_bodies(
        task.bodies, task.shot, task.frames, task.options.subframes, bool(task.options.feathers)
    )
    return [str(each) for each in written]


def _time(shot: Shot, first: int) -> dict[str, float]:
    """Return the time code of the skin's stage, or of the first collider's, at a frame, and its
    time codes per frame; those of the cache where there is no stage."""
    clocks = [shot.skin.clock] if shot.skin is not None else [each.clock for each in shot.colliders]
    clock = clocks[0] if clocks else StageClock(shot.first_frame, 1.0, shot.frames_per_second)
    code = clock.code(shot.time_of(first))
    return {"first_time_code": code, "time_codes_per_frame": clock.step}


def store_report(result: Mapping[str, Any], report: Path, before: Standing) -> None:
    """Write a report. before: state of its path when the work began."""
    remove_leftovers(report)
    text = json.dumps(result, indent=2) + "\n"
    write_all([(report, into(lambda file: file.write(text.encode())))], {report: before})


def _seconds(timed: Account) -> dict[str, Any]:
    """Return times for the report: five parts that add up to wall_seconds, each phase by its own
    name, and the CPU time of all."""
    phases = timed.seconds()
    return {
        "wall_seconds": sum(phases.values()),
        "processor_seconds": sum(timed.processor_seconds().values()),
        "seconds": in_parts(phases),
        "phases": phases,
    }


def in_parts(phases: Mapping[str, float]) -> dict[str, float]:
    """Sum the seconds of phases to those of the five parts of a bake."""
    parts = {part: sum(phases.get(name, 0.0) for name in names) for part, names in _PHASES.items()}
    setting_up = max(sum(phases.values()) - sum(parts.values()), 0.0)
    return {"setting_up": setting_up, **parts}


def peak_memory_bytes() -> int | None:
    """Return the largest resident memory of this process so far; None where it is not known."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024
