"""Statics: one feather brought to rest under its loads by ever longer implicit Euler steps.

Each step starts at rest (no velocity is carried over), so the elastic and potential energy can
only fall; as the step grows, what is left is the equilibrium. Short steps at first keep large
deformations on a path that Newton can follow.
"""

from __future__ import annotations

from featherfx.mechanics.model import Loads, Model
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.newton_kernels import CONVERGED, NOT_CONVERGED, minimise
from featherfx.solver.pose_kernels import load_pose
from featherfx.solver.state import State
from featherfx.solver.work import Work

FIRST, LAST, SHORTEST, GROWTH = 1e-2, 1e4, 1e-7, 8.0  # step lengths, s
ITERATIONS, STEPS = 100, 80


def settle(
    model: Model, loads: Loads, f: int, share: float, state: State, tolerance: float, work: Work
) -> tuple[int, int]:
    """Bring feather f of the state to rest, in place; its velocities become zero.

    share: 0..1, place within the loads' frame. tolerance: m, move of the last Newton step.
    Returns (Newton status, iterations).
    """
    now, around = work.now, work.around
    _stop(f, state)
    _load(model, f, state, work)
    around.reference[:] = 0.0
    h, iterations, status = FIRST, 0, CONVERGED
    for _ in range(STEPS):
        around.target[:] = now.points
        around.past[:] = now.points
        if loads.air[0] > 0.0:
            time, still = state.time[f], state.velocity[f]
            blow(now.points, time, loads, f, still, model.cell_stiffness[f], around)
        factors = (1.0 / (h * h), 1.0 / h, 0.0)
        status, count, _ = minimise(model, loads, f, share, factors, tolerance, ITERATIONS, work)
        iterations += count
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                break
            _load(model, f, state, work)
            continue
        state.turn[f], state.centre[f] = now.turn, now.centre
        state.coefficient[f], state.points[f] = now.coefficient, now.points
        if h >= LAST:
            break
        h *= GROWTH
    else:
        # in a wind that no pose can stand in, steps grow and fail in turn
        status = NOT_CONVERGED if status == CONVERGED else status
    state.strains[f, :] = now.strains
    return int(status), int(iterations)


def _stop(f: int, state: State) -> None:
    for rate in (
        state.velocity,
        state.acceleration,
        state.smoothed,
        state.spin,
        state.coefficient_rate,
        state.step,
    ):
        rate[f] = 0.0


def _load(model: Model, f: int, state: State, work: Work) -> None:
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], model.length[f], work.now)
    work.now.points[:] = state.points[f]
