"""Rods for experiments: a rachis without vane, straight or bent to a circle at rest.

    stiffness of an element = l / integral of ds / EI(s)      (its exact compliance)
    mass of a row           = integral of rho A(s) N_i(s) ds  (N_i linear hat of the row)

with s the arc length, so both are second order in the element length l, and a uniform or tapered
rod under end loads bends as it should between rows. The section scales linearly by
c = 1 - taper s / length: bending and torsion by c^4, stretch, shear and mass by c^2. Half of the
elements are spread evenly, half so that c falls by the same share along each: a rod that ends in a
point would else hang its tip on one element that is far too soft for what little it carries.

Experiments on one rod: bent by loads, its natural frequencies, released to swing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require, warn_input
from featherfx.lab.declare import FINITE, POSITIVE, Range, out_of_range, part, value
from featherfx.mechanics.model import Loads, Model, no_hooks, no_loads
from featherfx.solver.damping import DampedModes, damped_modes, fit_branches
from featherfx.solver.scratch import SolverScratch, make_scratch
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed
from featherfx.solver.state import State, rest_state
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.energy_kernels import elastic_energy
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.types import FORCES_ONLY, IntegratorFactors

Vector = tuple[float, float, float]

# stretch and shear stiffness of rods that are to have none, in units of EI / length^2: a load of
# EI / length^2 stretches them by one part in a million; more would cost digits of the forces
_RIGID = 1e6
# and at least this many times the load, for loads that are beyond all bending
_STIFFER = 1e5
# radius of gyration of the section as a share of the length, for rotary inertia
_GYRATION = 1e-4
# mass that gives statics a time scale to settle in: length^4 line mass / EI, s^2
_SETTLING = 1e-2


@dataclass(frozen=True)
class Rod:
    """A rod of circular or other doubly symmetric section, clamped at the origin, leaving along +x.

    Where ea or ga is not given, stretch or shear is practically rigid: 1e6 ei / length^2, or 1e5
    times the load if that is more. line_mass: where not given, length^4 line mass / ei = 0.01 s^2.
    """

    length: float = value("m.", allowed=POSITIVE)
    ei: float = value("Bending in the xy plane, N m^2.", allowed=POSITIVE)
    ei2: float | None = value(
        "Bending out of the xy plane, N m^2.  [default: that of --ei]", None, POSITIVE
    )
    gj: float | None = value("Torsion, N m^2.  [default: that of --ei]", None, POSITIVE)
    ea: float | None = value("Stretch, N.  [default: inextensible]", None, POSITIVE)
    ga: float | None = value("Shear, N.  [default: unshearable]", None, POSITIVE)
    taper: float = value(
        "Share C of the width lost at the tip: stiffness (1 - C s/L)^4, mass (1 - C s/L)^2.",
        0.0,
        Range(0.0, 1.0, below=True),
    )
    rest_curvature: float = value("1/m, in the xy plane, towards +y.", 0.0, FINITE)
    line_mass: float | None = value("kg/m at the clamp.", None, POSITIVE)
    line_weight: float = value("N/m at the clamp, along -z; tapers as the mass does.", 0.0, FINITE)
    segments: int = value("Elements of the rod.", 40, Range(2, 10_000))


def rod_problems(rod: Rod) -> list[Problem]:
    """Every value of the rod that is out of its range."""
    problems = out_of_range(rod, "rod")
    largest = np.pi * rod.segments / (rod.length or 1.0)
    if not problems and not abs(rod.rest_curvature) < largest:
        allowed = f"below {largest:g} 1/m in size (half a turn per segment)"
        message = f"{rod.rest_curvature:g} is not allowed. Give {allowed}"
        problems.append(Problem("rod", "rest_curvature", message))
    return problems


def rod_model(rod: Rod, load: float = 0.0) -> Model:
    """Constant arrays of a batch of one rod: no columns, no curvature coefficients.

    load: N, size of the forces that act on it besides its weight; matters where nothing but they
    tells how stiff an inextensible rod must be. Raises InputError with every value that is out of
    its range.
    """
    require(*rod_problems(rod))
    rows = rod.segments + 1
    station = stations(rod)
    length = np.diff(station)
    # the chord of an arc is shorter than the arc
    half = 0.5 * rod.rest_curvature * length
    rachis_rest = np.zeros((rod.segments, 6))
    rachis_rest[:, 0] = np.sinc(half / np.pi)
    rachis_rest[:, 5] = 2.0 * half
    mass = (line_mass(rod) * tributary_length(rod))[None, :, None]
    barbs = (1, 2, rows, 0)
    return Model(
        held=np.ones(1, dtype=np.bool_),
        length=length[None],
        rachis_rest=rachis_rest[None],
        rachis_stiffness=_stiffness(rod, station, load)[None],
        clamp=np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), (1, 2, rows, 4)).copy(),
        joints=np.zeros((*barbs, 4)),
        segment=np.zeros((1, 2, rows)),
        shapes=np.zeros((0, 0)),
        barb_stiffness=np.zeros(barbs),
        cell_rest=np.zeros((1, 2, rows - 1, 0, 2, 3)),
        cell_stiffness=np.zeros((1, 2, rows - 1, 0, 2, 2)),
        hinge_rest=np.zeros((*barbs, 3)),
        hinge_stiffness=np.zeros(barbs),
        twist_rest=np.zeros((1, 2, rows - 1, 0, 2)),
        twist_stiffness=np.zeros((1, 2, rows - 1, 0)),
        mass=mass,
        rotary_inertia=np.repeat(mass * (_GYRATION * rod.length) ** 2, 2, axis=2),
        rachis_area=np.zeros((1, rows)),
        air_volume=np.zeros((1, rows, 1)),
        passing=np.full((1, 2, 2), np.inf),
        attached=np.zeros((1, 2)),
        retardation=np.zeros((1, 2)),
        relaxation_time=np.zeros((1, 2, 0)),
        relaxation_weight=np.zeros((1, 2, 0)),
        hooks=no_hooks(1, rows),
    )


def stations(rod: Rod) -> Array:
    """(n,) m, arc lengths of the rows."""
    even = np.linspace(0.0, 1.0, rod.segments + 1)
    if rod.taper == 0.0:
        return rod.length * even
    # places so far towards a point that they are known by the section that is left there
    section = np.geomspace(1.0, 1.0 - rod.taper, 1 + 64 * rod.segments)
    place = (1.0 - section) / rod.taper
    fraction = 0.5 * place + 0.5 * np.linspace(0.0, 1.0, len(section))
    found = rod.length * np.interp(even, fraction, place)
    return np.asarray(found)


def line_mass(rod: Rod) -> float:
    """Mass per length at the clamp, kg/m."""
    return _SETTLING * rod.ei / rod.length**4 if rod.line_mass is None else rod.line_mass


def _stiffness(rod: Rod, station: Array, load: float) -> Array:
    """(n-1, 6) rachis_stiffness of Model. load: as for rod_model."""
    load += abs(rod.line_weight) * rod.length
    rigid = max(_RIGID * rod.ei / rod.length**2, _STIFFER * load)
    ea, ga = rod.ea or rigid, rod.ga or rigid
    along = np.array([ea, ga, ga])
    turning = np.array([rod.gj or rod.ei, rod.ei2 or rod.ei, rod.ei])
    length = np.diff(station)
    start = 1.0 - rod.taper * station[:-1] / rod.length
    end = 1.0 - rod.taper * station[1:] / rod.length
    # means of c^-2 and c^-4 over an element, in a form that holds at taper 0
    second = 1.0 / (start * end)
    fourth = (start**2 + start * end + end**2) / (3.0 * (start * end) ** 3)
    stretch = along * (length / second)[:, None]
    bend = turning / (length * fourth)[:, None]
    return np.concatenate([stretch, bend], axis=1)


def tributary_length(rod: Rod) -> Array:
    """(n,) m: integral of the section's area, 1 at the clamp, times each row's linear hat."""
    station = stations(rod)
    length = np.diff(station)
    tributary = np.zeros(len(station))
    # two Gauss points integrate the cubic exactly
    for place in (0.5 - np.sqrt(1.0 / 12.0), 0.5 + np.sqrt(1.0 / 12.0)):
        area = (1.0 - rod.taper * (station[:-1] + place * length) / rod.length) ** 2
        tributary[:-1] += 0.5 * length * area * (1.0 - place)
        tributary[1:] += 0.5 * length * area * place
    return tributary


def straight(model: Model) -> State:
    """A batch of one rod held straight along +x, whatever its rest shape, clamped at the origin."""
    rest = model.rachis_rest.copy()
    rest[:] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    return clamped(model._replace(rachis_rest=rest))


def rod_loads(
    rod: Rod, tip_force: Vector = (0.0, 0.0, 0.0), points: Sequence[tuple[float, Vector]] = ()
) -> Loads:
    """The rod's weight, a dead force at its tip and dead forces at other places.

    tip_force: N. points: (arc length from the clamp in m, force in N) pairs; a force between rows
    is shared linearly. Raises InputError for places off the rod and forces that are not finite.
    """
    require(*load_problems(rod, tip_force, points))
    force = np.zeros((rod.segments + 1, 3))
    force[:, 2] = -rod.line_weight * tributary_length(rod)
    station = stations(rod)
    for place, vector in ((rod.length, tip_force), *points):
        low = min(int(np.searchsorted(station, place, side="right")) - 1, rod.segments - 1)
        weight = (place - station[low]) / (station[low + 1] - station[low])
        force[low] += (1.0 - weight) * np.asarray(vector)
        force[low + 1] += weight * np.asarray(vector)
    return no_loads(1)._replace(force=force[None, :, None])


def load_problems(
    rod: Rod, tip_force: Vector, points: Sequence[tuple[float, Vector]]
) -> list[Problem]:
    """Every value of a rod and of the loads on it that is out of its range."""
    problems = rod_problems(rod) + [
        Problem("rod", name, f"{vector} is not allowed. Give finite numbers")
        for name, vector in (
            ("tip_force", tip_force),
            *((f"points[{k}]", force) for k, (_, force) in enumerate(points)),
        )
        if not np.isfinite(vector).all()
    ]
    problems += [
        Problem("rod", f"points[{k}]", f"{place:g} is not allowed. Give 0 to {rod.length:g} m")
        for k, (place, _) in enumerate(points)
        if rod.length > 0.0 and not 0.0 <= place <= rod.length
    ]
    return problems


def clamped(model: Model) -> State:
    """A batch of one rod in its rest shape, clamped at the origin, leaving along +x."""
    return rest_state(model, np.zeros((1, 3)), np.eye(3)[None])


# a Newton move that ends statics, as a share of the rod's length
_STATIC_MOVE = 1e-9
# Newton stops in a swing where a step moves nothing by more than this share of its tolerance
_NEWTON_SHARE = 1e-3
# sub-steps are limited by their error, not by their number
_SUBSTEPS = 1_000_000
# share of the first output interval that is stepped first: a state's first step is implicit
# Euler's, which would take energy from the rod
_START = 1e-3
# factors of velocity and acceleration in the forces: none
_STATIC = IntegratorFactors(0.0, 0.0, 0.0)
_NAME = "rod"
# Hz
_LOSS_BAND = 1.0, 200.0
_MIN_SEGMENTS = 40
# of the length within which a load bends a rod
_ELEMENTS_WITHIN = 3


@dataclass(frozen=True)
class BendTest:
    """Equilibrium of a clamped rod."""

    rod: Rod = part("line_mass")
    tip_force: Vector = value("N, keeps its direction.", (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class ModesTest:
    """Lowest natural frequencies of a clamped rod, or of a feather, about its rest shape.

    A frequency of two modes is listed twice; with --ei2 equal to --ei all of a straight rod's
    bending frequencies are.
    """

    rod: Rod = part("line_weight", line_mass=1.0, length=None, ei=None)
    count: int = value("Frequencies wanted.", 4)
    loss_factor: float = value("Of a rod's material, from 1 to 200 Hz.", 0.0, Range(0.0, 1.0))


@dataclass(frozen=True)
class ReleaseTest:
    """Release a rod at rest from the straight pose under its weight."""

    rod: Rod = part(line_mass=1.0)
    duration: float = value("s.", allowed=POSITIVE)
    tolerance: float = value("m, local error that a step may have.", 1e-4, POSITIVE)
    loss_factor: float = value("Of the material, from 1 to 200 Hz.", 0.0, Range(0.0, 1.0))
    samples: int = value("Output times after the first.", 100, Range(1, 1_000_000))
    radius: float = value(
        "1 conserves energy, 0 damps most of what a step does not resolve.", 0.8, Range(0.0, 1.0)
    )


@dataclass(frozen=True)
class Bent:
    """A rod at rest under its loads.

    tip: (3,) m. points: (n, 3) m, clamp to tip. iterations: of Newton. residual: N, largest
    unbalanced force on a row (moments divided by the rod's length). seconds: of the solve.
    """

    tip: Array
    points: Array
    iterations: int
    residual: float
    seconds: float


@dataclass(frozen=True)
class Swing:
    """A rod that was let go.

    time: (T,) s. tip: (T, 3) m. energy: (T,) J, kinetic, elastic and of the weight (zero at the
    height of the clamp). steps: sub-steps taken. seconds: of stepping.
    """

    time: Array
    tip: Array
    energy: Array
    steps: int
    seconds: float


def bend(
    rod: Rod, tip_force: Vector = (0.0, 0.0, 0.0), points: Sequence[tuple[float, Vector]] = ()
) -> Bent:
    """Equilibrium of a rod under its weight, a dead tip force (N) and point forces (rod_loads).

    Starts from the rest shape. Warns (InputWarning) of elements that are too long for the loads.
    Raises InputError for wrong values, SimulationError where no equilibrium is found.
    """
    forces = [tip_force, *(force for _, force in points)]
    load = sum(float(np.linalg.norm(force)) for force in forces)
    load = load if np.isfinite(load) else 0.0
    require(*load_problems(rod, tip_force, points))
    model, loads = rod_model(rod, load), rod_loads(rod, tip_force, points)
    _warn_of_coarse(rod, load + abs(rod.line_weight) * rod.length)
    _compile()
    begin = time.perf_counter()
    settings = Settings(newton=_STATIC_MOVE * rod.length)
    state, status, iterations = Solver(model, settings).equilibrium(clamped(model), loads)
    seconds = time.perf_counter() - begin
    raise_if_failed(status, state.time, [_NAME])
    work = posed(model, loads, state)
    assemble(model, loads, 0, 0.0, _STATIC, FORCES_ONLY, 0.0, work)
    unbalanced = np.abs(work.system.right.reshape(model.rows, -1))
    return Bent(
        tip=state.centre[0, -1].copy(),
        points=state.centre[0].copy(),
        iterations=int(iterations[0]),
        residual=float(max(unbalanced[:, :3].max(), unbalanced[:, 3:].max() / rod.length)),
        seconds=seconds,
    )


def enough_segments(rod: Rod, load: float) -> int:
    """Elements with which the tip of a rod under a load (N) errs by some 0.2 % of its reach.

    The load bends the rod within sqrt(EI / load) of its clamp. With k elements in that length the
    error is 0.018 / k^2 of the reach, measured at weights of 1e3 to 1e5 EI / length^2.
    """
    return max(_MIN_SEGMENTS, math.ceil(_ELEMENTS_WITHIN * rod.length / _bent_within(rod, load)))


def _bent_within(rod: Rod, load: float) -> float:
    """m from the clamp, where a load (N) turns the rod to its own direction."""
    return float(np.sqrt(min(rod.ei, rod.ei2 or rod.ei) / max(load, 1e-300)))


def _warn_of_coarse(rod: Rod, load: float) -> None:
    """InputWarning where a load (N) bends the rod within less than an element."""
    within, element = _bent_within(rod, load), rod.length / rod.segments
    if within < element:
        warn_input(
            f"rod: its loads of {load:g} N bend it within {within:.3g} m, less than an element of"
            f" {element:.3g} m. It may rest folded: {enough_segments(rod, load)} segments resolve"
            " that",
            3,
        )


def natural_frequencies(rod: Rod, count: int) -> Array:
    """(count,) lowest natural frequencies of a clamped rod about its rest shape, Hz, ascending."""
    return find_rod_modes(ModesTest(rod, count)).frequencies


def find_rod_modes(test: ModesTest) -> DampedModes:
    """Find the lowest vibrations of a clamped rod about its rest shape.

    A frequency that two modes share (bending in both planes of a rod with ei2 = ei) is listed
    twice. Raises InputError for wrong values; count is 1 to 3 times the segments.
    """
    rod, count = test.rod, test.count
    most = Range(1, 3 * rod.segments)
    problem = Problem(_NAME, "count", f"{count} is not allowed. Give {most}")
    wrong = [] if most.holds(count) else [problem]
    require(*rod_problems(rod), *wrong, *out_of_range(test, _NAME))
    return damped_modes(damped(rod_model(rod), test.loss_factor), 0, count)


def release(test: ReleaseTest) -> Swing:
    """Let go a rod that was held straight along +x, at rest, under its weight.

    A step is never longer than the distance of two output times. Raises InputError for wrong
    values, SimulationError where a step cannot be solved.
    """
    rod, tolerance = test.rod, test.tolerance
    require(*rod_problems(rod), *out_of_range(test, _NAME))
    model, loads = damped(rod_model(rod), test.loss_factor), rod_loads(rod)
    _compile()
    begin = time.perf_counter()
    settings = Settings(tolerance, _NEWTON_SHARE * tolerance, _SUBSTEPS, test.radius)
    solver = Solver(model, settings)
    state = straight(model)
    states, steps = [state], 0.0
    path = hold_roots(state)
    interval = test.duration / test.samples
    for pieces in ((_START, 1.0 - _START), *(((1.0,),) * (test.samples - 1))):
        for piece in pieces:
            state, report = solver.step(state, loads, path, piece * interval)
            raise_if_failed(report.status, state.time, [_NAME])
            steps += report.steps[0]
        states.append(state)
    seconds = time.perf_counter() - begin
    return Swing(
        time=np.linspace(0.0, test.duration, test.samples + 1),
        tip=np.array([each.centre[0, -1] for each in states]),
        energy=np.array([total_energy(model, loads, each) for each in states]),
        steps=int(steps),
        seconds=seconds,
    )


def damped(model: Model, loss_factor: float) -> Model:
    """The rod of a material with a loss factor from 1 to 200 Hz."""
    if loss_factor == 0.0:
        return model
    dashpot, times, weights = fit_branches(loss_factor, _LOSS_BAND)
    return model._replace(
        retardation=np.full((1, 2), dashpot),
        relaxation_time=np.tile(times, (1, 2, 1)),
        relaxation_weight=np.tile(weights, (1, 2, 1)),
    )


def posed(model: Model, loads: Loads, state: State) -> SolverScratch:
    """Scratch that holds points and strains of the first feather of a batch."""
    work = make_scratch(model)
    load_pose(model, 0, state, work.now)
    evaluate(model, loads, 0, 0.0, _STATIC, work.now, work.around)
    return work


def total_energy(model: Model, loads: Loads, state: State) -> float:
    """Kinetic, elastic and potential energy (J) of a batch of one under dead loads and gravity."""
    strains = posed(model, loads, state).now.strains
    elastic = elastic_energy(model, 0, strains, strains, state.gaps_of(0), 0.0, 0.0)
    inertia, nodes = (model.mass[0], model.rotary_inertia[0]), state.points.nodes[0]
    kinetic = sum(
        0.5 * np.einsum("np,npk,npk", mass, rate, rate)
        for mass, rate in zip(inertia, state.velocity.at(0), strict=True)
    )
    potential = -np.einsum("np,npk,k", model.mass[0], nodes, loads.gravity)
    if loads.force.size:
        potential -= np.sum(loads.force[0] * nodes)
    return float(elastic + kinetic + potential)


@cache
def _compile() -> None:
    """Load the kernels, so that measured times are those of the work."""
    rod = Rod(length=1.0, ei=1.0, segments=2)
    model = rod_model(rod)
    solver = Solver(model, Settings())
    state, _, _ = solver.equilibrium(clamped(model), rod_loads(rod))
    solver.step(state, rod_loads(rod), hold_roots(state), 0.01)
