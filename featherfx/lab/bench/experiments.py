"""Tables of `featherfx bench`. All ratios are of one run on one machine.

The yardstick: one banded Cholesky factorisation by LAPACK, of the size of the nodal matrix.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from statistics import median
from time import process_time, thread_time

import numpy as np
from scipy.linalg.lapack import dpbtrf

from featherfx.errors import SimulationError
from featherfx.groom.types import FeatherKind
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.lab.bench.shake import (
    EULER,
    Method,
    Shake,
    ShakeRun,
    barb_curvature,
    nodal,
    swan_primary,
    trajectory_error,
)

_UNKNOWNS, _HALF_BANDWIDTH = 2583, 131
_FACTORISATIONS = 15
_THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def factorisation_seconds() -> float:
    """Median processor seconds of LAPACK's dpbtrf on the nodal hero's matrix, with one thread.

    Measured in a process of its own: a library that has started its threads keeps them.
    """
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        env={**os.environ, **dict.fromkeys(_THREAD_VARIABLES, "1")},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


def _measured() -> float:
    random = np.random.default_rng(1)
    band = np.asfortranarray(random.uniform(-1.0, 1.0, (_HALF_BANDWIDTH + 1, _UNKNOWNS)))
    band[0] = 4.0 * _HALF_BANDWIDTH  # diagonally dominant, so that it is positive definite
    seconds = []
    for _ in range(_FACTORISATIONS):
        matrix = band.copy(order="F")
        begin = thread_time()
        _, info = dpbtrf(matrix, lower=1, overwrite_ab=1)
        seconds.append(thread_time() - begin)
        if info != 0:
            raise ArithmeticError(f"dpbtrf failed with info = {info}")
    return median(seconds)


if __name__ == "__main__":
    print(_measured())


# methods that are compared on one setting; the slow ones would spend hours on the whole front
_COMPARED: dict[str, Method] = {
    "barb-curvature": barb_curvature,
    "nodal, improved": nodal("improved"),
    "nodal, textbook": nodal("textbook"),
}
_RATIOS = tuple(10.0**k for k in range(2, 9))
# 1/s, fixed steps of the table of steps
_STEP_RATES = (24, 96, 384, 480)
_COST = "ms a simulated second"


def all_tables(extent: Extent, jobs: int) -> Iterator[ResultTable]:
    """Every table, one after another, so that progress can be shown. jobs: of the thread test."""
    kind = swan_primary()
    barb_curvature(kind, replace(PRODUCTION, duration=1.0 / 24.0))  # compiles before all is timed
    reference = barb_curvature(kind, extent.reference)
    yield steps_table(kind, extent, reference)
    yield methods_table(kind, extent)
    yield stiffness_table(kind, extent)
    yield front_table(kind, extent, reference)
    yield threads_table(kind, extent, jobs)
    yield batches_table(kind, extent)
    yield rows_table(kind, extent)


def steps_table(kind: FeatherKind, extent: Extent, reference: ShakeRun) -> ResultTable:
    """Hero and production feather at several steps, against the factorisation."""
    rows: list[Row] = []
    for title, shake in (("hero", HERO), ("production", PRODUCTION)):
        for rate, radius in product(_STEP_RATES, (0.0, 0.8)):
            timed = replace(shake, step=1.0 / rate, duration=extent.duration, radius=radius)
            yardstick = factorisation_seconds()
            run = fastest(barb_curvature, kind, timed)
            rows.append(
                {
                    "feather": title,
                    "unknowns": run.unknowns,
                    "steps per s": rate,
                    "radius": radius,
                    "iterations a step": run.step_iterations,
                    "ms a step": 1e3 * run.step_seconds,
                    "ms of dpbtrf": 1e3 * yardstick,
                    "ratio": run.step_seconds / yardstick,
                    "times real time": timed.duration / run.seconds,
                    "error": trajectory_error(run, reference, kind.length),
                }
            )
    note = (
        "Hero: 41 rows, 10 columns a side. Production: 21 rows, 6 columns. Two coefficients, a"
        " 3 Hz and 5 cm shake, Newton to 1e-6 m, no error control. dpbtrf: LAPACK's banded Cholesky"
        " of the nodal hero's matrix (2,583 unknowns, half-bandwidth 131), one thread, measured"
        " next to each line. Processor time, best of three runs. Radius and error as in the table"
        " of run time against error."
    )
    return ResultTable("steps", "Time of a step", note, rows)


def methods_table(kind: FeatherKind, extent: Extent) -> ResultTable:
    """The hero feather by every method: time, and distance from the first one's trajectory."""
    shake = replace(HERO, duration=extent.duration)
    rows: list[Row] = []
    runs: list[ShakeRun] = []
    for name, method in _COMPARED.items():
        method(kind, replace(shake, duration=shake.step))  # compiles before it is timed
        runs.append(fastest(method, kind, shake))
        rows.append(
            {
                "method": name,
                "unknowns": runs[-1].unknowns,
                "iterations a step": runs[-1].step_iterations,
                "ms a step": 1e3 * runs[-1].step_seconds,
                "times the first": runs[-1].step_seconds / runs[0].step_seconds,
                "distance from the first": trajectory_error(runs[-1], runs[0], kind.length),
            }
        )
    note = (
        "Hero feather at 1/96 s, best of three runs; distance: largest of any followed point, share"
        " of the length."
    )
    return ResultTable("methods", "Methods", note, rows)


