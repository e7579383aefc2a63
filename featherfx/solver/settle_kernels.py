"""Statics: one feather brought to rest under its loads by implicit Euler steps.

One step so long that hardly any inertia is left does for most; where Newton does not find its end,
ever longer ones do. Each starts at rest (no velocity is carried over), so the elastic and potential
energy can only fall; as the step grows, what is left is the equilibrium. Short steps keep large
deformations on a path that Newton can follow.

The pressure of wind follows the vane: it has no energy to be minimised. With the areas and normals
of the vane held as a, the pose at rest is a minimum and gives areas g(a). At rest g(a) = a, found
by Anderson's mixing of the last MIXING_DEPTH pairs (a, r = g(a) - a):

    a+ = a - dA c + s (r - dR c),        c = argmin |r - dR c|

dA, dR their differences from the last one, s MIXING_FRACTION; the first guess is g(a) where that is
_SMALL_AREA_CHANGE to a, as in most plumage. Each pose is found with the matrix of the one before,
where that still serves. Taking g(a) itself oscillates from some 3 m/s on, because the vane swings
through the wind. Source: Anderson 1965; Walker and Ni 2011.

Such poses may be several. Where the whole wind moves a feather by no more than _MAX_DIRECT_MOVE of
its length from where it starts, that pose is taken. Else it first comes to rest in calm air. Where
the whole wind moves it from there by more than _MAX_BRANCH_MOVE, the wind grows from nothing in
steps that move it by less: it stays on the branch of calm air, which is the same on every grid.
Where no step is short enough, the branch ends, and the feather jumps. It has several rest poses
where the whole wind at once leads elsewhere; its status says so.

Where mixing fails the feather is carried along by short steps that start at rest, in air that is
felt anew before each; they grow while the feather goes on in one way and shrink where it turns
back. Then mixing is tried once more. A feather that flutters has no rest in wind: it is left in
the pose that those steps led to.
"""

from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.vector_kernels import copy_values
from featherfx.jit.compiled import kernel
from featherfx.mechanics.air_kernels import blow
from featherfx.mechanics.barb_kernels import copy_points, points_of
from featherfx.mechanics.vane_hook_kernels import copy_gaps, gaps_of, never_slip
from featherfx.solver.step.gap_kernels import slip_gaps, weaken_gaps
from featherfx.solver.step.newton_kernels import (
    UNKNOWN_CONVERGENCE,
    NewtonGoal,
    minimise,
    next_convergence,
)
from featherfx.solver.step.pose_kernels import keep_pose, load_pose
from featherfx.solver.types import (
    CONVERGED,
    MIXING_DEPTH,
    NO_REST,
    NOT_CONVERGED,
    SEVERAL_RESTS,
    IntegratorFactors,
)

FIRST_SETTLE_STEP, MIN_SETTLE_STEP, SETTLE_STEP_GROWTH = 1e-2, 1e-7, 8.0  # step lengths, s
_MAX_ITERATIONS, MAX_SETTLE_STEPS = 100, 80
STATIC_STEP = 1e4  # s, a step after which hardly any inertia is left
MIXING_FRACTION, _RIDGE = 0.3, 1e-10
# part of all areas, change by the first pose that the wind's answer to is small beside it
_SMALL_AREA_CHANGE = 0.1
# part of all areas that counts as no change, and where the pose has not changed by more than it may
# be wrong; mixing steps; as many as may pass without progress
_AREA_TOLERANCE, _STILL_AREA_TOLERANCE, _MAX_MIXINGS, _MAX_STALLED_MIXINGS = 1e-5, 1e-4, 60, 12
# of the length: most that a step of the wind's growth moves a feather, and that loads all at once
# move one that is not followed from calm air; distance of two rest poses that are different
_MAX_BRANCH_MOVE, _MAX_DIRECT_MOVE, _SAME_REST_RATIO = 0.15, 0.05, 0.01
_MIN_WIND_STEP = 1.0 / 8.0  # least part of the wind's speed that a step adds
# in wind: of Newton, a step; number of short steps
_MAX_WIND_ITERATIONS, _MAX_WIND_STEPS = 25, 30

Array = NDArray[np.float64]


