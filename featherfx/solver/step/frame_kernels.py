"""One feather through one frame: error-controlled implicit steps, entirely compiled."""

from featherfx.algebra.copy_kernels import copy_values
from featherfx.algebra.rotation_kernels import (
    conjugate,
    logarithm,
    multiply,
    normalised,
    same_sign,
    store_rotation,
)
from featherfx.algebra.vec3_kernels import over, store
from featherfx.jit.compiled import kernel
from featherfx.mechanics.node_kernels import blow
from featherfx.solver.step.check_kernels import check_promise, energy_promise, nearly_solved
from featherfx.solver.step.energy_promise_kernels import slow_down
from featherfx.solver.step.integrator_kernels import (
    EULER,
    begin_step,
    end_step,
    integrator_coefficients,
    step_error,
)
from featherfx.solver.step.newton_kernels import CONVERGED, TOO_MUCH_WORK, minimise
from featherfx.solver.step.pose_kernels import chain, load_pose, material_points, turn_by
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

# share of the feather's length that the error of a step may not exceed where it can be shorter
COARSE = 0.01


@kernel
def _rebuild_centres(length, pose):
    """Rachis points from the root, the frames and the stretches in pose.rachis."""
    for i in range(pose.turn.shape[0] - 1):
        chain(
            pose.turn[i],
            pose.turn[i + 1],
            pose.rachis[i],
            length[i],
            pose.centre[i],
            pose.centre[i + 1],
        )


@kernel
def _go_on(h, held, spin, coefficient_rate, velocity, length, pose):
    """Predict the end of a step: the last step's rates go on, stretches stay.

    The root of a held feather is already in place. spin: (n, 3), velocity: (3,) of the root.
    """
    for i in range(1 if held else 0, pose.turn.shape[0]):
        turn_by(pose.turn[i], spin[i], h, pose.turn[i])
    if not held:
        for k in range(3):
            pose.centre[0, k] += h * velocity[k]
    for side in range(2):
        for i in range(pose.turn.shape[0]):
            for c in range(coefficient_rate.shape[2]):
                pose.coefficient[side, i, c] += h * coefficient_rate[side, i, c]
    _rebuild_centres(length, pose)


@kernel
def _follow_root(before, length, pose):
    """Predict the end of a step: the feather moves rigidly with its root.

    before: (4,) root quaternion at the step's start.
    """
    move = multiply(pose.turn[0], conjugate(before))
    for i in range(1, pose.turn.shape[0]):
        store_rotation(pose.turn[i], normalised(multiply(move, pose.turn[i])))
    _rebuild_centres(length, pose)


@kernel
def strain_rate_of(h, before, strains, reference):
    """Rate of the backward difference of strains (2, S); its reference is written (S,).

    before: s, length of the last step, 0 for the one-step difference.
    """
    if before <= 0.0:
        copy_values(strains[0], reference)
        return 1.0 / h
    r = h / before
    lead = (1.0 + 2.0 * r) / (1.0 + r)
    for s in range(reference.shape[0]):
        reference[s] = ((1.0 + r) * strains[0, s] - r * r / (1.0 + r) * strains[1, s]) / lead
    return lead / h


@kernel
def _keep_rates(h, pose, before, spin, coefficient, coefficient_rate):
    """Rates of the coordinates over the step just taken, for the next prediction.

    before: (n, 4) quaternions and coefficient: (2, n, 2 C), at the step's start.
    """
    for i in range(before.shape[0]):
        store(spin[i], over(logarithm(multiply(pose.turn[i], conjugate(before[i]))), h))
    for side in range(2):
        for i in range(before.shape[0]):
            for c in range(coefficient.shape[2]):
                change = pose.coefficient[side, i, c] - coefficient[side, i, c]
                coefficient_rate[side, i, c] = change / h


