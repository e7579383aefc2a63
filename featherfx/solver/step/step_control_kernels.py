"""Step-size control and fallbacks after a rejected or failed step.

A step is tried from the predicted pose, then from the rigidly moved one, then by implicit Euler,
and is then cut. Where the last two fail the way of the root and the step's inertia are put on in
LOAD_PARTS, each solved from the pose of the one before. Steps that were cut grow again from their
own length, by implicit Euler if that was needed, because where Newton failed it mostly fails again
at once.

The length of a step follows from its error. What is bounded is the work of a frame: half of its
steps may be as short as their errors ask, which what is struck or starts at full speed needs for a
moment, and three quarters of its work may go into them while they are easily solved, half where
they are not; the others share evenly what is left of the frame, however large their errors.
Implicit Euler is also taken where such a step misses the tolerance by far: the other method may
gain energy from motions that it does not resolve.

Once half of a frame's work is spent, its end comes first: a step that Newton does not solve is
tried by implicit Euler at once, and that is taken as far as its iterations have brought it, where
that is near its solution; else it is cut, until three quarters are spent. Few steps ask for that.
The distance from the solution counts as error. Such a pose is one that feathers can have, of less
energy than the one before, as it was come to downwards from there. What work there is in the end
goes into one step to the frame's end. Where feathers touch, unsolved steps are done again.

Strains and acceleration of a feather whose steps are yet to begin, and how long the first is.
"""

from math import ceil, sqrt
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
from featherfx.mechanics.barb_kernels import copy_points, points_of
from featherfx.mechanics.vane_hook_kernels import copy_gaps, gaps_of
from featherfx.solver.step.energy_kernels import EnergyBound
from featherfx.solver.step.integrator_kernels import NODE_POINTS, motion_of
from featherfx.solver.step.newton_kernels import (
    UNKNOWN_CONVERGENCE,
    ConvergenceHistory,
    NewtonGoal,
    evaluate,
    largest_move,
    minimise,
)
from featherfx.solver.step.pose_kernels import load_pose, root_at
from featherfx.solver.step.strain_kernels import (
    copy_strains,
    damping_over,
    relax_fully,
    set_reference_strains,
    strains_at,
)
from featherfx.solver.types import CONVERGED, GREW, IntegratorFactors, StepSettings

# what becomes of a try
TAKEN, _REJECTED, _FAILED = 0, 1, 2
# how a step is tried, in this order
EXTRAPOLATE, FOLLOW_ROOT, IMPLICIT_EULER = 0, 1, 2
# in which a step's root and inertia go on where Newton fails
LOAD_PARTS = 4
# error over tolerance beyond which a step that may not be shorter is taken by implicit Euler
_LOST_ERROR_RATIO = 30.0
# a regular step may be cut this far when Newton fails, by this factor each time
_MAX_CUT_RATIO, _STEP_CUT = 1e6, 0.25
# length of the next step over that whose error is the tolerance, and most over the last: more of
# either costs more in steps that are done again than it saves, as a vibration that turns round has
# no error for a moment (docs/decisions/tried.md)
_STEP_SAFETY, _MAX_STEP_GROWTH = 0.7, 1.5
# the same of half a frame that feathers share: with less, two steps would never become one
_WHOLE_FRAME_GROWTH = 2.0
# part that the last step's work has in the mean of the last ones
RECENT_WORK_WEIGHT = 0.5
# a next step that would be within this range of the last one is as long, so that its matrix serves,
# where a frame has more than two
_EQUAL_STEP_RANGE = 0.8, 1.25
# a step for its error alone over a regular one, at least; work set aside for a step, and over what
# those of the frame have taken in the mean
MIN_STEP_RATIO, _MIN_STEP_WORK, _WORK_RESERVE = 1e-4, 12.0, 2.0
# tries that are left for the end of a frame whose steps are easy, at least
MIN_ATTEMPTS_LEFT = 16
# part of a wanted length that its steps are divided by, and of the shortest one that a step is no
# longer than that is no longer cut: more than one over the former, or it is tried over and over
_EVEN_STEPS_RATIO, _FLOOR_RATIO = 0.999, 1.01


