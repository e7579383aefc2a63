"""How cost grows with feathers, rows and threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import process_time

from featherfx.groom.types import FeatherKind
from featherfx.lab.bench.extent import PRODUCTION, Extent
from featherfx.lab.bench.shake import Method, Run, Shake, barb_curvature
from featherfx.lab.bench.tables import Row, Table

REPEATS = 3


def fastest(method: Method, kind: FeatherKind, shake: Shake, repeats: int = REPEATS) -> Run:
    """The fastest of several equal runs: what the machine does when nobody disturbs it."""
    return min((method(kind, shake) for _ in range(repeats)), key=lambda run: run.seconds)


def threads_table(kind: FeatherKind, extent: Extent, jobs: int) -> Table:
    """32 feathers on one thread and on several."""
    shake = replace(PRODUCTION, count=32, duration=extent.duration)
    rows: list[Row] = []
    for threads in sorted({1, 2, jobs}):
        begin = process_time()
        run = fastest(barb_curvature, kind, replace(shake, jobs=threads))
        processor = (process_time() - begin) / (REPEATS * run.steps)
        first = rows[0]["ms a frame of 1/96 s"] if rows else 1e3 * run.step_seconds
        rows.append(
            {
                "threads": threads,
                "ms a frame of 1/96 s": 1e3 * run.step_seconds,
                "times one thread": first / (1e3 * run.step_seconds),
                "processor ms a frame": 1e3 * processor,
            }
        )
    note = (
        "32 production feathers; wall time of the best of three runs, processor time of all threads"
        " in the mean. Where other work takes the cores, only the latter tells what threads cost."
    )
    return Table("threads", "Threads", note, rows)


def batches_table(kind: FeatherKind, extent: Extent) -> Table:
    """Time per feather against their number."""
    rows = _scaling(
        extent.batches,
        lambda count: replace(PRODUCTION, count=count, duration=8.0 / 96.0),
        kind,
        "feathers",
    )
    note = "Production feathers on one thread, eight steps of 1/96 s; time of a step per feather."
    return Table("batches", "Time per feather", note, rows)


def rows_table(kind: FeatherKind, extent: Extent) -> Table:
    """Cost against the number of rows."""
    rows = _scaling(
        (11, 21, 41, 81, 161),
        lambda count: replace(PRODUCTION, rows=count, duration=8.0 / 96.0),
        kind,
        "rows",
    )
    note = "Six columns, two coefficients, eight steps of 1/96 s; time of an iteration per row."
    return Table("rows", "Cost against rows", note, rows)


def _scaling(
    counts: tuple[int, ...],
    shake: Callable[[int], Shake],
    kind: FeatherKind,
    unit: str,
) -> list[Row]:
    """Time of a step at several sizes, and per unit of size and iteration."""
    rows: list[Row] = []
    for count in counts:
        run = fastest(barb_curvature, kind, shake(count))
        each = run.seconds / run.iterations / count if unit == "rows" else run.step_seconds / count
        base = rows[0]["microseconds each"] if rows else 1e6 * each
        rows.append(
            {
                unit: count,
                "iterations a step": run.step_iterations,
                "ms a step": 1e3 * run.step_seconds,
                "microseconds each": 1e6 * each,
                "share of the first": 1e6 * each / base,
            }
        )
    return rows
