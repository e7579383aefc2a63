"""Experiments on one rod: bent by loads, its natural frequencies, released to swing."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import InputWarning, Problem, require
from featherfx.lab.declare import POSITIVE, Range, out_of_range, part, value
from featherfx.lab.rods.rod import (
    Rod,
    Vector,
    clamped,
    load_problems,
    rod_loads,
    rod_model,
    rod_problems,
    straight,
)
from featherfx.mechanics.model import Loads, Model
from featherfx.solver.solver import Settings, Solver, hold_roots, raise_if_failed
from featherfx.solver.state import State
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.energy_kernels import elastic_energy
from featherfx.solver.step.integrator_kernels import IntegratorFactors
from featherfx.solver.step.modes import first_frequency, frequencies
from featherfx.solver.step.newton_kernels import evaluate
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.vane.line_kernels import FORCES_ONLY
from featherfx.solver.work import SolverScratch, make_scratch

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
_LEAST_SEGMENTS = 40
# of the length within which a load bends a rod
_ELEMENTS_WITHIN = 3


@dataclass(frozen=True)
class BendTest:
    """Equilibrium of a clamped rod."""

    rod: Rod = part("line_mass")
    tip_force: Vector = value("N, keeps its direction.", (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class ModesTest:
    """Lowest natural frequencies of a clamped rod about its rest shape.

    A frequency of two modes is listed twice; with --ei2 equal to --ei all of a straight rod's
    bending frequencies are.
    """

    rod: Rod = part("line_weight", line_mass=1.0)
    count: int = value("Frequencies wanted.", 4)


@dataclass(frozen=True)
class ReleaseTest:
    """Release a rod at rest from the straight pose under its weight."""

    rod: Rod = part(line_mass=1.0)
    duration: float = value("s.", allowed=POSITIVE)
    tolerance: float = value("m, local error that a step may have.", 1e-4, POSITIVE)
    loss_factor: float = value(
        "Of the material, at the first natural frequency.", 0.0, Range(0.0, 10.0)
    )
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
    return Bent(
        tip=state.centre[0, -1].copy(),
        points=state.centre[0].copy(),
        iterations=int(iterations[0]),
        residual=_residual(model, loads, state, rod.length),
        seconds=seconds,
    )


def enough_segments(rod: Rod, load: float) -> int:
    """Elements with which the tip of a rod under a load (N) errs by some 0.2 % of its reach.

    The load bends the rod within sqrt(EI / load) of its clamp. With k elements in that length the
    error is 0.018 / k^2 of the reach, measured at weights of 1e3 to 1e5 EI / length^2.
    """
    return max(_LEAST_SEGMENTS, math.ceil(_ELEMENTS_WITHIN * rod.length / _bent_within(rod, load)))


def _bent_within(rod: Rod, load: float) -> float:
    """m from the clamp, where a load (N) turns the rod to its own direction."""
    return float(np.sqrt(min(rod.ei, rod.ei2 or rod.ei) / max(load, 1e-300)))


def _warn_of_coarse(rod: Rod, load: float) -> None:
    """InputWarning where a load (N) bends the rod within less than an element."""
    within, element = _bent_within(rod, load), rod.length / rod.segments
    if within < element:
        warnings.warn(
            f"rod: its loads of {load:g} N bend it within {within:.3g} m, less than an element of"
            f" {element:.3g} m; it may rest folded: {enough_segments(rod, load)} segments resolve"
            " that",
            InputWarning,
            stacklevel=3,
        )


def natural_frequencies(rod: Rod, count: int) -> Array:
    """(count,) lowest natural frequencies of a clamped rod about its rest shape, Hz, ascending.

    A frequency that two modes share (bending in both planes of a rod with ei2 = ei) is listed
    twice. Raises InputError for wrong values; count is 1 to 3 times the segments.
    """
    most = Range(1, 3 * rod.segments)
    problem = Problem(_NAME, "count", f"{count}; allowed: {most}")
    require(*rod_problems(rod), *([] if most.holds(count) else [problem]))
    return frequencies(rod_model(rod), 0, count)


def release(test: ReleaseTest) -> Swing:
    """Let go a rod that was held straight along +x, at rest, under its weight.

    A step is never longer than the distance of two output times. Raises InputError for wrong
    values, SimulationError where a step cannot be solved.
    """
    rod, tolerance = test.rod, test.tolerance
    require(*rod_problems(rod), *out_of_range(test, _NAME))
    model, loads = rod_model(rod), rod_loads(rod)
    if test.loss_factor > 0.0:
        model = damped(model, test.loss_factor)
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
    """The rod with Kelvin-Voigt damping: loss factor over its first angular frequency."""
    retardation = np.zeros_like(model.retardation)
    retardation[:, 0] = loss_factor / first_frequency(model, 0)
    return model._replace(retardation=retardation)


def posed(model: Model, loads: Loads, state: State) -> SolverScratch:
    """Scratch that holds points and strains of the first feather of a batch."""
    work = make_scratch(model)
    load_pose(model, 0, state, work.now)
    evaluate(model, loads, 0, 0.0, _STATIC, work.now, work.around)
    return work


def total_energy(model: Model, loads: Loads, state: State) -> float:
    """Kinetic, elastic and potential energy (J) of a batch of one under dead loads and gravity."""
    strains = posed(model, loads, state).now.strains
    elastic = elastic_energy(model, 0, strains, strains, state.gaps_of(0), 0.0)
    inertia, nodes = (model.mass[0], model.rotary_inertia[0]), state.points.nodes[0]
    kinetic = sum(
        0.5 * np.einsum("np,npk,npk", mass, rate, rate)
        for mass, rate in zip(inertia, state.velocity.at(0), strict=True)
    )
    potential = -np.einsum("np,npk,k", model.mass[0], nodes, loads.gravity)
    if loads.force.size:
        potential -= np.sum(loads.force[0] * nodes)
    return float(elastic + kinetic + potential)


def _residual(model: Model, loads: Loads, state: State, length: float) -> float:
    work = posed(model, loads, state)
    assemble(model, loads, 0, 0.0, _STATIC, FORCES_ONLY, 0.0, work)
    unbalanced = np.abs(work.system.right.reshape(model.rows, -1))
    return float(max(unbalanced[:, :3].max(), unbalanced[:, 3:].max() / length))


@cache
def _compile() -> None:
    """Load the kernels, so that measured times are those of the work."""
    rod = Rod(length=1.0, ei=1.0, segments=2)
    model = rod_model(rod)
    solver = Solver(model, Settings())
    state, _, _ = solver.equilibrium(clamped(model), rod_loads(rod))
    solver.step(state, rod_loads(rod), hold_roots(state), 0.01)
