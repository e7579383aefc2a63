"""Strains and acceleration of a feather whose steps are yet to begin."""

from featherfx.algebra.rotation_kernels import conjugate, multiply, rotate, store_rotation
from featherfx.algebra.vec3_kernels import add, store, sub
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.node_kernels import blow
from featherfx.mechanics.row_kernels import copy_points, points_of
from featherfx.mechanics.vane_hook_kernels import copy_gaps, gaps_of
from featherfx.solver.step.integrator_kernels import Factors
from featherfx.solver.step.newton_kernels import evaluate, minimise
from featherfx.solver.step.pose_kernels import load_pose
from featherfx.solver.step.root_kernels import root_at
from featherfx.solver.step.strain_kernels import copy_strains, strains_of

# the instant over which the first acceleration is taken, as a part of the step, and the Newton
# iterations that it gets: the second one only corrects for the curved paths of barbs and frames
INSTANT, START_ITERATIONS = 1.0, 8


@shared_kernel(None)
def start_acceleration(model, loads, f, duration, state, work, path):
    """Set the strains of feather f, in place, to those of its pose, and the accelerations to those
    that pose and velocity give.

    One implicit Euler step over the duration (s), a = (x - x0 - h v0) / h^2, which is then taken
    back. Damping and air take part: without them a relaxing material would first be thrown, and a
    feather that hangs in balance with the wind would fall out of it. What vibrates faster than
    that is left at rest: with a tenth of the duration, vibrations that the first step does not
    resolve would double their energy in it (radius 0; with a fifth or more a linear one never
    gains, with the whole no crumpled feather was seen to). With wrong accelerations the time
    integration would lose its second order at once. The root of a feather that is in motion goes
    along its path; of one that is not, it stays, because a path that starts at full speed tells
    nothing of accelerations. path: of the roots, over the duration.
    """
    h = INSTANT * duration
    now, around = work.now, work.around
    points, velocity = points_of(state.points, f), points_of(state.velocity, f)
    factors, before = Factors(1.0 / (h * h), 1.0 / h, 1.0 / h), strains_of(state.strains, f, 0)
    copy_points(points, around.target)
    copy_points(points, around.past)
    copy_strains(before, around.reference)
    copy_gaps(gaps_of(state.gaps, f), around.gaps)
    load_pose(model, f, state, now)
    evaluate(model, loads, f, 0.0, factors, now, around)
    copy_strains(now.strains, before)
    copy_strains(before, around.reference)
    if model.held[f] and _moves(velocity) and _goes(path.samples[f]):
        _carry_along(path, f, work.trial.rotation[0], now)
    _go_on(points, h, velocity, around.target)
    if loads.air[0] > 0.0:
        copy_points(points, now.points)
        time = state.time[f] + h
        blow(now.points.nodes, time, loads, f, velocity.nodes, model.cell_stiffness[f], around)
    minimise(model, loads, f, 0.0, factors, 0.0, START_ITERATIONS, work)
    acceleration = points_of(state.acceleration, f)
    _rates_of(now.points, around.target, h * h, acceleration)
    copy_points(acceleration, points_of(state.smoothed, f))


@kernel
def _moves(rates):
    moving = False
    for part in rates:
        for rate in part.flat:
            moving = moving or rate != 0.0
    return moving


@kernel
def _goes(samples):
    """Whether a path (K, 6) is not one and the same place."""
    goes = False
    for i in range(samples.shape[0]):
        for k in range(6):
            goes = goes or samples[i, k] != samples[0, k]
    return goes


@kernel
def _go_on(points, h, velocity, to):
    """Where points would be after h (s), to others."""
    for part in range(2):
        x, v, out = points[part].flat, velocity[part].flat, to[part].flat
        for i in range(points[part].size):
            out[i] = x[i] + h * v[i]


@kernel
def _rates_of(points, target, square, to):
    """How far points are from a target, over h^2 (s^2), to rates."""
    for part in range(2):
        x, y, out = points[part].flat, target[part].flat, to[part].flat
        for i in range(points[part].size):
            out[i] = (x[i] - y[i]) / square


@kernel
def _carry_along(path, f, end, pose):
    """Carry the rows of a pose rigidly to where their root's path ends. end: (4,), scratch."""
    first = add(pose.centre[0], (0.0, 0.0, 0.0))
    turn = conjugate(pose.rotation[0])
    place = pose.centre[0]
    root_at(path, f, 1.0, end, place)
    last = add(place, (0.0, 0.0, 0.0))
    move = multiply(end, turn)
    for i in range(pose.rotation.shape[0]):
        store_rotation(pose.rotation[i], multiply(move, pose.rotation[i]))
    for i in range(1, pose.centre.shape[0]):
        store(pose.centre[i], add(last, rotate(move, sub(pose.centre[i], first))))
