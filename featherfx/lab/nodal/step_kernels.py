"""One feather of the nodal kinematics through one frame."""

from typing import NamedTuple

from featherfx.algebra.vector_kernels import (
    accumulate,
    add,
    conjugate,
    copy_values,
    logarithm,
    multiply,
    normalised,
    over,
    rotate,
    same_sign,
    store,
    store_rotation,
    sub,
)
from featherfx.jit.compiled import kernel
from featherfx.lab.nodal.newton_kernels import Minimiser, gather, nodal_minimise, set_directors
from featherfx.mechanics.air_kernels import blow_step
from featherfx.mechanics.barb_kernels import copy_points, points_of
from featherfx.solver.state import RootPath
from featherfx.solver.step.energy_kernels import EnergyBound
from featherfx.solver.step.integrator_kernels import (
    EULER,
    NODE_POINTS,
    begin_points,
    end_points,
    integrator_of,
    motion_of,
    step_error,
)
from featherfx.solver.step.newton_kernels import UNKNOWN_CONVERGENCE
from featherfx.solver.step.pose_kernels import root_at, rotate_by
from featherfx.solver.step.step_control_kernels import (
    EXTRAPOLATE,
    FOLLOW_ROOT,
    IMPLICIT_EULER,
    TAKEN,
    Attempt,
    Outcome,
    after_step,
    count_attempt,
    judge_attempt,
    next_step,
    record_failure,
)
from featherfx.solver.step.strain_kernels import damping_over, relax, set_reference
from featherfx.solver.types import CONVERGED, IntegratorFactors, StepSettings

# beside the ways of solver/step/step_control_kernels.py: start at the last pose
_STAY = -1


class NodalFrame(NamedTuple):
    """Input of a frame: the roots' path, the settings and the method of its steps."""

    path: RootPath
    settings: StepSettings
    textbook: bool


@kernel
def _pin(nodal, f, pose, rotation, centre):
    """Put what is prescribed where the root says; rotation: (4,), centre: (3,) of the root.

    The frame and point of row 0 may be rotation and centre themselves.
    """
    root = rotation[0], rotation[1], rotation[2], rotation[3]
    place = centre[0], centre[1], centre[2]
    slot = nodal.slot[f]
    for i in range(slot.shape[0]):
        if nodal.frame_slot[f, i] < 0:
            store_rotation(pose.rotation[i], normalised(multiply(root, nodal.rest_rotation[f, i])))
        for p in range(slot.shape[1]):
            if slot[i, p] < 0:
                node = add(place, rotate(root, nodal.rest_nodes[f, i, p]))
                store(pose.points.nodes[i, p], node)


@kernel
def load_state(state, f, work):
    """The state's pose and multipliers to work.now."""
    copy_values(state.rotation[f], work.now.rotation)
    copy_points(points_of(state.points, f), work.now.points)
    copy_values(state.multiplier[f], work.multiplier)
    copy_values(state.strains[f, 0], work.before)


@kernel
def _go_on(h, nodal, f, state, pose):
    """Predict the end of a step: the last step's rates go on."""
    slot, nodes = nodal.slot[f], pose.points.nodes
    for i in range(slot.shape[0]):
        if nodal.frame_slot[f, i] >= 0:
            rotate_by(pose.rotation[i], state.spin[f, i], h, pose.rotation[i])
        for p in range(slot.shape[1]):
            if slot[i, p] >= 0:
                accumulate(nodes[i, p], h, state.velocity.nodes[f, i, p])


@kernel
def _follow_root(before, start, rotation, centre, pose):
    """Predict the end of a step: the feather moves rigidly with its root.

    before (4,), start (3,): root at the step's start; rotation, centre: at its end.
    """
    move = multiply(rotation, conjugate(before))
    for i in range(pose.rotation.shape[0]):
        store_rotation(pose.rotation[i], normalised(multiply(move, pose.rotation[i])))
        for point in pose.points.nodes[i]:
            store(point, add(centre, rotate(move, sub(point, start))))


