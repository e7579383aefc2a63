"""Time saved and error added by each way of skipping work, and work against error of whole birds.

Each way is switched on and off alone. Birds are baked at each quality beside a fine reference, each
in its own process.

    error    of every feather the largest distance of any point of its mesh, at any frame, from
             where the reference has it, over the feather's length; told are 99 % of the feathers

The reference is the quality `final` at half of its error, and a quarter of its tolerance where
feathers touch. All write meshes of one grid, so that their points can be compared.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

import featherfx
from featherfx.algebra.types import Array, Indices
from featherfx.errors import InputError, Problem
from featherfx.groom.keys.preset import Quality
from featherfx.groom.presets.presets import read_quality
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.lab.program import write_swan
from featherfx.shot.contact.partition import share_numbers
from featherfx.shot.frames import Frame
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.options import CHOSEN
from featherfx.shot.patterns import Detail
from featherfx.shot.types import LevelOfDetail, Motion, Shot, part_of

_SAMPLES = Path(featherfx.__file__).parent.parent / "samples"
_GRID = {"render_rows": 9, "render_columns": 2}
# finer than `final` by
_FINER_ERROR, _FINER_CONTACT = 2.0, 4.0
_SWAN = "swan layered"
# names of scenes: shots below the samples, None: made here
SCENES = {
    "pigeon in contact": "pigeon/contact.toml",
    _SWAN: None,
    "owl in flight": "owl_flight/shot.toml",
}
_NOTE = """\
Each line bakes a bird in a process of its own, kernels compiled before. `error` is the percent of
their length within which 99 % of the feathers are of a reference, at all of their points and
frames. Of scenes that are cut short only feathers around the longest are baked.
"""


@dataclass(frozen=True)
class BirdExtent:
    """Extent of a run. frames: of each scene. feathers: of each, around one place; None: all.
    qualities: names of presets, or errors in percent. swan: feathers of the swan."""

    frames: int
    feathers: int | None
    qualities: Sequence[str | float]
    swan: int


QUICK_BIRDS = BirdExtent(4, 40, ("draft", "preview"), 600)
FULL_BIRDS = BirdExtent(24, None, ("draft", "preview", "final", 2.0, 1.0), 25_000)


def measure_birds(extent: BirdExtent, progress: Callable[[int, int], None]) -> list[Row]:
    """Bake each scene at each quality and at the reference; return a row for each.

    Raises InputError where the samples are not there.
    """
    for shot in filter(None, SCENES.values()):
        if not (_SAMPLES / shot).is_file():
            told = "is missing. Run it in a checkout, which holds the samples"
            raise InputError(Problem(str(_SAMPLES / shot), "", told))
    rows: list[Row] = []
    total = len(SCENES) * len(extent.qualities)
    for scene in SCENES:
        for row in _measure_scene(scene, extent):
            rows.append(row)
            progress(len(rows), total)
    return rows


def birds_table(extent: BirdExtent, progress: Callable[[int, int], None]) -> ResultTable:
    """The rows of measure_birds as a table."""
    return ResultTable("birds", "Birds", _NOTE, measure_birds(extent, progress))


def _measure_scene(scene: str, extent: BirdExtent) -> Iterator[Row]:
    with TemporaryDirectory() as name:
        folder = Path(name)
        _alone(_bake_scene, scene, replace(extent, frames=1), "draft", folder / "warm.usdc")
        reference = folder / "reference.usdc"
        _alone(_bake_scene, scene, extent, None, reference)
        for number, quality in enumerate(extent.qualities):
            cache = folder / f"{number}.usdc"
            report = _alone(_bake_scene, scene, extent, quality, cache)
            yield {
                "scene": scene,
                "quality": quality if isinstance(quality, str) else f"{quality:g} %",
                "error": _alone(_error, cache, reference),
                "cpu_seconds": report["processor_seconds"],
                "wall_seconds": report["wall_seconds"],
                "peak_memory_bytes": report["peak_memory_bytes"],
            }


def _alone(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a process of its own, whose memory and time are its own."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(function, *arguments).result()


def _bake_scene(
    scene: str, extent: BirdExtent, quality: str | float | None, output: Path
) -> dict[str, Any]:
    """Bake a scene at a quality, an error in percent, or finely; return the report."""
    shot = _open_scene(scene, extent)
    options: dict[str, Any] = {"jobs": 1, **_GRID}
    if quality is None:
        shot = replace(shot, quality=_reference_quality())
    elif isinstance(quality, str):
        options["quality"] = quality
    else:
        options["error"] = quality
    report = featherfx.bake(shot, output, **options).report
    assert report is not None
    return report


def _reference_quality() -> Quality:
    final = read_quality("final")
    assert final.error is not None
    assert final.contact_tolerance is not None
    return replace(
        final,
        error=final.error / _FINER_ERROR,
        contact_tolerance=final.contact_tolerance / _FINER_CONTACT,
    )


def _open_scene(scene: str, extent: BirdExtent) -> Shot:
    """Read a scene, and cut it to the extent."""
    file = SCENES[scene]
    with TemporaryDirectory() as folder:
        path = write_swan(Path(folder), extent.swan, extent.frames) if file is None else None
        shot = featherfx.read_shot(path or _SAMPLES / str(file))
        last = min(shot.last_frame, shot.first_frame + extent.frames - 1)
        shot = replace(shot, last_frame=last)
        return shot if extent.feathers is None else part_of(shot, _around(shot, extent.feathers))


def _around(shot: Shot, count: int) -> Indices:
    """Numbers of the feathers whose roots are nearest to that of the longest, in order.

    That one is simulated in every scene.
    """
    roots = np.array([each.position for each in shot.groom.feathers])
    longest = int(np.argmax([each.kind.length for each in shot.groom.feathers]))
    away = np.linalg.norm(roots - roots[longest], axis=1)
    return np.sort(np.argsort(away, kind="stable")[:count])


def _error(cache: Path, reference: Path) -> float:
    """Return percent of their length within which 99 % of the feathers are of the reference."""
    one, other = featherfx.open_cache(cache), featherfx.open_cache(reference)
    first, last = other.frames
    worst = []
    for name, exact in other.items():
        own, length = one[name], np.ptp(exact.points(), axis=0).max()
        off = [
            np.linalg.norm(own.points(frame) - exact.points(frame), axis=1).max()
            for frame in range(first, last + 1)
        ]
        worst.append(max(off) / length)
    return 100.0 * float(np.quantile(worst, 0.99))


Change = Callable[[Shot], Shot]

# feathers of a shot that are simulated first, so that kernels are compiled
_WARMING = 16
# the most coefficients that the solver chooses by itself
_MAX_COEFFICIENTS = 4
# fewer feathers are no plumage whose feathers could follow each other
_GUIDABLE = 8

_SKIPS_NOTE = """\
Each line switches one skip on and compares with the same shot without it, everything else as in
the file. Seconds are processor times of one thread, without the first frame, in which the feathers
settle; the error is the largest distance of any point at any frame, as a share of its feather's
length, and the mean that of all points, frames and feathers. Sleeping has no occasion in shots in
which something always moves, so it is measured on their feathers, held still in still air for six
seconds. `coarse`, `rachis` and `rigid` are for feathers that are far or small; here all are.
`guided`: every eighth feather of a region is a guide. Levels by size are those of a picture in
which a feather of mean length is twenty pixels long."""


# s, how long feathers are held still
_SCENE = 6.0


def seen_small(shot: Shot) -> Shot:
    """All feathers are seen so small that one of mean length is twenty pixels long."""
    mean = float(np.mean([p.kind.length for p in shot.groom.feathers]))
    return replace(undecided(shot), level_of_detail=LevelOfDetail(pixels_per_metre=20.0 / mean))


def undecided(shot: Shot) -> Shot:
    """Without the levels that the file gives, which overrule a camera's."""
    return replace(shot, details=())