def stiff_kind(kind: FeatherKind, ratio: float, varied: str = "barbs") -> FeatherKind:
    """The feather with a given ratio of the vane's moduli along barbs and across them.

    varied: "stretch", the modulus along barbs alone; "vane", those across barbs and in shear;
    "barbs", the modulus along barbs and with it their bending stiffnesses.
    """
    vane = kind.vane_material
    factor = ratio / (vane.modulus_along_barbs / vane.modulus_across_barbs)
    if varied == "vane":
        soft = replace(
            vane,
            modulus_across_barbs=vane.modulus_across_barbs / factor,
            shear_modulus=vane.shear_modulus / factor,
        )
        return replace(kind, vane_material=soft)
    bend = factor if varied == "barbs" else 1.0
    stiff = replace(
        vane,
        modulus_along_barbs=vane.modulus_along_barbs * factor,
        barb_bending_normal=vane.barb_bending_normal * bend,
        barb_bending_in_plane=vane.barb_bending_in_plane * bend,
    )
    return replace(kind, vane_material=stiff)


def stiffness_table(kind: FeatherKind, extent: Extent) -> ResultTable:
    """Iterations against the stiffness ratio."""
    rows: list[Row] = []
    cases = [("barb-curvature", HERO, varied, _RATIOS) for varied in ("stretch", "vane", "barbs")]
    cases.append(("nodal, improved", PRODUCTION, "barbs", _RATIOS[:3]))
    for name, shake, varied, ratios in cases:
        for ratio in ratios:
            feather = stiff_kind(kind, ratio, varied)
            for rate in (96, 24):
                timed = replace(shake, step=1.0 / rate, duration=extent.duration)
                run = _COMPARED[name](feather, timed)
                rows.append(
                    {
                        "method": name,
                        "varied": varied,
                        "ratio of moduli": ratio,
                        "steps per s": rate,
                        "iterations a step": run.step_iterations,
                        "ms a step": 1e3 * run.step_seconds,
                    }
                )
    note = (
        "Hero feather, the nodal method on the production feather. The swan's own ratio of the"
        " moduli along barbs and across them is 7,500. Varied: stretch, the modulus along barbs"
        " alone, which barbs of the barb-curvature method do not have; vane, the moduli across"
        " barbs and in shear; barbs, the modulus along barbs and with it their bending"
        " stiffnesses. All else stays."
    )
    return ResultTable("stiffness", "Iterations against the stiffness ratio", note, rows)


def front_shakes(extent: Extent) -> Iterator[Shake]:
    """Every setting of the front: fixed steps, then error control."""
    steps = [(1.0 / rate, radius) for rate, radius in product(extent.steps, extent.radii)]
    for (rows, columns), coefficients in product(extent.grids, extent.coefficients):
        for step, radius in steps:
            yield Shake(rows, columns, coefficients, step, radius=radius)
    control = product(extent.grids, extent.tolerances, (0.5, 0.8))
    for (rows, columns), ratio, radius in control:
        tolerance = ratio * swan_primary().length
        newton = min(1e-6, 1e-3 * tolerance)
        yield Shake(rows, columns, 2, 0.0, tolerance, radius, newton)


def front_table(kind: FeatherKind, extent: Extent, reference: ShakeRun) -> ResultTable:
    """Time against the trajectory's error."""
    rows = [_front_row(kind, shake, reference) for shake in front_shakes(extent)]
    finest = extent.reference
    note = (
        "Error: largest distance of any rachis point or vane edge, at any frame of half a second,"
        f" from a reference with {finest.rows} rows, {finest.coefficients} coefficients, steps of"
        f" 1/{round(1.0 / finest.step)} s and radius {finest.radius:g}; share of the feather's"
        " length. Steps per second 0: chosen by the error control to the tolerance (m). Radius -1:"
        " implicit Euler. Runs that could not be solved have the error inf."
    )
    return ResultTable("front", "Run time against error", note, rows)


