"""One feather through one frame: error-controlled implicit steps, entirely compiled.

Several feathers of a batch through one frame, one after the other, in one call from Python.
"""

from featherfx.algebra.vector_kernels import (
    add,
    conjugate,
    copy_values,
    logarithm,
    multiply,
    normalised,
    over,
    same_sign,
    scale,
    store,
    store_rotation,
    sub,
)
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.air_kernels import blow_step
from featherfx.mechanics.barb_kernels import points_of
from featherfx.mechanics.vane_hook_kernels import copy_gaps, gaps_of, never_slip
from featherfx.solver.step.energy_kernels import (
    begin_bound,
    bound_step,
    damped_energy,
    slow_down,
    solved_energy,
    update_bound,
)
from featherfx.solver.step.gap_kernels import (
    DAMPED_ENERGY,
    MAX_STEP_SLIP,
    PASSED_ERROR_RATIO,
    barbs_pass,
    slip_gaps,
    weaken_gaps,
)
from featherfx.solver.step.integrator_kernels import (
    EULER,
    NODE_POINTS,
    begin_points,
    end_points,
    integrator_of,
    motion_of,
    step_error,
)
from featherfx.solver.step.newton_kernels import (
    UNKNOWN_CONVERGENCE,
    NewtonGoal,
    NewtonResult,
    accept_nearly_solved,
    load_convergence,
    minimise,
    next_convergence,
    store_convergence,
)
from featherfx.solver.step.pose_kernels import (
    keep_pose,
    load_pose,
    place_points,
    rebuild_centres,
    root_at,
    rotate_by,
)
from featherfx.solver.step.step_control_kernels import (
    EXTRAPOLATE,
    FOLLOW_ROOT,
    IMPLICIT_EULER,
    RECENT_WORK_WEIGHT,
    TAKEN,
    Attempt,
    Outcome,
    after_step,
    allowed_distance,
    attempt_work,
    count_attempt,
    judge_attempt,
    load_parts,
    min_step_length,
    next_step,
    record_failure,
    scale_settings,
    start_acceleration,
    work_after_failure,
)
from featherfx.solver.step.strain_kernels import (
    copy_strains,
    damping_over,
    relax_strains,
    set_reference_strains,
    strains_at,
)
from featherfx.solver.types import CONVERGED, GREW, NOT_CONVERGED, TOO_MUCH_WORK, IntegratorFactors

# of where Newton ends for a held feather, where it ends for one that flies
_FREE_TOLERANCE_RATIO = 0.1
# of the error that no step may have, within which all parts of a step but the last are solved
_PART_TOLERANCE_RATIO = 0.1
# of the last change of the rates, what a prediction adds to them: with all of it what iterations
# leave would grow with the square of the steps
_RATE_CHANGE_WEIGHT = 0.5


@kernel
def _extrapolate(model, f, attempt, state, work):
    """Predict the end of a step to work.now: the last step's rates go on, and so does a part of
    their change; stretches stay.

    The root of a held feather is already in place.
    """
    pose, h, bend = work.now, attempt.h, attempt.bend
    held, rates = model.held[f], state.coefficient_rate[f]
    for i in range(1 if held else 0, pose.rotation.shape[0]):
        spin = state.spin[f, i]
        ahead = add(spin, scale(bend, sub(spin, work.spin[i])))
        rotate_by(pose.rotation[i], ahead, h, pose.rotation[i])
    if not held:
        for k in range(3):
            pose.centre[0, k] += h * state.velocity.nodes[f, 0, 0, k]
    for side in range(2):
        for i in range(pose.rotation.shape[0]):
            for c in range(rates.shape[2]):
                change = rates[side, i, c] - work.coefficient_rate[side, i, c]
                pose.coefficient[side, i, c] += h * (rates[side, i, c] + bend * change)
    rebuild_centres(model.length[f], pose)


@kernel
def _follow_root(length, before, pose):
    """Predict the end of a step: the feather moves rigidly with its root.

    before: (4,) root quaternion at the step's start.
    """
    move = multiply(pose.rotation[0], conjugate(before))
    for i in range(1, pose.rotation.shape[0]):
        store_rotation(pose.rotation[i], normalised(multiply(move, pose.rotation[i])))
    rebuild_centres(length, pose)


