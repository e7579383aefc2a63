"""Time saved and error added by each way of skipping work, switched on and off alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.lab.bench.report import ResultTable, Row
from featherfx.shot.frames import Frame
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.options.options import CHOSEN
from featherfx.shot.partition.partition import share_numbers
from featherfx.shot.patterns import part_of
from featherfx.shot.types import Detail, LevelOfDetail, Motion, Shot

Change = Callable[[Shot], Shot]

# feathers of a shot that are simulated first, so that kernels are compiled
_WARMING = 16
# the most coefficients that the solver chooses by itself
_MAX_COEFFICIENTS = 4
# fewer feathers are no plumage whose feathers could follow each other
_GUIDABLE = 8

_NOTE = """\
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
    return ResultTable("skips", "Skipped work", _NOTE, rows)


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
