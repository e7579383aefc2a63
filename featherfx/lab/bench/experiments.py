"""What `featherfx bench` measures, each as a table. All ratios are of one run on one machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

from featherfx.errors import SimulationError
from featherfx.groom.types import FeatherKind
from featherfx.lab.bench.factorisation import factorisation_seconds
from featherfx.lab.bench.shake import (
    EULER,
    Method,
    Run,
    Shake,
    barb_curvature,
    swan_primary,
    trajectory_error,
)
from featherfx.lab.bench.tables import Row, Table

HERO = Shake(rows=41, columns=10, coefficients=2)
PRODUCTION = Shake(rows=21, columns=6, coefficients=2)
# methods that the comparison runs; another kinematics joins here under its name
METHODS: dict[str, Method] = {"barb-curvature": barb_curvature}
RATIOS = tuple(10.0**k for k in range(2, 9))
REPEATS = 3


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    rows, coefficients, steps (1/s), radii: of the front. tolerances: share of the length, with
    error control. reference: shake of the reference. batches: feathers at a time. duration: s, of
    the timed runs.
    """

    rows: tuple[int, ...]
    coefficients: tuple[int, ...]
    steps: tuple[int, ...]
    radii: tuple[float, ...]
    tolerances: tuple[float, ...]
    reference: Shake
    batches: tuple[int, ...]
    duration: float


QUICK = Extent(
    rows=(6, 11, 21),
    coefficients=(1, 2),
    steps=(24, 96),
    radii=(0.0, 0.5, EULER),
    tolerances=(1e-2, 1e-3),
    reference=Shake(rows=81, columns=6, coefficients=3, step=1.0 / 768.0, radius=0.8),
    batches=(1, 10, 100),
    duration=0.25,
)
FULL = Extent(
    rows=(6, 11, 21, 41),
    coefficients=(0, 1, 2, 3, 4),
    steps=(24, 48, 96, 192, 384),
    radii=(0.0, 0.5, 0.8, EULER),
    tolerances=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4),
    reference=Shake(rows=161, columns=10, coefficients=4, step=1.0 / 6144.0, radius=0.8),
    batches=(1, 10, 100, 1000),
    duration=0.5,
)


def all_tables(extent: Extent, jobs: int) -> Iterator[Table]:
    """Every table, one after another, so that progress can be shown. jobs: of the thread test."""
    kind = swan_primary()
    for method in METHODS.values():
        method(kind, replace(PRODUCTION, duration=1.0 / 24.0))  # compiles before anything is timed
    yield steps_table(kind, extent)
    yield stiffness_table(kind, extent)
    yield front_table(kind, extent)
    yield threads_table(kind, extent, jobs)
    yield batches_table(kind, extent)
    yield rows_table(kind, extent)


def fastest(method: Method, kind: FeatherKind, shake: Shake, repeats: int = REPEATS) -> Run:
    """The fastest of several equal runs: what the machine does when nobody disturbs it."""
    return min((method(kind, shake) for _ in range(repeats)), key=lambda run: run.seconds)


def steps_table(kind: FeatherKind, extent: Extent) -> Table:
    """Hero and production feather at three steps, against the factorisation."""
    rows: list[Row] = []
    for name, method in METHODS.items():
        for title, shake in (("hero", HERO), ("production", PRODUCTION)):
            for rate in (24, 96, 384):
                timed = replace(shake, step=1.0 / rate, duration=extent.duration)
                yardstick = factorisation_seconds()
                run = fastest(method, kind, timed)
                rows.append(
                    {
                        "method": name,
                        "feather": title,
                        "unknowns": run.unknowns,
                        "steps per s": rate,
                        "iterations a step": run.step_iterations,
                        "ms a step": 1e3 * run.step_seconds,
                        "ms of dpbtrf": 1e3 * yardstick,
                        "ratio": run.step_seconds / yardstick,
                        "times real time": timed.duration / run.seconds,
                    }
                )
    note = (
        "Hero: 41 rows, 10 columns a side. Production: 21 rows, 6 columns. Two coefficients, a"
        " 3 Hz and 5 cm shake, Newton to 1e-6 m, no error control. dpbtrf: LAPACK's banded Cholesky"
        " of the nodal hero's matrix (2,583 unknowns, half-bandwidth 131), one thread, measured"
        " next to each line. Processor time, best of three runs."
    )
    return Table("steps", "Time of a step", note, rows)


