"""The error of a shot, by simulating a few of its feathers again, each time finer.

The feathers that bend most, those that are longest and those that are pulled are simulated as the
shot says, then in full with twice the rows, twice the columns, more coefficients, and steps of a
smaller tolerance, each alone and all together. A difference is multiplied by what a series of
further doublings would add (4/3 where errors fall with the square of the spacing).

Whether there is such a series is asked in the first frame, where feathers are at rest or flutter:
ends of barbs that flutter on four times the rows may hang still on twice as many, as the waves that
run along the vane are too short for them. Where feathers are farther from there than the series
tells, that is their error.

What is compared are the nodes of the shot's own grid, at every frame. Where feathers touch, those
that are looked at touch colliders and each other (those of one grid), and no others.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.api import Folders, read_quality, read_shot
from featherfx.errors import all_of, warn_input
from featherfx.feather.types import Feather, RowPoints
from featherfx.mechanics.resolution import rachis_deflection
from featherfx.phases import phase
from featherfx.shot.loads import estimate_loads
from featherfx.shot.loop.run import drawn_feathers
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.shot.loop.window_runs import max_distance, nearest_pushing
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import FeatherOptions, resolve_options, simulation_quality
from featherfx.shot.types import Quality, Shot, part_of

# feathers that are looked at by default
_LOOKED_AT = 4
# what a finer simulation has more: intervals of rows and columns, and sub-steps, times as many;
# coefficients, in addition; the tolerance of a step, divided
_FINER, _MORE_COEFFICIENTS, _TIGHTER, _MORE_SUBSTEPS = 2, 2, 16.0, 4
# bounds of the quality's keys
_MAX_ROWS, _MAX_COLUMNS, _MAX_COEFFICIENTS, _MAX_SUBSTEPS = 400, 100, 6, 20_000
_MIN_TOLERANCE = 1e-9
# a share of the length that is no difference
_ROUNDING = 1e-9
_TOTAL = "all"
# options of a feather that the report has
_TOLD = ("level", "rows", "columns", "coefficients", "tolerance")
# what is farther off in the first frame, on a grid that is finer twice over, than the series tells
_AT_FIRST = "rest"
# what is made finer for each part of the error
_PARTS = {name: frozenset((name,)) for name in ("rows", "columns", "coefficients", "time")}
_PARTS[_TOTAL] = frozenset(_PARTS)
# the error is the difference times this, for errors that fall with the square of the spacing, and
# with the power 2/3 of the tolerance; what coefficients leave after two more is nothing beside it
_HALVED = 1.0 / (1.0 - _FINER**-2.0)
_REST = {
    "rows": _HALVED,
    "columns": _HALVED,
    "coefficients": 1.0,
    "time": 1.0 / (1.0 - _TIGHTER ** (-2.0 / 3.0)),
    _TOTAL: _HALVED,
}


@dataclass(frozen=True)
class ErrorPart:
    """mm: largest error of any node, at any frame. percent: largest of feathers, each of its
    length."""

    mm: float
    percent: float


@dataclass(frozen=True)
class ShotError:
    """error_mm, error_percent: of all together. feather: the worst, by percent. parts: of each
    alone; "detail" is what levels coarser than full cost, "rest" what the first frame shows on four
    times the rows and columns, if that is more than all others together tell. feathers: ids of
    those looked at. resolutions: what is simulated of each. frames: looked at. contact: whether the
    shot has feathers that touch: what those that are not looked at do to the others is left out.
    seconds: that it took."""

    error_mm: float
    error_percent: float
    feather: str
    parts: dict[str, ErrorPart]
    feathers: tuple[str, ...]
    resolutions: tuple[dict[str, Any], ...]
    frames: int
    contact: bool
    seconds: float


def shot_error(shot: Shot, feathers: int = _LOOKED_AT, jobs: int = 1) -> ShotError:
    """The error of a shot, estimated on so many of its feathers.

    jobs: threads. Raises InputError where feathers cannot be built, and SimulationError where one
    cannot be simulated as the shot says or finer; InputWarning where contact is left out.
    """
    begin = time.perf_counter()
    touching, contact = shot.contact is not None, shot.contact
    if touching and feathers < len(shot.groom.feathers):
        text = (
            f"{shot.source}: contact: what feathers that are not looked at do to the others is left"
            " out of the error"
        )
        warn_input(text)
    shot = replace(shot, quality=simulation_quality(shot), contact=None)
    if contact is None:
        chosen = chosen_feathers(shot, feathers)
    else:
        chosen = _with_neighbours(replace(shot, contact=contact), feathers)
    alone = part_of(shot, chosen)
    part = replace(alone, contact=contact)
    with phase("comparing", 3 + len(_PARTS)) as done:
        simulation = simulate(shot, jobs, wanted=chosen.tolist())
        shown = _Run(simulation.feathers, _by_feather(simulation))
        done(1)
        grids = own_grids(shot, simulation.options, chosen)
        # what follows or is rigid is compared with itself simulated
        plain = _simulated(part, grids, frozenset(), jobs)
        bare = _simulated(alone, grids, frozenset(), jobs) if touching else plain
        found = {"detail": _ways(bare, shown)}
        done(2)
        for number, (name, finer) in enumerate(_PARTS.items(), 3):
            fine = _simulated(part, grids, finer, jobs)
            coarse = shown if name == _TOTAL and not touching else plain
            found[name] = _REST[name] * _ways(fine, coarse)
            done(number)
        at_first = _ways_at_first(alone, grids, jobs)
        done(number + 1)
    total = found.pop(_TOTAL) + (found["detail"] if touching else 0.0)
    if (at_first > total).any():
        found[_AT_FIRST], total = at_first, np.maximum(at_first, total)
    lengths = np.array([each.kind.length for each in part.groom.feathers])
    if (found["detail"] < _ROUNDING * lengths).all():
        found.pop("detail")
    ids = tuple(each.id for each in part.groom.feathers)
    parts = {
        name: ErrorPart(1e3 * float(ways.max()), 100.0 * float((ways / lengths).max()))
        for name, ways in found.items()
    }
    return ShotError(
        error_mm=1e3 * float(total.max()),
        error_percent=100.0 * float((total / lengths).max()),
        feather=ids[int(np.argmax(total / lengths))],
        parts=parts,
        feathers=ids,
        resolutions=tuple(
            {name: getattr(each, name) for name in _TOLD} for each in simulation.options
        ),
        frames=shot.last_frame - shot.first_frame + 1,
        contact=touching,
        seconds=time.perf_counter() - begin,
    )


def error_of(
    path: str | Path,
    *,
    quality: str | None = None,
    feathers: int = _LOOKED_AT,
    jobs: int = 1,
    preset_folders: Folders = (),
) -> ShotError:
    """shot_error of a shot's file. quality: preset instead of the shot's."""
    folders = tuple(preset_folders)
    shot, chosen = all_of(
        lambda: read_shot(path, folders),
        lambda: read_quality(quality, folders) if quality else None,
    )
    return shot_error(replace(shot, quality=chosen) if chosen else shot, feathers, jobs)


def chosen_feathers(shot: Shot, count: int) -> Indices:
    """Numbers, ascending, of feathers that are pulled, bend most, bend most for their length, or
    are longest; of each in turn."""
    placements = shot.groom.feathers
    loads = estimate_loads(shot, root_motion(shot))
    lengths = np.array([each.kind.length for each in placements])
    sag = np.array(
        [
            rachis_deflection(feather, each.kind, loads.acceleration[f], loads.pressure[f])
            for f, (feather, each) in enumerate(zip(drawn_feathers(shot), placements, strict=True))
        ]
    )
    pulled = {each.feather for each in shot.grips} | {each.feather for each in shot.forces}
    orders: list[list[int]] = [[f for f, each in enumerate(placements) if each.id in pulled]]
    values: tuple[Array, ...] = (sag, sag / lengths, lengths)
    orders += [np.argsort(-each, kind="stable").tolist() for each in values]
    ranked = [order[k] for k in range(len(placements)) for order in orders if k < len(order)]
    return np.sort(np.array(list(dict.fromkeys(ranked))[:count], dtype=np.int64))


def _with_neighbours(shot: Shot, count: int) -> Indices:
    """Numbers, ascending, of so many feathers: half of them chosen, the others near these."""
    options = resolve_options(shot, drawn_feathers(shot), root_motion(shot)).feathers
    found = chosen_feathers(shot, (count + 1) // 2).tolist()
    found += [g for f in found for g in nearest_pushing(shot, options, f).tolist()]
    return np.sort(np.array(list(dict.fromkeys(found))[:count], dtype=np.int64))


def own_grids(
    shot: Shot, options: Sequence[FeatherOptions], chosen: Indices
) -> list[FeatherOptions]:
    """Return the options of every chosen feather, for followers as if they were simulated."""
    full = resolve_options(shot, drawn_feathers(shot), root_motion(shot)).full
    return [
        each if each.is_simulated else full[f]
        for f, each in zip(chosen.tolist(), options, strict=True)
    ]


class _Run(NamedTuple):
    """feathers: as they are given. points: of each, frame by frame."""

    feathers: Sequence[Feather]
    points: list[list[RowPoints]]


def _by_feather(simulation: Simulation) -> list[list[RowPoints]]:
    frames = [[pose.points for pose in frame.poses] for frame in simulation]
    return [list(each) for each in zip(*frames, strict=True)]


def _simulated(
    part: Shot, grids: Sequence[FeatherOptions], finer: frozenset[str], jobs: int
) -> _Run:
    """The feathers of a part of a shot in full on their own grids, finer in what is named."""
    feathers: dict[int, Feather] = {}
    points: dict[int, list[RowPoints]] = {}
    for grid in dict.fromkeys(grids):
        members = np.array([f for f, each in enumerate(grids) if each == grid])
        same = replace(
            part_of(part, members),
            quality=finer_quality(part.quality, grid, finer),
            details=(),
            level_of_detail=None,
        )
        simulation = simulate(same, jobs)
        feathers |= dict(zip(members.tolist(), simulation.feathers, strict=True))
        points |= dict(zip(members.tolist(), _by_feather(simulation), strict=True))
    order = range(len(grids))
    return _Run([feathers[f] for f in order], [points[f] for f in order])


def _ways_at_first(alone: Shot, grids: Sequence[FeatherOptions], jobs: int) -> Array:
    """(F,) m, largest distance of the nodes of feathers in the first frame from where they are on
    four times the rows and columns; both come to rest in it, however they got there in the shot."""
    first = replace(alone, last_frame=alone.first_frame, preroll=0)
    finer = [
        finer_quality(alone.quality, grid, _PARTS["rows"] | _PARTS["columns"]) for grid in grids
    ]
    twice = [
        replace(grid, rows=each.rows, columns=each.columns)
        for grid, each in zip(grids, finer, strict=True)
    ]
    space = _PARTS[_TOTAL] - _PARTS["time"]
    fine = _simulated(first, twice, space, jobs)
    return _ways(fine, _simulated(first, grids, frozenset(), jobs))


def finer_quality(quality: Quality, grid: FeatherOptions, finer: frozenset[str]) -> Quality:
    """The quality that simulates every feather in full on a grid, finer in rows, columns,
    coefficients or time."""
    rows, columns, count = grid.rows, grid.columns, grid.coefficients
    tolerance, substeps = grid.tolerance, quality.max_substeps
    if "rows" in finer:
        rows = min(_FINER * (rows - 1) + 1, _MAX_ROWS)
    if "columns" in finer:
        columns = min(_FINER * columns, _MAX_COLUMNS)
    if "coefficients" in finer:
        count = min(count + _MORE_COEFFICIENTS, _MAX_COEFFICIENTS)
    if "time" in finer:
        tolerance = max(tolerance / _TIGHTER, _MIN_TOLERANCE)
        substeps = min(_MORE_SUBSTEPS * substeps, _MAX_SUBSTEPS)
    return quality.on_grid(rows, columns, count, tolerance=tolerance, max_substeps=substeps)


def _ways(fine: _Run, coarse: _Run) -> Array:
    """(F,) m, largest distance of the nodes of a coarse run from where a fine one has them."""
    pairs = zip(coarse.feathers, fine.feathers, coarse.points, fine.points, strict=True)
    return np.array([max_distance(*each) for each in pairs])
