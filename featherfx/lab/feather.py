"""An experiment on one feather: a preset, clamped at its base, shaken or pulled at its tip.

In vacuum under gravity (0, 0, -9.81) m/s^2, settled first. The root frame is the world's at rest:
rachis along +x, leading vane towards +y, dorsal +z.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind, Groom, Placement
from featherfx.lab.rod import Vector
from featherfx.mechanics.batch import barb_nodes, make_model
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.types import Grip, Motion, Quality, Shot, Wind
from featherfx.solver.state import State
from featherfx.solver.step import Settings, Solver, raise_if_failed

Array = NDArray[np.float64]

GRAVITY = (0.0, 0.0, -9.81)
FRAMES_PER_SECOND = 24.0
# spring of a pulled tip: far stiffer than any feather's tip, N/m
PULL_STIFFNESS = 1e3
NEWTON_SHARE = 1e-3
SUBSTEPS = 4096
UNLIMITED = 1e30
TIMED_ITERATIONS, TIMED_RUNS = 10, 8


@dataclass(frozen=True)
class FeatherTest:
    """What to do with a feather.

    preset: name of a feather preset. rows, columns: of the grid. coefficients: curvature
    coefficients per barb and direction. shake: (amplitude in m, frequency in Hz) of the root along
    z, started smoothly within a quarter period, or None. pull: m, displacement of the tip, reached
    smoothly at the end, or None. duration: s. tolerance: m, local error of a step. fixed_step: s,
    length of all steps, or None for steps chosen by their error.
    """

    preset: str
    duration: float
    tolerance: float = 1e-4
    rows: int = 21
    columns: int = 6
    coefficients: int = 2
    shake: tuple[float, float] | None = None
    pull: Vector | None = None
    fixed_step: float | None = None


@dataclass(frozen=True)
class FeatherRun:
    """Outcome of a FeatherTest.

    points: (n, 1 + 2 m, 3) m, rachis point, leading and trailing barb nodes of every row at the
    end. iterations_per_step: Newton iterations, mean. steps: accepted. unknowns: generalised
    coordinates. barb_strain_max: largest relative change of a barb segment's length. seconds: wall
    time of stepping. seconds_assembly, seconds_solve: of the iterations' assemblies and of
    their factorisations with solves, from the cost of one at the final pose.
    """

    points: Array
    iterations_per_step: float
    steps: int
    unknowns: int
    barb_strain_max: float
    seconds: float
    seconds_assembly: float
    seconds_solve: float


def run_feather(test: FeatherTest, preset_folders: tuple[str | Path, ...] = ()) -> FeatherRun:
    """Settle a feather, then step it through the test.

    Raises InputError with every wrong value, SimulationError where a step cannot be solved.
    """
    from featherfx.feather.build import build_feather
    from featherfx.solver.modes import with_damping
    from featherfx.solver.state import rest_state

    kind = _checked(test, preset_folders)
    feather = build_feather(kind, test.rows, test.columns)
    model = with_damping(make_model([feather], [kind], test.coefficients), [kind])
    tolerance = UNLIMITED if test.fixed_step else test.tolerance
    settings = Settings(tolerance, NEWTON_SHARE * test.tolerance, SUBSTEPS)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    solver = Solver(model, settings)
    shot = _shot(test, kind)
    grips = _grips(test)
    loads = _loads(shot, (), feather, state, 0.0, 0.0)
    state, status, _ = solver.equilibrium(state, loads)
    raise_if_failed(status, state.time, [test.preset])
    return _stepped(test, shot, grips, feather, solver, state)


def _stepped(
    test: FeatherTest,
    shot: Shot,
    grips: tuple[tuple[int, Grip], ...],
    feather: Feather,
    solver: Solver,
    start: State,
) -> FeatherRun:
    from featherfx.shot.loads import root_path
    from featherfx.shot.motion import root_motion

    motion = root_motion(shot)
    members = np.zeros(1, dtype=np.int64)
    interval = test.fixed_step or 1.0 / FRAMES_PER_SECOND
    count = max(1, round(test.duration / interval))
    interval = test.duration / count
    state, steps, iterations, seconds = start, 0.0, 0.0, 0.0
    for k in range(count):
        now, then = k * interval, (k + 1) * interval
        loads = _loads(shot, grips, feather, start, now, then)
        path = root_path(motion, members, now, then)
        begin = time.perf_counter()
        state, report = solver.step(state, loads, path, interval)
        seconds += time.perf_counter() - begin
        raise_if_failed(report.status, state.time, [test.preset])
        steps += report.steps[0]
        iterations += report.iterations[0]
    assembly, solve = _iteration_seconds(solver.model, loads, state)
    return FeatherRun(
        points=np.delete(state.points[0], (1, 2), axis=1),
        iterations_per_step=float(iterations / steps),
        steps=int(steps),
        unknowns=solver.model.unknowns,
        barb_strain_max=_barb_strain(feather, state),
        seconds=seconds,
        seconds_assembly=float(iterations * assembly),
        seconds_solve=float(iterations * solve),
    )


def _loads(
    shot: Shot,
    grips: tuple[tuple[int, Grip], ...],
    feather: Feather,
    start: State,
    now: float,
    then: float,
) -> Loads:
    from featherfx.shot.loads import frame_loads

    return frame_loads(shot, grips, [feather], [start.points[0]], now, then)


def _iteration_seconds(model: Model, loads: Loads, state: State) -> tuple[float, float]:
    """Seconds of one assembly, and of one factorisation with solve, at a pose."""
    from featherfx.lab.pose import posed
    from featherfx.lab.timing_kernels import repeat_iteration

    work = posed(model, loads, state)
    step = float(state.step[0])
    factors = (1.0 / step**2, 1.0 / step, 1.0 / step)
    seconds = []
    for solve in (False, True):
        repeat_iteration(model, loads, 0, factors, solve, 1, work)
        best = np.inf
        # the shortest of several runs: other work on the machine only ever adds
        for _ in range(TIMED_RUNS):
            begin = time.perf_counter()
            repeat_iteration(model, loads, 0, factors, solve, TIMED_ITERATIONS, work)
            best = min(best, time.perf_counter() - begin)
        seconds.append(float(best) / TIMED_ITERATIONS)
    return seconds[0], max(seconds[1] - seconds[0], 0.0)


def _barb_strain(feather: Feather, state: State) -> float:
    m = feather.columns
    sides = [state.points[0, :, 3 + s * m : 3 + (s + 1) * m] for s in range(2)]
    root = state.points[0, :, :1]
    nodes = np.stack([np.concatenate([root, side], axis=1) for side in sides])
    rest = np.linalg.norm(np.diff(barb_nodes(feather), axis=2), axis=-1)
    length = np.linalg.norm(np.diff(nodes, axis=2), axis=-1)
    present = rest > 0.0
    return float(np.max(np.abs(length[present] / rest[present] - 1.0), initial=0.0))


def _shot(test: FeatherTest, kind: FeatherKind) -> Shot:
    placement = Placement(test.preset, kind, "", np.zeros(3), np.eye(3))
    motion = Motion("hold", {})
    if test.shake:
        amplitude, frequency = test.shake
        values = {"amplitude": amplitude, "frequency": frequency, "direction": (0.0, 0.0, 1.0)}
        motion = Motion("shake", values)
    source = Path(test.preset)
    vacuum = Wind(np.array([1.0, 0.0, 0.0]), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1)
    quality = Quality("lab", test.rows, test.columns, test.coefficients, test.tolerance, SUBSTEPS)
    return Shot(
        name=test.preset,
        source=source,
        groom=Groom(test.preset, source, (placement,)),
        first_frame=0,
        last_frame=1,
        frames_per_second=FRAMES_PER_SECOND,
        motion=motion,
        wind=vacuum,
        quality=quality,
        gravity=np.array(GRAVITY),
    )


def _grips(test: FeatherTest) -> tuple[tuple[int, Grip], ...]:
    if test.pull is None:
        return ()
    grip = Grip(
        feather=test.preset,
        row=1.0,
        column=0.0,
        side="leading",
        displacement=np.asarray(test.pull, dtype=float),
        start=0.0,
        end=test.duration,
        stiffness=PULL_STIFFNESS,
    )
    return ((0, grip),)


def _checked(test: FeatherTest, preset_folders: tuple[str | Path, ...]) -> FeatherKind:
    """The preset's kind; raises InputError with every wrong value of the test."""
    problems = [
        Problem("feather", name, f"{value:g}; allowed: above 0")
        for name, value in (
            ("duration", test.duration),
            ("tolerance", test.tolerance),
            ("fixed_step", test.fixed_step),
            ("shake frequency", test.shake[1] if test.shake else None),
        )
        if value is not None and not 0.0 < value < np.inf
    ]
    problems += [
        Problem("feather", name, f"{value}; allowed: {low} to {high}")
        for name, value, low, high in (
            ("rows", test.rows, 3, 1000),
            ("columns", test.columns, 1, 200),
            ("coefficients", test.coefficients, 0, 8),
        )
        if not low <= value <= high
    ]
    vectors = {"shake amplitude": test.shake[:1] if test.shake else None, "pull": test.pull}
    problems += [
        Problem("feather", name, f"{value}; allowed: finite numbers")
        for name, value in vectors.items()
        if value is not None and not np.isfinite(value).all()
    ]
    try:
        kind = feather_kind(test.preset, preset_folders)
    except InputError as error:
        problems += error.problems
    if problems:
        raise InputError(*problems)
    return kind


def feather_kind(preset: str, preset_folders: tuple[str | Path, ...] = ()) -> FeatherKind:
    """The kind that a feather preset describes. Raises InputError."""
    from featherfx.groom.kinds import kind_of
    from featherfx.groom.presets import load_preset
    from featherfx.groom.schema import Place, Problems

    family, tree = load_preset(preset, preset_folders)
    if family != "feather":
        raise InputError(Problem("presets", preset, f"is of family {family}, not feather"))
    problems = Problems()
    kind = kind_of(preset.rpartition("/")[2], tree, Place("presets", preset, problems))
    problems.raise_any()
    assert kind is not None
    return kind