@kernel
def settle_feathers(model, loads, feathers, goal, state, found, mixing, work):
    """Bring feathers (K,) of the state to rest, in place; their velocities become zero.

    goal: the place within the loads' frame, 0..1, and m, distance of a step from its solution.
    """
    for f in feathers:
        found.iterations[f] = 0.0
        _begin(model, f, state, work)
        if loads.air[0] > 0.0 and _blows(loads, f):
            status = _settle_in_wind(model, loads, f, goal, state, found, mixing, work)
        else:
            status = _settle_still(model, loads, f, goal, state, found, work)
        found.status[f] = status


@kernel
def _clear(array):
    flat = array.flat
    for i in range(array.size):
        flat[i] = 0.0


@kernel
def _blows(loads, f):
    """Return whether there is any wind at feather f."""
    for k in range(3):
        if loads.wind_mean[f, k] != 0.0:
            return True
        for wave in range(loads.wind_amplitude.shape[1]):
            if loads.wind_amplitude[k, wave] != 0.0:
                return True
    return False


@kernel
def _begin(model, f, state, work):
    """Feather f stands still, and its pose is the one now."""
    for rate in (state.velocity, state.acceleration, state.smoothed):
        _clear(rate.nodes[f])
        _clear(rate.directors[f])
    _clear(state.spin[f])
    _clear(work.around.carried)
    _clear(state.coefficient_rate[f])
    state.step[f] = 0.0
    _clear(work.around.angles)
    _load(model, f, state, work)
    copy_gaps(gaps_of(state.gaps, f), work.around.gaps)


@kernel
def _load(model, f, state, work):
    """Take the pose that was kept last."""
    load_pose(model, f, state, work.now)
    copy_points(points_of(state.points, f), work.now.points)


@kernel
def _keep(model, f, state, work):
    """The pose now becomes the state's; gaps slip and open as they do after a step."""
    now, before, after = work.now, work.around.gaps, work.gaps
    keep_pose(f, now, state)
    if not never_slip(before):
        slip_gaps(model, f, now.strains.cell, before, after)
        weaken_gaps(model, f, now.strains.cell, before, after)
        copy_gaps(after, before)
        copy_gaps(after, gaps_of(state.gaps, f))


@kernel
def _scale(array, factor):
    flat = array.flat
    for i in range(array.size):
        flat[i] *= factor


@kernel
def _feel_wind(model, loads, f, part, state, work):
    """Wind, areas and speeds at the pose now. part: of the wind's speed."""
    time, still = state.time[f], state.velocity.nodes[f]
    blow(work.now.points.nodes, time, loads, f, still, model, work.around)
    _scale(work.around.wind, part)
    _scale(work.around.speed, part)
    _scale(work.around.stream, part)


@kernel
def _step(model, loads, f, goal, times, pace, found, work):
    """One step from rest, in the air around as it is; returns the NewtonResult.

    times: s, its length, and Newton's iterations at most. pace: of the step before, whose matrix
    may serve, or UNKNOWN_CONVERGENCE.
    """
    h, limit = times
    fraction, tolerance = goal
    copy_points(work.now.points, work.around.target)
    copy_points(work.now.points, work.around.past)
    factors = IntegratorFactors(1.0 / (h * h), 1.0 / h, 0.0, 0.0)
    wanted = NewtonGoal(tolerance, limit, pace, True)
    solved = minimise(model, loads, f, fraction, factors, wanted, work)
    found.iterations[f] += solved.iterations
    return solved


@kernel
def _settle_still(model, loads, f, goal, state, found, work):
    """Two steps that leave hardly any inertia, after ever longer ones if need be; returns Newton's
    status."""
    if loads.air[0] > 0.0:
        _feel_wind(model, loads, f, 0.0, state, work)
    h, limit, status, rests = STATIC_STEP, _MAX_WIND_ITERATIONS, CONVERGED, False
    for k in range(MAX_SETTLE_STEPS):
        status = _step(model, loads, f, goal, (h, limit), UNKNOWN_CONVERGENCE, found, work).status
        if status != CONVERGED:
            h, limit = FIRST_SETTLE_STEP if k == 0 else 0.25 * h, _MAX_ITERATIONS
            if h < MIN_SETTLE_STEP:
                return status
            _load(model, f, state, work)
            continue
        _keep(model, f, state, work)
        if rests:
            return CONVERGED
        rests = h >= STATIC_STEP
        h *= 1.0 if rests else SETTLE_STEP_GROWTH
    return NOT_CONVERGED if status == CONVERGED else status


