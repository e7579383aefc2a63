"""Whether shots keep the error that is promised: measured against fine references."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from featherfx.lab.bench.front import FrontRun, errors, run
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.lab.bench.skips import share_of
from featherfx.shot.detail.promise import front
from featherfx.shot.types import Shot

NOTE = """\
The error that a shot is simulated with, as promised, as the simulation itself estimates it, and as
measured: of every feather the largest distance of any point that is simulated, at any frame, from
where a reference has it, percent of the feather's length. References have as many rows and columns
as were measured at most, three coefficients, and steps of a tolerance of 1e-5 of the median
length. Points of the meshes between simulated rows are interpolated, and not counted. Seconds are
processor times of one thread without the first frame."""
REFERENCE_ERROR, REFERENCE_TOLERANCE = 0.01, 1e-5


def kept_table(
    shots: Sequence[Shot],
    promised: Sequence[float],
    progress: Callable[[int, int], None],
    frames: int | None = None,
    every: int = 1,
) -> ResultTable:
    """Every shot at every error (percent). frames: of each shot, all by default. every: n-th
    feather of each alone."""
    rows: list[Row] = []
    total = len(shots) * len(promised)
    for shot in shots:
        some = share_of(shot, 1, min(every, len(shot.groom.feathers)))
        if frames is not None:
            some = replace(some, last_frame=min(some.last_frame, some.first_frame + frames - 1))
        some = replace(some, quality=replace(some.quality, max_substeps=4096), details=())
        reference = run(fine(some))
        for error in promised:
            rows.append(_kept(some, error, reference))
            progress(len(rows), total)
    return ResultTable("promise", "Promised errors", NOTE, rows)


def fine(shot: Shot) -> Shot:
    """The shot as it is compared with."""
    finest = front()
    length = float(np.median([p.kind.length for p in shot.groom.feathers]))
    quality = replace(
        shot.quality.with_error(REFERENCE_ERROR),
        rows=max(finest.rows.cost),
        simulated_rows=max(finest.rows.cost),
        columns=max(finest.columns.cost),
        coefficients=3,
        tolerance=REFERENCE_TOLERANCE * length,
    )
    return replace(shot, quality=quality)


def _kept(shot: Shot, error: float, reference: FrontRun) -> Row:
    found = run(replace(shot, quality=shot.quality.with_error(error)))
    measured = 100.0 * np.array(errors(found, reference))
    return {
        "shot": shot.name,
        "feathers": len(measured),
        "promised %": error,
        "estimated %": found.report["error_estimated"],
        "median %": float(np.median(measured)),
        "of 95 in 100 %": float(np.quantile(measured, 0.95)),
        "worst %": float(measured.max()),
        "kept by": float((measured <= error).mean()),
        "sub-steps a frame": found.report["substeps"]["mean"],
        "ms a simulated second": 1e3
        * found.seconds
        * shot.frames_per_second
        / max(shot.last_frame - shot.first_frame, 1)
        / len(shot.groom.feathers),
    }
