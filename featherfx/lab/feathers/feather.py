"""An experiment on one feather: a preset, clamped at its base, shaken or pulled at its tip.

In vacuum under gravity (0, 0, -9.81) m/s^2, settled first. The root frame is the world's at rest:
rachis along +x, leading vane towards +y, dorsal +z.

It also tells what one Newton iteration costs: assembly, and factorisation with the solution.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputError, Problem, require
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.presets.kinds import kind_of
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.types import FeatherKind, Groom, Placement
from featherfx.lab.declare import FINITE, POSITIVE, Range, out_of_range, value
from featherfx.lab.feathers.repeat_kernels import repeat_iteration, repeat_nodal_iteration
from featherfx.lab.nodal.model import NodalModel, nodal_model
from featherfx.lab.nodal.solver import (
    NodalSolver,
    NodalState,
    make_nodal_work,
    nodal_rest_state,
    nodal_system,
)
from featherfx.lab.ribbons.rod import Vector, posed
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.vane_rest import barb_nodes
from featherfx.shot.loads.loads import frame_loads
from featherfx.shot.motion.motion import root_motion, root_path
from featherfx.shot.types import Grip, Motion, Quality, Shot, Wind
from featherfx.solver.damping import with_damping
from featherfx.solver.solver import Settings, Solver, raise_if_failed
from featherfx.solver.state import State, rest_state
from featherfx.solver.types import IntegratorFactors

Kinematics = Literal["nodal", "barb-curvature"]

_GRAVITY = (0.0, 0.0, -9.81)
_FRAMES_PER_SECOND = 24.0
# spring of a pulled tip: far stiffer than any feather's tip, N/m
_PULL_STIFFNESS = 1e3
_NEWTON_SHARE = 1e-3
_SUBSTEPS = 4096
# periods within which a shake rises: hard, as the tables of benchmarks were measured
_RISE = 0.25
_UNLIMITED = 1e30


@dataclass(frozen=True)
class FeatherTest:
    """Settle a feather under gravity in vacuum, then shake its root or pull at its tip.

    The shake along z starts smoothly within a quarter period; the pull, smooth too, is reached at
    the end. Without a fixed step the steps are chosen by their error.
    """

    preset: str = value("Feather preset.")
    duration: float = value("s.", 0.5, POSITIVE)
    tolerance: float = value("m, local error that a step may have.", 1e-4, POSITIVE)
    rows: int = value("Rachis rows.", 21, Range(3, 1000))
    columns: int = value("Barb columns a side.", 6, Range(1, 200))
    coefficients: int = value(
        "Curvature coefficients per barb and direction; 0: rigid barbs.", 2, Range(0, 8)
    )
    shake_amplitude: float | None = value("m, of the root along z.", None, FINITE)
    shake_frequency: float | None = value("Hz.", None, POSITIVE)
    pull: Vector | None = value("m, displacement of the tip, reached at the end.", None)
    fixed_step: float | None = value("s, instead of the error control.", None, POSITIVE)
    kinematics: Kinematics = value("nodal: every node is free, the reference.", "barb-curvature")


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


@dataclass(frozen=True)
class _FeatherBody:
    """A feather ready to step: its solver and state of either kinematics, and its unknowns.

    repeat: Newton iterations at a pose, to time, from loads and state.
    """

    solver: Any
    state: Any
    unknowns: int
    repeat: Callable[[Loads, Any], Repeat]


def run_feather(test: FeatherTest, preset_folders: tuple[str | Path, ...] = ()) -> FeatherRun:
    """Settle a feather, then step it through the test.

    Raises InputError with every wrong value, SimulationError where a step cannot be solved.
    """
    kind = _checked(test, preset_folders)
    feather = build_feather(kind, test.rows, test.columns)
    body = _body(test, feather, kind)
    shot = _shot(test, kind)
    loads = frame_loads(shot, (), [feather], [body.state.points.nodes[0]], 0.0, 0.0)
    state, status, _ = body.solver.equilibrium(body.state, loads)
    raise_if_failed(status, state.time, [test.preset])
    return _stepped(test, shot, feather, replace(body, state=state))


def _settings(test: FeatherTest) -> Settings:
    tolerance = _UNLIMITED if test.fixed_step else test.tolerance
    return Settings(tolerance, _NEWTON_SHARE * test.tolerance, _SUBSTEPS)


def _body(test: FeatherTest, feather: Feather, kind: FeatherKind) -> _FeatherBody:
    elastic = make_model([feather], [kind], test.coefficients)
    root, settings = (np.zeros((1, 3)), np.eye(3)[None]), _settings(test)
    if test.kinematics == "barb-curvature":
        model = with_damping(elastic, [kind])
        repeat = partial(curvature_repeat, model)
        return _FeatherBody(
            Solver(model, settings), rest_state(model, *root), model.unknowns, repeat
        )
    nodal = nodal_model(elastic, [feather], [kind], section="carried")
    model = with_damping(elastic, [kind])
    return _FeatherBody(
        NodalSolver(model, nodal, settings),
        nodal_rest_state(model, nodal, *root),
        int(nodal.size[0]),
        partial(nodal_repeat, model, nodal),
    )


def _stepped(test: FeatherTest, shot: Shot, feather: Feather, body: _FeatherBody) -> FeatherRun:
    motion, grips = root_motion(shot), _grips(test)
    members = np.zeros(1, dtype=np.int64)
    interval = test.fixed_step or 1.0 / _FRAMES_PER_SECOND
    count = max(1, round(test.duration / interval))
    interval = test.duration / count
    state, steps, iterations, seconds = body.state, 0.0, 0.0, 0.0
    for k in range(count):
        now, then = k * interval, (k + 1) * interval
        loads = frame_loads(shot, grips, [feather], [body.state.points.nodes[0]], now, then)
        path = root_path(motion, members, now, then)
        if k == 0:
            body.solver.step(state, loads, path, interval)  # compiles before anything is timed
        begin = time.perf_counter()
        state, report = body.solver.step(state, loads, path, interval)
        seconds += time.perf_counter() - begin
        raise_if_failed(report.status, state.time, [test.preset])
        steps += report.steps[0]
        iterations += report.iterations[0]
    assembly, solve = iteration_seconds(body.repeat(loads, state), float(state.step[0]))
    return FeatherRun(
        points=state.points.nodes[0],
        iterations_per_step=float(iterations / steps),
        steps=int(steps),
        unknowns=body.unknowns,
        barb_strain_max=barb_strain(feather, state.points.nodes[0]),
        seconds=seconds,
        seconds_assembly=float(iterations * assembly),
        seconds_solve=float(iterations * solve),
    )


def barb_strain(feather: Feather, nodes: Array) -> float:
    """Largest relative change of length of a barb's segments; nodes: (n, 1 + 2 m, 3) m."""
    rest, now = (
        np.linalg.norm(np.diff(barb_nodes(each), axis=2), axis=-1)
        for each in (feather.rest.nodes, nodes)
    )
    present = rest > 0.0
    return float(np.max(np.abs(now[present] / rest[present] - 1.0), initial=0.0))