@kernel
def _settle_in_wind(model, loads, f, goal, state, found, mixing, work):
    """Bring a feather to rest; returns CONVERGED, SEVERAL_RESTS, Newton's status or NO_REST."""
    size, nodes, follows = _size(model, f), work.now.points.nodes, False
    rests = _mix(model, loads, f, 1.0, (goal, found), state, mixing, work)
    if rests and _largest_way(nodes, state.points.nodes[f]) <= _MAX_DIRECT_MOVE * size:
        _keep(model, f, state, work)
        return CONVERGED
    _load(model, f, state, work)
    still = _settle_still(model, loads, f, goal, state, found, work)
    _load(model, f, state, work)
    if still != CONVERGED:
        rests = False
    else:
        rests = rests and _mix(model, loads, f, 1.0, (goal, found), state, mixing, work)
        if rests and _largest_way(nodes, state.points.nodes[f]) <= _MAX_BRANCH_MOVE * size:
            _keep(model, f, state, work)
            return CONVERGED
        copy_values(nodes, mixing.direct)
        follows = _follow_branch(model, loads, f, goal, state, found, mixing, work)
    if not follows:
        status = _drift(model, loads, f, goal, state, found, mixing, work)
        if status != CONVERGED:
            return status
        if not _mix(model, loads, f, 1.0, (goal, found), state, mixing, work):
            return NO_REST
        _keep(model, f, state, work)
    same = _largest_way(nodes, mixing.direct) <= _SAME_REST_RATIO * size
    return SEVERAL_RESTS if rests and not same else CONVERGED


@kernel
def _follow_branch(model, loads, f, goal, state, found, mixing, work):
    """Let the wind grow from calm, from the pose that was kept last, and keep the poses on the way;
    whether the feather is at rest in the whole wind."""
    part, step, nodes, size = 0.0, 0.5, work.now.points.nodes, _size(model, f)
    while part < 1.0:
        _load(model, f, state, work)
        wanted = min(part + step, 1.0)
        rests = _mix(model, loads, f, wanted, (goal, found), state, mixing, work)
        near = rests and _largest_way(nodes, state.points.nodes[f]) <= _MAX_BRANCH_MOVE * size
        if near or (rests and step <= _MIN_WIND_STEP):
            _keep(model, f, state, work)
            part, step = wanted, (2.0 if near else 1.0) * step
        elif step <= _MIN_WIND_STEP:
            _load(model, f, state, work)
            return False
        else:
            step *= 0.5
    return True


@kernel
def _size(model, f):
    """Length of the rachis of feather f (m)."""
    size = 0.0
    for i in range(model.length.shape[1]):
        size += model.length[f, i]
    return size


@kernel
def _largest_way(nodes, before):
    """Return the largest distance (m) of nodes from where they were, of which one array may be
    flat."""
    own, other, worst = nodes.flat, before.flat, 0.0
    for i in range(0, nodes.size, 3):
        square = 0.0
        for k in range(3):
            square += (own[i + k] - other[i + k]) ** 2
        worst = max(worst, square)
    return sqrt(worst)


@kernel
def _mix(model, loads, f, part, ends, state, mixing, work):
    """Find areas that the pose in them gives back, in a part of the wind's speed; whether they were
    found. ends: goal and found, as of settle_feathers."""
    goal, found = ends
    area, nodes = work.around.area, work.now.points.nodes
    _feel_wind(model, loads, f, part, state, work)
    copy_values(area, mixing.next)
    least, waited, pace = inf, 0, UNKNOWN_CONVERGENCE
    for k in range(_MAX_MIXINGS):
        guess, change = mixing.guess[k % MIXING_DEPTH], mixing.change[k % MIXING_DEPTH]
        copy_values(mixing.next, guess)
        copy_values(guess, area)
        solved = _step(
            model, loads, f, goal, (STATIC_STEP, _MAX_WIND_ITERATIONS), pace, found, work
        )
        if solved.status != CONVERGED:
            return False
        pace = next_convergence(solved.iterations, solved.pace)
        _feel_wind(model, loads, f, part, state, work)
        left, whole, own = 0.0, 0.0, area.flat
        still = k > 0 and _has_stayed(nodes, mixing.before, goal)
        copy_values(nodes, mixing.before)
        for i in range(area.size):
            change[i] = own[i] - guess[i]
            left += change[i] * change[i]
            whole += own[i] * own[i]
        left = sqrt(left)
        if left <= (_STILL_AREA_TOLERANCE if still else _AREA_TOLERANCE) * sqrt(whole):
            return True
        waited = 0 if left < 0.9 * least else waited + 1
        least = min(least, left)
        if waited > _MAX_STALLED_MIXINGS:
            return False
        share = 1.0 if k == 0 and left <= _SMALL_AREA_CHANGE * sqrt(whole) else MIXING_FRACTION
        mix(mixing, min(k + 1, MIXING_DEPTH), k % MIXING_DEPTH, share)
    return False


