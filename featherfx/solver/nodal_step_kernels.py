"""One feather of the nodal kinematics through one frame, and to rest."""

from featherfx.compiled import kernel
from featherfx.mechanics.copy_kernels import copy_values
from featherfx.mechanics.node_kernels import blow
from featherfx.mechanics.rotations_kernels import logarithm, multiply, normalised, rotate
from featherfx.solver.integrator_kernels import (
    EULER,
    begin_step,
    end_step,
    integrator_coefficients,
    step_error,
)
from featherfx.solver.newton_kernels import CONVERGED, NOT_CONVERGED
from featherfx.solver.nodal_assembly_kernels import nodal_assemble
from featherfx.solver.nodal_newton_kernels import evaluate, gather, nodal_minimise, set_directors
from featherfx.solver.pose_kernels import turn_by
from featherfx.solver.root_kernels import root_at
from featherfx.solver.settle_kernels import FIRST, GROWTH, LAST, SHORTEST
from featherfx.solver.step_kernels import (
    ERROR,
    FAILED,
    FALLBACKS,
    ITERATIONS,
    MOVE,
    REJECTED,
    SMALLEST_SHARE,
    STATUS,
    STEPS,
    _strain_rate,
)


@kernel
def _pin(nodal, f, pose, turn, centre):
    """Put what is prescribed where the root says; turn: (4,), centre: (3,) of the root.

    The frame and point of row 0 may be turn and centre themselves.
    """
    w, x, y, z = turn[0], turn[1], turn[2], turn[3]
    cx, cy, cz = centre[0], centre[1], centre[2]
    slot = nodal.slot[f]
    for i in range(slot.shape[0]):
        if slot[i, 1] < 0:
            t = nodal.rest_turn[f, i]
            a, b, c, d = multiply(w, x, y, z, t[0], t[1], t[2], t[3])
            out = pose.turn[i]
            out[0], out[1], out[2], out[3] = normalised(a, b, c, d)
        for p in range(slot.shape[1]):
            if slot[i, p] < 0 and p != 1 and p != 2:
                r = nodal.rest_points[f, i, p]
                px, py, pz = rotate(w, x, y, z, r[0], r[1], r[2])
                q = pose.points[i, p]
                q[0], q[1], q[2] = cx + px, cy + py, cz + pz


@kernel
def _load(state, f, work):
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
    w, x, y, z = multiply(
        turn[0], turn[1], turn[2], turn[3], before[0], -before[1], -before[2], -before[3]
    )
    sx, sy, sz = start[0], start[1], start[2]
    for i in range(pose.turn.shape[0]):
        t = pose.turn[i]
        a, b, c, d = multiply(w, x, y, z, t[0], t[1], t[2], t[3])
        t[0], t[1], t[2], t[3] = normalised(a, b, c, d)
        for p in range(pose.points.shape[1]):
            if p != 1 and p != 2:
                q = pose.points[i, p]
                px, py, pz = rotate(w, x, y, z, q[0] - sx, q[1] - sy, q[2] - sz)
                q[0], q[1], q[2] = centre[0] + px, centre[1] + py, centre[2] + pz


