"""Feathers simulated over a window of a shot, and how far finer settings lead elsewhere.

A window begins at rest under the loads of its first sample. Finer in space has twice the columns
and intervals of rows and one coefficient more; finer in time has a tenth of the tolerance.

The error of feathers that push each other, measured on patches of a shot.

A patch is a feather that loads bend most of its kind, and its nearest neighbours on the same grid.
It is simulated in contact where the shot begins, settling included, as the shot says, and finer:

    e = e_space + e_time,     e_space = 4/3 |x - x_s|,     e_time = 5/4 |x - x_t|

with the distances and finer settings of window_runs.py. Where a tenth of the tolerance leads
elsewhere, and a hundredth is no nearer to it, feathers have no unique answer.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.errors import SimulationError
from featherfx.feather.density import density_map
from featherfx.feather.shapes import carry_points
from featherfx.feather.types import Feather, RowPoints
from featherfx.files.disk_cache import digest, kept, nothing_kept, shot_settings
from featherfx.groom.keys.preset import Quality
from featherfx.shot.loads import estimate_deflections, estimate_loads
from featherfx.shot.loop.run import drawn_feathers, report_errors
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.motion.motion import root_motion
from featherfx.shot.options import (
    MAX_COEFFICIENTS,
    SPACE,
    SPACE_NUMBERS,
    TIME,
    FeatherOptions,
    given_grid,
    resolve_options,
)
from featherfx.shot.roots import NO_RUN_UP, Roots
from featherfx.shot.types import Shot, may_touch, part_of

# the error over the difference from what is finer: of second order, and of the power 0.7
REST_RATIOS = {"space": 4.0 / 3.0, "time": 5.0 / 4.0}
# what is finer: columns and intervals of rows, coefficients, tolerance
_FINER_RATIO, _MORE_COEFFICIENTS, TIGHTER_RATIO = 2, 1, 10.0
# least fall of an error from level to level, that shows that finer settings come nearer
MIN_FALL = 0.7
# s, of each window
WINDOW = 0.17
# m, a tolerance that binds no feather, and the least of a quality
_LARGEST, _MIN_TOLERANCE = 0.1, 1e-9

# of SPACE and TIME, and which of them is finer
Level = tuple[int, int, str]
# (first, last) sample
Window = tuple[int, int]


class WindowRun(NamedTuple):
    """A feather as it was simulated, and its points at every sample of its windows, None where a
    step failed; whether it found no rest at the first."""

    feather: Feather | None
    points: list[RowPoints]
    flutters: bool


FAILED_RUN = WindowRun(None, [], False)


def simulate_window(shot: Shot, window: Window, motion: Roots | None = None) -> list[WindowRun]:
    """Simulate the feathers of a shot in a window that they begin at rest. motion: of the roots,
    None: the shot's own."""
    first, last = (shot.first_frame + each for each in window)
    shot = replace(shot, last_frame=max(shot.last_frame, last))
    simulation = simulate(shot, frames=(first, last), begin=window[0], motion=motion)
    points: list[list[RowPoints]] = [[] for _ in shot.groom.feathers]
    for _ in simulation:
        for f, (_, now) in simulation.simulated().items():
            points[f].append(RowPoints(now.nodes.copy(), now.directors.copy()))
    feathers, fluttering = simulation.simulated(), simulation.fluttering()
    return [WindowRun(feathers[f][0], own, f in fluttering) for f, own in enumerate(points)]


def run_distance(one: WindowRun, other: WindowRun) -> float:
    """Return the largest distance (m) of a feather's nodes from a finer run of it."""
    if one.feather is None or other.feather is None:
        return math.inf
    return max_distance(one.feather, other.feather, one.points, other.points)


def mean_run_distance(one: WindowRun, other: WindowRun) -> float:
    """Return the distance (m) of a feather's mean pose and swing from those of a finer run."""
    if one.feather is None or other.feather is None:
        return math.inf
    return mean_distance(one.feather, (one.feather, one.points), (other.feather, other.points))


def quality_at(quality: Quality, level: Level) -> Quality:
    """Return the quality that simulates all feathers at one level; its own numbers overrule it."""
    grid = dict(zip(SPACE_NUMBERS, SPACE[level[0]], strict=True)) | given_grid(quality)
    tolerance, relative = (
        quality.tolerance or _LARGEST,
        1.0 if quality.tolerance else TIME[level[1]],
    )
    found = quality.on_grid(*grid.values(), tolerance=tolerance, relative_tolerance=relative)
    return refine_quality(found, level[2]) if level[2] else found


