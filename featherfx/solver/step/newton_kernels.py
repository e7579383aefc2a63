"""Minimise the energy of one implicit step: Newton with a line search on the full energy.

Where the matrix is indefinite, only the stabilising part of the geometric stiffness is taken. That
is definite, but may be so much stiffer that the feather creeps: after CREPT such iterations,
inertia is added to the whole matrix instead, as if the step were shorter, as much as it takes.

A new matrix costs four times what a gradient and a solution do. So it is kept, corrected by what
the steps since have shown (secant_kernels), for as long as each full step is less than SLOW of the
one before; after a step that had to be cut, or with a matrix that was not the whole one, the next
is new.

It stops where the distance to the minimum is below the tolerance. With moves d_1, d_2, ... of full
steps that shrink by t = d_k / d_(k-1), that distance is at most d_k t / (1 - t) if they go on to
shrink like that. Newton's shrink faster, so for a new matrix this is the estimate if t < 1/2, else
d_k. With a kept one soft directions may shrink more slowly than what is seen, so there it is taken
as no less than d_k. A first move has no t yet; it is taken to shrink as in the step before, worse
by as much as it is longer, and a little worse each time that this was not seen again (Hairer and
Wanner, Solving Ordinary Differential Equations II, section IV.8). What that misjudges counts as
error of the step, which is then done again.
"""

from math import isfinite, sqrt
from typing import NamedTuple

from featherfx.algebra.copy_kernels import copy_values
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.row_kernels import copy_points
from featherfx.solver.status import CONVERGED, NOT_CONVERGED, NOT_DEFINITE, NOT_FINITE
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import factorise
from featherfx.solver.step.energy_kernels import step_energy
from featherfx.solver.step.pose_kernels import add_increment, complete_pose
from featherfx.solver.step.secant_kernels import (
    PAIRS,
    begin_step,
    end_step,
    keep_step,
    solve_corrected,
)
from featherfx.solver.step.strain_kernels import copy_strains
from featherfx.solver.vane.pairs_kernels import FORCES_ONLY, STABILISING, WHOLE

HALVINGS = 8
# shares of the inertia that are added to an indefinite matrix; what is done beyond the last
FIRST_SHIFT, GROWTH, LAST_SHIFT = 0.25, 4.0, 100.0
STABLE, NONE = -1.0, -2.0
CREPT = 4
# a kept matrix is given up when a step is longer than this part of the one before
SLOW = 0.5
# part of a step's own error that it may be away from its solution when its iterations are used up
NEARLY = 0.01
# power of a shrink that was not seen again
FORGET = 0.8


class Pace(NamedTuple):
    """How moves shrink: the second over the first (shrink, 1 where it is not known), and that first
    one (m)."""

    shrink: float
    first: float


UNKNOWN = Pace(1.0, 0.0)


class Goal(NamedTuple):
    """How far minimise goes: the distance from the minimum that counts as converged (tolerance, m),
    most iterations (limit), the Pace of the step before."""

    tolerance: float
    limit: int
    pace: Pace


class Solved(NamedTuple):
    """What minimise did: status, Newton iterations, those of them with a new matrix, distance from
    the minimum as estimated (move, m); shrink and first of the Pace."""

    status: int
    iterations: int
    matrices: int
    move: float
    shrink: float
    first: float


@kernel
def _largest_square(before, after):
    worst = 0.0
    for i in range(before.shape[0]):
        for p in range(before.shape[1]):
            square = 0.0
            for k in range(3):
                square += (after[i, p, k] - before[i, p, k]) ** 2
            worst = max(worst, square)
    return worst


@kernel
def largest_move(before, after, arm):
    """Largest distance between the RowPoints of two poses, m.

    arm: m, the lever at which a director's turn counts.
    """
    turn = arm * arm * _largest_square(before.directors, after.directors)
    return sqrt(max(_largest_square(before.nodes, after.nodes), turn))


@shared_kernel(float)
def evaluate(model, loads, f, fraction, factors, pose, around):
    """Points and strains of a pose from its coordinates, and its energy (J)."""
    complete_pose(model, f, pose, around.reference)
    return step_energy(model, loads, f, fraction, factors, pose, around)


@kernel
def copy_pose(source, target):
    """All arrays of one pose to another's."""
    copy_values(source.rotation, target.rotation)
    copy_values(source.centre, target.centre)
    copy_values(source.coefficient, target.coefficient)
    copy_points(source.points, target.points)
    copy_values(source.frames, target.frames)
    copy_values(source.halfway, target.halfway)
    copy_values(source.rachis, target.rachis)
    copy_strains(source.strains, target.strains)


