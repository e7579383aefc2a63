"""One feather through one frame: error-controlled implicit steps, entirely compiled."""

from featherfx.compiled import kernel
from featherfx.mechanics.copy_kernels import copy_values
from featherfx.mechanics.node_kernels import blow
from featherfx.mechanics.rotations_kernels import logarithm, multiply, normalised, same_sign
from featherfx.solver.integrator_kernels import (
    EULER,
    begin_step,
    end_step,
    integrator_coefficients,
    step_error,
)
from featherfx.solver.newton_kernels import CONVERGED, TOO_MUCH_WORK, minimise
from featherfx.solver.pose_kernels import chain, load_pose, material_points, turn_by
from featherfx.solver.root_kernels import root_at

# columns of a feather's counters
STEPS, ITERATIONS, MATRICES, REJECTED, FAILED, FALLBACKS, FORCED, ERROR, MOVE, STATUS = range(10)
COUNTERS = 10
# error over tolerance beyond which a step that may not be shorter is taken by implicit Euler
LOST = 30.0
# and as a share of the feather's length: beyond it even such a step is cut
COARSE = 0.01
# Newton iterations beyond which the next step is not made longer
HARD = 12
# how a step is tried, in this order
GO_ON, FOLLOW, BACKWARD = 0, 1, 2
# a regular step may be cut this far when Newton fails, by this share each time
SMALLEST_SHARE, CUT = 1e6, 0.25


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
    now = pose.turn[0]
    w, x, y, z = multiply(
        now[0], now[1], now[2], now[3], before[0], -before[1], -before[2], -before[3]
    )
    for i in range(1, pose.turn.shape[0]):
        t = pose.turn[i]
        a, b, c, d = multiply(w, x, y, z, t[0], t[1], t[2], t[3])
        t[0], t[1], t[2], t[3] = normalised(a, b, c, d)
    _rebuild_centres(length, pose)


@kernel
def _strain_rate(h, before, strains, reference):
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
        a, b = pose.turn[i], before[i]
        w, x, y, z = multiply(a[0], a[1], a[2], a[3], b[0], -b[1], -b[2], -b[3])
        x, y, z = logarithm(w, x, y, z)
        spin[i, 0], spin[i, 1], spin[i, 2] = x / h, y / h, z / h
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
    strain_rate = _strain_rate(h, before, state.strains[f], around.reference)
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
        material_points(model, f, now.turn, now.centre, now.coefficient, now.points)
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
def advance(model, loads, f, duration, path, base, state, settings, work, counters):
    """Bring feather f of the state through one frame of the given duration (s), in place.

    path (K, 6), base (4,): root_kernels. settings: (spectral radius, Newton tolerance m, most
    iterations of an attempt, error tolerance per step m, shortest regular step s, most iterations
    of the call). counters: (COUNTERS,), added to. Returns the Newton status; if it is not
    CONVERGED the state is that of the last good step.

    A step is tried from the predicted pose, then from the rigidly moved one, then by implicit
    Euler, and is then cut. Steps that were cut grow again from their own length, by implicit Euler
    if that was needed, because where Newton failed it mostly fails again at once. Implicit Euler is
    also taken where the shortest step misses the tolerance by far: the other method may gain energy
    from motions that it does not resolve.
    """
    shortest = min(settings[4], duration)
    h = state.proposal[f]
    if h <= 0.0 or h > duration:
        h = duration
    coarse = 0.0
    for i in range(model.length.shape[1]):
        coarse += COARSE * model.length[f, i]
    done, option, spent = 0.0, GO_ON, 0
    while done < duration * (1.0 - 1e-9):
        limit = min(int(settings[2]), int(settings[5]) - spent)
        if limit <= 0:
            counters[STATUS] = TOO_MUCH_WORK
            return TOO_MUCH_WORK
        left = duration - done
        step = left if h > 0.999 * left else (0.5 * left if h > 0.6 * left else h)
        share = 1.0 if step == left else (done + step) / duration
        radius = settings[0]
        if state.step[f] <= 0.0:
            # there are no rates to go on with
            option = max(option, FOLLOW)
        if option == BACKWARD:
            radius = EULER
        factors = _predict(
            model, loads, f, share, step, radius, option != GO_ON, path, base, state, work
        )
        status, iterations, move, matrices = minimise(
            model, loads, f, share, factors, settings[1], limit, work
        )
        spent += iterations
        counters[ITERATIONS] += iterations
        counters[MATRICES] += matrices
        if status != CONVERGED:
            counters[FAILED] += 1
            option = BACKWARD if step < 0.999 * shortest and option < BACKWARD else option + 1
            if option > BACKWARD:
                h, option = CUT * step, GO_ON
                if h < shortest / SMALLEST_SHARE:
                    counters[STATUS] = status
                    return status
            continue
        error = step_error(
            radius,
            step,
            work.now.points,
            state.acceleration[f],
            state.smoothed[f],
            work.around.target,
        )
        change = 0.9 * (settings[3] / max(error, 1e-30)) ** (1.0 / 3.0)
        if error > settings[3] and step > 1.001 * shortest:
            counters[REJECTED] += 1
            h, option = max(shortest, step * max(0.2, change)), GO_ON
            continue
        lost = error > LOST * settings[3]
        if lost and option != BACKWARD:
            counters[REJECTED] += 1
            option = BACKWARD
            continue
        if lost and error > coarse and CUT * step > shortest / SMALLEST_SHARE:
            counters[REJECTED] += 1
            h = CUT * step
            continue
        _accept(f, step, radius, state, work.now, work.around)
        done += step
        counters[STEPS] += 1
        counters[FALLBACKS] += 1 if option == BACKWARD else 0
        counters[FORCED] += 1 if error > settings[3] else 0
        counters[ERROR] = max(counters[ERROR], error)
        counters[MOVE] = max(counters[MOVE], move)
        option = BACKWARD if option == BACKWARD and step < 0.999 * shortest else GO_ON
        most = 1.0 if iterations > HARD or lost else 2.0
        h = max(min(shortest, most * step), step * min(most, max(0.5, change)))
    state.proposal[f] = h
    return CONVERGED
