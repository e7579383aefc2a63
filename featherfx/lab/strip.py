"""A strip that falls from its clamp: the scene for runs beside other simulators.

0.25 x 0.05 m, 0.1 kg/m^2, thickness h = 1e-4 m, 100 x 12 cells (2,400 triangles), x along the
strip. The nodes at x = 0 and 2.5 mm are held; gravity (0, 0, -9.81) m/s^2; no drag, no damping;
from rest, flat.

iso        E h = 3.2e4 N/m, no Poisson effect, bending stiffness E h^3 / 12
feather    barbs along y: 3.2e4 N/m along them, 4.5 N/m across and in shear, bending 2.67e-5 N m
           along them and 3.75e-9 N m across; a rachis in the middle with EA = 5e3 N and
           EI = 8e-4 N m^2

What the scene leaves open: barbs bend within the vane as they do out of it, the rachis has GJ = EI
and GA = EA, no mass, and neither has rotary inertia.

A rectangular vane of any bending moduli, held at one end, that is bent by its weight.

    W = 1/2 k.D k per area,    k = (k_11, k_22, 2 k_12),    D = [[D_11, D_12, 0],
                                                                 [D_12, D_22, 0],
                                                                 [0,    0,    D_66]]

1 along the barbs, which lie at an angle to the plate's length, 2 across them. A plate that is
narrow beside its length L bends and twists as a rod of the compliance d = D'^-1, D' in the plate's
own axes: its moment q (L - x)^2 / 2 gives it the curvatures d_11 and d_16 / 2 times as much, so
that under a load q its end is q d_11 L^4 / 8 below its clamp and turned by q d_16 L^3 / 12
(Lekhnitskii 1968). A wide one is stiffer, because its clamp lets it neither curl nor twist.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import radians
from typing import Any, Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.feather.types import LEADING, TRAILING, Feather, RowPoints, barb_slice
from featherfx.feather.vane import vane_surface
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind, RachisShape, VaneShape
from featherfx.lab.declare import POSITIVE, Range, out_of_range, value
from featherfx.lab.nodal.model import hinge_places, nodal_model, plate_tables
from featherfx.lab.nodal.solver import NodalSolver, nodal_rest_state
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.model import Model, no_loads
from featherfx.solver.solver import Settings, Solver, raise_if_failed
from featherfx.solver.state import RootPath, rest_state

Scene = Literal["iso", "feather"]
Kinematics = Literal["nodal", "barb-curvature"]
Method = Literal["improved", "textbook"]
Stretch = Literal["stiff", "inextensible"]

STRIP_LENGTH, STRIP_WIDTH, STRIP_THICKNESS, STRIP_DENSITY = 0.25, 0.05, 1e-4, 0.1
CELLS = 100
STIFF, _SOFT = 3.2e4, 4.5
_BARB_BENDING, _BENDING_ACROSS = 2.67e-5, 3.75e-9
_RACHIS_STRETCH, _RACHIS_BENDING = 5e3, 8e-4
GRAVITY_ALONG_Z = (0.0, 0.0, -9.81)
OUTPUT_TIMES = (0.1, 0.2, 0.4)
_UNLIMITED = 1e30
# N m: barbs of the held row are rigid beside their own 1e-7
_HELD_BARB = 1.0


@dataclass(frozen=True)
class StripTest:
    """Let a strip of 0.25 x 0.05 m, held at its first two node columns, fall from rest.

    Steps between two output times are equal and not longer than `dt`.
    """

    scene: Scene = value("iso: an isotropic plate. feather: stiff barbs, a soft vane, a rachis.")
    dt: float = value("s, longest step.", allowed=Range(0.0, OUTPUT_TIMES[0], above=True, unit="s"))
    kinematics: Kinematics = value("barb-curvature: for the feather.", "nodal")
    columns: int = value("Cells to each side of the middle.", 6, Range(1, 100))
    refinement: int = value("Cells along the strip, in hundreds.", 1, Range(1, 10))
    coefficients: int = value("Curvature coefficients per barb and direction.", 2, Range(0, 8))
    method: Method = value("Of the nodal Newton iterations.", "improved")
    stretch: Stretch = value("Of nodal barbs.", "stiff")
    radius: float = value(
        "1 conserves energy, 0 damps most of what a step does not resolve.", 0.8, Range(0.0, 1.0)
    )
    newton: float = value(
        "m, last move of a step's iterations.", 1e-5, Range(0.0, STRIP_LENGTH, above=True, unit="m")
    )


@dataclass(frozen=True)
class StripRun:
    """Outcome of a StripTest.

    time: (T,) s, the output times. tip: (T, 3) m, middle of the free end. strain_max: largest
    relative change of a mesh edge's length after any step, of barbs (feather) or of all edges
    along x and y (iso). cpu_seconds: processor time of all steps. steps, iterations: of Newton,
    all of them. unknowns: generalised coordinates.
    """

    time: Array
    tip: Array
    strain_max: float
    cpu_seconds: float
    steps: int
    iterations: int
    unknowns: int


def run_strip(test: StripTest, end: float = OUTPUT_TIMES[-1]) -> StripRun:
    """Let a strip fall until the last output time up to end (s).

    Raises InputError with every wrong value, SimulationError where a step cannot be solved.
    """
    _check(test)
    body = _curvature_body(test) if test.kinematics == "barb-curvature" else _nodal_body(test)
    return _fall(test, body, [0.0, *(each for each in OUTPUT_TIMES if each <= end)])


@dataclass(frozen=True)
class _StripBody:
    """A strip ready to fall: solver, state and unknowns."""

    solver: Any
    state: Any
    unknowns: int


def _fall(test: StripTest, body: _StripBody, times: list[float]) -> StripRun:
    # the root stays where it is
    samples = np.zeros((1, 2, 6))
    samples[:, :, :3] = body.state.points.nodes[:, None, 0, 0]
    state, loads, path = (
        body.state,
        no_loads(1, GRAVITY_ALONG_Z),
        RootPath(samples, body.state.rotation[:, 0].copy()),
    )
    rest = _edges(test, state.points.nodes[0])
    tips, strain, seconds, steps, iterations = [], 0.0, 0.0, 0, 0
    body.solver.step(state, loads, path, test.dt)  # compiles before anything is timed
    for step, is_output in _steps(times, test.dt):
        begin = time.process_time()
        state, report = body.solver.step(state, loads, path, step)
        seconds += time.process_time() - begin
        raise_if_failed(report.status, state.time, [f"strip '{test.scene}'"])
        steps += int(report.steps[0])
        iterations += int(report.iterations[0])
        strain = max(strain, float(np.abs(_edges(test, state.points.nodes[0]) / rest - 1.0).max()))
        if is_output:
            tips.append(state.points.nodes[0, -1, 0])
    return StripRun(
        time=np.array(times[1:]),
        tip=np.array(tips),
        strain_max=strain,
        cpu_seconds=seconds,
        steps=steps,
        iterations=iterations,
        unknowns=body.unknowns,
    )


def _steps(times: list[float], longest: float) -> Iterator[tuple[float, bool]]:
    """Step lengths through the times, and whether each step ends at one of them."""
    for before, after in pairwise(times):
        count = max(1, int(np.ceil((after - before) / longest - 1e-6)))
        for k in range(count):
            yield (after - before) / count, k == count - 1


def _edges(test: StripTest, points: Array) -> Array:
    """Lengths of the stiff edges, m: along y, and for iso along x; points: (n, 1 + 2 m, 3)."""
    columns = test.columns
    order = [*range(2 * columns, columns, -1), *range(1 + columns)]
    nodes = points[:, order]
    along_y = np.linalg.norm(np.diff(nodes, axis=1), axis=-1).ravel()
    if test.scene == "feather":
        return along_y
    along_x = np.linalg.norm(np.diff(nodes, axis=0), axis=-1).ravel()
    return np.concatenate([along_y, along_x])


def _material(scene: Scene) -> VaneMaterial:
    iso = scene == "iso"
    plate = STIFF * STRIP_THICKNESS**2 / 12.0
    return VaneMaterial(
        modulus_along_barbs=STIFF / STRIP_THICKNESS,
        modulus_across_barbs=(STIFF if iso else _SOFT) / STRIP_THICKNESS,
        # no Poisson effect: the shear modulus is half of Young's
        shear_modulus=(0.5 * STIFF if iso else _SOFT) / STRIP_THICKNESS,
        thickness=STRIP_THICKNESS,
        surface_density=STRIP_DENSITY,
        barb_bending_normal=plate if iso else _BARB_BENDING,
        barb_bending_in_plane=0.0 if iso else _BARB_BENDING,
        barb_taper=0.0,
        bending_across=plate if iso else _BENDING_ACROSS,
        loss_factor=0.0,
    )


def _with_rachis(model: Model) -> Model:
    """The model with the rachis of the scene in its middle."""
    length = model.length[0][:, None]
    stretch, bending = np.full(3, _RACHIS_STRETCH), np.full(3, _RACHIS_BENDING)
    stiffness = np.concatenate([stretch * length, bending / length], axis=1)
    return model._replace(rachis_stiffness=stiffness[None])


def _nodal_body(test: StripTest) -> _StripBody:
    rows = CELLS * test.refinement + 1
    kind = strip_kind(STRIP_LENGTH, _material(test.scene))
    feather = strip_feather(STRIP_LENGTH, STRIP_WIDTH, rows, test.columns)
    model = make_model([feather], [kind], 0)
    pinned = np.zeros((rows, 1 + 2 * test.columns), dtype=np.bool_)
    pinned[: test.refinement + 1] = True
    iso = test.scene == "iso"
    if not iso:
        model = _with_rachis(model)
    nodal = nodal_model(
        model,
        [feather],
        [kind],
        bending="plate" if iso else "barbs",
        stretch=test.stretch,
        section="vane" if iso else "carried",
        has_rachis=not iso,
        pinned=pinned,
    )
    state = nodal_rest_state(model, nodal, np.zeros((1, 3)), np.eye(3)[None])
    solver = NodalSolver(model, nodal, _settings(test), test.method)
    return _StripBody(solver, state, int(nodal.size[0]))


def _curvature_body(test: StripTest) -> _StripBody:
    """The held columns are the root: the feather begins at the second, whose barbs are rigid."""
    held = STRIP_LENGTH / CELLS
    rows = (CELLS - 1) * test.refinement + 1
    kind = strip_kind(STRIP_LENGTH - held, _material(test.scene))
    feather = strip_feather(STRIP_LENGTH - held, STRIP_WIDTH, rows, test.columns)
    model = _with_rachis(make_model([feather], [kind], test.coefficients))
    barbs = model.barb_stiffness.copy()
    barbs[:, :, 0] = _HELD_BARB
    model = model._replace(barb_stiffness=barbs)
    state = rest_state(model, np.array([[held, 0.0, 0.0]]), np.eye(3)[None])
    return _StripBody(Solver(model, _settings(test)), state, model.unknowns)


def _settings(test: StripTest) -> Settings:
    return Settings(_UNLIMITED, test.newton, 1, test.radius)


def _check(test: StripTest) -> None:
    """InputError with every wrong value of the test."""
    problems = out_of_range(test, "strip")
    if test.scene == "iso" and test.kinematics == "barb-curvature":
        problems.append(Problem("strip", "kinematics", "iso has no barbs. Give nodal"))
    if test.stretch == "inextensible" and (test.scene, test.kinematics) != ("feather", "nodal"):
        message = "inextensible is for the nodal feather. Give stiff"
        problems.append(Problem("strip", "stretch", message))
    require(*problems)


# m; a rachis of nearly no stiffness and mass, because a section of no size has no torsion constant
RACHIS_SIZE = 1e-9


def strip_kind(length: float, vane: VaneMaterial) -> FeatherKind:
    """Kind of a strip of the given length (m) and vane."""
    nothing = VaneShape((), ())
    return FeatherKind(
        name="strip",
        length=length,
        calamus=0.0,
        barb_spacing=length,
        rachis=RachisShape(RACHIS_SIZE, RACHIS_SIZE),
        leading=nothing,
        trailing=nothing,
        vane_material=vane,
        rachis_material=RachisMaterial(
            youngs_modulus=1.0,
            shear_modulus=1.0,
            cortex_fraction=1.0,
            cortex_density=1.0,
            core_density=1.0,
            loss_factor=0.0,
        ),
    )


def strip_feather(length: float, width: float, rows: int, columns: int) -> Feather:
    """Rest geometry of a strip 0..length by -width/2..width/2 (m); columns: to each side of x."""
    station = np.linspace(0.0, length, rows)
    nodes = np.zeros((rows, 1 + 2 * columns, 3))
    reach = 0.5 * width * np.arange(1, columns + 1) / columns
    nodes[:, :, 0] = station[:, None]
    nodes[:, barb_slice(LEADING, columns), 1] = reach
    nodes[:, barb_slice(TRAILING, columns), 1] = -reach
    tributary = np.full(rows, station[1])
    tributary[[0, -1]] *= 0.5
    barb_length = np.full((2, rows), 0.5 * width)
    cell = np.ones((2, rows - 1, columns, 2), dtype=np.bool_)
    return Feather(
        rest=RowPoints(nodes, np.tile(np.eye(3)[1:], (rows, 1, 1))),
        station=station,
        width=np.full(rows, RACHIS_SIZE),
        height=np.full(rows, RACHIS_SIZE),
        barb_length=barb_length,
        barb_span=np.stack([tributary, tributary]),
        cell=cell,
        surface=vane_surface(nodes, station, barb_length, cell),
    )


_GRAVITY = 9.81
# of the membrane, which such small deflections do not stretch
_THICKNESS, _STRETCH = 1e-4, 1e4
# m over the deflection, that the pose may be off
_CLOSE = 1e-6


@dataclass(frozen=True)
class PlateTest:
    """Bend a rectangular vane of any bending moduli by its weight, held at one end."""

    along: float = value("N m, bending modulus along the barbs, D_11.", allowed=POSITIVE)
    across: float = value("N m, across them, D_22.", allowed=POSITIVE)
    twist: float = value("N m, in twist, D_66; D (1 - poisson) / 2 if isotropic.", allowed=POSITIVE)
    coupling: float = value("N m, D_12; D times Poisson's ratio if isotropic.", 0.0, Range())
    angle: float = value(
        "Of the barbs to the length of the plate.", 90.0, Range(-180.0, 180.0, unit="deg")
    )
    length: float = value("m", 0.1, POSITIVE)
    width: float = value("m", 0.01, POSITIVE)
    deflection: float = value(
        "Of a narrow plate's end under its weight, over its length.",
        1e-4,
        Range(0.0, 0.01, above=True),
    )
    rows: int = value("Cells along the plate.", 80, Range(4, 2000))
    columns: int = value("Cells to each side of its middle.", 4, Range(1, 100))


@dataclass(frozen=True)
class PlateRun:
    """Outcome of a PlateTest. load: N/m^2. deflection: m, of the middle of the free end, downwards,
    and twist: rad, of that end about the plate's length. narrow_deflection, narrow_twist: of a
    plate that is narrow beside its length."""

    load: float
    deflection: float
    twist: float
    narrow_deflection: float
    narrow_twist: float


def run_plate(test: PlateTest) -> PlateRun:
    """Bend a plate. Raises InputError with every wrong value, SimulationError where no balance is
    found."""
    problems = out_of_range(test, "plate")
    if not problems and test.coupling**2 >= test.along * test.across:
        most = np.sqrt(test.along * test.across)
        message = f"{test.coupling:g} is not allowed. Give less than {most:g} either way"
        problems.append(Problem("plate", "coupling", message))
    require(*problems)
    moduli = _turned(test)
    compliance = np.linalg.inv(moduli)
    load = 8.0 * test.deflection / (compliance[0, 0] * test.length**3)
    end = _bent(test, moduli, load)
    sides = end[2 * test.columns] - end[test.columns]
    return PlateRun(
        load=load,
        deflection=float(-end[0, 2]),
        twist=float(sides[2] / sides[1]),
        narrow_deflection=test.deflection * test.length,
        narrow_twist=float(-load * compliance[0, 2] * test.length**3 / 12.0),
    )


def _turned(test: PlateTest) -> Array:
    """(3, 3) N m, D' for curvatures along the plate (x), across it (y) and twice the twist."""
    c, s = np.cos(radians(test.angle)), np.sin(radians(test.angle))
    turn = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    own = np.array(
        [[test.along, test.coupling, 0.0], [test.coupling, test.across, 0.0], [0, 0, test.twist]]
    )
    moduli: Array = turn.T @ own @ turn
    return moduli