def still(shot: Shot) -> Shot:
    """Nothing moves, in still air, for some seconds."""
    wind = replace(shot.wind, speed=0.0, gust=0.0)
    free = replace(shot, grips=(), forces=(), skin=None, wind_source=None)
    last = shot.first_frame + round(_SCENE * shot.frames_per_second)
    return replace(free, motion=Motion("hold", {}), wind=wind, last_frame=last)


class Skip(NamedTuple):
    """One switch. on, off: the shot with it and without it. fits: shots on which it is tried.
    scene: what is made of the shot before; its name is added to the shot's."""

    name: str
    on: Change
    off: Change
    fits: Callable[[Shot], bool]
    scene: tuple[str, Change] | None = None


class _Baked(NamedTuple):
    """seconds: of processor. points: per frame and feather (n, 1 + 2 m, 3)."""

    seconds: float
    points: list[tuple[Array, ...]]
    simulation: Simulation


def _quality(**values: Any) -> Change:
    """Numbers, which no error overrules."""
    return lambda shot: replace(shot, quality=replace(shot.quality.pushing, **values))


def _level(level: str) -> Change:
    return lambda shot: replace(shot, details=(*shot.details, Detail(level=level)))


# one object, so that skips that are compared with it share its run
_FULL = _level("full")


def _all_rows(shot: Shot) -> Shot:
    return _quality(simulated_rows=shot.quality.rows)(shot)


def _always(shot: Shot) -> bool:
    return True


def _not_pulled(shot: Shot) -> bool:
    return not shot.grips and not shot.forces


def _untouched(shot: Shot) -> bool:
    return shot.contact is None


