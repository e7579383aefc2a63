"""One feather of the nodal kinematics through one frame."""

from featherfx.algebra.copy_kernels import copy_values
from featherfx.algebra.rotation_kernels import (
    conjugate,
    logarithm,
    multiply,
    normalised,
    rotate,
    same_sign,
    store_rotation,
)
from featherfx.algebra.vec3_kernels import add, over, store, sub
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.newton_kernels import gather, nodal_minimise, set_directors
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.step.frame_kernels import coarse_error, strain_rate_of
from featherfx.solver.step.integrator_kernels import (
    EULER,
    begin_step,
    end_step,
    integrator_coefficients,
    step_error,
)
from featherfx.solver.step.newton_kernels import CONVERGED
from featherfx.solver.step.pose_kernels import turn_by
from featherfx.solver.step.retry_kernels import (
    BACKWARD,
    FOLLOW,
    GO_ON,
    HARD,
    STEPS,
    after_step,
    count_try,
    judge,
    next_step,
    stop,
)
from featherfx.solver.step.root_kernels import root_at

# beside the options of step_kernels: start at the last pose
STAY = -1


@kernel
def _pin(nodal, f, pose, turn, centre):
    """Put what is prescribed where the root says; turn: (4,), centre: (3,) of the root.

    The frame and point of row 0 may be turn and centre themselves.
    """
    root = turn[0], turn[1], turn[2], turn[3]
    place = centre[0], centre[1], centre[2]
    slot = nodal.slot[f]
    for i in range(slot.shape[0]):
        if slot[i, 1] < 0:
            store_rotation(pose.turn[i], normalised(multiply(root, nodal.rest_turn[f, i])))
        for p in range(slot.shape[1]):
            if slot[i, p] < 0 and p != 1 and p != 2:
                store(pose.points[i, p], add(place, rotate(root, nodal.rest_points[f, i, p])))


@kernel
def load_state(state, f, work):
    """The state's pose and multipliers to work.now."""
    copy_values(state.turn[f], work.now.turn)
    copy_values(state.points[f], work.now.points)
    copy_values(state.multiplier[f], work.multiplier)
    copy_values(state.strains[f, 0], work.before)


@kernel
def _go_on(h, slot, spin, velocity, pose):
    """Predict the end of a step: the last step's rates go on."""
    for i in range(slot.shape[0]):
        if slot[i, 1] >= 0:
            turn_by(pose.turn[i], spin[i], h, pose.turn[i])
        for p in range(slot.shape[1]):
            if slot[i, p] >= 0 and p != 1 and p != 2:
                for k in range(3):
                    pose.points[i, p, k] += h * velocity[i, p, k]


@kernel
def _follow_root(before, start, turn, centre, pose):
    """Predict the end of a step: the feather moves rigidly with its root.

    before (4,), start (3,): root at the step's start; turn, centre: at its end.
    """
    move = multiply(turn, conjugate(before))
    for i in range(pose.turn.shape[0]):
        store_rotation(pose.turn[i], normalised(multiply(move, pose.turn[i])))
        for p in range(pose.points.shape[1]):
            if p != 1 and p != 2:
                point = pose.points[i, p]
                store(point, add(centre, rotate(move, sub(point, start))))


@kernel
def _predict(model, nodal, loads, f, share, h, radius, option, path, base, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator.

    option: GO_ON: the rates go on, STAY: the last pose, else rigidly with the root.
    """
    now, around = work.now, work.around
    load_state(state, f, work)
    begin_step(
        radius,
        h,
        state.points[f],
        state.velocity[f],
        state.acceleration[f],
        state.smoothed[f],
        around.target,
        around.past,
    )
    strain_rate = strain_rate_of(h, state.step[f], state.strains[f], around.reference)
    if option == GO_ON:
        _go_on(h, nodal.slot[f], state.spin[f], state.velocity[f], now)
    if model.held[f]:
        # scratch of the elements, which are not in use yet
        turn, centre = work.element.matrix[0], work.element.matrix[1]
        root_at(path, base, share, turn, centre)
        same_sign(state.turn[f, 0], turn)
        if option >= FOLLOW:
            _follow_root(state.turn[f, 0], state.points[f, 0, 0], turn, centre, now)
        _pin(nodal, f, now, turn, centre)
    gather(nodal.present[f], now.points)
    set_directors(now.turn, now.points)
    if loads.air[0] > 0.0:
        blow(
            now.points,
            state.time[f] + h,
            loads,
            f,
            state.velocity[f],
            model.cell_stiffness[f],
            around,
        )
    factors = integrator_coefficients(radius, h)
    return factors[0], factors[1], strain_rate


@kernel
def _accept(f, h, radius, state, work):
    """The solved step becomes the state."""
    now, around = work.now, work.around
    end_step(
        radius,
        h,
        now.points,
        state.velocity[f],
        state.acceleration[f],
        state.smoothed[f],
        around.target,
        around.past,
    )
    for i in range(now.turn.shape[0]):
        change = multiply(now.turn[i], conjugate(state.turn[f, i]))
        store(state.spin[f, i], over(logarithm(change), h))
    copy_values(state.strains[f, 0], state.strains[f, 1])
    keep_state(f, state, work)
    state.step[f] = h
    state.time[f] += h


@kernel
def keep_state(f, state, work):
    """Pose, strains and multipliers of work to the state."""
    copy_values(work.now.turn, state.turn[f])
    copy_values(work.now.points, state.points[f])
    copy_values(work.now.strains, state.strains[f, 0])
    copy_values(work.multiplier, state.multiplier[f])


@kernel
def nodal_advance(
    model, nodal, loads, f, duration, path, base, state, settings, textbook, work, counters
):
    """Bring feather f of the state through one frame of the given duration (s), in place.

    As advance of solver/step/frame_kernels.py, which explains path, base, settings, counters
    and the status that is returned.
    """
    hard = int(settings[2]) if textbook else HARD
    limits = (min(settings[4], duration), settings[3], coarse_error(model.length[f]), hard)
    h = state.proposal[f] if 0.0 < state.proposal[f] <= duration else duration
    # the textbook method begins every step at the last pose, so there is nothing else to try
    first = FOLLOW if textbook else GO_ON
    done, option, limit = 0.0, first, int(settings[2])
    while done < duration * (1.0 - 1e-9):
        step, share = next_step(h, done, duration)
        if state.step[f] <= 0.0:
            # there are no rates to go on with
            option = max(option, FOLLOW)
        radius = EULER if option == BACKWARD else settings[0]
        place = STAY if textbook else option
        factors = _predict(
            model, nodal, loads, f, share, step, radius, place, path, base, state, work
        )
        status, iterations, move = nodal_minimise(
            model, nodal, loads, f, share, factors, settings[1], limit, textbook, work
        )
        # each iteration has its matrix
        work_done = (iterations, iterations)
        now, target = work.now.points, work.around.target
        error = step_error(radius, step, now, state.acceleration[f], state.smoothed[f], target)
        verdict, h, option = judge(h, step, option, first, status, error, limits)
        count_try(counters, verdict, option, work_done, error, limits, move)
        if verdict == STEPS:
            _accept(f, step, radius, state, work)
            done += step
            h, option = after_step(step, option, first, error, limits, work_done)
        elif h == 0.0:
            return stop(counters, status)
    state.proposal[f] = h
    return CONVERGED