@kernel
def _predict(model, nodal, loads, f, share, h, radius, option, path, base, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator.

    option: 0 rates go on, 1 rigidly with the root, 2 the last pose.
    """
    now, around = work.now, work.around
    _load(state, f, work)
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
    strain_rate = _strain_rate(h, state.step[f], state.strains[f], around.reference)
    if option == 0:
        _go_on(h, nodal.slot[f], state.spin[f], state.velocity[f], now)
    if model.held[f]:
        # scratch of the elements, which are not in use yet
        turn, centre = work.element.matrix[0], work.element.matrix[1]
        root_at(path, base, share, turn, centre)
        if option == 1:
            _follow_root(state.turn[f, 0], state.points[f, 0, 0], turn, centre, now)
        _pin(nodal, f, now, turn, centre)
    gather(nodal.present[f], now.points)
    set_directors(now.turn, now.points)
    if loads.air[0] > 0.0:
        blow(
            now.points,
            state.time[f] + h,
            loads,
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
        a, b = now.turn[i], state.turn[f, i]
        w, x, y, z = multiply(a[0], a[1], a[2], a[3], b[0], -b[1], -b[2], -b[3])
        x, y, z = logarithm(w, x, y, z)
        spin = state.spin[f, i]
        spin[0], spin[1], spin[2] = x / h, y / h, z / h
    copy_values(state.strains[f, 0], state.strains[f, 1])
    _keep(f, state, work)
    state.step[f] = h
    state.time[f] += h


@kernel
def _keep(f, state, work):
    """Pose, strains and multipliers of work to the state."""
    copy_values(work.now.turn, state.turn[f])
    copy_values(work.now.points, state.points[f])
    copy_values(work.now.strains, state.strains[f, 0])
    copy_values(work.multiplier, state.multiplier[f])


@kernel
def _solve_step(
    model, nodal, loads, f, share, h, path, base, state, settings, textbook, work, counters
):
    """Try a step from the predicted pose, then from the rigidly moved one, then by implicit Euler.

    The textbook method starts at the last pose. Returns (status, spectral radius that worked).
    """
    status, radius = NOT_CONVERGED, settings[0]
    if state.step[f] <= 0.0:
        # no acceleration is known yet; see featherfx/solver/step_kernels.py
        radius = EULER
    for attempt in range(3):
        if attempt == 0 and state.step[f] <= 0.0 and not textbook:
            continue
        if textbook and attempt == 1:
            continue
        if attempt == 2:
            radius = EULER
            counters[FALLBACKS] += 1
        option = 2 if textbook else min(attempt, 1)
        factors = _predict(
            model, nodal, loads, f, share, h, radius, option, path, base, state, work
        )
        status, iterations, move = nodal_minimise(
            model, nodal, loads, f, share, factors, settings[1], int(settings[2]), textbook, work
        )
        counters[ITERATIONS] += iterations
        if status == CONVERGED:
            counters[MOVE] = max(counters[MOVE], move)
            break
        counters[FAILED] += 1
    return status, radius


@kernel
def nodal_advance(
    model, nodal, loads, f, duration, path, base, state, settings, textbook, work, counters
):
    """Bring feather f of the state through one frame of the given duration (s), in place.

    As advance of featherfx/solver/step_kernels.py, which explains path, base, settings, counters
    and the status that is returned.
    """
    shortest = min(settings[4], duration)
    h = state.proposal[f]
    if h <= 0.0 or h > duration:
        h = duration
    done = 0.0
    while done < duration * (1.0 - 1e-9):
        left = duration - done
        step = left if h > 0.999 * left else (0.5 * left if h > 0.6 * left else h)
        share = 1.0 if step == left else (done + step) / duration
        status, radius = _solve_step(
            model,
            nodal,
            loads,
            f,
            share,
            step,
            path,
            base,
            state,
            settings,
            textbook,
            work,
            counters,
        )
        if status != CONVERGED:
            h = 0.5 * step
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
            h = max(shortest, step * max(0.2, change))
            continue
        _accept(f, step, radius, state, work)
        done += step
        counters[STEPS] += 1
        counters[ERROR] = max(counters[ERROR], error)
        h = max(shortest, step * min(2.0, max(0.5, change)))
    state.proposal[f] = h
    return CONVERGED


@kernel
def nodal_settle(model, nodal, loads, f, share, state, tolerance, limit, most, textbook, work):
    """Bring feather f of the state to rest, in place, by ever longer implicit Euler steps.

    As settle of featherfx/solver/settle_kernels.py. Returns (status, iterations).
    """
    around, now = work.around, work.now
    around.reference[:] = 0.0
    state.velocity[f] = 0.0
    state.acceleration[f] = 0.0
    state.smoothed[f] = 0.0
    state.spin[f] = 0.0
    state.step[f] = 0.0
    h = FIRST
    iterations = 0
    status = CONVERGED
    for _ in range(most):
        _load(state, f, work)
        copy_values(now.points, around.target)
        copy_values(now.points, around.past)
        if loads.air[0] > 0.0:
            blow(
                now.points, state.time[f], loads, state.velocity[f], model.cell_stiffness[f], around
            )
        factors = (1.0 / (h * h), 1.0 / h, 0.0)
        status, count, _ = nodal_minimise(
            model, nodal, loads, f, share, factors, tolerance, limit, textbook, work
        )
        iterations += count
        if status != CONVERGED:
            h *= 0.25
            if h < SHORTEST:
                break
            continue
        _keep(f, state, work)
        if h >= LAST:
            break
        h *= GROWTH
    copy_values(state.strains[f, 0], state.strains[f, 1])
    return status, iterations


@kernel
def nodal_gradient(model, nodal, loads, f, inertia, state, work):
    """Assemble at feather f's pose of the state: work.system holds Hessian and minus gradient.

    inertia: 1/s^2, times the mass about the pose itself; 0 for the stiffness alone. Geometric
    stiffness is that of the pose's own stresses. Returns the energy (J).
    """
    from_state, around = work.now, work.around
    _load(state, f, work)
    copy_values(from_state.points, around.target)
    copy_values(from_state.points, around.past)
    around.reference[:] = 0.0
    factors = (inertia, 0.0, 0.0)
    energy = evaluate(model, nodal, loads, f, 0.0, factors, from_state, work)
    nodal_assemble(model, nodal, loads, f, 0.0, factors, True, from_state.strains, work)
    return energy
