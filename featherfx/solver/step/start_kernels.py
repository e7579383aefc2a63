"""Strains and acceleration of a feather whose steps are yet to begin, and how long the first is."""

from math import sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import (
    add,
    conjugate,
    copy_values,
    dot,
    multiply,
    rotate,
    store,
    store_rotation,
    sub,
)
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.air_kernels import blow_step
from featherfx.mechanics.row_kernels import copy_points, points_of
from featherfx.mechanics.vane_hook_kernels import copy_gaps, gaps_of
from featherfx.solver.step.integrator_kernels import NODE_POINTS, motion_of
from featherfx.solver.step.newton_kernels import (
    UNKNOWN_CONVERGENCE,
    NewtonGoal,
    evaluate,
    largest_move,
    minimise,
)
from featherfx.solver.step.pose_kernels import load_pose, root_at
from featherfx.solver.step.relaxation_kernels import (
    damping_over,
    relax_fully,
    set_reference_strains,
)
from featherfx.solver.step.step_control_kernels import min_step_length
from featherfx.solver.step.strain_kernels import copy_strains, strains_at
from featherfx.solver.types import IntegratorFactors

# Newton iterations that a first acceleration gets: the second one only corrects for the curved
# paths of barbs and frames
_MAX_START_ITERATIONS = 8


class StartInterval(NamedTuple):
    """The begin of a frame: its length (s), the fraction of the frame at its end, Newton iterations
    at most (limit)."""

    length: float
    fraction: float
    limit: int


@shared_kernel(None)
def start_acceleration(model, loads, f, path, settings, state, work):
    """Set the strains of feather f, in place, to those of its pose, and the accelerations to those
    that pose and velocity give; and the proposal, the length of the first step. A feather at rest
    has rested for long: its dashpots hold nothing.

    One implicit Euler step over its length h, a = (x - x0 - h v0) / h^2, which is then taken
    back. Damping and air take part: without them a relaxing material would first be thrown, and a
    feather that hangs in balance with the wind would fall out of it. What vibrates faster than
    that is left at rest: with a tenth of the step, vibrations that it does not resolve would double
    their energy in it (radius 0; with a fifth or more a linear one never gains, with the whole no
    crumpled feather was seen to). With wrong accelerations the time integration would lose its
    second order at once.

    The error of the first step itself does not tell how wrong they are: out of balance, a step that
    is too long goes to rest as the implicit Euler step did. So it is halved until h^2 times the
    accelerations, or their change with half of h, is less than it may err. The root of a feather
    that is in motion goes along its path; of one that is not, it stays, because a path that starts
    at full speed tells nothing of accelerations.

    path: of the roots, over the frame. settings: StepSettings of the frame.
    """
    given, duration = state.proposal[f], settings.duration
    limit = min(_MAX_START_ITERATIONS, settings.iterations)
    floor = min_step_length(settings, 0.0, 0, settings.most_iterations, 0.0)
    h = given if 0.0 < given < duration else duration
    history = strains_at(state.strains, f)
    before = strains_at(history, 0)
    copy_gaps(gaps_of(state.gaps, f), work.around.gaps)
    load_pose(model, f, state, work.now)
    copy_values(before.hinge, work.around.angles)
    evaluate(model, loads, f, 0.0, IntegratorFactors(0.0, 0.0, 0.0, 0.0), work.now, work.around)
    copy_strains(work.now.strains, before)
    if not _moves(points_of(state.velocity, f)):
        relax_fully(history)
    accepted, finer = points_of(state.acceleration, f), points_of(state.smoothed, f)
    _accelerate(model, loads, f, path, StartInterval(h, h / duration, limit), state, work, accepted)
    while 0.5 * h > floor:
        allowed = min(settings.tolerance, settings.coarse) / (h * h)
        if _largest(accepted.nodes) <= allowed:
            break
        half = StartInterval(0.5 * h, 0.5 * h / duration, limit)
        _accelerate(model, loads, f, path, half, state, work, finer)
        if largest_move(accepted, finer, 0.0) <= allowed:
            break
        copy_points(finer, accepted)
        h = half.length
    copy_points(accepted, finer)
    state.proposal[f] = h


@kernel
def _accelerate(model, loads, f, path, span, state, work, to):
    """Accelerations of feather f over a StartInterval, to rates."""
    now, around, h = work.now, work.around, span.length
    points, velocity = points_of(state.points, f), points_of(state.velocity, f)
    copy_points(points, around.target)
    set_reference_strains(model, f, (h, 0.0), strains_at(state.strains, f), around.reference)
    load_pose(model, f, state, now)
    if model.held[f] and _moves(velocity) and _goes(path.samples[f]):
        _carry_along(path, f, span.fraction, work.trial.rotation[0], now)
    _go_on(points, h, velocity, around.target)
    if loads.air[0] > 0.0:
        # the air at velocities of the start, as v = (x - x_v) / h
        copy_points(points, around.past)
        _go_on(points, -h, velocity, around.past)
        copy_points(points, now.points)
        motion, times = motion_of(state, f, NODE_POINTS), (state.time[f] + h, h, 1.0 / h, 0.0)
        blow_step(motion, now.points.nodes, times, state.spin[f, 0], loads, f, model, around)
    copy_points(points, around.past)
    goal = NewtonGoal(0.0, span.limit, UNKNOWN_CONVERGENCE, True)
    rachis, vane = damping_over(model, f, 0, h, 0.0), damping_over(model, f, 1, h, 0.0)
    factors = IntegratorFactors(1.0 / (h * h), 1.0 / h, rachis, vane)
    minimise(model, loads, f, 0.0, factors, goal, work)
    _rates_of(now.points, around.target, h * h, to)


@kernel
def _largest(vectors):
    """Length of the longest of vectors (n, ., 3)."""
    worst = 0.0
    for i in range(vectors.shape[0]):
        for p in range(vectors.shape[1]):
            worst = max(worst, dot(vectors[i, p], vectors[i, p]))
    return sqrt(worst)


@kernel
def _moves(rates):
    moving = False
    for part in rates:
        for rate in part.flat:
            moving = moving or rate != 0.0
    return moving


@kernel
def _goes(samples):
    """Return whether a path (K, 6) is not one and the same place."""
    goes = False
    for i in range(samples.shape[0]):
        for k in range(6):
            goes = goes or samples[i, k] != samples[0, k]
    return goes


@kernel
def _go_on(points, h, velocity, to):
    """Write where points would be after h (s), to others."""
    for part in range(2):
        x, v, out = points[part].flat, velocity[part].flat, to[part].flat
        for i in range(points[part].size):
            out[i] = x[i] + h * v[i]


@kernel
def _rates_of(points, target, square, to):
    """Write how far points are from a target, over h^2 (s^2), to rates."""
    for part in range(2):
        x, y, out = points[part].flat, target[part].flat, to[part].flat
        for i in range(points[part].size):
            out[i] = (x[i] - y[i]) / square


@kernel
def _carry_along(path, f, fraction, end, pose):
    """Carry the rows of a pose rigidly to where their root is at a fraction of the frame. end:
    (4,), scratch."""
    first = add(pose.centre[0], (0.0, 0.0, 0.0))
    turn = conjugate(pose.rotation[0])
    place = pose.centre[0]
    root_at(path, f, fraction, end, place)
    last = add(place, (0.0, 0.0, 0.0))
    move = multiply(end, turn)
    for i in range(pose.rotation.shape[0]):
        store_rotation(pose.rotation[i], multiply(move, pose.rotation[i]))
    for i in range(1, pose.centre.shape[0]):
        store(pose.centre[i], add(last, rotate(move, sub(pose.centre[i], first))))