def stiff_kind(kind: FeatherKind, ratio: float) -> FeatherKind:
    """The feather with its barbs bending as those of a given along-to-across modulus ratio."""
    vane = kind.vane_material
    factor = ratio / (vane.along / vane.across)
    stiff = replace(
        vane,
        along=vane.along * factor,
        barb_bending_normal=vane.barb_bending_normal * factor,
        barb_bending_in_plane=vane.barb_bending_in_plane * factor,
    )
    return replace(kind, vane_material=stiff)


def stiffness_table(kind: FeatherKind, extent: Extent) -> Table:
    """Iterations against the stiffness ratio."""
    shake = replace(HERO, duration=extent.duration)
    rows: list[Row] = []
    for name, method in METHODS.items():
        for ratio in RATIOS:
            run = method(stiff_kind(kind, ratio), shake)
            rows.append(
                {
                    "method": name,
                    "ratio of moduli": ratio,
                    "iterations a step": run.step_iterations,
                    "ms a step": 1e3 * run.step_seconds,
                }
            )
    note = (
        "Hero feather at 1/96 s; the barbs' modulus and bending stiffness vary, all else stays."
        " The swan's own ratio is 7,500."
    )
    return Table("stiffness", "Iterations against the stiffness ratio", note, rows)


def front_shakes(extent: Extent) -> Iterator[Shake]:
    """Every setting of the front: fixed steps, then error control."""
    columns = PRODUCTION.columns
    steps = [(1.0 / rate, radius) for rate, radius in product(extent.steps, extent.radii)]
    for rows, coefficients in product(extent.rows, extent.coefficients):
        for step, radius in steps:
            yield Shake(rows, columns, coefficients, step, radius=radius)
    for rows, share in product(extent.rows, extent.tolerances):
        tolerance = share * swan_primary().length
        newton = min(1e-6, 1e-3 * tolerance)
        yield Shake(rows, columns, 2, step=0.0, tolerance=tolerance, newton=newton)


def front_table(kind: FeatherKind, extent: Extent) -> Table:
    """Wall time against the trajectory's error."""
    reference = barb_curvature(kind, extent.reference)
    rows: list[Row] = []
    for name, method in METHODS.items():
        rows += [_front_row(kind, name, method, shake, reference) for shake in front_shakes(extent)]
    finest = extent.reference
    note = (
        "Error: largest distance of any rachis point or vane edge, at any frame of half a second,"
        f" from a reference with {finest.rows} rows, {finest.coefficients} coefficients, steps of"
        f" 1/{round(1.0 / finest.step)} s and radius {finest.radius:g}; share of the feather's"
        " length. Steps per second 0: chosen by the error control to the tolerance (m). Radius -1:"
        " implicit Euler. Runs that could not be solved have the error inf."
    )
    return Table("front", "Run time against error", note, rows)


def _front_row(kind: FeatherKind, name: str, method: Method, shake: Shake, reference: Run) -> Row:
    try:
        run = method(kind, shake)
        error, milliseconds = trajectory_error(run, reference, kind.length), 1e3 * run.seconds
        iterations, steps = run.step_iterations, run.steps
    except SimulationError:
        error, milliseconds, iterations, steps = float("inf"), float("inf"), 0.0, 0
    return {
        "method": name,
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


def threads_table(kind: FeatherKind, extent: Extent, jobs: int) -> Table:
    """32 feathers on one thread and on several."""
    shake = replace(PRODUCTION, count=32, duration=extent.duration)
    rows: list[Row] = []
    for threads in sorted({1, 2, jobs}):
        run = fastest(barb_curvature, kind, replace(shake, jobs=threads))
        first = rows[0]["ms a frame of 1/96 s"] if rows else 1e3 * run.step_seconds
        rows.append(
            {
                "threads": threads,
                "ms a frame of 1/96 s": 1e3 * run.step_seconds,
                "times one thread": first / (1e3 * run.step_seconds),
            }
        )
    return Table("threads", "Threads", "32 production feathers; best of three runs.", rows)


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
