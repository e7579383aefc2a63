"""The test that all methods run: one feather whose root is shaken, in vacuum, without gravity."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from time import perf_counter, thread_time
from typing import Any, Literal

import numpy as np

from featherfx.algebra.interpolation import smooth_step
from featherfx.algebra.types import Array, Flags
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind
from featherfx.lab.feather import feather_kind
from featherfx.lab.nodal.model import nodal_model
from featherfx.lab.nodal.solver import NodalSolver, nodal_rest_state
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Model, no_loads
from featherfx.solver.damping import with_damping
from featherfx.solver.solver import RootPath, Settings, Solver, raise_if_failed
from featherfx.solver.state import rest_state

_AMPLITUDE, _FREQUENCY = 0.05, 3.0
_OUTPUT_RATE = 24.0
_PATH_SAMPLES = 5
_NO_ERROR_CONTROL = 1e30
# spectral radius that stands for implicit Euler in the solver
EULER = -1.0


@dataclass(frozen=True)
class Shake:
    """One feather, or several equal ones, shaken along z by 5 cm at 3 Hz.

    rows, columns, coefficients: of the grid. step: s, of all steps, or 0 where the error control
    chooses them. tolerance: m, of the error control. radius: of the integrator, EULER for implicit
    Euler. newton: m, last move of Newton. duration: s. count: feathers. jobs: threads.
    max_substeps: of a frame, with error control.
    """

    rows: int = 41
    columns: int = 10
    coefficients: int = 2
    step: float = 1.0 / 96.0
    tolerance: float = _NO_ERROR_CONTROL
    radius: float = 0.0
    newton: float = 1e-6
    duration: float = 0.5
    count: int = 1
    jobs: int = 1
    max_substeps: int = 64


@dataclass(frozen=True)
class ShakeRun:
    """Outcome of a shake.

    station: (n,) m. moved: (T, n, 3, 3) m, displacements from rest of the rachis point and the two
    vane edges at the output times. present: (n, 3) whether the row has that point. seconds: of
    stepping, processor time where one thread does it (other work on the machine does not count),
    wall time else. steps, iterations: per feather. unknowns: per feather.
    """

    station: Array
    moved: Array
    present: Flags
    seconds: float
    steps: int
    iterations: int
    unknowns: int

    @property
    def step_seconds(self) -> float:
        """Time of a step of all feathers, s."""
        return self.seconds / self.steps

    @property
    def step_iterations(self) -> float:
        return self.iterations / self.steps


# A method takes a feather kind through a shake.
Method = Callable[[FeatherKind, Shake], ShakeRun]


@lru_cache
def swan_primary() -> FeatherKind:
    """The feather of all measurements: swan moduli, 0.35 m."""
    return replace(feather_kind("swan_primary"), length=0.35)


def shifted(time: float) -> float:
    """Place of the root on z at a time in s, m; from rest within a quarter period."""
    periods = time * _FREQUENCY
    return _AMPLITUDE * math.sin(2.0 * math.pi * periods) * smooth_step(4.0 * periods)


@lru_cache(maxsize=64)
def _model(kind: FeatherKind, rows: int, columns: int, coefficients: int) -> Model:
    feather = build_feather(kind, rows, columns)
    return with_damping(make_model([feather], [kind], coefficients), [kind])


def barb_curvature(kind: FeatherKind, shake: Shake) -> ShakeRun:
    """The default solver."""
    one = _model(kind, shake.rows, shake.columns, shake.coefficients)
    model = one.some([0] * shake.count) if shake.count > 1 else one
    state = rest_state(model, np.zeros((shake.count, 3)), np.tile(np.eye(3), (shake.count, 1, 1)))
    with Solver(model, _settings(shake), shake.jobs) as solver:
        return _run(kind, shake, solver, state, one.unknowns)


def nodal(method: Literal["improved", "textbook"]) -> Method:
    """The nodal solver, of one feather, by the improved or the textbook Newton method."""

    def run(kind: FeatherKind, shake: Shake) -> ShakeRun:
        feather = build_feather(kind, shake.rows, shake.columns)
        model = _model(kind, shake.rows, shake.columns, 0)
        constants = nodal_model(model, [feather], [kind], section="carried")
        state = nodal_rest_state(model, constants, np.zeros((1, 3)), np.eye(3)[None])
        solver = NodalSolver(model, constants, _settings(shake), method)
        return _run(kind, shake, solver, state, int(constants.slot.max()) + 3)

    return run


def _settings(shake: Shake) -> Settings:
    most = 1 if shake.step > 0.0 else shake.max_substeps
    return Settings(shake.tolerance, shake.newton, most, shake.radius)


def _run(kind: FeatherKind, shake: Shake, solver: Any, state: Any, unknowns: int) -> ShakeRun:
    """Step any solver through the shake; solver and state have the shape of Solver and State."""
    feather = build_feather(kind, shake.rows, shake.columns)
    rest = _followed(feather, state.points.nodes[0])
    loads = no_loads(shake.count)
    clock = perf_counter if shake.jobs > 1 else thread_time
    moved, seconds, steps, iterations = [], 0.0, 0, 0
    step = shake.step or 1.0 / _OUTPUT_RATE
    times: Array = np.linspace(0.0, shake.duration, max(1, round(shake.duration / step)) + 1)
    for before, after in pairwise(times):
        count = shake.count
        samples = np.zeros((count, _PATH_SAMPLES, 6))
        samples[:, :, 2] = [shifted(time) for time in np.linspace(before, after, _PATH_SAMPLES)]
        path = RootPath(samples, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)))
        begin = clock()
        state, report = solver.step(state, loads, path, after - before)
        seconds += clock() - begin
        raise_if_failed(report.status, state.time, ["shaken feather"] * shake.count)
        steps += int(report.steps[0])
        iterations += int(report.iterations[0])
        if abs(after * _OUTPUT_RATE - round(after * _OUTPUT_RATE)) < 1e-6:
            moved.append(_followed(feather, state.points.nodes[0]) - rest)
    present = np.concatenate([np.ones((1, feather.rows)), feather.barb_length]) > 0.0
    return ShakeRun(
        feather.station, np.array(moved), present.T, seconds, steps, iterations, unknowns
    )


def _followed(feather: Feather, points: Array) -> Array:
    """(n, 3, 3) rachis point and ends of both barbs of every row, from nodes (n, 1 + 2 m, 3)."""
    m = feather.columns
    return points[:, [0, m, 2 * m]]


def trajectory_error(run: ShakeRun, reference: ShakeRun, length: float) -> float:
    """Largest distance of any followed point at any output time of a run, as a share of the length.

    The reference lasts at least as long. Its displacements are interpolated along the rachis, where
    both have the point.
    """
    worst, theirs_moved = 0.0, reference.moved[: len(run.moved)]
    for point in range(3):
        theirs = reference.present[:, point]
        if not theirs.any():
            continue
        known = reference.station[theirs]
        inside = (run.station >= known[0]) & (run.station <= known[-1])
        for row in np.flatnonzero(run.present[:, point] & inside):
            right = _interpolated(known, theirs_moved[:, theirs, point], float(run.station[row]))
            gap = np.linalg.norm(run.moved[:, row, point] - right, axis=-1)
            worst = max(worst, float(gap.max()))
    return worst / length


def _interpolated(station: Array, values: Array, place: float) -> Array:
    """(T, 3) values (T, K, 3) at a place between the stations (K,)."""
    after = min(max(int(np.searchsorted(station, place)), 1), len(station) - 1)
    weight = (place - station[after - 1]) / (station[after] - station[after - 1])
    result: Array = (1.0 - weight) * values[:, after - 1] + weight * values[:, after]
    return result
