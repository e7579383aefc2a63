"""Acceleration of a feather whose steps are yet to begin."""

from __future__ import annotations

from featherfx.mechanics.model import Loads, Model
from featherfx.solver.assembly_kernels import assemble
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.newton_kernels import evaluate
from featherfx.solver.pose_kernels import add_increment, barb_jacobians, load_pose, material_points
from featherfx.solver.state import State
from featherfx.solver.work import Work

# the instant over which the first acceleration is taken, as a share of the step
INSTANT = 1e-3


def start_acceleration(
    model: Model, loads: Loads, f: int, duration: float, state: State, work: Work
) -> None:
    """Set the accelerations of feather f, in place, to those that its loads give at rest.

    One linear implicit step over a thousandth of the duration (s): (M / h^2 + K) dx = -dV/dx,
    a = dx / h^2. What vibrates faster than that instant is left at rest. With wrong accelerations
    the time integration would lose its second order at once.
    """
    h = INSTANT * duration
    now, trial, around = work.now, work.trial, work.around
    factors = (1.0 / (h * h), 0.0, 0.0)
    length = model.length[f]
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], length, now)
    around.target[:] = state.points[f]
    evaluate(model, loads, f, 0.0, factors, now, around)
    barb_jacobians(model, f, now, work.frame, work.spin, work.jacobian)
    assemble(model, loads, f, 0.0, factors, False, work)
    if not factorise(work.system.band):
        return
    step = work.system.right
    solve_factored(work.system.band, step)
    add_increment(length, now, step, 1.0, trial, work.beam.gradient, work.stretch)
    material_points(model, f, trial.turn, trial.centre, trial.coefficient, trial.points)
    state.acceleration[f] = (trial.points - now.points) / (h * h)
    state.smoothed[f] = state.acceleration[f]