def _bent(test: PlateTest, moduli: Array, load: float) -> Array:
    """(1 + 2 m, 3) m, nodes of the free end of the plate under a load (N/m^2)."""
    # the plate bends from the middle between the two rows that are held on
    cell = test.length / (test.rows - 0.5)
    whole = test.length + 0.5 * cell
    vane = VaneMaterial(
        modulus_along_barbs=_STRETCH / _THICKNESS,
        modulus_across_barbs=_STRETCH / _THICKNESS,
        shear_modulus=0.5 * _STRETCH / _THICKNESS,
        thickness=_THICKNESS,
        surface_density=load / _GRAVITY,
        barb_bending_normal=test.along,
        barb_bending_in_plane=0.0,
        barb_taper=0.0,
        bending_across=test.across,
        loss_factor=0.0,
    )
    kind = strip_kind(whole, vane)
    feather = strip_feather(whole, test.width, test.rows + 1, test.columns)
    model = make_model([feather], [kind], 0)
    pinned = np.zeros((test.rows + 1, 1 + 2 * test.columns), dtype=np.bool_)
    pinned[:2] = True
    nodal = nodal_model(model, [feather], [kind], bending="plate", has_rachis=False, pinned=pinned)
    y, x, xy = 1, 0, 2
    order = np.ix_((y, x, xy), (y, x, xy))
    weight = moduli[order] * np.outer((1.0, 1.0, 2.0), (1.0, 1.0, 2.0))
    area = np.full(feather.cell.shape, 0.5 * cell * 0.5 * test.width / test.columns)
    table = plate_tables(feather.rest.nodes, area, hinge_places(feather.cell), weight)
    nodal = nodal._replace(plate=table[None])
    settings = Settings(1e30, _CLOSE * test.deflection * test.length, 1, 0.0)
    state = nodal_rest_state(model, nodal, np.zeros((1, 3)), np.eye(3)[None])
    solver = NodalSolver(model, nodal, settings)
    bent, status, _ = solver.equilibrium(state, no_loads(1, (0.0, 0.0, -_GRAVITY)))
    raise_if_failed(status, np.zeros(1), ["plate"])
    end: Array = bent.points.nodes[0, -1] - bent.points.nodes[0, 0, 0]
    return end