@kernel
def _predict(model, loads, f, share, h, radius, follow, path, base, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator."""
    now, around, length = work.now, work.around, model.length[f]
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], length, now)
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
    # the two-step difference may put energy into strains that relax within a step
    before = 0.0 if radius == EULER else state.step[f]
    strain_rate = strain_rate_of(h, before, state.strains[f], around.reference)
    if model.held[f]:
        turn_by(state.turn[f, 0], state.spin[f, 0], h, work.trial.turn[0])
        root_at(path, base, share, now.turn[0], now.centre[0])
        same_sign(work.trial.turn[0], now.turn[0])
    if follow and model.held[f]:
        same_sign(state.turn[f, 0], now.turn[0])
        _follow_root(state.turn[f, 0], length, now)
    else:
        _go_on(
            h,
            model.held[f],
            state.spin[f],
            state.coefficient_rate[f],
            state.velocity[f, 0, 0],
            length,
            now,
        )
    if loads.air[0] > 0.0:
        material_points(model, f, now.turn, now.centre, now.coefficient, now.frames, now.points)
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
def _accept(f, h, radius, state, now, around):
    """The solved step becomes the state."""
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
    _keep_rates(
        h, now, state.turn[f], state.spin[f], state.coefficient[f], state.coefficient_rate[f]
    )
    copy_values(now.turn, state.turn[f])
    copy_values(now.centre, state.centre[f])
    copy_values(now.coefficient, state.coefficient[f])
    copy_values(now.points, state.points[f])
    copy_values(state.strains[f, 0], state.strains[f, 1])
    copy_values(now.strains, state.strains[f, 0])
    state.step[f] = h
    state.time[f] += h


@kernel
def _attempt(model, loads, f, how, root, state, aims, energy, work):
    """Solve a step to work.now and check it.

    how: (length s, share of the frame at its end, option, spectral radius, most iterations). root:
    its path and base. aims: (Newton tolerance m, limits of judge, what energy_promise gave).
    Returns (status, (iterations, of them with a new matrix), distance from the solution m, error m,
    share of its velocities that the step may keep, energy after it J).
    """
    h, share, option, radius, most = how
    path, base = root
    newton, limits, promise = aims
    factors = _predict(model, loads, f, share, h, radius, option != GO_ON, path, base, state, work)
    status, iterations, move, matrices = minimise(
        model, loads, f, share, factors, newton, most, work
    )
    now, target = work.now.points, work.around.target
    error = step_error(radius, h, now, state.acceleration[f], state.smoothed[f], target)
    status = nearly_solved(status, iterations == most, move, error)
    status, keeps, after = check_promise(
        model, loads, f, h, radius, status, error, limits, promise, energy, factors[1], state, work
    )
    return status, (iterations, matrices), move, error, keeps, after


@kernel
def coarse_error(length):
    """The error (m) that no step may have where it can be shorter; length: (n-1,) m, of rows."""
    total = 0.0
    for i in range(length.shape[0]):
        total += COARSE * length[i]
    return total


@kernel
def advance(model, loads, f, duration, path, base, state, settings, work, counters):
    """Bring feather f of the state through one frame of the given duration (s), in place.

    path (K, 6), base (4,): root_kernels. settings: (spectral radius, Newton tolerance m, most
    iterations of an attempt, error tolerance per step m, shortest regular step s, most iterations
    of the call). counters: (COUNTERS,), added to. Returns the Newton status or GREW; if it is not
    CONVERGED the state is that of the last good step. How steps are repeated: retry_kernels.
    """
    limits = (min(settings[4], duration), settings[3], coarse_error(model.length[f]), HARD)
    h = state.proposal[f] if 0.0 < state.proposal[f] <= duration else duration
    done, option, left = 0.0, GO_ON, int(settings[5])
    promise, energy = energy_promise(model, loads, f, path, duration, state)
    while done < duration * (1.0 - 1e-9):
        if left <= 0:
            return stop(counters, TOO_MUCH_WORK)
        step, share = next_step(h, done, duration)
        if state.step[f] <= 0.0:
            option = max(option, FOLLOW)  # there are no rates to go on with
        radius, limit = EULER if option == BACKWARD else settings[0], min(int(settings[2]), left)
        how, aims = (step, share, option, radius, limit), (settings[1], limits, promise)
        status, effort, move, error, keeps, after = _attempt(
            model, loads, f, how, (path, base), state, aims, energy, work
        )
        verdict, h, option = judge(h, step, option, GO_ON, status, error, limits)
        count_try(counters, verdict, option, effort, error, limits, move)
        left -= effort[0]
        if verdict == STEPS:
            _accept(f, step, radius, state, work.now, work.around)
            slow_down(keeps, promise[1], state.velocity[f])
            energy, done = after, done + step
            h, option = after_step(step, option, GO_ON, error, limits, effort)
        elif h == 0.0:
            return stop(counters, status)
    state.proposal[f] = h
    return CONVERGED
