"""Statics: one feather brought to rest under its loads by ever longer implicit Euler steps.

Each step starts at rest (no velocity is carried over), so the elastic and potential energy can
only fall; as the step grows, what is left is the equilibrium. Short steps at first keep large
deformations on a path that Newton can follow.
"""

from featherfx.compiled import kernel
from featherfx.mechanics.copy_kernels import copy_values
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.newton_kernels import CONVERGED, minimise
from featherfx.solver.pose_kernels import load_pose

FIRST, LAST, SHORTEST, GROWTH = 1e-2, 1e4, 1e-7, 8.0


@kernel
def settle(model, loads, f, share, state, tolerance, limit, most, work):
    """Bring feather f of the state to rest, in place; its velocities become zero.

    share: 0..1, place within the loads' frame. tolerance: m, move of the last Newton step. limit:
    Newton iterations per step. most: steps in all. Returns (status, iterations).
    """
    now, around = work.now, work.around
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], model.length[f], now)
    copy_values(state.points[f], now.points)
    around.reference[:] = 0.0
    state.velocity[f] = 0.0
    state.acceleration[f] = 0.0
    state.smoothed[f] = 0.0
    state.spin[f] = 0.0
    state.coefficient_rate[f] = 0.0
    state.step[f] = 0.0
    h = FIRST
    iterations = 0
    status = CONVERGED
    for _ in range(most):
        copy_values(now.points, around.target)
        copy_values(now.points, around.past)
        if loads.air[0] > 0.0:
            blow(
                now.points, state.time[f], loads, state.velocity[f], model.cell_stiffness[f], around
            )
        factors = (1.0 / (h * h), 1.0 / h, 0.0)
        status, count, _ = minimise(model, loads, f, share, factors, tolerance, limit, work)
        iterations += count
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                break
            load_pose(state.turn[f], state.centre[f], state.coefficient[f], model.length[f], now)
            copy_values(state.points[f], now.points)
            continue
        copy_values(now.turn, state.turn[f])
        copy_values(now.centre, state.centre[f])
        copy_values(now.coefficient, state.coefficient[f])
        copy_values(now.points, state.points[f])
        if h >= LAST:
            break
        h *= GROWTH
    copy_values(now.strains, state.strains[f, 0])
    copy_values(now.strains, state.strains[f, 1])
    return status, iterations
