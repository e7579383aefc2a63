"""An experiment on one feather: a preset, clamped at its base, shaken or pulled at its tip.

In vacuum under gravity (0, 0, -9.81) m/s^2, settled first. The root frame is the world's at rest:
rachis along +x, leading vane towards +y, dorsal +z.

It also tells what one Newton iteration costs: assembly, and factorisation with the solution.

A feather in air: natural frequencies with the air that it carries, force of a stream, and fall.

The stream goes across the rachis, from the leading to the trailing edge, at an angle a to the plane
of the vane, from below:

    u = V (0, -cos a, sin a),    c_n = F_z / q S,    c_t = -F_y / q S,    q = rho V^2 / 2

F force on the feather in its rest shape, S area of its vanes, of which no part is taken off for
permeability. The feather's frame: x along the rachis, y to the leading vane, z dorsal.
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
from featherfx.jit.compiled import kernel
from featherfx.lab.declare import FINITE, POSITIVE, Range, out_of_range, value
from featherfx.lab.nodal.model import NodalModel, nodal_model
from featherfx.lab.nodal.newton_kernels import nodal_assemble
from featherfx.lab.nodal.solver import (
    NodalSolver,
    NodalState,
    make_nodal_work,
    nodal_rest_state,
    nodal_system,
)
from featherfx.lab.ribbons.rod import Vector, posed
from featherfx.mechanics.air_kernels import area_vectors, blow
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.mechanics.node_kernels import node_forces
from featherfx.mechanics.vane_rest import barb_nodes
from featherfx.shot.loads import SHAFT_DRAG, frame_loads
from featherfx.shot.motion.motion import root_motion, root_path
from featherfx.shot.patterns import Grip
from featherfx.shot.types import Motion, Quality, Shot, Wind
from featherfx.solver.damping import DampedModes, damped_modes, with_damping
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import WHOLE_STIFFNESS, IntegratorFactors

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


@kernel
def repeat_iteration(model, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in assemble. Returns how many matrices were positive definite.
    """
    good = 0
    for _ in range(count):
        assemble(model, loads, f, 0.0, factors, WHOLE_STIFFNESS, 0.0, work)
        if solve and factorise(work.system.band, work.system.panel):
            solve_factored(work.system.band, work.system.right)
            good += 1
    return good


@kernel
def repeat_nodal_iteration(model, nodal, loads, f, factors, solve, count, work):
    """Assemble at the pose work.now count times and, if solve, factorise and solve as often.

    Other arguments as in nodal_assemble. Returns how many matrices were positive definite.
    """
    good, system = 0, work.system
    for _ in range(count):
        nodal_assemble(model, nodal, loads, f, 0.0, factors, False, work)
        if solve and factorise(system.band, system.panel):
            solve_factored(system.band, system.right)
            good += 1
    return good


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


# rows, columns and coefficients of a feather that is measured, and of one that falls
GRID, _FALL_GRID = (41, 6, 2), (21, 4, 1)
# m/s^2; output times of a fall
_STEPS_PER_SECOND = 50
_STILL = Wind(direction=np.array([0.0, -1.0, 0.0]), speed=0.0)


@dataclass(frozen=True)
class StreamTest:
    """Force of an even stream across the rachis on a feather in its rest shape."""

    kind: str = value("Feather preset.")
    angles: str = value("deg, between stream and vane, with commas.", "5,10,30,60,90")
    speed: float = value("m/s.", 10.0, Range(0.0, 150.0, above=True, unit="m/s"))


@dataclass(frozen=True)
class StreamForces:
    """Outcome of a StreamTest. angles: (k,) deg. cn, ct: (k,) force across the vane and along it,
    towards the trailing edge, over that of the stream's pressure on the area of the vanes."""

    angles: Array
    cn: Array
    ct: Array


@dataclass(frozen=True)
class FallTest:
    """Let go of a feather at rest in still air, its vane level, and let it fall freely."""

    kind: str = value("Feather preset.")
    duration: float = value("s.", 4.0, Range(0.1, 60.0, unit="s"))
    tolerance: float = value("m, local error that a step may have.", 1e-4, POSITIVE)


@dataclass(frozen=True)
class Fall:
    """Outcome of a FallTest, over the second half of its duration. speed: m/s, mean of the centre
    of mass, downwards; slowest, fastest: m/s, of its steps; drift: m/s, mean of its level speed;
    across: m/s, mean of its speed across the plane that its vane lies in on average."""

    speed: float
    slowest: float
    fastest: float
    drift: float
    across: float