def refine_quality(quality: Quality, name: str, times: int = 1) -> Quality:
    """Return the quality of one grid finer in "space" or "time", so many times."""
    if name == "time":
        ratio = TIGHTER_RATIO**times
        assert quality.tolerance is not None
        return replace(
            quality,
            tolerance=max(quality.tolerance / ratio, _MIN_TOLERANCE),
            relative_tolerance=quality.relative_tolerance / ratio,
        )
    return replace(
        quality,
        rows=_FINER_RATIO**times * (quality.rows - 1) + 1,
        columns=_FINER_RATIO**times * quality.own_columns,
        coefficients=min(quality.coefficients + times * _MORE_COEFFICIENTS, MAX_COEFFICIENTS),
    )


def carry_all(feather: Feather, grid: Feather, points: Sequence[RowPoints]) -> list[RowPoints]:
    """Carry points of a feather to another grid of it."""
    if feather is grid:
        return list(points)
    to_grid = density_map(feather, grid)
    return [carry_points(to_grid, each) for each in points]


def mean_distance(
    grid: Feather,
    one: tuple[Feather, Sequence[RowPoints]],
    other: tuple[Feather, Sequence[RowPoints]],
) -> float:
    """m, largest distance of the mean poses of two runs of a feather, as seen from its root, or
    difference of their swings, the largest RMS distances of nodes from their means.

    grid: the feather whose nodes count. Poses of either run need no common times.
    """
    nodes = [_seen_from_root(grid, carry_all(feather, grid, own)) for feather, own in (one, other)]
    mean = [each.mean(axis=0) for each in nodes]
    swing = [
        np.sqrt(((each - middle) ** 2).sum(axis=-1).mean(axis=0)).max()
        for each, middle in zip(nodes, mean, strict=True)
    ]
    apart = np.linalg.norm(mean[0] - mean[1], axis=-1).max()
    return float(max(apart, abs(swing[0] - swing[1])))


def _seen_from_root(grid: Feather, points: Sequence[RowPoints]) -> Array:
    """(T, K, 3) m, nodes of a grid in the frame of its root."""
    there, found = existing_nodes(grid), []
    for nodes, directors in points:
        d2, d3 = directors[0]
        found.append((nodes[there] - nodes[0, 0]) @ np.array([np.cross(d2, d3), d2, d3]).T)
    return np.array(found)


def existing_nodes(feather: Feather) -> Flags:
    """(n, 1 + 2 m) nodes of the rachis and of barbs that are there."""
    grown = np.repeat(feather.barb_length.T > 0.0, feather.columns, axis=1)
    return np.concatenate([np.ones((feather.rows, 1), dtype=np.bool_), grown], axis=1)


def max_distance(
    coarse: Feather, fine: Feather, points: Sequence[RowPoints], wanted: Sequence[RowPoints]
) -> float:
    """m, largest distance of the nodes of a coarse feather from where a fine one has them, in any
    of some poses; nodes of barbs that are not there do not count."""
    there = existing_nodes(coarse)
    ways = [
        np.linalg.norm(a.nodes - b.nodes, axis=-1)[there].max()
        for a, b in zip(points, carry_all(fine, coarse, wanted), strict=True)
    ]
    return float(max(ways))


# patches of a shot, and feathers of a patch, at most
_MAX_PATCHES, PATCH_SIZE = 4, 3


class PatchErrors(NamedTuple):
    """Errors of S feathers in contact. feathers: (S,) numbers. error: (S,) over the length. unique:
    (S,) whether finer steps come nearer to each other, and could be solved."""

    feathers: Indices
    error: Array
    unique: Array


def add_contact_error(shot: Shot, report: Mapping[str, Any]) -> dict[str, Any]:
    """Add errors of feathers that push each other to the report of a shot (report_errors), where an
    error is asked for; or why there are none."""
    promised = shot.quality.promised
    if shot.contact is None or promised is None:
        return {**report}
    if report.get("contact", {}).get("feathers_whose_contacts_yielded"):
        # they keep no error, and finer steps are yet harder to solve
        return {**report, "error_not_promised": "contacts were left out that could not be solved"}
    arrays = kept(
        "contact-errors", [digest(shot_settings(shot))], lambda: _measured(shot)._asdict()
    )
    found = PatchErrors(**arrays)
    numbers, errors, unique = (each.tolist() for each in found)
    if not numbers:
        return {**report, "error_not_promised": "no two feathers on one grid push each other"}
    known = [(error if own else math.inf, own) for error, own in zip(errors, unique, strict=True)]
    told = {**report, **report_errors(shot, promised, dict(zip(numbers, known, strict=True)))}
    before, after = report["undefined"], told["undefined"]
    told["undefined"] = {
        kind: sorted({*before.get(kind, ()), *after.get(kind, ())}) for kind in {**before, **after}
    }
    return {key: each for key, each in told.items() if key != "error_not_promised"}


