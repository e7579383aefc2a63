"""Accuracy and cost of single feathers and of whole shots."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.api import read_shot
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.types import FeatherKind
from featherfx.lab.feathers.feather import feather_kind
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import no_loads
from featherfx.shot.loop.simulate import Simulation, simulate
from featherfx.solver.solver import Settings, Solver, hold_roots
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.modes import frequencies

_ROWS, _COLUMNS = 21, 6
_SIZES = (0.25, 0.5, 1.0, 2.0, 5.0)
_GRAVITY = (0.0, 0.0, -9.81)  # m/s^2


def _at_rest(solver: Solver) -> State:
    return rest_state(solver.model, np.zeros((1, 3)), np.eye(3)[None])


def _segment_changes(feather: Feather, points: np.ndarray) -> Iterator[np.ndarray]:
    """Yield the relative length changes of the barb segments of each side; points: (n, P, 3)."""
    m = feather.columns
    for side in range(2):
        barbs = points[:, 3 + side * m : 3 + (side + 1) * m]
        nodes = np.concatenate([points[:, :1], barbs], axis=1)
        length = np.linalg.norm(np.diff(nodes, axis=1), axis=2)
        present = feather.barb_length[side] > 0.0
        yield length[present] / (feather.barb_length[side, present, None] / m) - 1.0


def _run(path: Path, jobs: int) -> tuple[str, float, float, Simulation]:
    """Return hash of all points, largest change of a segment, wall seconds and simulation."""
    begin = time.perf_counter()
    simulation = simulate(read_shot(path), jobs=jobs)
    digest, worst = hashlib.sha256(), 0.0
    for frame in simulation:
        for feather, points in zip(simulation.feathers, frame.rows, strict=True):
            digest.update(points.tobytes())
            for change in _segment_changes(feather, points):
                worst = max(worst, float(np.abs(change).max(initial=0.0)))
    return digest.hexdigest(), worst, time.perf_counter() - begin, simulation


def _rest_drift(feather: Feather, kind: FeatherKind, coefficients: int) -> float:
    """Return the largest displacement (m) in 1 s without loads, the root held."""
    with Solver(make_model([feather], [kind], coefficients), Settings()) as solver:
        state = start = _at_rest(solver)
        for _ in range(24):
            state, report = solver.step(state, no_loads(1), hold_roots(state), 1.0 / 24.0)
            if report.status.any():
                return float("nan")
    return float(np.linalg.norm(state.points.nodes - start.points.nodes, axis=-1).max())


def _time_error(path: Path) -> float:
    """Return the largest distance from a run with a 50th of the tolerance, in feather lengths."""
    shot = read_shot(path)
    run, worst = simulate(shot), 0.0
    tolerance = 0.02 * min(each.tolerance for each in run.options)
    fine = replace(shot, quality=replace(shot.quality, tolerance=tolerance))
    for one, other in zip(run, simulate(fine), strict=True):
        for placement, a, b in zip(shot.groom.feathers, one.rows, other.rows, strict=True):
            distance = np.linalg.norm(np.delete(a - b, (1, 2), axis=1), axis=2).max()
            worst = max(worst, float(distance) / placement.kind.length)
    return worst


def shot_figures(path: Path) -> dict[str, object]:
    """Measure a shot: times, iterations, and how well it keeps what the model promises."""
    _run(path, 1)  # compiles
    digest, worst, seconds, simulation = _run(path, 1)
    other, _, seconds_of_two, _ = _run(path, 2)
    shot, coefficients = simulation.shot, [each.coefficients for each in simulation.options]
    kind, feather = shot.groom.feathers[0].kind, simulation.feathers[0]
    return {
        "shot": shot.name,
        "feathers": len(simulation.feathers),
        "quality": shot.quality.name,
        "seconds with 1 and 2 threads": [seconds, seconds_of_two],
        "Newton iterations a frame": simulation.report["newton_iterations"],
        "substeps a frame": simulation.report["substeps"],
        "coefficients of the barbs": sorted(set(coefficients)),
        "largest change of a barb segment": worst,
        "drift of the first feather in 1 s, m": _rest_drift(feather, kind, coefficients[0]),
        "error of the substeps, feather lengths": _time_error(path),
        "same bytes with 1 and 2 threads": digest == other,
    }


def scaling_rows(preset: str) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield droop and first frequency of a feather held level, by scaling rule and size.

    Rule, size, droop of the tip and of the lowest barb below its root (feather lengths), Hz.
    """
    for rule in ("similar", "behaviour", "fixed_vane"):
        for size in _SIZES:
            kind = adjusted(replace(feather_kind(preset), scaling=rule), Change(scale=size))
            model = make_model([build_feather(kind, _ROWS, _COLUMNS)], [kind], 2)
            with Solver(model, Settings(newton=1e-7 * kind.length)) as solver:
                start = _at_rest(solver)
                state, status, _ = solver.equilibrium(start, no_loads(1, _GRAVITY))
            if status[0] != 0:
                raise RuntimeError(f"{preset}, {rule}, size {size}: found no equilibrium.")
            down = (start.points.nodes[0] - state.points.nodes[0])[..., 2] / kind.length
            barbs = (down[:, 1:] - down[:, :1]).max()
            yield rule, size, float(down[-1, 0]), float(barbs), frequencies(model, 0, 1)[0]