@kernel
def _keep_rates(f, h, pose, state):
    """Rates of the coordinates over a step of h (s) from the state to a pose, for the next
    prediction."""
    before, coefficient = state.rotation[f], state.coefficient[f]
    for i in range(before.shape[0]):
        turned = multiply(pose.rotation[i], conjugate(before[i]))
        store(state.spin[f, i], over(logarithm(turned), h))
    for side in range(2):
        for i in range(before.shape[0]):
            for c in range(coefficient.shape[2]):
                change = pose.coefficient[side, i, c] - coefficient[side, i, c]
                state.coefficient_rate[f, side, i, c] = change / h


@kernel
def _place(model, f, path, attempt, state, work):
    """Coordinates of the pose work.now where feather f is expected at the end of a step."""
    before, h, now, expected = state.rotation[f, 0], attempt.h, work.now, work.trial.rotation[0]
    load_pose(model, f, state, now)
    if model.held[f]:
        rotate_by(before, state.spin[f, 0], h, expected)
        root_at(path, f, attempt.fraction, now.rotation[0], now.centre[0])
        same_sign(expected, now.rotation[0])
    if attempt.way != EXTRAPOLATE and model.held[f]:
        same_sign(before, now.rotation[0])
        _follow_root(model.length[f], before, now)
    else:
        _extrapolate(model, f, attempt, state, work)


@kernel
def _step_before(radius, before):
    """Return the step before for the strains' difference: that over two steps may put energy into
    strains that relax within a step."""
    return 0.0 if radius == EULER else before