def nearest_pushing(shot: Shot, options: Sequence[FeatherOptions], centre: int) -> Indices:
    """Return the numbers, ascending, of the patch of a feather. options: of all feathers."""
    assert shot.contact is not None
    grids = [(each.is_simulated, each.rows, each.columns, each.coefficients) for each in options]
    alike = np.array([each == grids[centre] for each in grids]) & may_touch(shot, shot.contact)
    middles = np.array(
        [p.position + 0.5 * p.kind.length * p.rotation[:, 0] for p in shot.groom.feathers]
    )
    away = np.linalg.norm(middles - middles[centre], axis=1)
    near = np.flatnonzero(alike & (away < shot.groom.feathers[centre].kind.length))
    return np.sort(near[np.argsort(away[near], kind="stable")[:PATCH_SIZE]])


def _measured(shot: Shot) -> PatchErrors:
    drawn, motion = drawn_feathers(shot), root_motion(shot)
    options = resolve_options(shot, drawn, motion).feathers
    deflections = estimate_deflections(shot, drawn, estimate_loads(shot, motion), range(len(drawn)))
    found: dict[int, tuple[float, bool]] = {}
    with nothing_kept(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the bake itself warns
        for patch in _patches(shot, options, [each.rachis for each in deflections]):
            for f, error, unique in zip(
                patch.tolist(), *_errors(shot, options, patch), strict=True
            ):
                before = found.get(f, (0.0, True))
                found[f] = max(error, before[0]), bool(unique and before[1])
    numbers = sorted(found)
    return PatchErrors(
        np.array(numbers, dtype=np.int64),
        np.array([found[f][0] for f in numbers]),
        np.array([found[f][1] and math.isfinite(found[f][0]) for f in numbers], dtype=np.bool_),
    )


def _patches(shot: Shot, options: Sequence[FeatherOptions], bent: Sequence[float]) -> list[Indices]:
    """Patches about the feathers that bend most of their kind, for their length (m)."""
    assert shot.contact is not None
    placements, pushing = shot.groom.feathers, may_touch(shot, shot.contact)
    some = [f for f in range(len(bent)) if pushing[f] and options[f].is_simulated]
    some.sort(key=lambda f: -bent[f] / placements[f].kind.length)
    first: dict[str, int] = {}
    for f in some:
        first.setdefault(placements[f].kind.name, f)
    patches = dict.fromkeys(tuple(nearest_pushing(shot, options, f)) for f in first.values())
    return [np.array(each) for each in patches if len(each) > 1][:_MAX_PATCHES]


def _errors(
    shot: Shot, options: Sequence[FeatherOptions], patch: Indices
) -> tuple[list[float], list[bool]]:
    """Errors of the feathers of a patch, over their lengths, and whether they are unique."""
    promised, grid = shot.quality.promised, options[int(patch[0])]
    assert promised is not None
    part = replace(part_of(shot, patch), run_up=NO_RUN_UP, preroll=0)
    targets = tuple(each for each in shot.targets if each.points is None)
    part = replace(part, details=(), level_of_detail=None, targets=targets)
    plain = part.quality.on_grid(
        grid.rows, grid.columns, grid.coefficients, tolerance=grid.tolerance
    )
    contact = part.contact
    assert contact is not None
    lengths = [placement.kind.length for placement in part.groom.feathers]

    def run(name: str = "", times: int = 0) -> list[WindowRun] | None:
        quality = refine_quality(plain, name, times) if name else plain
        # errors of steps go with the square of their length
        steps = round(contact.steps * TIGHTER_RATIO ** (0.5 * times * (name == "time")))
        shot = replace(part, quality=quality, contact=replace(contact, steps=steps))
        try:
            return simulate_window(shot, (0, window))
        except SimulationError:
            return None

    def apart(one: list[WindowRun] | None, other: list[WindowRun] | None) -> Array:
        if one is None or other is None:
            return np.full(len(lengths), math.inf)
        pairs = zip(one, other, lengths, strict=True)
        return np.array([run_distance(a, b) / size for a, b, size in pairs])

    window = min(max(2, round(WINDOW * shot.frames_per_second)), shot.last_frame - shot.first_frame)
    own, tight = run(), run("time", 1)
    time = apart(own, tight)
    error = REST_RATIOS["time"] * time + REST_RATIOS["space"] * apart(own, run("space", 1))
    unique = np.ones(len(lengths), dtype=np.bool_)
    if (REST_RATIOS["time"] * time > promised).any():
        left = apart(tight, run("time", 2))
        unique = (time <= promised) | (left <= MIN_FALL * time)
    return error.tolist(), unique.tolist()
