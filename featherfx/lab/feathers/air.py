"""A feather in air: natural frequencies with the air that it carries, force of a stream, and fall.

The stream goes across the rachis, from the leading to the trailing edge, at an angle a to the plane
of the vane, from below:

    u = V (0, -cos a, sin a),    c_n = F_z / q S,    c_t = -F_y / q S,    q = rho V^2 / 2

F force on the feather in its rest shape, S area of its vanes, of which no part is taken off for
permeability. The feather's frame: x along the rachis, y to the leading vane, z dorsal.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.feather.build import build_feather
from featherfx.groom.keys.preset import Wind
from featherfx.lab.declare import POSITIVE, Range, out_of_range, value
from featherfx.lab.feathers.feather import feather_kind
from featherfx.mechanics.air_kernels import blow
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Model, no_loads
from featherfx.mechanics.node_kernels import node_forces
from featherfx.shot.loads.loads import SHAFT_DRAG
from featherfx.solver.damping import with_damping
from featherfx.solver.scratch import make_scratch
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed
from featherfx.solver.state import rest_state
from featherfx.solver.step.modes import damped_modes
from featherfx.solver.types import IntegratorFactors

# rows, columns and coefficients of a feather that is measured, and of one that falls
GRID, _FALL_GRID = (41, 6, 2), (21, 4, 1)
# m/s^2; output times of a fall
_GRAVITY, _STEPS_PER_SECOND = (0.0, 0.0, -9.81), 50
_STILL = Wind(direction=np.array([0.0, -1.0, 0.0]), speed=0.0)


@dataclass(frozen=True)
class FeatherModes:
    """Lowest modes of a feather that is held at its root. frequencies_hz, decrements: (count,)."""

    frequencies_hz: Array
    decrements: Array


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
    of mass, downwards; slowest, fastest: m/s, of its steps; drift: m/s, mean of its level speed."""

    speed: float
    slowest: float
    fastest: float
    drift: float


def find_feather_modes(
    kind: str, count: int, in_air: bool, preset_folders: tuple[str | Path, ...] = ()
) -> FeatherModes:
    """Find the modes of a feather preset in vacuum, or in still air that it carries.

    Raises InputError with a preset that is none, and a count that is out of range.
    """
    model = _model(kind, preset_folders)
    allowed = Range(1, model.unknowns // 4)
    if not allowed.holds(count):
        require(Problem("modes", "count", f"{count} is not allowed. Give {allowed}"))
    density = _STILL.air_density if in_air else 0.0
    return FeatherModes(*damped_modes(model, 0, count, density))


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
    centres, mass = [], model.mass[0] / model.mass[0].sum()
    for _ in range(steps):
        centres.append(np.einsum("ip,ipx->x", mass, state.points.nodes[0]))
        state, report = solver.step(state, loads, hold_roots(state), test.duration / steps)
        raise_if_failed(report.status, state.time, [test.kind])
    velocity = np.diff(centres, axis=0)[steps // 2 :] / (test.duration / steps)
    speeds, level = -velocity[:, 2], np.hypot(velocity[:, 0], velocity[:, 1])
    return Fall(*map(float, (speeds.mean(), speeds.min(), speeds.max(), level.mean())))


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