@kernel
def _predict(model, loads, f, path, attempt, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator."""
    now, around, h, radius = work.now, work.around, attempt.h, attempt.spectral_radius
    begin_points(radius, h, state, f, around)
    steps = h, _step_before(radius, state.step[f])
    set_reference_strains(model, f, steps, strains_at(state.strains, f), around.reference)
    copy_values(state.strains.hinge[f, 0], around.angles)
    copy_gaps(gaps_of(state.gaps, f), around.gaps)
    _place(model, f, path, attempt, state, work)
    method = integrator_of(radius, h)
    if loads.air[0] > 0.0:
        place_points(model, f, now)
        motion = motion_of(state, f, NODE_POINTS)
        span = state.time[f] + h, h, method.rate, method.inertia
        blow_step(motion, now.points.nodes, span, state.spin[f, 0], loads, f, model, around)
    rachis, vane = (damping_over(model, f, 0, h, steps[1]), damping_over(model, f, 1, h, steps[1]))
    return IntegratorFactors(method.inertia, method.rate, rachis, vane)


@kernel
def _goal_of(model, f, attempt, settings):
    """Return how far Newton goes."""
    firm = attempt.way != EXTRAPOLATE
    if model.held[f]:
        return NewtonGoal(settings.newton, attempt.limit, attempt.pace, firm)
    # what is left of a step would be momentum that a feather in flight keeps for ever
    return NewtonGoal(
        _FREE_TOLERANCE_RATIO * settings.newton, attempt.limit, UNKNOWN_CONVERGENCE, firm
    )


@kernel
def _add_work(before, solved):
    """Return the NewtonResult of the last of two solves, with the work of both."""
    iterations, matrices = before.iterations + solved.iterations, before.matrices + solved.matrices
    return NewtonResult(solved.status, iterations, matrices, solved.move, solved.pace)


@kernel
def _aim_at_part(part, state, f, around):
    """Bring the targets of the surroundings nearer to the points of feather f."""
    for k in range(2):
        points, target = state.points[k][f], around.target[k]
        for i in range(target.shape[0]):
            for p in range(target.shape[1]):
                for axis in range(3):
                    x = points[i, p, axis]
                    target[i, p, axis] = x + part * (target[i, p, axis] - x)


@kernel
def _attempt_in_parts(model, loads, f, path, attempt, state, settings, work):
    """Solve a step as _attempt_step does, from the pose before it, with inertia and the way of the
    root put on in parts; returns what minimise does of the last one, with all work."""
    now, around = work.now, work.around
    before, factors = work.trial.rotation[0], _predict(model, loads, f, path, attempt, state, work)
    load_pose(model, f, state, now)
    solved, whole = (
        NewtonResult(CONVERGED, 0, 0, 0.0, UNKNOWN_CONVERGENCE),
        attempt.h / settings.duration,
    )
    for part in range(1, attempt.parts + 1):
        share = part / attempt.parts
        fraction = attempt.fraction - (1.0 - share) * whole
        copy_values(now.rotation[0], before)
        root_at(path, f, fraction, now.rotation[0], now.centre[0])
        same_sign(before, now.rotation[0])
        _follow_root(model.length[f], before, now)
        begin_points(attempt.spectral_radius, attempt.h, state, f, around)
        tolerance = settings.newton
        if part < attempt.parts:
            _aim_at_part(share, state, f, around)
            tolerance = max(tolerance, _PART_TOLERANCE_RATIO * settings.coarse)
        goal = NewtonGoal(tolerance, attempt.limit, UNKNOWN_CONVERGENCE, True)
        solved = _add_work(solved, minimise(model, loads, f, fraction, factors, goal, work))
        if solved.status not in (CONVERGED, NOT_CONVERGED):
            break
    return solved


@kernel
def _attempt_step(model, loads, f, path, attempt, state, settings, work):
    """Solve a step to work.now and check it; returns its Outcome."""
    h, radius, now, around = attempt.h, attempt.spectral_radius, work.now, work.around
    factors = _predict(model, loads, f, path, attempt, state, work)
    goal = _goal_of(model, f, attempt, settings)
    solved = minimise(model, loads, f, attempt.fraction, factors, goal, work)
    if solved.status != CONVERGED and attempt.parts > 0:
        again = _attempt_in_parts(model, loads, f, path, attempt, state, settings, work)
        solved = _add_work(solved, again)
    error = step_error(
        radius, h, motion_of(state, f, NODE_POINTS), now.points.nodes, around.target.nodes
    )
    slipped = slip_gaps(model, f, now.strains.cell, around.gaps, work.gaps) / MAX_STEP_SLIP
    before, after = state.points.nodes[f], now.points.nodes
    passed = barbs_pass(model, f, before, after, now.strains.cell, around.gaps)
    excess = max(error, settings.tolerance * max(slipped, PASSED_ERROR_RATIO if passed else 0.0))
    allowed = attempt.allowed if attempt.way == IMPLICIT_EULER else 0.0
    status = accept_nearly_solved(solved, excess, allowed)
    if status != solved.status:
        error, excess = max(error, solved.move), max(excess, solved.move)
    keeps, energy = 1.0, attempt.promise.energy
    if attempt.promise.alone and status == CONVERGED:
        growth = 0.0
        if radius != EULER and excess <= min(settings.tolerance, settings.coarse):
            growth = max(0.0, attempt.promise.most - attempt.promise.energy)
        relax_strains(model, f, h, now.strains, strains_at(state.strains, f), work.history)
        keeps, energy = solved_energy(model, loads, f, attempt.promise, growth, factors.rate, work)
        status = GREW if keeps < 0.0 else status
    pace = solved.pace if status == CONVERGED else UNKNOWN_CONVERGENCE
    numbers = solved.iterations, solved.matrices, solved.move
    return Outcome(status, *numbers, error, passed, slipped, excess, keeps, energy, pace)


@kernel
def _accept(model, f, attempt, state, work):
    """The solved step becomes the state, whose rates go to work; gaps that it brought to their
    strength give way.

    Returns what these release, J.
    """
    now, around, h = work.now, work.around, attempt.h
    released = weaken_gaps(model, f, now.strains.cell, around.gaps, work.gaps)
    history = strains_at(state.strains, f)
    relax_strains(model, f, h, now.strains, history, history)
    if not never_slip(around.gaps):
        steps = h, _step_before(attempt.spectral_radius, state.step[f])
        work.gaps.spent[DAMPED_ENERGY] += damped_energy(
            model, f, now.strains, around.reference, history, around.gaps, steps
        )
    copy_gaps(work.gaps, gaps_of(state.gaps, f))
    end_points(attempt.spectral_radius, h, state, f, now.points, around)
    copy_values(state.spin[f], work.spin)
    copy_values(state.coefficient_rate[f], work.coefficient_rate)
    _keep_rates(f, h, now, state)
    copy_strains(strains_at(history, 0), strains_at(history, 1))
    keep_pose(f, now, state)
    state.step[f] = h
    state.time[f] += h
    return released


@shared_kernel(int)
def advance_feather(model, loads, f, path, state, settings, work, report):
    """Bring feather f of the state through one frame, in place.

    path: RootPath. settings: StepSettings. report: StepReport, added to. Returns the status; if it
    is not CONVERGED the state is that of the last good step. How steps are repeated:
    step_control_kernels.
    """
    duration, left = settings.duration, settings.most_iterations
    proposed = 0.0 < state.proposal[f] <= duration and settings.shared == 0.0
    h = state.proposal[f] if proposed else duration
    done, taken, way, pace, before = 0.0, 0, EXTRAPOLATE, load_convergence(work.kept.pace), 0.0
    recent, begun = 0.0, left
    store_convergence(UNKNOWN_CONVERGENCE, work.kept.pace)
    found = UNKNOWN_CONVERGENCE
    promise = begin_bound(model, loads, f, path, duration, state, work.around)
    while done < duration * (1.0 - 1e-9):
        if left <= 0:
            return record_failure(report, f, TOO_MUCH_WORK)
        allowed, limit = allowed_distance(settings, left), min(settings.iterations, left)
        if allowed > 0.0 and left < settings.iterations:
            h, way, limit = duration - done, IMPLICIT_EULER, settings.iterations
        step, fraction = next_step(h, done, duration)
        if state.step[f] <= 0.0:
            way = max(way, FOLLOW_ROOT)  # there are no rates to go on with
        radius = EULER if way == IMPLICIT_EULER else settings.spectral_radius
        floor = min_step_length(settings, done, taken, left, recent)
        last = state.step[f]
        bend = _RATE_CHANGE_WEIGHT * (step + last) / (last + before) if before > 0.0 else 0.0
        promise = bound_step(promise, model, f, step, state, work.around)
        parts = load_parts(settings, way, left, model.held[f])
        attempt = Attempt(
            step, floor, fraction, way, radius, limit, promise, pace, bend, allowed, parts
        )
        outcome = _attempt_step(model, loads, f, path, attempt, state, settings, work)
        verdict, h, way = judge_attempt(h, EXTRAPOLATE, attempt, outcome, settings)
        count_attempt(report, f, verdict, attempt, outcome, settings)
        left, found = left - attempt_work(outcome), outcome.pace
        pace = next_convergence(outcome.iterations, found)
        if verdict == TAKEN:
            released = _accept(model, f, attempt, state, work)
            slow_down(outcome.keeps, promise.drift, points_of(state.velocity, f))
            promise, done = update_bound(promise, outcome.energy - released), done + step
            taken, before = taken + 1, last if pace.inertia > 0.0 else 0.0
            recent, begun = recent + RECENT_WORK_WEIGHT * (begun - left - recent), left
            h, way = after_step(EXTRAPOLATE, attempt, outcome, settings)
        elif h == 0.0:
            # no shorter one is solved either
            left, h = work_after_failure(settings, left), floor
            if left == 0:
                return record_failure(report, f, outcome.status)
            begun = left
    state.proposal[f] = h
    if work.kept.plain.shape[0] > 0:
        store_convergence(found, work.kept.pace)
    return CONVERGED


@kernel
def advance_feathers(model, loads, feathers, path, state, frame, work, report):
    """Bring feathers (K,) of the state through one frame, in place; those whose steps are yet to
    begin get their accelerations first.

    frame: StepSettings whose coarse is a part of a feather's length. Others as in advance.
    """
    for f in feathers:
        settings = scale_settings(frame, model.length[f])
        if state.step[f] == 0.0:
            start_acceleration(model, loads, f, path, settings, state, work)
        advance_feather(model, loads, f, path, state, settings, work, report)
