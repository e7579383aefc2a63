"""The solver of the nodal kinematics: the reference that the default one is measured against.

Statics, the system at a pose, and the first acceleration.

Changing data of a batch in the nodal kinematics, and its scratch memory.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Indices
from featherfx.algebra.vectors import along_rows, frames_to_quats, quats_to_frames
from featherfx.errors import InputError, Problem
from featherfx.feather.types import RowPoints, both, turned
from featherfx.lab.nodal.model import NodalModel
from featherfx.lab.nodal.newton_kernels import (
    Minimiser,
    evaluate,
    move_by,
    nodal_assemble,
    nodal_minimise,
)
from featherfx.lab.nodal.step_kernels import NodalFrame, keep_state, load_state, nodal_advance
from featherfx.mechanics.air_kernels import blow
from featherfx.mechanics.batch import row_frames
from featherfx.mechanics.model import Loads, Model, expand_wind
from featherfx.solver.scratch import LinearSystem, make_points, make_system
from featherfx.solver.settle_kernels import (
    FIRST_SETTLE_STEP,
    MAX_SETTLE_STEPS,
    MIN_SETTLE_STEP,
    SETTLE_STEP_GROWTH,
    STATIC_STEP,
)
from featherfx.solver.solver import HARD_STEP_WORK, RootPath, Settings, StepReport, step_settings
from featherfx.solver.state import make_report
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.types import CONVERGED, IntegratorFactors


class NodalState(NamedTuple):
    """Positions and rates of F feathers at one time (see Model for F, n, m).

    rotation: (F, n, 4) row frames as quaternions. points: (F, ...) nodes, the coordinates
    themselves, and directors; velocity, acceleration, smoothed: as in State. spin: (F, n, 3) rad/s.
    strains: (F, 2 + B, S), as in State. multiplier: (F, 2, n, m) N m, of
    inextensible barb segments. step, proposal, time: (F,) s, as in State.
    """

    rotation: Array
    points: RowPoints
    velocity: RowPoints
    acceleration: RowPoints
    smoothed: RowPoints
    spin: Array
    strains: Array
    multiplier: Array
    step: Array
    proposal: Array
    time: Array

    def copy(self) -> NodalState:
        return deepcopy(self)


class NodalPose(NamedTuple):
    """One feather's pose: rotation (n, 4), points; halfway (n-1, 3, 3) and rachis
    (n-1, 6) of the rachis elements; strains (S,), measured from rest."""

    rotation: Array
    points: RowPoints
    halfway: Array
    rachis: Array
    strains: Array


class StencilSums(NamedTuple):
    """Sums of one energy's stencil, of K points at most.

    lines: (8, 3 K) gradients, weight: (8,) theirs. slots: (K,), nodes: (6, 2) int. membrane:
    (4, 3, 3), turns: (2, 3, 3), hinge: (4, 3), frame: (3, 3), matrix: (12, 12),
    beam: (6, 12), stress: (6,).
    """

    lines: Array
    weight: Array
    slots: Indices
    nodes: Indices
    membrane: Array
    turns: Array
    hinge: Array
    frame: Array
    matrix: Array
    beam: Array
    stress: Array


class NodalSurroundings(NamedTuple):
    """As StepEnvironment of solver/scratch.py; reference: (S,)."""

    target: RowPoints
    past: RowPoints
    reference: Array
    wind: Array
    area: Array
    speed: Array
    carried: Array
    slip: Array
    aside: Array
    stream: Array


class NodalWork(NamedTuple):
    """Scratch of one thread. now, trial: poses. before: (S,) strains of the last iterate.
    multiplier: (2, n, m). around: NodalSurroundings. system: band (N, B + 1) and right (N,). force
    (n, 1 + 2 m, 3), stiff (n, 1 + 2 m, 6): of the nodes."""

    now: NodalPose
    trial: NodalPose
    before: Array
    multiplier: Array
    around: NodalSurroundings
    system: LinearSystem
    element: StencilSums
    force: Array
    stiff: Array


def nodal_strain_count(model: Model) -> int:
    """Length S of a strain vector: rachis, stretch, turns, membrane, hinges."""
    n, m = model.rows, model.columns
    return 6 * (n - 1) + 2 * n * m + 4 * n * m + 8 * (n - 1) * m + 6 * n * m


def nodal_rest_state(
    model: Model, nodal: NodalModel, positions: Array, rotations: Array
) -> NodalState:
    """Feathers at rest in their rest shape, roots at positions (F, 3) m, rotations (F, 3, 3)."""
    turns = np.swapaxes(np.asarray(rotations, float), 1, 2)[:, None]
    directors = quats_to_frames(nodal.rest_rotation).swapaxes(2, 3)[:, :, 1:]
    points = turned(turns, RowPoints(nodal.rest_nodes, directors))
    return nodal_state(model, points.shifted(np.asarray(positions, float)))


def nodal_state(model: Model, points: RowPoints) -> NodalState:
    """F feathers at rest (without velocity) with given points.

    So a pose of the barb-curvature kinematics (State.points) is carried over as it is; the other
    way, NodalState.points are there to compare with it or to draw.
    """
    points = both(np.array, points)
    count, n, m = len(points.nodes), model.rows, model.columns
    return NodalState(
        rotation=along_rows(frames_to_quats(row_frames(points.directors))),
        points=points,
        velocity=make_points(n, m, count),
        acceleration=make_points(n, m, count),
        smoothed=make_points(n, m, count),
        spin=np.zeros((count, n, 3)),
        strains=np.zeros((count, 2 + model.relaxation_time.shape[2], nodal_strain_count(model))),
        multiplier=np.zeros((count, 2, n, m)),
        step=np.zeros(count),
        proposal=np.zeros(count),
        time=np.zeros(count),
    )


def _make_pose(model: Model) -> NodalPose:
    n = model.rows
    return NodalPose(
        rotation=np.zeros((n, 4)),
        points=make_points(n, model.columns),
        halfway=np.zeros((n - 1, 3, 3)),
        rachis=np.zeros((n - 1, 6)),
        strains=np.zeros(nodal_strain_count(model)),
    )


def make_nodal_work(model: Model, nodal: NodalModel) -> NodalWork:
    """Scratch for one thread working on feathers of this batch."""
    n, m = model.rows, model.columns
    size = 1 + 2 * m
    unknowns, nodes = int(nodal.size.max()), (n, size, 3)
    count = nodal_strain_count(model)
    # of a stencil: a triangle and its neighbours, or a whole barb with its row
    points = max(6, model.columns + 2)
    return NodalWork(
        now=_make_pose(model),
        trial=_make_pose(model),
        before=np.zeros(count),
        multiplier=np.zeros((2, n, m)),
        around=NodalSurroundings(
            target=make_points(n, m),
            past=make_points(n, m),
            reference=np.zeros(count),
            wind=np.zeros(nodes),
            area=np.zeros(nodes),
            speed=np.zeros((n, size)),
            carried=np.zeros((n, size)),
            slip=np.zeros((n, size)),
            aside=np.zeros((n, size, 3)),
            stream=np.zeros((n, size, 3)),
        ),
        system=make_system(unknowns, nodal.band + 1),
        element=StencilSums(
            lines=np.zeros((8, 3 * points)),
            weight=np.zeros(8),
            slots=np.zeros(points, np.int64),
            nodes=np.zeros((6, 2), np.int64),
            membrane=np.zeros((4, 3, 3)),
            turns=np.zeros((2, 3, 3)),
            hinge=np.zeros((4, 3)),
            frame=np.zeros((3, 3)),
            matrix=np.zeros((12, 12)),
            beam=np.zeros((6, 12)),
            stress=np.zeros(6),
        ),
        force=np.zeros(nodes),
        stiff=np.zeros((n, size, 6)),
    )


def nodal_settle(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    fraction: float,
    state: NodalState,
    method: Minimiser,
    work: NodalWork,
) -> tuple[int, int]:
    """Bring feather f of the state to rest, in place, by ever longer implicit Euler steps.

    As settle_feathers of solver/settle_kernels.py, without its first long step. method: of its
    steps. Returns (Newton status, iterations).
    """
    around, now = work.around, work.now
    points = *state.velocity, *state.acceleration, *state.smoothed
    for rate in (*points, state.spin, state.step):
        rate[f] = 0.0
    around.reference[:], around.carried[:] = 0.0, 0.0
    h, iterations, status = FIRST_SETTLE_STEP, 0, CONVERGED
    for _ in range(MAX_SETTLE_STEPS):
        load_state(state, f, work)
        for held in (around.target, around.past):
            held.assign(now.points)
        if loads.air[0] > 0.0:
            time, still = state.time[f], state.velocity.nodes[f]
            blow(now.points.nodes, time, loads, f, still, model, around)
        factors = IntegratorFactors(1.0 / (h * h), 1.0 / h, 0.0)
        solved = nodal_minimise(model, nodal, loads, f, fraction, factors, method, work)
        status, iterations = solved.status, iterations + solved.iterations
        if status != CONVERGED:
            h *= 0.25
            if h < MIN_SETTLE_STEP:
                break
            continue
        keep_state(f, state, work)
        if h >= STATIC_STEP:
            break
        h *= SETTLE_STEP_GROWTH
    state.strains[f, 1:] = state.strains[f, 0]
    return int(status), int(iterations)


def nodal_system(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    inertia: float,
    state: NodalState,
    work: NodalWork,
) -> float:
    """Assemble at feather f's pose of the state: work.system holds Hessian and minus gradient.

    inertia: 1/s^2, times the mass about the pose itself; 0 for the stiffness alone. Geometric
    stiffness is that of the pose's own stresses. Returns the energy (J).
    """
    now, around = work.now, work.around
    load_state(state, f, work)
    for held in (around.target, around.past):
        held.assign(now.points)
    around.reference[:] = 0.0
    factors = IntegratorFactors(inertia, 0.0, 0.0)
    energy = evaluate(model, nodal, loads, f, 0.0, factors, now, work)
    work.before[:] = now.strains
    nodal_assemble(model, nodal, loads, f, 0.0, factors, True, work)
    return float(energy)


def nodal_start(
    model: Model,
    nodal: NodalModel,
    loads: Loads,
    f: int,
    duration: float,
    state: NodalState,
    work: NodalWork,
) -> None:
    """Set the accelerations of feather f, in place, to those that its loads give at rest.

    As start_acceleration of featherfx/solver/step/step_control_kernels.py; duration: s.
    """
    square = duration**2
    nodal_system(model, nodal, loads, f, 1.0 / square, state, work)
    system, now, trial = work.system, work.now, work.trial
    if not factorise(system.band, system.panel):
        return
    solve_factored(system.band, system.right)
    move_by(model, nodal, f, 1.0, True, work)
    rates = both(lambda after, before: (after - before) / square, trial.points, now.points)
    for kept in (state.acceleration, state.smoothed):
        kept.at(f).assign(rates)


Method = Literal["improved", "textbook"]

# Newton iterations of a step at most; the improved method gives up early and halves the step
_LIMITS = {"improved": 30, "textbook": 50}
_SETTLE_LIMITS = {"improved": 60, "textbook": 200}


@dataclass(frozen=True)
class NodalSystem:
    """Energy (J) and linear system of one feather at a pose: stiffness band[j, d] of unknowns j
    and j + d, (N, B + 1), and gradient (N,); N, numbered by NodalModel.slot."""

    energy: float
    band: Array
    gradient: Array


class NodalSolver:
    """Steps a batch in the nodal kinematics; shape and settings are those of Solver.

    model, nodal: constant data. method: "improved", or "textbook" for projected Newton with a line
    search on the whole energy, which is kept as a measure. Raises InputError for another method.
    """

    def __init__(
        self, model: Model, nodal: NodalModel, settings: Settings, method: Method = "improved"
    ) -> None:
        if method not in _LIMITS:
            message = f"'{method}' is not one of {', '.join(_LIMITS)}"
            raise InputError(Problem("", "method", message))
        self.model, self.nodal, self.settings, self.method = model, nodal, settings, method
        self._work: NodalWork = make_nodal_work(model, nodal)

    @property
    def _textbook(self) -> bool:
        return self.method == "textbook"

    def step(
        self, state: NodalState, loads: Loads, path: RootPath, duration: float
    ) -> tuple[NodalState, StepReport]:
        """Advance all feathers by a duration in s; the given state is not changed.

        A feather that cannot be solved stays at its last good sub-step and has a status in the
        report: see raise_if_failed of featherfx/solver/solver.py.
        """
        new, loads = state.copy(), expand_wind(loads, self.model.feathers)
        report, limit = make_report(self.model.feathers), _LIMITS[self.method]
        hard = limit if self._textbook else HARD_STEP_WORK
        for f in range(self.model.feathers):
            if new.step[f] == 0.0:
                nodal_start(self.model, self.nodal, loads, f, duration, new, self._work)
            settings = step_settings(self.settings, duration, self.model.length[f].sum())
            settings = settings._replace(iterations=limit, hard=hard)
            frame = NodalFrame(path, settings, self._textbook)
            nodal_advance(self.model, self.nodal, loads, f, frame, new, self._work, report)
        return new, report

    def equilibrium(
        self, state: NodalState, loads: Loads, fraction: float = 0.0
    ) -> tuple[NodalState, Array, Array]:
        """Bring all feathers to rest under their loads; the given state is not changed.

        fraction: 0..1, place within the loads' frame (grips). Returns the state, and per feather
        the status (0: at rest within settings.newton) and the Newton iterations.
        """
        new, loads = state.copy(), expand_wind(loads, self.model.feathers)
        status = np.zeros(self.model.feathers)
        iterations = np.zeros(self.model.feathers)
        method = Minimiser(self.settings.newton, _SETTLE_LIMITS[self.method], self._textbook)
        for f in range(self.model.feathers):
            status[f], iterations[f] = nodal_settle(
                self.model, self.nodal, loads, f, fraction, new, method, self._work
            )
        return new, status, iterations

    def system(
        self, state: NodalState, loads: Loads, feather: int, inertia: float = 0.0
    ) -> NodalSystem:
        """Energy, stiffness and gradient of one feather's pose, at rest.

        inertia: 1/s^2, times the mass that is added to the stiffness.
        """
        energy = nodal_system(self.model, self.nodal, loads, feather, inertia, state, self._work)
        size = int(self.nodal.size[feather])
        system = self._work.system
        return NodalSystem(energy, system.band[:size].copy(), -system.right[:size])


def barb_strain(model: Model, state: NodalState) -> Array:
    """(F,) largest stretch e_vv (Green-Lagrange) of any barb segment after the last step."""
    start = 6 * (model.rows - 1)
    stretch = state.strains[:, 0, start : start + 2 * model.rows * model.columns]
    return np.abs(stretch).max(axis=1, initial=0.0)
