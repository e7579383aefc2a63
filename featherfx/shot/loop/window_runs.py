"""Feathers simulated over a window of a shot, and how far finer settings lead elsewhere.

A window begins at rest under the loads of its first sample. Finer in space has twice the columns
and intervals of rows and one coefficient more; finer in time has a tenth of the tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.feather.density import density_map
from featherfx.feather.shapes import carry_points
from featherfx.feather.types import Feather, RowPoints
from featherfx.groom.keys.preset import Quality
from featherfx.shot.loop.simulate import simulate
from featherfx.shot.options import MAX_COEFFICIENTS, SPACE, SPACE_NUMBERS, TIME, given_grid
from featherfx.shot.roots import Roots
from featherfx.shot.types import Shot

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