@kernel
def _has_stayed(nodes, before, goal):
    """Return whether no coordinate is further from where it was than a step may be from its
    solution."""
    _, tolerance = goal
    own, stayed = nodes.flat, True
    for i in range(nodes.size):
        stayed &= abs(own[i] - before[i]) <= tolerance
    return stayed


@kernel
def mix(mixing, count, last, share):
    """The next guess from pairs of guesses and changes, to mixing.next.

    count: of the pairs that there are. last: which is the newest; its own weight stays zero.
    share: of what is left of the change that is taken.
    """
    guess, change, weight = mixing.guess, mixing.change, mixing.weight
    _least_squares(mixing, count, last)
    for i in range(guess.shape[1]):
        value = guess[last, i] + share * change[last, i]
        for a in range(count):
            by_guess = guess[last, i] - guess[a, i]
            value -= weight[a] * (by_guess + share * (change[last, i] - change[a, i]))
        mixing.next[i] = value


@kernel
def _least_squares(mixing, count, last):
    """c of the normal equations, with a ridge, to mixing.weight, by Cholesky's factors."""
    change, normal, weight = mixing.change, mixing.normal, mixing.weight
    trace = 0.0
    for a in range(count):
        weight[a] = 0.0
        for b in range(a + 1):
            normal[a, b] = 0.0
        for i in range(change.shape[1]):
            by_a = change[last, i] - change[a, i]
            weight[a] += by_a * change[last, i]
            for b in range(a + 1):
                normal[a, b] += by_a * (change[last, i] - change[b, i])
        trace += normal[a, a]
    for a in range(count):
        normal[a, a] += _RIDGE * trace
        if a == last or trace == 0.0:
            normal[a, a] = 1.0
        for b in range(a + 1):
            for c in range(b):
                normal[a, b] -= normal[a, c] * normal[b, c]
            normal[a, b] = sqrt(normal[a, a]) if a == b else normal[a, b] / normal[b, b]
    for a in range(count):
        for b in range(a):
            weight[a] -= normal[a, b] * weight[b]
        weight[a] /= normal[a, a]
    for a in range(count - 1, -1, -1):
        for b in range(a + 1, count):
            weight[a] -= normal[b, a] * weight[b]
        weight[a] /= normal[a, a]


@kernel
def _drift(model, loads, f, goal, state, found, mixing, work):
    """Short steps towards rest; returns Newton's status, CONVERGED if any step could be solved."""
    h, best, steps, nodes = FIRST_SETTLE_STEP, NOT_CONVERGED, 0, work.now.points.nodes
    for _ in range(_MAX_WIND_STEPS):
        copy_values(nodes, mixing.before)
        _feel_wind(model, loads, f, 1.0, state, work)
        status = _step(
            model, loads, f, goal, (h, _MAX_WIND_ITERATIONS), UNKNOWN_CONVERGENCE, found, work
        ).status
        best = CONVERGED if best == CONVERGED else status
        if status != CONVERGED:
            h *= 0.25
            if h < MIN_SETTLE_STEP:
                break
            _load(model, f, state, work)
            continue
        _keep(model, f, state, work)
        goes_on, own = 0.0, nodes.flat
        for i in range(nodes.size):
            way = own[i] - mixing.before[i]
            goes_on += way * mixing.way[i]
            mixing.way[i] = way
        if steps > 0:
            h *= 2.0 if goes_on > 0.0 else 0.5
        h, steps = min(max(h, 1e3 * MIN_SETTLE_STEP), STATIC_STEP), steps + 1
    _load(model, f, state, work)
    return best