@kernel
def _factorised(model, loads, f, fraction, factors, last, work):
    """Assemble at work.now and factorise; returns the shift that made the matrix definite.

    last: shift of the iteration before. STABLE: only the stabilising part of the geometric
    stiffness is in the matrix; NONE: not even that is definite.
    """
    system = work.system
    shift = last / GROWTH if last > FIRST_SHIFT * GROWTH else 0.0
    while True:
        wanted = STABILISING if shift == STABLE else WHOLE
        assemble(model, loads, f, fraction, factors, wanted, max(shift, 0.0), work)
        if factorise(system.band, system.panel):
            return shift
        if shift == STABLE:
            return NONE
        shift = GROWTH * shift if shift > 0.0 else FIRST_SHIFT
        if last == STABLE or shift > LAST_SHIFT:
            shift = STABLE


@kernel
def _search(model, loads, f, fraction, factors, energy, tolerance, work):
    """Go along the increment in work.system.right to work.trial, less far until the energy falls.

    Returns the energy there, the move of the whole increment (m), and the part of it that was
    taken, 0 if none was good.
    """
    now, trial = work.now, work.trial
    scale, new, move = 1.0, energy, 0.0
    for _ in range(HALVINGS):
        step, gradient = work.system.right, work.beam.gradient
        add_increment(model.length[f], now, step, scale, trial, gradient)
        new = evaluate(model, loads, f, fraction, factors, trial, work.around)
        move = largest_move(now.points, trial.points, model.length[f, 0]) / scale
        slack = 1e-9 * (abs(energy) + abs(new))
        if isfinite(new) and (new <= energy + slack or move < tolerance):
            return new, move, scale
        scale *= 0.5
    return new, move, 0.0


@kernel
def _distance_left(move, before, fresh):
    """Distance to the minimum (m) after a full step; before: move of the last one, 0 for none."""
    shrink = move / before if before > 0.0 else 1.0
    if fresh:
        return move * shrink / (1.0 - shrink) if shrink < 0.5 else move
    return move * max(1.0, shrink / (1.0 - min(shrink, 0.9)))


@kernel
def _first_left(move, pace):
    """Distance to the minimum (m) after a first full step, by the Pace of the step before."""
    if pace.shrink >= 1.0:
        return move
    return move * pace.shrink * max(1.0, move / pace.first)


@shared_kernel(Solved)
def minimise(model, loads, f, fraction, factors, goal, work):
    """Bring the pose work.now to the minimum of step_energy.

    fraction: of the frame. goal: Goal. Returns Solved.
    """
    now, right, band, secants = work.now, work.system.right, work.system.band, work.secants
    tolerance, shrink, first = goal.tolerance, goal.pace.shrink**FORGET, goal.pace.first
    energy = evaluate(model, loads, f, fraction, factors, now, work.around)
    if not isfinite(energy):
        return Solved(NOT_FINITE, 0, 0, 0.0, shrink, first)
    before, left, shift, stable, matrices, kept = 0.0, 0.0, 0.0, 0, 0, 0
    crept, fresh = False, True
    for iteration in range(1, goal.limit + 1):
        if not fresh:
            assemble(model, loads, f, fraction, factors, FORCES_ONLY, 0.0, work)
            fresh = not end_step(kept, right, secants)
            kept += 1
        if fresh:
            shift = _factorised(
                model, loads, f, fraction, factors, shift if crept else STABLE, work
            )
            if shift == NONE:
                return Solved(NOT_DEFINITE, iteration, matrices, left, shrink, first)
            kept, matrices = 0, matrices + 1
            stable += 1 if shift == STABLE else 0
            if stable == CREPT:
                crept, shift = True, 0.0
        begin_step(kept, right, secants)
        solve_corrected(band, kept, secants, right)
        keep_step(kept, right, secants)
        new, move, scale = _search(model, loads, f, fraction, factors, energy, tolerance, work)
        if scale == 0.0:
            if fresh and shift == STABLE:
                return Solved(NOT_CONVERGED, iteration, matrices, move, shrink, first)
            shift, fresh = STABLE if fresh else shift, True
            continue
        if shift > 0.0 and scale < 0.5:
            shift *= GROWTH * GROWTH
        copy_pose(work.trial, now)
        energy, left = new, move
        if scale == 1.0:
            left = _distance_left(move, before, fresh)
            if iteration == 1:
                left = _first_left(move, goal.pace)
            elif iteration == 2 and before > 0.0:
                shrink, first = move / before, before
            if left < tolerance:
                return Solved(CONVERGED, iteration, matrices, left, shrink, first)
        slow = not fresh and move > SLOW * before
        fresh = slow or scale < 1.0 or shift != 0.0 or kept + 1 == PAIRS
        before = move if scale == 1.0 else 0.0
    return Solved(NOT_CONVERGED, goal.limit, matrices, left, shrink, first)


@kernel
def nearly_solved(solved, limit, error):
    """Its status, or CONVERGED where the limit of iterations was used up close to the minimum.

    error: m, of the step, far above its distance from the solution.
    """
    used_up = solved.iterations == limit
    if solved.status == NOT_CONVERGED and used_up and solved.move <= NEARLY * error:
        return CONVERGED
    return solved.status