def _front_row(kind: FeatherKind, shake: Shake, reference: ShakeRun) -> Row:
    try:
        run = barb_curvature(kind, shake)
        error, milliseconds = trajectory_error(run, reference, kind.length), 1e3 * run.seconds
        iterations, steps = run.step_iterations, run.steps
    except SimulationError:
        error, milliseconds, iterations, steps = float("inf"), float("inf"), 0.0, 0
    return {
        "method": "barb-curvature",
        "rows": shake.rows,
        "columns": shake.columns,
        "coefficients": shake.coefficients,
        "steps per s": round(1.0 / shake.step) if shake.step else 0,
        "tolerance": 0.0 if shake.step else shake.tolerance,
        "radius": shake.radius,
        "error": error,
        "ms a simulated second": milliseconds / shake.duration,
        "steps": steps,
        "iterations a step": iterations,
    }


HERO = Shake(rows=41, columns=10, coefficients=2)
PRODUCTION = Shake(rows=21, columns=6, coefficients=2)


@dataclass(frozen=True)
class Extent:
    """Amount to measure.

    grids (rows, columns), coefficients, steps (1/s), radii: of the front. tolerances: share of the
    length, with error control. reference: shake of the reference. batches: feathers at a time.
    duration: s, of the timed runs.
    """

    grids: tuple[tuple[int, int], ...]
    coefficients: tuple[int, ...]
    steps: tuple[int, ...]
    radii: tuple[float, ...]
    tolerances: tuple[float, ...]
    reference: Shake
    batches: tuple[int, ...]
    duration: float


QUICK_EXTENT = Extent(
    grids=((11, 4), (21, 6)),
    coefficients=(1, 2),
    steps=(24, 96, 384),
    radii=(0.0, 0.8, EULER),
    tolerances=(1e-2, 1e-3),
    reference=Shake(rows=81, columns=6, coefficients=3, step=1.0 / 1536.0, radius=0.8),
    batches=(1, 10, 100),
    duration=0.25,
)
FULL_EXTENT = Extent(
    grids=((6, 4), (11, 4), (21, 6), (41, 10)),
    coefficients=(0, 1, 2, 3),
    steps=(24, 96, 384),
    radii=(0.0, 0.5, 0.8, EULER),
    tolerances=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4),
    reference=Shake(rows=161, columns=10, coefficients=3, step=1.0 / 3072.0, radius=0.8),
    batches=(1, 10, 100, 1000),
    duration=0.5,
)


_REPEATS = 3


def fastest(method: Method, kind: FeatherKind, shake: Shake) -> ShakeRun:
    """The fastest of several equal runs: what the machine does when nobody disturbs it."""
    return min((method(kind, shake) for _ in range(_REPEATS)), key=lambda run: run.seconds)


def threads_table(kind: FeatherKind, extent: Extent, jobs: int) -> ResultTable:
    """32 feathers on one thread and on several."""
    shake = replace(PRODUCTION, count=32, duration=extent.duration)
    rows: list[Row] = []
    for threads in sorted({1, 2, jobs}):
        begin = process_time()
        run = fastest(barb_curvature, kind, replace(shake, jobs=threads))
        processor = (process_time() - begin) / (_REPEATS * run.steps)
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
    return ResultTable("threads", "Threads", note, rows)


def batches_table(kind: FeatherKind, extent: Extent) -> ResultTable:
    """Time per feather against their number."""
    rows = _scaling(
        extent.batches,
        lambda count: replace(PRODUCTION, count=count, duration=8.0 / 96.0),
        kind,
        "feathers",
    )
    note = "Production feathers on one thread, eight steps of 1/96 s; time of a step per feather."
    return ResultTable("batches", "Time per feather", note, rows)


def rows_table(kind: FeatherKind, extent: Extent) -> ResultTable:
    """Cost against the number of rows."""
    rows = _scaling(
        (11, 21, 41, 81, 161),
        lambda count: replace(PRODUCTION, rows=count, duration=8.0 / 96.0),
        kind,
        "rows",
    )
    note = "Six columns, two coefficients, eight steps of 1/96 s; time of an iteration per row."
    return ResultTable("rows", "Cost against rows", note, rows)


def _scaling(
    counts: tuple[int, ...], shake: Callable[[int], Shake], kind: FeatherKind, unit: str
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
