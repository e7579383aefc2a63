"""What skipping work saves on shots, and what it costs: each switch alone, on and off."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.lab.bench.tables import Row, Table
from featherfx.shot.detail import CHOSEN_BY_SOLVER
from featherfx.shot.simulate import Simulation, simulate
from featherfx.shot.types import Detail, Motion, Shot

Array = NDArray[np.float64]
Change = Callable[[Shot], Shot]

# the most coefficients that the solver chooses by itself
MOST_COEFFICIENTS = 4
# s, how long feathers are held still or fly straight on
SCENE = 6.0
# of the tolerance, so small that every sub-step is the shortest allowed
TIGHT = 1e-3

NOTE = """\
Each line switches one skip on and compares with the same shot without it, everything else as in
the file. Seconds are processor times of one thread, without the first frame, in which the feathers
settle; the error is the largest distance of any point at any frame, as a share of its feather's
length. Sleeping and coasting have no occasion in shots in which something always moves, so they are
measured on their feathers, held still in still air or flying straight on in vacuum for six seconds.
`coarse`, `rachis` and `rigid` are for feathers that are far or small; here all are."""


class Skip(NamedTuple):
    """One switch. on, off: the shot with it and without it. fits: shots on which it is tried.
    scene: what is made of the shot before; its name is added to the shot's."""

    name: str
    on: Change
    off: Change
    fits: Callable[[Shot], bool]
    scene: tuple[str, Change] | None = None


class _Run(NamedTuple):
    """seconds: of processor. points: per frame and feather (n, P, 3)."""

    seconds: float
    points: list[tuple[Array, ...]]
    simulation: Simulation


def _quality(**values: Any) -> Change:
    return lambda shot: replace(shot, quality=replace(shot.quality, **values))


def _level(level: str) -> Change:
    return lambda shot: replace(shot, details=(*shot.details, Detail("*", level)))


def _same(shot: Shot) -> Shot:
    return shot


def _tight(shot: Shot) -> Shot:
    return _quality(tolerance=TIGHT * shot.quality.tolerance)(shot)


def _still(shot: Shot) -> Shot:
    """Nothing moves, in still air, for some seconds."""
    wind = replace(shot.wind, speed=0.0, gust=0.0)
    free = replace(shot, grips=(), forces=(), skin=None, wind_source=None)
    last = shot.first_frame + round(SCENE * shot.frames_per_second)
    return replace(free, motion=Motion("hold", {}), wind=wind, last_frame=last)


def _cruising(shot: Shot) -> Shot:
    """The whole groom flies straight on at 10 m/s in vacuum, after a start of a second."""
    still, start = _still(shot), 1.0
    times = np.linspace(0.0, SCENE, 121)
    way = np.where(times < start, 5.0 * times**2 / start, 10.0 * (times - 0.5 * start))
    keys = [
        {"time": float(t), "joint": "", "position": (float(x), 0.0, 0.0)}
        for t, x in zip(times, way, strict=True)
    ]
    motion = Motion("keys", {"keyframes": keys})
    return replace(still, motion=motion, wind=replace(still.wind, air_density=0.0))


def _always(shot: Shot) -> bool:
    return True


def _not_pulled(shot: Shot) -> bool:
    return not shot.grips and not shot.forces


SKIPS = (
    Skip(
        "feathers at rest sleep",
        lambda shot: replace(shot, sleep=True),
        lambda shot: replace(shot, sleep=False),
        _always,
        ("held still", _still),
    ),
    Skip(
        "feathers on even roots coast",
        lambda shot: replace(shot, coast=True),
        lambda shot: replace(shot, coast=False),
        _always,
        ("flying straight on", _cruising),
    ),
    Skip(
        "coefficients chosen, not 4",
        _quality(coefficients=CHOSEN_BY_SOLVER),
        _quality(coefficients=MOST_COEFFICIENTS),
        _always,
    ),
    Skip(
        "rows chosen, not all",
        _quality(simulated_rows=CHOSEN_BY_SOLVER),
        _quality(simulated_rows=0),
        _always,
    ),
    Skip("sub-steps chosen, not the shortest", _same, _tight, _always),
    Skip("detail coarse", _level("coarse"), _level("full"), _always),
    Skip("detail rachis", _level("rachis"), _level("full"), _always),
    Skip("detail rigid", _level("rigid"), _level("full"), _not_pulled),
)


def skips_table(shots: Sequence[Shot], progress: Callable[[int, int], None]) -> Table:
    """Every skip on every shot that it fits. progress: called with the lines done and all."""
    pairs = [(shot, skip) for shot in shots for skip in SKIPS if skip.fits(shot)]
    rows: list[Row] = []
    for shot, skip in pairs:
        rows.append(_measured(shot, skip))
        progress(len(rows), len(pairs))
    return Table("skips", "Skipped work", NOTE, rows)


def _measured(shot: Shot, skip: Skip) -> Row:
    name = shot.name
    if skip.scene is not None:
        name, shot = f"{name}, {skip.scene[0]}", skip.scene[1](shot)
    without, with_skip = _run(skip.off(shot)), _run(skip.on(shot))
    grids = sorted({(r.rows, r.columns, r.coefficients) for r in with_skip.simulation.resolutions})
    return {
        "shot": name,
        "skip": skip.name,
        "grids": ", ".join("x".join(str(n) for n in grid) for grid in grids),
        "seconds without": without.seconds,
        "seconds with": with_skip.seconds,
        "time saved %": 100.0 * (1.0 - with_skip.seconds / max(without.seconds, 1e-9)),
        "error added %": 100.0 * _error(shot, without.points, with_skip.points),
        "skipped feather frames": sum(with_skip.simulation.report["skipped"].values()),
    }


def _run(shot: Shot) -> _Run:
    """The shot on one thread, after its first two frames have compiled what they need."""
    list(simulate(shot, frames=(shot.first_frame, min(shot.first_frame + 1, shot.last_frame))))
    simulation = simulate(shot)
    frames = iter(simulation)
    points = [next(frames).points]
    begin = time.process_time()
    points += [frame.points for frame in frames]
    return _Run(time.process_time() - begin, points, simulation)


def _error(
    shot: Shot, first: Iterable[tuple[Array, ...]], second: Iterable[tuple[Array, ...]]
) -> float:
    """Largest distance of any point over its feather's length, directors left out."""
    worst = 0.0
    for one, other in zip(first, second, strict=True):
        for placement, a, b in zip(shot.groom.feathers, one, other, strict=True):
            way = np.delete(a - b, (1, 2), axis=1)
            worst = max(worst, float(np.linalg.norm(way, axis=2).max()) / placement.kind.length)
    return worst
