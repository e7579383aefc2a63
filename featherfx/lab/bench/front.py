"""Error against work, by what is resolved: rows, columns, coefficients and steps, each alone.

On every scene one of them is varied while the others stay, and compared with the finest of its
kind: what it alone misses. Errors of rows, columns and coefficients come with the deflections that
the loads were estimated to cause, those of steps with the tolerance. featherfx/shot/detail/promise
chooses what is simulated of a feather from these figures.

And whether shots keep the error that is promised, measured against fine references.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from time import process_time
from typing import Any, NamedTuple

import numpy as np

from featherfx.feather.density import farthest
from featherfx.feather.shapes import feathers_of
from featherfx.feather.types import Feather, RowPoints, stacked
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.lab.bench.scenes import scene
from featherfx.lab.bench.skips import share_of
from featherfx.shot.detail.detail import deflections, load_estimate
from featherfx.shot.detail.estimate import bends
from featherfx.shot.detail.promise import front
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.simulate import simulate
from featherfx.shot.types import Quality, Shot

ROWS = (6, 8, 11, 15, 21, 29, 57)
COLUMNS = (2, 3, 4, 6, 12)
COEFFICIENTS = (1, 2, 3, 4)
FINEST = {"rows": ROWS[-1], "columns": COLUMNS[-1], "coefficients": COEFFICIENTS[-1]}
# of the feather's length
TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-6)


@dataclass(frozen=True)
class Setting:
    """What is simulated of every feather. tolerance: of the feather's length."""

    rows: int = 11
    columns: int = 4
    coefficients: int = 2
    tolerance: float = 1e-4
    radius: float = 0.8


def sweeps() -> Iterator[tuple[str, list[Setting]]]:
    """What is varied, and its settings, the finest last; steps are those of the presets' radius."""
    yield "rows", [Setting(rows=n, columns=3) for n in ROWS]
    yield "columns", [Setting(columns=m) for m in COLUMNS]
    yield "coefficients", [Setting(columns=6, coefficients=c) for c in COEFFICIENTS]
    yield "tolerance", [Setting(tolerance=t, radius=0.5) for t in TOLERANCES]


class FrontRun(NamedTuple):
    """By number, feathers as they are simulated in full, and their points at every frame. seconds:
    of processor, all but the first frame. report: of the simulation."""

    feathers: dict[int, Feather]
    points: dict[int, list[RowPoints]]
    seconds: float
    report: dict[str, Any]


def run(shot: Shot) -> FrontRun:
    """A shot on one thread."""
    simulation, begin = simulate(shot), 0.0
    feathers: dict[int, Feather] = {}
    points: dict[int, list[RowPoints]] = {}
    for _ in simulation:
        begin = begin or process_time()
        for f, (feather, now) in simulation.simulated().items():
            feathers[f] = feather
            points.setdefault(f, []).append(RowPoints(now.nodes.copy(), now.directors.copy()))
    return FrontRun(feathers, points, process_time() - begin, simulation.report)


def at(shot: Shot, setting: Setting) -> Shot:
    """A shot of which all feathers are simulated alike; tolerances are of the median length."""
    length = float(np.median([p.kind.length for p in shot.groom.feathers]))
    quality = Quality(
        name="front",
        rows=setting.rows,
        columns=setting.columns,
        coefficients=setting.coefficients,
        tolerance=setting.tolerance * length,
        max_substeps=4096,
        radius=setting.radius,
    )
    return replace(shot, quality=quality)


def errors(one: FrontRun, reference: FrontRun) -> list[float]:
    """Per feather the largest distance of any point that one run simulates, at any frame, from
    where the reference has it, over the feather's length."""
    return [
        farthest(own, reference.feathers[f], one.points[f], reference.points[f])
        / float(own.station[-1])
        for f, own in one.feathers.items()
    ]


def estimated_deflections(shot: Shot) -> list[tuple[float, float]]:
    """Per feather, how far loads are estimated to bend shaft and barbs, of the feather's length."""
    loads = load_estimate(replace(shot, quality=shot.quality.with_error(1.0)), root_motion(shot))
    assert loads is not None
    found = deflections(shot, feathers_of(shot.groom.feathers, 21, 6), loads)
    lengths = [p.kind.length for p in shot.groom.feathers]
    return [(a / size, b / size) for (a, b), size in zip(found, lengths, strict=True)]


def bent(ran: FrontRun) -> list[tuple[float, float]]:
    """Per feather, how far shaft and barbs did bend, of the feather's length."""
    found = []
    for f, feather in ran.feathers.items():
        rest = stacked([feather.rest] * len(ran.points[f]))
        shaft, barb = (float(each.max()) for each in bends(rest, stacked(ran.points[f])))
        found.append((shaft / feather.station[-1], barb / feather.station[-1]))
    return found


