"""Statics of the nodal kinematics, the system at a pose, and the first acceleration."""

from __future__ import annotations

from featherfx.feather.types import both
from featherfx.lab.nodal.assembly_kernels import nodal_assemble
from featherfx.lab.nodal.model import NodalModel
from featherfx.lab.nodal.newton_kernels import Minimiser, evaluate, move_by, nodal_minimise
from featherfx.lab.nodal.state import NodalState, NodalWork
from featherfx.lab.nodal.step_kernels import keep_state, load_state
from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.settle.settle import FIRST, GROWTH, LAST, SHORTEST, STEPS
from featherfx.solver.status import CONVERGED
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.step.start_kernels import INSTANT


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

    As settle of solver/settle/settle.py. method: of its steps. Returns (Newton status, iterations).
    """
    around, now = work.around, work.now
    points = *state.velocity, *state.acceleration, *state.smoothed
    for rate in (*points, state.spin, state.step):
        rate[f] = 0.0
    around.reference[:] = 0.0
    h, iterations, status = FIRST, 0, CONVERGED
    for _ in range(STEPS):
        load_state(state, f, work)
        for held in (around.target, around.past):
            held.assign(now.points)
        if loads.air[0] > 0.0:
            time, still = state.time[f], state.velocity.nodes[f]
            blow(now.points.nodes, time, loads, f, still, model.cell_stiffness[f], around)
        factors = Factors(1.0 / (h * h), 1.0 / h, 0.0)
        solved = nodal_minimise(model, nodal, loads, f, fraction, factors, method, work)
        status, iterations = solved.status, iterations + solved.iterations
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                break
            continue
        keep_state(f, state, work)
        if h >= LAST:
            break
        h *= GROWTH
    state.strains[f, 1] = state.strains[f, 0]
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
    factors = Factors(inertia, 0.0, 0.0)
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

    As start_acceleration of featherfx/solver/step/start_kernels.py; duration: s.
    """
    square = (INSTANT * duration) ** 2
    nodal_system(model, nodal, loads, f, 1.0 / square, state, work)
    system, now, trial = work.system, work.now, work.trial
    if not factorise(system.band, system.panel):
        return
    solve_factored(system.band, system.right)
    move_by(model, nodal, f, 1.0, True, work)
    rates = both(lambda after, before: (after - before) / square, trial.points, now.points)
    for kept in (state.acceleration, state.smoothed):
        kept.at(f).assign(rates)