@kernel
def _predict(model, nodal, loads, f, path, attempt, state, work):
    """Set up a step: pose work.now, surroundings; returns the factors of the integrator.

    attempt.way: EXTRAPOLATE: the rates go on, _STAY: the last pose, else rigidly with the root.
    """
    now, around, h, way = work.now, work.around, attempt.h, attempt.way
    load_state(state, f, work)
    begin_points(attempt.spectral_radius, h, state, f, around)
    history, first = state.strains[f], 6 * (now.rotation.shape[0] - 1)
    steps, last = (h, state.step[f]), history.shape[1]
    set_reference(model, f, 0, steps, (0, first), history, around.reference)
    set_reference(model, f, 1, steps, (first, last), history, around.reference)
    if way == EXTRAPOLATE:
        _go_on(h, nodal, f, state, now)
    if model.held[f]:
        # scratch of the elements, which are not in use yet
        rotation, centre = work.element.matrix[0], work.element.matrix[1]
        root_at(path, f, attempt.fraction, rotation, centre)
        same_sign(state.rotation[f, 0], rotation)
        if way >= FOLLOW_ROOT:
            _follow_root(state.rotation[f, 0], state.points.nodes[f, 0, 0], rotation, centre, now)
        _pin(nodal, f, now, rotation, centre)
    gather(nodal.present[f], now.points.nodes)
    set_directors(now)
    method = integrator_of(attempt.spectral_radius, h)
    if loads.air[0] > 0.0:
        motion = motion_of(state, f, NODE_POINTS)
        span = state.time[f] + h, h, method.rate, method.inertia
        blow_step(motion, now.points.nodes, span, state.spin[f, 0], loads, f, model, around)
    rachis = damping_over(model, f, 0, h, state.step[f])
    vane = damping_over(model, f, 1, h, state.step[f])
    return IntegratorFactors(method.inertia, method.rate, rachis, vane)


@kernel
def _accept(model, f, attempt, state, work):
    """The solved step becomes the state."""
    now, around, h = work.now, work.around, attempt.h
    end_points(attempt.spectral_radius, h, state, f, now.points, around)
    for i in range(now.rotation.shape[0]):
        change = multiply(now.rotation[i], conjugate(state.rotation[f, i]))
        store(state.spin[f, i], over(logarithm(change), h))
    history, first = state.strains[f], 6 * (now.rotation.shape[0] - 1)
    relax(model, f, 0, h, (0, first), now.strains, history, history)
    relax(model, f, 1, h, (first, history.shape[1]), now.strains, history, history)
    copy_values(history[0], history[1])
    keep_state(f, state, work)
    state.step[f] = h
    state.time[f] += h


@kernel
def keep_state(f, state, work):
    """Pose, strains and multipliers of work to the state."""
    copy_values(work.now.rotation, state.rotation[f])
    copy_points(work.now.points, points_of(state.points, f))
    copy_values(work.now.strains, state.strains[f, 0])
    copy_values(work.multiplier, state.multiplier[f])


@kernel
def nodal_advance(model, nodal, loads, f, frame, state, work, report):
    """Bring feather f of the state through one frame, in place.

    As advance of solver/step/frame_kernels.py, which explains report and the status that is
    returned. frame: NodalFrame.
    """
    settings, textbook, duration = frame.settings, frame.textbook, frame.settings.duration
    method = Minimiser(settings.newton, settings.iterations, textbook)
    h = state.proposal[f] if 0.0 < state.proposal[f] <= duration else duration
    # the textbook method begins every step at the last pose, so there is nothing else to try
    first = FOLLOW_ROOT if textbook else EXTRAPOLATE
    done, way = 0.0, first
    promise = EnergyBound(False, (0.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    while done < duration * (1.0 - 1e-9):
        step, fraction = next_step(h, done, duration)
        if state.step[f] <= 0.0:
            # there are no rates to go on with
            way = max(way, FOLLOW_ROOT)
        radius = EULER if way == IMPLICIT_EULER else settings.spectral_radius
        floor, limit = settings.shortest, settings.iterations
        attempt = Attempt(
            step, floor, fraction, way, radius, limit, promise, UNKNOWN_CONVERGENCE, 0.0, 0.0, 0
        )
        place = Attempt(
            step, floor, fraction, _STAY, radius, limit, promise, UNKNOWN_CONVERGENCE, 0.0, 0.0, 0
        )
        factors = _predict(
            model, nodal, loads, f, frame.path, place if textbook else attempt, state, work
        )
        solved = nodal_minimise(model, nodal, loads, f, fraction, factors, method, work)
        error = step_error(
            radius,
            step,
            motion_of(state, f, NODE_POINTS),
            work.now.points.nodes,
            work.around.target.nodes,
        )
        numbers = solved.iterations, solved.matrices, solved.move
        outcome = Outcome(
            solved.status, *numbers, error, False, 0.0, error, 1.0, 0.0, UNKNOWN_CONVERGENCE
        )
        verdict, h, way = judge_attempt(h, first, attempt, outcome, settings)
        count_attempt(report, f, verdict, attempt, outcome, settings)
        if verdict == TAKEN:
            _accept(model, f, attempt, state, work)
            done += step
            h, way = after_step(first, attempt, outcome, settings)
        elif h == 0.0:
            return record_failure(report, f, outcome.status)
    state.proposal[f] = h
    return CONVERGED