def find_feather_modes(
    kind: str, count: int, in_air: bool, preset_folders: tuple[str | Path, ...] = ()
) -> DampedModes:
    """Find the modes of a feather preset in vacuum, or in still air that it carries.

    Raises InputError with a preset that is none, and a count that is out of range.
    """
    model = _model(kind, preset_folders)
    allowed = Range(1, model.unknowns // 4)
    if not allowed.holds(count):
        require(Problem("modes", "count", f"{count} is not allowed. Give {allowed}"))
    density = _STILL.air_density if in_air else 0.0
    return damped_modes(model, 0, count, density)


def measure_stream(test: StreamTest, preset_folders: tuple[str | Path, ...] = ()) -> StreamForces:
    """Measure the force of a stream at every angle. Raises InputError with every wrong value."""
    angles = _angles(test)
    model = _model(test.kind, preset_folders)
    turn = np.radians(angles)
    streams = test.speed * np.stack([0.0 * turn, -np.cos(turn), np.sin(turn)], axis=1)
    found = np.array([stream_coefficients(model, stream) for stream in streams])
    return StreamForces(angles=angles, cn=found[:, 2], ct=-found[:, 1])


def stream_coefficients(model: Model, stream: Array) -> Array:
    """(3,) force of a stream (3,), m/s, on the first feather of a model in its rest shape, over
    rho V^2 S / 2."""
    streams = np.tile(stream, (model.feathers, 1))
    loads = no_loads(model.feathers)._replace(air=_air(), wind_mean=streams)
    state, around = rest_state(model, np.zeros((1, 3)), np.eye(3)[None]), make_scratch(model).around
    nodes = state.points.nodes[0]
    around.past.nodes[:] = nodes
    blow(nodes, 0.0, loads, 0, state.velocity.nodes[0], model, around)
    force, stiff = np.zeros(nodes.shape), np.zeros((*nodes.shape[:2], 6))
    factors = IntegratorFactors(0.0, 1.0, 0.0)
    node_forces(model, loads, 0, factors, nodes, around, force, stiff)
    cells = model.cell_rest[0][model.cell_rest[0][..., 0] > 0.0]
    area = np.sum(0.5 / (cells[:, 0] * cells[:, 2]))
    pressure = 0.5 * _STILL.air_density * (stream @ stream)
    return np.asarray(-force.sum(axis=(0, 1)) / (pressure * area))


def measure_fall(test: FallTest, preset_folders: tuple[str | Path, ...] = ()) -> Fall:
    """Measure how fast a feather falls. Raises InputError with every wrong value, SimulationError
    where a step cannot be solved."""
    require(*out_of_range(test, "fall"))
    model = _model(test.kind, preset_folders, _FALL_GRID)._replace(held=np.zeros(1, dtype=np.bool_))
    loads = no_loads(1, _GRAVITY)._replace(air=_air(), added_mass=np.ones(1))
    state = rest_state(model, np.zeros((1, 3)), np.eye(3)[None])
    solver = Solver(model, Settings(tolerance=test.tolerance, newton=0.01 * test.tolerance))
    steps = max(2, round(test.duration * _STEPS_PER_SECOND))
    centres, normals, mass = [], [], model.mass[0] / model.mass[0].sum()
    area = np.zeros((*mass.shape, 3))
    for _ in range(steps):
        nodes = state.points.nodes[0]
        area_vectors(nodes, model.cell_stiffness[0], area)
        centres.append(np.einsum("ip,ipx->x", mass, nodes))
        normals.append(area.sum(axis=(0, 1)) / np.linalg.norm(area.sum(axis=(0, 1))))
        state, report = solver.step(state, loads, hold_roots(state), test.duration / steps)
        raise_if_failed(report.status, state.time, [test.kind])
    velocity = np.diff(centres, axis=0)[steps // 2 :] / (test.duration / steps)
    speeds, level = -velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1])
    across = np.abs(np.einsum("kx,kx->k", velocity, normals[1 + steps // 2 :]))
    found = speeds.mean(), speeds.min(), speeds.max(), level.mean(), across.mean()
    return Fall(*map(float, found))


def _air() -> Array:
    """Return the air of Loads."""
    return np.array([_STILL.air_density, _STILL.drag_normal, _STILL.drag_tangential, SHAFT_DRAG])


def _model(
    preset: str, preset_folders: tuple[str | Path, ...], grid: tuple[int, int, int] = GRID
) -> Model:
    kind, (rows, columns, coefficients) = feather_kind(preset, preset_folders), grid
    model = make_model([build_feather(kind, rows, columns)], [kind], coefficients)
    return with_damping(model, [kind])


def _angles(test: StreamTest) -> Array:
    """(k,) deg, of a test whose values are allowed; raises InputError with every wrong one."""
    problems, allowed = out_of_range(test, "air"), Range(-180.0, 180.0, unit="deg")
    try:
        angles = [float(each) for each in test.angles.split(",")]
    except ValueError:
        angles = [np.inf]
    if not all(allowed.holds(each) for each in angles):
        message = f"{test.angles} is not allowed. Give {allowed}, with commas"
        problems.append(Problem("air", "angles", message))
    require(*problems)
    return np.array(angles)