@kernel
def scale_settings(frame, length):
    """Settings of a frame for a feather with rachis elements length (n-1,), m.

    frame: StepSettings whose coarse and unsolved are parts of the feather's length.
    """
    total = 0.0
    for i in range(length.shape[0]):
        total += length[i]
    return StepSettings(
        frame.duration,
        frame.shortest,
        frame.spectral_radius,
        frame.tolerance,
        frame.coarse * total,
        frame.newton,
        frame.iterations,
        frame.hard,
        frame.most_iterations,
        frame.unsolved * total,
        frame.shared,
    )


class Attempt(NamedTuple):
    """A try of a step: its length h (s), the length below which none is tried for its error (floor,
    s), the fraction of the frame at its end, EXTRAPOLATE, FOLLOW_ROOT or IMPLICIT_EULER (way), the
    spectral radius, Newton iterations at most (limit), the EnergyBound, the history of the try
    before, how much of the last change of the rates the prediction adds to them (bend), where the
    frame must end, distance (m) from its solution at which implicit Euler's step is taken (allowed,
    else 0), and in how many parts it is tried where Newton fails (0: it is not)."""

    h: float
    floor: float
    fraction: float
    way: int
    spectral_radius: float
    limit: int
    promise: EnergyBound
    pace: ConvergenceHistory
    bend: float
    allowed: float
    parts: int


class Outcome(NamedTuple):
    """Result of an attempt: status, Newton iterations and those of them with a new matrix, distance
    from the solution (move, m), the part of its velocities that it keeps and its energy (J,
    energy_kernels), the convergence.

    error: m, local error. Whether loose barbs passed through each other, and how far hooks slipped,
    over the most that a step should (gap_kernels), shorten a step as an error does (excess, m).
    """

    status: int
    iterations: int
    matrices: int
    move: float
    error: float
    passed: bool
    slipped: float
    excess: float
    keeps: float
    energy: float
    pace: ConvergenceHistory


@kernel
def count_attempt(report, f, verdict, attempt, outcome, settings):
    """Add a try to the StepReport of feather f."""
    report.iterations[f] += outcome.iterations
    report.matrices[f] += outcome.matrices
    if verdict == _REJECTED:
        report.rejected[f] += 1
    elif verdict == _FAILED:
        report.failed[f] += 1
    else:
        report.steps[f] += 1
        report.fallbacks[f] += 1 if attempt.way == IMPLICIT_EULER else 0
        report.forced[f] += 1 if outcome.error > settings.tolerance else 0
        report.passed[f] += 1 if outcome.passed else 0
        report.slipped[f] += 1 if outcome.slipped > 1.0 else 0
        report.error[f] = max(report.error[f], outcome.error)
        report.move[f] = max(report.move[f], outcome.move)


