"""An experiment on one feather: a preset, clamped at its base, shaken or pulled at its tip.

In vacuum under gravity (0, 0, -9.81) m/s^2, settled first. The root frame is the world's at rest:
rachis along +x, leading vane towards +y, dorsal +z.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.feather.types import Feather
from featherfx.groom.types import FeatherKind, Groom, Placement
from featherfx.lab.rods.rod import Vector
from featherfx.mechanics.batch import barb_nodes, make_model
from featherfx.mechanics.model import Loads, Model
from featherfx.shot.types import Grip, Motion, Quality, Shot, Wind
from featherfx.solver.solver import Settings, Solver, raise_if_failed

if TYPE_CHECKING:
    from featherfx.lab.feathers.timing import Repeat

Array = NDArray[np.float64]
Kinematics = Literal["nodal", "barb-curvature"]

GRAVITY = (0.0, 0.0, -9.81)
FRAMES_PER_SECOND = 24.0
# spring of a pulled tip: far stiffer than any feather's tip, N/m
PULL_STIFFNESS = 1e3
NEWTON_SHARE = 1e-3
SUBSTEPS = 4096
UNLIMITED = 1e30


@dataclass(frozen=True)
class FeatherTest:
    """What to do with a feather.

    preset: name of a feather preset. rows, columns: of the grid. coefficients: curvature
    coefficients per barb and direction. shake: (amplitude in m, frequency in Hz) of the root along
    z, started smoothly within a quarter period, or None. pull: m, displacement of the tip, reached
    smoothly at the end, or None. duration: s. tolerance: m, local error of a step. fixed_step: s,
    length of all steps, or None for steps chosen by their error. kinematics: "barb-curvature" or
    "nodal", the same feather on the same grid with free nodes (coefficients then play no part).
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
    kinematics: Kinematics = "barb-curvature"


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
class _Body:
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
    from featherfx.feather.build import build_feather

    kind = _checked(test, preset_folders)
    feather = build_feather(kind, test.rows, test.columns)
    body = (
        _nodal_body(test, feather, kind)
        if test.kinematics == "nodal"
        else _body(test, feather, kind)
    )
    shot = _shot(test, kind)
    loads = _loads(shot, (), feather, body.state, 0.0, 0.0)
    state, status, _ = body.solver.equilibrium(body.state, loads)
    raise_if_failed(status, state.time, [test.preset])
    return _stepped(test, shot, feather, replace(body, state=state))


def _model(test: FeatherTest, feather: Feather, kind: FeatherKind) -> Model:
    from featherfx.solver.step.modes import with_damping

    return with_damping(make_model([feather], [kind], test.coefficients), [kind])


def _settings(test: FeatherTest) -> Settings:
    tolerance = UNLIMITED if test.fixed_step else test.tolerance
    return Settings(tolerance, NEWTON_SHARE * test.tolerance, SUBSTEPS)


def _body(test: FeatherTest, feather: Feather, kind: FeatherKind) -> _Body:
    from featherfx.lab.feathers.timing import curvature_repeat
    from featherfx.solver.state import rest_state

    model = _model(test, feather, kind)
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    return _Body(
        Solver(model, _settings(test)), state, model.unknowns, partial(curvature_repeat, model)
    )


def _nodal_body(test: FeatherTest, feather: Feather, kind: FeatherKind) -> _Body:
    from featherfx.lab.feathers.timing import nodal_repeat
    from featherfx.lab.nodal.model import nodal_model
    from featherfx.lab.nodal.solver import NodalSolver
    from featherfx.lab.nodal.state import nodal_rest_state

    model = _model(test, feather, kind)
    nodal = nodal_model(model, [feather], [kind], section="carried")
    state = nodal_rest_state(model, nodal, np.zeros((1, 3)), np.eye(3)[None])
    solver = NodalSolver(model, nodal, _settings(test))
    return _Body(solver, state, int(nodal.size[0]), partial(nodal_repeat, model, nodal))


def _stepped(test: FeatherTest, shot: Shot, feather: Feather, body: _Body) -> FeatherRun:
    from featherfx.lab.feathers.timing import iteration_seconds
    from featherfx.shot.motion.motion import root_motion, root_path

    motion, grips = root_motion(shot), _grips(test)
    members = np.zeros(1, dtype=np.int64)
    interval = test.fixed_step or 1.0 / FRAMES_PER_SECOND
    count = max(1, round(test.duration / interval))
    interval = test.duration / count
    state, steps, iterations, seconds = body.state, 0.0, 0.0, 0.0
    for k in range(count):
        now, then = k * interval, (k + 1) * interval
        loads = _loads(shot, grips, feather, body.state, now, then)
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
        points=np.delete(state.points[0], (1, 2), axis=1),
        iterations_per_step=float(iterations / steps),
        steps=int(steps),
        unknowns=body.unknowns,
        barb_strain_max=_barb_strain(feather, state.points[0]),
        seconds=seconds,
        seconds_assembly=float(iterations * assembly),
        seconds_solve=float(iterations * solve),
    )


def _loads(
    shot: Shot,
    grips: tuple[tuple[int, Grip], ...],
    feather: Feather,
    start: Any,
    now: float,
    then: float,
) -> Loads:
    from featherfx.shot.loads.loads import frame_loads

    return frame_loads(shot, grips, [feather], [start.points[0]], now, then)


def _barb_strain(feather: Feather, points: Array) -> float:
    m = feather.columns
    sides = [points[:, 3 + s * m : 3 + (s + 1) * m] for s in range(2)]
    root = points[:, :1]
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
    if test.kinematics not in get_args(Kinematics):
        allowed = ", ".join(get_args(Kinematics))
        problems.append(
            Problem("feather", "kinematics", f"'{test.kinematics}'; allowed: {allowed}")
        )
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
    from featherfx.groom.keys.values import Place, Problems
    from featherfx.groom.presets.kinds import kind_of
    from featherfx.groom.presets.presets import load_preset

    family, tree = load_preset(preset, preset_folders)
    if family != "feather":
        raise InputError(Problem("presets", preset, f"is of family {family}, not feather"))
    problems = Problems()
    kind = kind_of(preset.rpartition("/")[2], tree, Place("presets", preset, problems))
    problems.raise_any()
    assert kind is not None
    return kind