def _guidable(shot: Shot) -> bool:
    """Feathers that are many, free and do not touch."""
    return _not_pulled(shot) and _untouched(shot) and len(shot.groom.feathers) > _GUIDABLE


SKIPS = (
    Skip(
        "feathers at rest sleep",
        lambda shot: replace(shot, sleep=True),
        lambda shot: replace(shot, sleep=False),
        _always,
        ("held still", still),
    ),
    Skip(
        "coefficients chosen, not 4",
        _quality(coefficients=CHOSEN),
        _quality(coefficients=_MAX_COEFFICIENTS),
        _always,
    ),
    Skip("rows chosen, not all", _quality(simulated_rows=CHOSEN), _all_rows, _always),
    Skip("detail coarse", _level("coarse"), _FULL, _untouched),
    Skip("detail rachis", _level("rachis"), _FULL, _untouched),
    Skip("detail guided", _level("guided"), _FULL, _guidable),
    Skip("detail rigid", _level("rigid"), _FULL, _not_pulled),
    Skip("levels by size in the image", seen_small, undecided, _guidable),
)


def skips_table(
    shots: Sequence[Shot],
    progress: Callable[[int, int], None],
    only: str = "*",
    frames: int | None = None,
    every: int = 1,
) -> ResultTable:
    """Every skip on every shot that it fits.

    progress: called with the lines done and all. only: pattern of the skips' names, with * and ?.
    frames: of each shot, from its first on; all by default. every: n-th feather of each shot alone.
    """
    shots = [_first(share_of(shot, 1, every), frames) for shot in shots]
    pairs = [
        (shot, skip)
        for shot in shots
        for skip in SKIPS
        if skip.fits(shot) and fnmatchcase(skip.name, only)
    ]
    rows: list[Row] = []
    known: dict[tuple[int, Change], _Baked] = {}
    for shot, skip in pairs:
        rows.append(_measured(shot, skip, known))
        progress(len(rows), len(pairs))
    return ResultTable("skips", "Skipped work", _SKIPS_NOTE, rows)


def share_of(shot: Shot, index: int, count: int) -> Shot:
    """The shot with every count-th feather from the index-th on, index from 1 to count.

    Raises InputError where none would be left.
    """
    return part_of(shot, share_numbers(shot, index, count))


def _first(shot: Shot, frames: int | None) -> Shot:
    if frames is None:
        return shot
    return replace(shot, last_frame=min(shot.last_frame, shot.first_frame + frames - 1))


def _measured(shot: Shot, skip: Skip, known: dict[tuple[int, Change], _Baked]) -> Row:
    """One line. known: runs without a skip, by shot and change, for other skips to compare with."""
    name, key = shot.name, (id(shot), skip.off)
    if skip.scene is not None:
        name, shot = f"{name}, {skip.scene[0]}", skip.scene[1](shot)
        without = _run(skip.off(shot))
    else:
        without = known[key] if key in known else _run(skip.off(shot))
        known[key] = without
    with_skip = _run(skip.on(shot))
    grids = sorted({(r.rows, r.columns, r.coefficients) for r in with_skip.simulation.options})
    worst, mean = _errors(shot, without.points, with_skip.points)
    return {
        "shot": name,
        "skip": skip.name,
        "grids": ", ".join("x".join(str(n) for n in grid) for grid in grids),
        "seconds without": without.seconds,
        "seconds with": with_skip.seconds,
        "time saved %": 100.0 * (1.0 - with_skip.seconds / max(without.seconds, 1e-9)),
        "error added %": 100.0 * worst,
        "mean error %": 100.0 * mean,
        "skipped feather frames": sum(with_skip.simulation.report["skipped"].values()),
    }


def _run(shot: Shot) -> _Baked:
    """The shot on one thread, after two frames of some feathers have compiled what they need."""
    some = share_of(shot, 1, max(1, len(shot.groom.feathers) // _WARMING))
    list(simulate(some, frames=(shot.first_frame, min(shot.first_frame + 1, shot.last_frame))))
    simulation = simulate(shot)
    frames = iter(simulation)
    points = [_nodes(next(frames))]
    begin = time.process_time()
    points += [_nodes(frame) for frame in frames]
    return _Baked(time.process_time() - begin, points, simulation)


def _nodes(frame: Frame) -> tuple[Array, ...]:
    return tuple(pose.points.nodes for pose in frame.poses)


def _errors(
    shot: Shot, first: Iterable[tuple[Array, ...]], second: Iterable[tuple[Array, ...]]
) -> tuple[float, float]:
    """Largest and mean distance of points over their feather's length."""
    worst, means = 0.0, []
    for one, other in zip(first, second, strict=True):
        for placement, a, b in zip(shot.groom.feathers, one, other, strict=True):
            way = np.linalg.norm(a - b, axis=2) / placement.kind.length
            worst = max(worst, float(way.max()))
            means.append(float(way.mean()))
    return worst, float(np.mean(means))
