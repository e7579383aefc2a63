"""Several shots as one job, or one shot by several workers."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from featherfx._version import __version__
from featherfx.baking.bake import store_report
from featherfx.baking.options import BakeOptions, takes
from featherfx.baking.task import check_report
from featherfx.errors import InputError, Problem
from featherfx.farm.cluster import opened
from featherfx.farm.job import Job
from featherfx.farm.places import outputs_of
from featherfx.files.atomic_write import standing
from featherfx.groom.presets.folders import SHIPPED_PRESETS, own_folders
from featherfx.usd.types import OutputError


@takes(BakeOptions)
def bake_many(
    shots: Sequence[str | Path],
    output: str | Path = ".",
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    shares: int | None = None,
    on_frame: Callable[[float, float], None] | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Bake shots by workers of a Dask cluster, each with the bytes of a bake by itself, and return
    the report of the job.

    output: a folder, made where it is missing, which takes a .usdc named after each shot's file;
    for one shot also a USD file. scheduler: address of one that is there; None: a cluster of
    processes of this machine is started, and ends with the job. workers: its processes, by default
    one for each core; of a scheduler, how many to wait for (default 1). shares: into how many each
    shot is cut, by default about two for each worker. on_frame: called with the frames done of all
    shots and their number. options: fields of featherfx.baking.options.BakeOptions; jobs are the
    threads of each worker. Workers need the same paths for shots, what these name, and the output
    (docs/farm.md). What goes on is told to the logger "featherfx.farm".

    Raises InputError with all that is wrong with any shot before any work; afterwards, with the
    shots that could not be baked, when all others are done. Needs the extra "dask".
    """
    begin = time.perf_counter()
    chosen = BakeOptions(**options)
    if not shots or chosen.feathers is not None:
        what = (
            "no shot is given. Name a shot"
            if not shots
            else "shares are cut by the job. Leave feathers out"
        )
        raise InputError(Problem("bake_many", "", what))
    report = None if chosen.report is None else Path(chosen.report)
    check_report(report, chosen.overwrite or chosen.resume)
    before = standing(report) if report else None
    paths = [Path(os.path.abspath(each)) for each in shots]
    where = Path(os.path.abspath(output))
    outputs = outputs_of(paths, where)
    folders = [*(str(each) for each in own_folders(chosen.preset_folders)), SHIPPED_PRESETS]
    given = asdict(replace(chosen, preset_folders=folders, report=None))
    with opened(scheduler, workers) as engine, _made(None if outputs == [where] else where):
        starting = time.perf_counter() - begin
        job = Job(paths, outputs, given, engine, shares, on_frame or (lambda done, total: None))
        told, count = job.run(), engine.workers
        parts = {"starting": starting, **job.seconds()}
    seconds = time.perf_counter() - begin
    parts["ending"] = seconds - sum(parts.values())
    result = {"version": __version__, "workers": count, "wall_seconds": seconds, "seconds": parts}
    result["shots"] = told
    if report is not None:
        store_report(result, report, before)
    return result


@contextmanager
def _made(folder: Path | None) -> Iterator[None]:
    """A folder that is made where it is missing, and goes again where nothing came into it."""
    if folder is None or folder.exists():
        yield
        return
    try:
        folder.mkdir()
    except OSError as error:
        message = f"the folder cannot be made: {error.strerror}"
        raise OutputError(Problem(str(folder), "output", message)) from error
    try:
        yield
    finally:
        with suppress(OSError):
            folder.rmdir()
