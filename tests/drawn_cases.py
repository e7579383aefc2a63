"""Random simulations that a solver must survive, of feathers far beyond what grows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from featherfx.algebra.types import Array
from featherfx.algebra.vectors import along_rows, frames_to_quats, quats_to_frames
from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Loads, Model, no_loads
from featherfx.solver.damping import with_damping
from featherfx.solver.scratch import Pose, make_scratch
from featherfx.solver.solver import RootPath, Settings, hold_roots, limit_iterations
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.pose_kernels import complete_pose, load_pose, rebuild_centres

# share of cases with narrow vanes, and of vanes that are missing
_SLIVERS, _MISSING = 0.15, 0.12
# barb bending over that of a plate of the barb modulus, measured on swan feathers
_BARB_OVER_PLATE = 4.8


@dataclass(frozen=True)
class Drawn:
    """A random feather. ratio: barb over across modulus, 1 to 1e8; rachis: factor on the rachis's
    stiffness, 1e-4 to 1e4; sliver: whether its vanes are narrow."""

    feather: Feather
    kind: FeatherKind
    ratio: float
    rachis: float
    sliver: bool


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is evenly spread."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def draw_feather(random: np.random.Generator, rows: int, columns: int) -> Drawn:
    """A feather of 5 mm to 2 m; shapes that cannot be built are drawn again."""
    while True:
        drawn = _draw_kind(random)
        kind, ratio, rachis, sliver = drawn
        try:
            return Drawn(build_feather(kind, rows, columns), kind, ratio, rachis, sliver)
        except InputError:
            continue


def _draw_kind(random: np.random.Generator) -> tuple[FeatherKind, float, float, bool]:
    length = log_uniform(random, 5e-3, 2.0)
    ratio, rachis = log_uniform(random, 1.0, 1e8), log_uniform(random, 1e-4, 1e4)
    sliver = bool(random.random() < _SLIVERS)
    base = 0.017 * length * log_uniform(random, 0.3, 2.0)
    shape = RachisShape(
        diameter_base=base,
        diameter_tip=base * log_uniform(random, 0.02, 1.0),
        taper=random.uniform(0.3, 2.0),
        camber=random.uniform(-30.0, 90.0),
        sweep=random.uniform(-30.0, 90.0),
        twist=random.uniform(-60.0, 60.0),
    )
    kind = FeatherKind(
        name="stress",
        length=length,
        calamus=float(random.choice([0.0, 0.05, 0.15, 0.4])),
        barb_spacing=5e-4,
        rachis=shape,
        leading=_draw_vane(random, sliver),
        trailing=_draw_vane(random, sliver),
        vane_material=_draw_vane_material(random, ratio),
        rachis_material=_draw_rachis_material(random, rachis),
    )
    return kind, ratio, rachis, sliver


def _draw_vane(random: np.random.Generator, sliver: bool) -> VaneShape:
    if random.random() < _MISSING:
        return VaneShape((), ())
    width = log_uniform(random, 2e-4, 5e-3) if sliver else random.uniform(0.005, 0.2)
    outline = (
        (0.0, width * float(random.choice([0.0, 0.5]))),
        (random.uniform(0.05, 0.2), width * random.uniform(0.6, 1.0)),
        (random.uniform(0.4, 0.6), width),
        (random.uniform(0.8, 0.9), width * random.uniform(0.3, 0.9)),
        (random.uniform(0.97, 1.05), 0.0),
    )
    base = random.uniform(10.0, 90.0)
    tip = random.uniform(10.0, base)
    camber = random.uniform(-20.0, 60.0)
    guides = tuple(
        BarbGuide(position, angle, random.uniform(-0.2, 0.6) * angle, camber)
        for position, angle in ((0.0, base), (0.5, 0.5 * (base + tip)), (1.0, tip))
    )
    return VaneShape(outline, guides)


def _draw_vane_material(random: np.random.Generator, ratio: float) -> VaneMaterial:
    thickness = log_uniform(random, 1e-5, 1e-3)
    across = log_uniform(random, 1e3, 1e6)
    bending = _BARB_OVER_PLATE * ratio * across * thickness**3 / 12.0
    return VaneMaterial(
        modulus_along_barbs=ratio * across,
        modulus_across_barbs=across,
        shear_modulus=across * log_uniform(random, 0.05, 2.0),
        thickness=thickness,
        surface_density=400.0 * thickness,
        barb_bending_normal=bending,
        barb_bending_in_plane=bending * log_uniform(random, 1.0, 100.0),
        barb_taper=random.uniform(0.0, 3.0),
        bending_across=across * thickness**3 / 12.0,
        loss_factor=float(random.choice([0.0, 0.02, 0.3])),
    )


def _draw_rachis_material(random: np.random.Generator, factor: float) -> RachisMaterial:
    return RachisMaterial(
        youngs_modulus=5e9 * factor,
        shear_modulus=1.5e9 * factor,
        cortex_fraction=random.uniform(0.05, 1.0),
        flattening=random.uniform(0.3, 1.5),
        cortex_density=1300.0,
        core_density=100.0,
        loss_factor=float(random.choice([0.0, 0.02, 0.3])),
    )


_FRAMES = 3
_PATH_SAMPLES = 5
_GRAVITY = 9.81
_ROOTS = ("held", "moved", "spun", "jumped", "moved and spun")
_POSES = ("at rest", "bent", "wrung", "crumpled")
# of the tolerance, distance from a step's solution, as of the strictest bakes, those with contact
_SOLVED = 1e-3
# largest turn between two rows and largest barb coefficient of a start pose, rad
_POSE_ANGLES = {"at rest": 0.0, "bent": 0.05, "wrung": 0.5, "crumpled": np.pi}


@dataclass(frozen=True)
class Case:
    """One feather through _FRAMES frames.

    seed: draws the same case again. numbers: what was drawn, for the report. model, state,
    loads, settings: as the solver takes them. paths: one per frame. duration: s, of a frame.
    still: whether no work is done on the feather, so that its energy must not grow.
    """

    seed: int
    numbers: dict[str, Any]
    model: Model
    state: State
    loads: Loads
    paths: tuple[RootPath, ...]
    duration: float
    settings: Settings
    still: bool


def draw_case(seed: int, max_rows: int = 200) -> Case:
    """The case of a seed. max_rows: of the feather, 3 at least."""
    random = np.random.default_rng(seed)
    rows = round(log_uniform(random, 3, max_rows))
    columns, coefficients = int(random.integers(1, 11)), int(random.integers(0, 5))
    drawn = draw_feather(random, rows, columns)
    model = with_damping(make_model([drawn.feather], [drawn.kind], coefficients), [drawn.kind])
    pose, root = str(random.choice(_POSES)), str(random.choice(_ROOTS))
    windy = bool(random.random() < 0.4)
    duration = log_uniform(random, 1e-5, 1.0 / 12.0)
    state = _start(model, random, _POSE_ANGLES[pose])
    loads = _loads(random, windy)
    paths = _paths(state, random, root, duration, drawn.kind.length)
    tolerance = log_uniform(random, 1e-5, 1e-1) * drawn.kind.length
    settings = Settings(
        tolerance,
        newton=max(1e-6 * drawn.kind.length, _SOLVED * tolerance),
        max_iterations=limit_iterations(model.unknowns),
    )
    numbers = _numbers(drawn, model, loads, settings, duration)
    numbers |= {"pose": pose, "root": root}
    still = root == "held" and not windy
    return Case(seed, numbers, model, state, loads, paths, duration, settings, still)


def _numbers(
    drawn: Drawn, model: Model, loads: Loads, settings: Settings, duration: float
) -> dict[str, Any]:
    return {
        "length": drawn.kind.length,
        "rows": model.rows,
        "columns": model.columns,
        "coefficients": model.coefficients,
        "stiffness_ratio": drawn.ratio,
        "rachis_factor": drawn.rachis,
        "thickness": drawn.kind.vane_material.thickness,
        "sliver": drawn.sliver,
        "duration": duration,
        "gravity": float(np.linalg.norm(loads.gravity)),
        "wind": float(np.linalg.norm(loads.wind_mean)),
        "tolerance": settings.tolerance,
        "max_iterations": settings.max_iterations,
    }


def _direction(random: np.random.Generator) -> Array:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _loads(random: np.random.Generator, windy: bool) -> Loads:
    """Gravity up to 50 g, and air that rests or blows at up to 80 m/s with gusts."""
    gravity = log_uniform(random, 0.01, 50.0) * _GRAVITY * _direction(random)
    loads = no_loads(1)._replace(gravity=gravity)
    if not windy:
        return loads
    waves = int(random.integers(0, 5))
    speed = random.uniform(0.0, 80.0)
    vectors = random.normal(size=(waves, 3)) * 2.0 * np.pi / log_uniform(random, 0.05, 5.0)
    mean = speed * _direction(random)
    return loads._replace(
        air=np.array([1.2, random.uniform(0.5, 4.0), random.uniform(0.0, 0.5), 1.1]),
        wind_mean=mean,
        wind_wave=vectors.T.copy(),
        wind_rate=vectors @ mean,
        wind_amplitude=0.3 * speed * random.normal(size=(waves, 3)).T.copy(),
        wind_phase=random.uniform(0.0, 2.0 * np.pi, waves),
    )


def _turn(random: np.random.Generator, angle: float) -> Array:
    """(3, 3) rotation by up to an angle about any axis."""
    matrix: Array = Rotation.from_rotvec(random.uniform(0, angle) * _direction(random)).as_matrix()
    return matrix


def _start(model: Model, random: np.random.Generator, angle: float) -> State:
    """A feather at rest in space, its rows turned against each other by up to the angle."""
    root = _turn(random, np.pi)
    state = rest_state(model, random.normal(size=(1, 3)), root[None])
    if angle > 0.0:
        crumple(model, state, random, angle)
    return state


def crumple(model: Model, state: State, random: np.random.Generator, angle: float) -> None:
    """Turn the rows of feather 0 and bend its barbs by up to the angle (rad), in place.

    Points and strains follow, so that the state is one that the solver could have reached.
    """
    frames = quats_to_frames(state.rotation[0])
    shared = np.eye(3)
    for row in range(1, model.rows):
        shared = _turn(random, angle) @ shared
        frames[row] = shared @ frames[row]
    state.rotation[0] = along_rows(frames_to_quats(frames))
    bend = min(angle, 2.0)
    state.coefficient[0] = random.uniform(-bend, bend, state.coefficient[0].shape)
    unstretched = make_scratch(model).now
    load_pose(model, 0, state, unstretched)
    unstretched.rachis[:] = model.rachis_rest[0, :, :6]
    rebuild_centres(model.length[0], unstretched)
    state.centre[0] = unstretched.centre
    pose = pose_of(model, state)
    state.points.at(0).assign(pose.points)
    for step in range(state.strains.rachis.shape[1]):
        state.strains.at(0, step).assign(pose.strains)


def pose_of(model: Model, state: State) -> Pose:
    """The pose of feather 0 that belongs to its coordinates, with points and strains."""
    pose = make_scratch(model).now
    load_pose(model, 0, state, pose)
    complete_pose(model, 0, pose, state.strains.hinge[0, 0])
    return pose


def _paths(
    state: State, random: np.random.Generator, root: str, duration: float, length: float
) -> tuple[RootPath, ...]:
    """Root paths: up to 50 m/s, 300 rad/s, or a jump of up to two lengths and any turn."""
    if root == "held":
        return (hold_roots(state),) * _FRAMES
    position, frame = state.centre[0, 0], quats_to_frames(state.rotation[0, 0])
    if root == "jumped":
        jump = random.uniform(0.0, 2.0 * length) * _direction(random)
        return (_path(position + jump, 0.0, _turn(random, np.pi) @ frame, 0.0),) * _FRAMES
    move = random.uniform(0.0, 50.0) * duration * _direction(random)
    spin = random.uniform(0.0, 300.0) * duration * _direction(random)
    if root == "moved":
        spin = np.zeros(3)
    if root == "spun":
        move = np.zeros(3)
    paths = []
    for _ in range(_FRAMES):
        paths.append(_path(position, move, frame, spin))
        position = position + move
        frame = _rotation(spin) @ frame
    return tuple(paths)


def _rotation(vector: Array) -> Array:
    matrix: Array = Rotation.from_rotvec(vector).as_matrix()
    return matrix


def _path(position: Array, move: Array | float, frame: Array, spin: Array | float) -> RootPath:
    """A path at constant velocity: move (3,) m and spin (3,) rad within the frame."""
    progress = np.linspace(0.0, 1.0, _PATH_SAMPLES)[:, None]
    samples = np.zeros((1, _PATH_SAMPLES, 6))
    samples[0, :, :3] = position + progress * np.broadcast_to(move, 3)
    samples[0, :, 3:] = progress * np.broadcast_to(spin, 3)
    return RootPath(samples, frames_to_quats(frame)[None])