def _shot(test: FeatherTest, kind: FeatherKind) -> Shot:
    placement = Placement(test.preset, kind, "", np.zeros(3), np.eye(3))
    motion = Motion("hold", {})
    if test.shake_amplitude is not None:
        values = {"amplitude": test.shake_amplitude, "frequency": test.shake_frequency}
        motion = Motion("shake", values | {"direction": (0.0, 0.0, 1.0), "ramp_periods": _RISE})
    source = Path(test.preset)
    vacuum = Wind(np.array([1.0, 0.0, 0.0]), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1)
    quality = Quality("lab", test.rows, test.columns, test.coefficients, test.tolerance, _SUBSTEPS)
    return Shot(
        name=test.preset,
        source=source,
        groom=Groom(test.preset, source, (placement,)),
        first_frame=0,
        last_frame=1,
        frames_per_second=_FRAMES_PER_SECOND,
        motion=motion,
        wind=vacuum,
        quality=quality,
        gravity=np.array(_GRAVITY),
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
        stiffness=_PULL_STIFFNESS,
    )
    return ((0, grip),)


def _checked(test: FeatherTest, preset_folders: tuple[str | Path, ...]) -> FeatherKind:
    """The preset's kind; raises InputError with every wrong value of the test."""
    problems = out_of_range(test, "feather")
    if test.pull is not None and not np.isfinite(test.pull).all():
        problems.append(
            Problem("feather", "pull", f"{test.pull} is not allowed. Give finite numbers")
        )
    try:
        kind = feather_kind(test.preset, preset_folders)
    except InputError as error:
        problems += error.problems
    require(*problems)
    return kind


def feather_kind(preset: str, preset_folders: tuple[str | Path, ...] = ()) -> FeatherKind:
    """The kind that a feather preset describes, its vanes square as in what was measured and
    published. Raises InputError."""
    family, tree = load_preset(preset, preset_folders)
    if family != "feather":
        raise InputError(Problem("presets", preset, f"is of family {family}, not feather"))
    kind = kind_of(preset.rpartition("/")[2], tree, Place("presets", preset, Problems()))
    leading, trailing = (
        replace(vane, rounded_base=0.0, rounded_tip=0.0) for vane in (kind.leading, kind.trailing)
    )
    return replace(kind, leading=leading, trailing=trailing)


_TIMED_ITERATIONS, _TIMED_RUNS = 10, 8
# repeat(factors, solve, count): that many iterations, with the factorisation if solve
Repeat = Callable[[IntegratorFactors, bool, int], object]


def curvature_repeat(model: Model, loads: Loads, state: State) -> Repeat:
    """Iterations of the barb-curvature kinematics at a pose."""
    work = posed(model, loads, state)
    return lambda factors, solve, count: repeat_iteration(
        model, loads, 0, factors, solve, count, work
    )


def nodal_repeat(model: Model, nodal: NodalModel, loads: Loads, state: NodalState) -> Repeat:
    """Iterations of the nodal kinematics at a pose."""
    work = make_nodal_work(model, nodal)
    nodal_system(model, nodal, loads, 0, 0.0, state, work)
    return lambda factors, solve, count: repeat_nodal_iteration(
        model, nodal, loads, 0, factors, solve, count, work
    )


def iteration_seconds(repeat: Repeat, step: float) -> tuple[float, float]:
    """Seconds of one assembly, and of one factorisation with solution; step: s, of the inertia."""
    factors = IntegratorFactors(1.0 / step**2, 1.0 / step, 1.0 / step)
    seconds = []
    for solve in (False, True):
        repeat(factors, solve, 1)
        best = np.inf
        # the shortest of several runs: other work on the machine only ever adds
        for _ in range(_TIMED_RUNS):
            begin = time.perf_counter()
            repeat(factors, solve, _TIMED_ITERATIONS)
            best = min(best, time.perf_counter() - begin)
        seconds.append(float(best) / _TIMED_ITERATIONS)
    return seconds[0], max(seconds[1] - seconds[0], 0.0)
