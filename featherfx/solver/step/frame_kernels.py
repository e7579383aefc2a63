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
from featherfx.solver.status import CONVERGED, GREW, TOO_MUCH_WORK
from featherfx.solver.step.energy_promise_kernels import (
    held_energy,
    promise_of,
    slow_down,
    solved_energy,
    with_energy,
)
from featherfx.solver.step.integrator_kernels import (
    EULER,
    Factors,
    begin_step,
    end_step,
    integrator_of,
    motion_of,
    step_error,
)
from featherfx.solver.step.newton_kernels import minimise, nearly_solved
from featherfx.solver.step.pose_kernels import chain, load_pose, material_points, turn_by
from featherfx.solver.step.retry_kernels import (
    BACKWARD,
    FOLLOW,
    GO_ON,
    TAKEN,
    Attempt,
    Outcome,
    after_step,
    count_try,
    judge,
    next_step,
    stop,
)
from featherfx.solver.step.root_kernels import root_at


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
def _place(model, loads, f, path, attempt, state, work):
    """Coordinates of work.now where feather f is expected at the end of a step."""
    now, length, h = work.now, model.length[f], attempt.h
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], length, now)
    if model.held[f]:
        turn_by(state.turn[f, 0], state.spin[f, 0], h, work.trial.turn[0])
        root_at(path, f, attempt.fraction, now.turn[0], now.centre[0])
        same_sign(work.trial.turn[0], now.turn[0])
    if attempt.way != GO_ON and model.held[f]:
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


@kernel
def _predict(model, loads, f, path, attempt, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator."""
    now, around, h, radius = work.now, work.around, attempt.h, attempt.spectral_radius
    begin_step(radius, h, motion_of(state, f), around.target, around.past)
    # the two-step difference may put energy into strains that relax within a step
    before = 0.0 if radius == EULER else state.step[f]
    strain_rate = strain_rate_of(h, before, state.strains[f], around.reference)
    _place(model, loads, f, path, attempt, state, work)
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
    method = integrator_of(radius, h)
    return Factors(method.inertia, method.rate, strain_rate)


@kernel
def _try(model, loads, f, path, attempt, state, settings, work):
    """Solve a step to work.now and check it; returns its Outcome."""
    h, radius, now, target = attempt.h, attempt.spectral_radius, work.now, work.around.target
    factors = _predict(model, loads, f, path, attempt, state, work)
    solved = minimise(
        model, loads, f, attempt.fraction, factors, settings.newton, attempt.limit, work
    )
    error = step_error(radius, h, motion_of(state, f), now.points, target)
    status, keeps, energy = nearly_solved(solved, attempt.limit, error), 1.0, attempt.promise.energy
    if attempt.promise.alone and status == CONVERGED:
        growth = 0.0
        if radius != EULER and error <= min(settings.tolerance, settings.coarse):
            growth = held_energy(model.mass[f], h, attempt.promise.drift, motion_of(state, f))
        keeps, energy = solved_energy(
            model, loads, f, attempt.promise, growth, factors.rate, now, work.around.past
        )
        status = GREW if keeps < 0.0 else status
    return Outcome(status, solved.iterations, solved.matrices, solved.move, error, keeps, energy)


@kernel
def _accept(f, attempt, state, now, around):
    """The solved step becomes the state."""
    h = attempt.h
    end_step(
        attempt.spectral_radius, h, motion_of(state, f), now.points, around.target, around.past
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
def advance(model, loads, f, path, state, settings, work, report):
    """Bring feather f of the state through one frame, in place.

    path: RootPath. settings: StepSettings. report: StepReport, added to. Returns the status; if it
    is not CONVERGED the state is that of the last good step. How steps are repeated:
    retry_kernels.
    """
    duration, left = settings.duration, settings.most_iterations
    h = state.proposal[f] if 0.0 < state.proposal[f] <= duration else duration
    done, way = 0.0, GO_ON
    promise = promise_of(model, loads, f, path, duration, state)
    while done < duration * (1.0 - 1e-9):
        if left <= 0:
            return stop(report, f, TOO_MUCH_WORK)
        step, fraction = next_step(h, done, duration)
        if state.step[f] <= 0.0:
            way = max(way, FOLLOW)  # there are no rates to go on with
        radius = EULER if way == BACKWARD else settings.spectral_radius
        attempt = Attempt(step, fraction, way, radius, min(settings.iterations, left), promise)
        outcome = _try(model, loads, f, path, attempt, state, settings, work)
        verdict, h, way = judge(h, GO_ON, attempt, outcome, settings)
        count_try(report, f, verdict, attempt, outcome, settings)
        left -= outcome.iterations
        if verdict == TAKEN:
            _accept(f, attempt, state, work.now, work.around)
            slow_down(outcome.keeps, promise.drift, state.velocity[f])
            promise, done = with_energy(promise, outcome.energy), done + step
            h, way = after_step(GO_ON, attempt, outcome, settings)
        elif h == 0.0:
            return stop(report, f, outcome.status)
    state.proposal[f] = h
    return CONVERGED