@kernel
def attempt_work(outcome):
    """Return the cost of an attempt, in Newton iterations with a new matrix each; one with a matrix
    at hand costs a quarter of that."""
    return max(1, (outcome.iterations + 3 * outcome.matrices) // 4)


@kernel
def record_failure(report, f, status):
    """Note why the frame was not finished."""
    report.status[f] = status
    return status


@kernel
def min_step_length(settings, done, taken, left, recent):
    """Length (s) below which no step is tried for its error, once so many steps have brought the
    frame to done (s) and so much work is left. recent: work that the last ones took each."""
    if settings.shared > 0.0:
        return MIN_STEP_RATIO * settings.shortest
    most, kept = settings.duration / settings.shortest, 0.5 * settings.most_iterations
    if _WORK_RESERVE * recent <= _MIN_STEP_WORK:
        kept = min(kept, max(0.5 * kept, MIN_ATTEMPTS_LEFT * settings.iterations))
    if 2.0 * (taken + 1) <= most and left >= kept:
        return MIN_STEP_RATIO * settings.shortest
    spent = max(recent, (settings.most_iterations - left) / max(taken, 1))
    count = min(most - taken, left / max(_MIN_STEP_WORK, _WORK_RESERVE * spent))
    return (settings.duration - done) / max(1.0, count)


@kernel
def load_parts(settings, way, left, held):
    """In how many parts a step is tried where Newton fails; 0 for none, as where too little work is
    left for all of them. held: whether a root carries the feather."""
    return (
        LOAD_PARTS
        if held and way != EXTRAPOLATE and left >= (LOAD_PARTS + 2) * settings.iterations
        else 0
    )


@kernel
def _urgency(settings, left):
    """Return how much the end of a frame with so much work left presses: 0 until half is spent, 1
    until three quarters are, then 2."""
    if 2 * left >= settings.most_iterations:
        return 0
    return 1 if 4 * left >= settings.most_iterations else 2


@kernel
def allowed_distance(settings, left):
    """Distance (m) from its solution at which a step is taken of a frame with so much work left; 0
    where the frame need not end yet."""
    urgency = _urgency(settings, left)
    if urgency == 0:
        return 0.0
    return min(settings.coarse, settings.unsolved) if urgency == 1 else settings.unsolved


@kernel
def work_after_failure(settings, left):
    """Work that a frame with so much of it left goes on with where no shorter step is solved: so
    little that more is allowed (allowed_distance), 0 where that is so already."""
    if settings.unsolved == 0.0:
        return 0
    urgency = _urgency(settings, left)
    return 0 if urgency == 2 else (settings.most_iterations - 1) // (2 + 2 * urgency)


@kernel
def next_step(h, done, duration):
    """Length (s) of a step if at most h is wanted, and the fraction of the frame (duration, of
    which done have passed, s) at its end: what is left is divided evenly."""
    left = duration - done
    count = ceil(_EVEN_STEPS_RATIO * left / h)
    if count <= 1:
        return left, 1.0
    step = left / count
    return step, (done + step) / duration


@kernel
def _length_for(error, tolerance, step, least, most):
    """Length whose error would be a little below the tolerance, within least to most of step."""
    change = _STEP_SAFETY * (tolerance / max(error, 1e-30)) ** (1.0 / 3.0)
    return step * min(most, max(least, change))


@kernel
def judge_attempt(h, first, attempt, outcome, settings):
    """Judge an attempt: (TAKEN, _REJECTED or _FAILED, next wanted length h, next way).

    h: s, wanted length, the one tried may be shorter. first: way of a fresh step. The next h is 0
    where a step cannot be cut further.
    """
    shortest, floor, tolerance = settings.shortest, attempt.floor, settings.tolerance
    step, way, error = attempt.h, attempt.way, outcome.excess
    smallest, shorter = shortest / _MAX_CUT_RATIO, _STEP_CUT * step
    if outcome.status == GREW:
        # another start of Newton would find the same
        way = max(way, FOLLOW_ROOT)
    if outcome.status != CONVERGED:
        last = step < 0.999 * shortest or attempt.allowed > 0.0
        way = IMPLICIT_EULER if last and way < IMPLICIT_EULER else way + 1
        if way <= IMPLICIT_EULER:
            return _FAILED, h, way
        return _FAILED, shorter if shorter >= smallest else 0.0, first
    if settings.shared > 0.0:
        return TAKEN, h, way
    if error > tolerance and step > _FLOOR_RATIO * floor:
        return _REJECTED, max(floor, _length_for(error, tolerance, step, 0.2, 1.0)), first
    lost = error > _LOST_ERROR_RATIO * tolerance
    if lost and way != IMPLICIT_EULER:
        return _REJECTED, h, IMPLICIT_EULER
    far = error > settings.coarse and attempt.allowed == 0.0
    if lost and far and shorter > smallest:
        return _REJECTED, shorter, way
    return TAKEN, h, way


@kernel
def after_step(first, attempt, outcome, settings):
    """The next (h, way) where a step was taken; arguments as in judge."""
    tolerance, error = settings.tolerance, outcome.excess
    several, growth = attempt.h < 0.4 * settings.duration, _MAX_STEP_GROWTH
    if settings.shared > 0.0:
        tolerance *= settings.shared
        growth = _MAX_STEP_GROWTH if several else _WHOLE_FRAME_GROWTH
    pressed, hard = attempt.allowed > 0.0, attempt_work(outcome) > settings.hard
    most = 1.0 if not pressed and (hard or error > _LOST_ERROR_RATIO * tolerance) else growth
    wanted = _length_for(error, tolerance, attempt.h, 0.5, most)
    if several and _EQUAL_STEP_RANGE[0] * attempt.h < wanted < _EQUAL_STEP_RANGE[1] * attempt.h:
        wanted = attempt.h
    h = max(min(attempt.floor, most * attempt.h), wanted)
    cut = attempt.h < 0.999 * settings.shortest or (pressed and hard)
    way = IMPLICIT_EULER if cut and attempt.way == IMPLICIT_EULER else first
    return h, way


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