def measure(name: str, only: str = "*") -> list[Row]:
    """A row for each feather and setting of a scene. only: names of what is varied (*, ?)."""
    rows: list[Row] = []
    shot = scene(name)
    estimated = estimated_deflections(shot)
    run(at(shot, Setting(tolerance=1e-2)))  # compiles
    for varied, settings in sweeps():
        if not fnmatch(varied, only):
            continue
        runs = [run(at(shot, setting)) for setting in settings]
        real = bent(runs[-1])
        for setting, each in zip(settings[:-1], runs[:-1], strict=True):
            found = errors(each, runs[-1])
            parts = zip(shot.groom.feathers, found, estimated, real, strict=True)
            for p, error, (shaft, barb), (shaft_bent, barb_bent) in parts:
                rows.append(
                    {
                        "scene": name,
                        "feather": p.id,
                        "length": p.kind.length,
                        "varied": varied,
                        **vars(setting),
                        "shaft": shaft,
                        "barb": barb,
                        "shaft bent": shaft_bent,
                        "barb bent": barb_bent,
                        "substeps": each.report["substeps"]["mean"],
                        "error": error,
                        "seconds": each.seconds,
                    }
                )
    return rows


HOW = (
    "Written by featherfx bench --front. On every scene of featherfx/lab/bench/scenes.py rows,"
    " columns, coefficients and the tolerance of steps are varied alone and compared with the"
    " finest; error: largest distance of any simulated point at any frame, of the length."
    " factor f and exponent q: nine of ten feathers miss at most f d^q, d the deflection of shaft"
    " (rows) or barbs, before: as estimated from the loads, after: as simulated; of steps, d is the"
    " tolerance over the length. cost: time of a step over the least."
)
# of feathers and scenes, in how many a setting misses no more than is written
HELD = 0.9
LEAST = 1e-5


def missed(rows: Sequence[Row]) -> dict[str, Any]:
    """What featherfx/shot/detail/promise.py chooses and estimates by, of the rows that `measure`
    gives; what they did not vary is left out."""
    found: dict[str, Any] = {}
    for name, bend in (("rows", "shaft"), ("columns", "barb"), ("coefficients", "barb")):
        own = [r for r in rows if r["varied"] == name]
        if not own:
            continue
        found[name] = {
            "cost": _costs(own, name),
            "before": _by_number(own, name, bend),
            "after": _by_number(own, name, f"{bend} bent"),
        }
    own = [r for r in rows if r["varied"] == "tolerance"]
    return found | ({"steps": _by_steps(own)} if own else {})


def _by_number(rows: Sequence[Row], name: str, bend: str) -> dict[str, Any]:
    """exponent q and, by number, factor f of an error f d^q of feathers that bend by d; all of the
    length. The finest, with which the others were compared, misses what these lead on to."""
    numbers = sorted({r[name] for r in rows})
    groups = [[r for r in rows if r[name] == number] for number in numbers]
    bends = [np.log([max(r[bend], LEAST) for r in own]) for own in groups]
    errors = [np.log([max(r["error"], LEAST) for r in own]) for own in groups]
    x, y = (np.concatenate([each - each.mean() for each in values]) for values in (bends, errors))
    exponent = float(np.clip(x @ y / (x @ x), 0.0, 1.0))
    factors = [
        float(np.exp(np.quantile(error - exponent * each, HELD)))
        for each, error in zip(bends, errors, strict=True)
    ]
    factors = np.minimum.accumulate(factors).tolist()
    order = np.log(factors[0] / factors[-1]) / np.log(numbers[-1] / numbers[0])
    finest = FINEST[name]
    factors.append(float(factors[-1] * (numbers[-1] / finest) ** order))
    return {"exponent": exponent, "factor": dict(zip([*numbers, finest], factors, strict=True))}


def _costs(rows: Sequence[Row], name: str) -> dict[int, float]:
    """By number, time of a step over that with the least."""
    numbers = sorted({r[name] for r in rows})
    times = [
        {r["scene"]: r["seconds"] / r["substeps"] for r in rows if r[name] == n} for n in numbers
    ]
    ratios = [np.median([own[scene] / times[0][scene] for scene in own]) for own in times]
    slope = np.log(ratios[-1]) / np.log(numbers[-1] / numbers[0])
    finest = FINEST[name]
    ratios.append(ratios[-1] * (finest / numbers[-1]) ** slope)
    return {n: float(each) for n, each in zip([*numbers, finest], ratios, strict=True)}


def _by_steps(rows: Sequence[Row]) -> dict[str, float]:
    """Factor and exponent of a trajectory's error by the tolerance of steps, both of the length."""
    scenes = {r["scene"] for r in rows}
    median = {s: float(np.median([r["length"] for r in rows if r["scene"] == s])) for s in scenes}
    ratio = np.log([r["tolerance"] * median[r["scene"]] / r["length"] for r in rows])
    error = np.log([max(r["error"], LEAST) for r in rows])
    feathers = np.array([f"{r['scene']}/{r['feather']}" for r in rows])
    each = [np.polyfit(ratio[feathers == f], error[feathers == f], 1)[0] for f in set(feathers)]
    # the middle one: of a vane that snaps errors say nothing of the steps
    exponent = np.median(each)
    factor = np.exp(np.quantile(error - exponent * ratio, HELD))
    return {
        "factor": float(factor),
        "exponent": float(exponent),
        "finest": TOLERANCES[-1],
        "coarsest": TOLERANCES[0],
    }


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
    frames: int | None,
    every: int,
) -> ResultTable:
    """Every shot at every error (percent). frames: of each shot; None: all. every: n-th
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
