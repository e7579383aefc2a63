"""Minimise the energy of one implicit step: Newton with a line search on the full energy.

Where the matrix is indefinite, only the stabilising part of the geometric stiffness is taken. That
is definite, but may be so much stiffer that the feather creeps: after _MAX_STABILISED_ITERATIONS
such iterations, inertia is added to the whole matrix instead, as if the step were shorter, as much
as it takes. The same is done where a definite matrix is too far from the energy: where less than
_MIN_STEP_FRACTION of its step can be gone. Of a step that leads upwards so much is tried next as a
parabola through both energies and the slope has its minimum at. Whether that gets anywhere is
chance where a feather is crumpled, so a step that is tried again goes half as far each time
instead, by the stabilising part first. No increment turns a joint of a barb by more than half a
turn: beyond a whole one the same places come again, where the barb is wound up and most of its
energy is where the next steps do not look.

A new matrix costs four times what a gradient and a solution do. So it is kept, corrected by what
the steps since have shown (banded_kernels), for as long as each full step is less than
_MAX_REUSE_CONTRACTION of the one before; after a step that had to be cut, or with a matrix that was
not the whole one, the next is new. Contacts that open or close on the way ask for no other matrix
(active_contact_kernels). The next steps of the frame begin with it as well while their inertia is
within _MAX_INERTIA_RATIO of its own, and so do the next solves of a feather among others that
touch: there it is kept without contacts, which are put in anew before it is factored. It is kept in
coordinates that turn with the rows, in which what moves or turns rigidly has the matrix of before.

It stops where the distance to the minimum is below the tolerance. With moves d_1, d_2, ... of full
steps that shrink by t = d_k / d_(k-1), that distance is at most d_k t / (1 - t) if they go on to
shrink like that. Newton's shrink faster, so for a new matrix this is the estimate if t < 1/2, else
d_k. With a kept one soft directions may shrink more slowly than what is seen, so there it is taken
as no less than d_k. A first move has no t yet; it is taken to shrink as in the step before, worse
by as much as it is longer, with a kept matrix by _SOFT_MOVE_RATIO as well, and a little worse each
time that this was not seen again (Hairer and Wanner, Solving Ordinary Differential Equations II,
section IV.8). What that misjudges counts as error of the step, which is then done again.
"""

from math import inf, isfinite, pi, sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import copy_values
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.mechanics.barb_kernels import copy_points
from featherfx.solver.step.active_contact_kernels import (
    add_contacts_to_matrix,
    followed_contacts,
    linearise_contacts,
    switch_contacts,
    turn_contact_axes,
)
from featherfx.solver.step.assembly_kernels import assemble
from featherfx.solver.step.banded_kernels import (
    begin_pair,
    end_pair,
    factorise,
    solve_corrected,
    store_step,
)
from featherfx.solver.step.energy_kernels import step_energy
from featherfx.solver.step.pose_kernels import (
    add_increment,
    barb_jacobians,
    complete_pose,
    turn_rows,
)
from featherfx.solver.step.strain_kernels import copy_strains
from featherfx.solver.types import (
    CONVERGED,
    FORCES_ONLY,
    MAX_SECANT_PAIRS,
    NOT_CONVERGED,
    NOT_DEFINITE,
    NOT_FINITE,
    STABILISING_STIFFNESS,
    WHOLE_STIFFNESS,
)

# rad, that an increment turns a joint of a barb by at most
_MAX_JOINT_TURN = pi
# places along an increment at most; the next one over the last, at least and at most
MAX_LINE_SEARCH_TRIALS, _LINE_SEARCH_CUTS = 8, (0.1, 0.5)
# shares of the inertia that are added to an indefinite matrix; what is done beyond the last
_FIRST_SHIFT, _SHIFT_GROWTH, MAX_SHIFT = 0.25, 4.0, 100.0
STABILISED, _INDEFINITE, STABILISED_ONLY = -1.0, -2.0, -3.0
_MAX_STABILISED_ITERATIONS = 4
# part of a step below which its matrix was too far from the energy
_MIN_STEP_FRACTION = 0.2
# a kept matrix is given up when a step is longer than this part of the one before
_MAX_REUSE_CONTRACTION = 0.5
# inertia of a step over that of a kept matrix, and the other way round, at most; iterations of a
# step that leaves its matrix to the next, at most: where there are more, poses are not alike
_MAX_INERTIA_RATIO, MAX_REUSE_ITERATIONS = 1.2, 4
# distance from the minimum after a first move with it over what the moves of the step before tell
_SOFT_MOVE_RATIO = 10.0
# part of a step's own error that it may be away from its solution where Newton cannot go on
_NEARLY_SOLVED_RATIO = 0.01
# times that contacts are turned on and off in a step, at most
_MAX_CONTACT_SWITCHES = 4
# power of a shrink that was not seen again
_CONTRACTION_MEMORY = 0.8


class ConvergenceHistory(NamedTuple):
    """Convergence of Newton's moves in the last steps: with a new matrix the second over the first
    (shrink, 1 where it is not known), and that first one (m); with the reused matrix each over the
    one before (kept), and the longer of the two (longest, m). Of that matrix, the inertia (1/s^2, 0
    where there is none), and its pairs of secants."""

    shrink: float
    first: float
    kept: float
    longest: float
    inertia: float
    pairs: int


UNKNOWN_CONVERGENCE = ConvergenceHistory(1.0, 0.0, 1.0, 0.0, 0.0, 0)
# pairs where there is the matrix without contacts, and no factor of it
_UNFACTORED = -1


@kernel
def next_convergence(iterations, pace):
    """Return the ConvergenceHistory for the next step after one of so many iterations."""
    if iterations <= MAX_REUSE_ITERATIONS:
        return pace
    return ConvergenceHistory(pace.shrink, pace.first, pace.kept, pace.longest, 0.0, pace.pairs)


@kernel
def load_convergence(numbers):
    """Load the history of StoredMatrix.pace, of a factor that is no longer there."""
    shrink, first, kept = numbers[0], numbers[1], numbers[2]
    longest, inertia = numbers[3], numbers[4]
    if inertia == 0.0:
        return UNKNOWN_CONVERGENCE
    return ConvergenceHistory(shrink, first, kept, longest, inertia, _UNFACTORED)


@kernel
def store_convergence(pace, numbers):
    """Store a history in StoredMatrix.pace, without its pairs."""
    numbers[0], numbers[1], numbers[2] = pace.shrink, pace.first, pace.kept
    numbers[3], numbers[4] = pace.longest, pace.inertia


class NewtonGoal(NamedTuple):
    """End of a Newton solve: the distance from the minimum that counts as converged (tolerance, m),
    most iterations (limit), the convergence of the step before; and whether a matrix that is too
    far from the energy is made stiffer before inertia is added, and increments are halved (firm).
    """

    tolerance: float
    limit: int
    pace: ConvergenceHistory
    firm: bool


class NewtonResult(NamedTuple):
    """Result of minimise: status, Newton iterations, those of them with a new matrix, estimated
    distance from the minimum (move, m), the convergence."""

    status: int
    iterations: int
    matrices: int
    move: float
    pace: ConvergenceHistory


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
    complete_pose(model, f, pose, around.angles)
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
def _assemble_definite(model, loads, f, fraction, factors, last, before, work):
    """Assemble at work.now and factorise; returns the shift that made the matrix definite.

    last: shift of the iteration before, or STABILISED_ONLY. before: of add_contacts_to_matrix.
    STABILISED: only the stabilising part of the geometric stiffness is in the matrix, as is asked
    for by STABILISED_ONLY; _INDEFINITE: not even that is definite.
    """
    system, points = work.system, work.now.points.nodes
    shift = last / _SHIFT_GROWTH if last > _FIRST_SHIFT * _SHIFT_GROWTH else 0.0
    if last == STABILISED_ONLY:
        shift = STABILISED
    while True:
        wanted = STABILISING_STIFFNESS if shift == STABILISED else WHOLE_STIFFNESS
        assemble(model, loads, f, fraction, factors, wanted, max(shift, 0.0), work)
        copy_values(system.band[: work.kept.plain.shape[0]], work.kept.plain)
        add_contacts_to_matrix(model, loads.contacts, f, fraction, points, before, work)
        if factorise(system.band, system.panel):
            return shift
        if shift == STABILISED:
            return _INDEFINITE
        shift = _SHIFT_GROWTH * shift if shift > 0.0 else _FIRST_SHIFT
        if last == STABILISED or shift > MAX_SHIFT:
            shift = STABILISED


@kernel
def _stiffer(shift, firm):
    """Return what to ask for after a matrix with a shift that was too far from the energy: inertia,
    then more of it; if firm, after the whole one its stabilising part first."""
    if shift == 0.0 and firm:
        return STABILISED_ONLY
    return _SHIFT_GROWTH * _SHIFT_GROWTH * max(shift, _FIRST_SHIFT)


@kernel
def _slope(gradient, step):
    """Return the slope of the energy along a step (N,), J, by minus the gradient (N,)."""
    slope = 0.0
    for k in range(step.shape[0]):
        slope -= gradient[k] * step[k]
    return slope


@kernel
def _nearer(scale, gain, slope):
    """Part of an increment to try after one at which the energy was more by gain (J): where a
    parabola with this slope (J) at the beginning has its minimum."""
    bend = gain - slope * scale
    if not (isfinite(bend) and slope < 0.0 < bend):
        return _LINE_SEARCH_CUTS[1] * scale
    part = -0.5 * slope * scale / bend
    return scale * min(max(part, _LINE_SEARCH_CUTS[0]), _LINE_SEARCH_CUTS[1])


@kernel
def _largest_turn(shapes, rows, step):
    """Return an upper bound of how far a step (N,) turns a joint of a barb, out of the vane or
    within it, rad."""
    count, total = shapes.shape[0], 0.0
    for c in range(count):
        share, largest = 0.0, 0.0
        for j in range(shapes.shape[1]):
            share = max(share, abs(shapes[c, j]))
        for i in range(rows):
            for part in range(4):
                largest = max(largest, abs(step[i * (6 + 4 * count) + 6 + part * count + c]))
        total += share * largest
    return total


@kernel
def _search(model, loads, f, fraction, factors, level, tolerance, work):
    """Go along the increment in work.system.right to work.trial, less far until the energy falls.

    level: energy at the beginning and slope along the increment, J, 0 to go half as far each time.
    Returns the energy there, the move of the whole increment (m), and the part of it that was
    taken, 0 if none was good.
    """
    now, trial, energy, slope = work.now, work.trial, level[0], level[1]
    turn = _largest_turn(model.shapes, now.rotation.shape[0], work.system.right)
    scale, new, move = _MAX_JOINT_TURN / max(turn, _MAX_JOINT_TURN), energy, 0.0
    for _ in range(MAX_LINE_SEARCH_TRIALS):
        step, gradient = work.system.right, work.beam.gradient
        add_increment(model.length[f], now, step, scale, trial, gradient)
        new = evaluate(model, loads, f, fraction, factors, trial, work.around)
        move = largest_move(now.points, trial.points, model.length[f, 0]) / scale
        slack = 1e-9 * (abs(energy) + abs(new))
        if isfinite(new) and (new <= energy + slack or move < tolerance):
            return new, move, scale
        scale = _nearer(scale, new - energy, slope)
    return new, move, 0.0


@kernel
def _distance_left(move, before, fresh):
    """Distance to the minimum (m) after a full step; before: move of the last one, 0 for none."""
    shrink = move / before if before > 0.0 else 1.0
    if fresh:
        return move * shrink / (1.0 - shrink) if shrink < 0.5 else move
    return move * max(1.0, shrink / (1.0 - min(shrink, 0.9)))


@kernel
def _first_left(move, reused, pace):
    """Distance to the minimum (m) after a first full step, by the history of the step before.
    reused: whether it is with the matrix of that."""
    shrink, before = (
        (_SOFT_MOVE_RATIO * pace.kept, pace.longest) if reused else (pace.shrink, pace.first)
    )
    if shrink >= 1.0:
        return move
    return move * shrink * max(1.0, move / before)


@kernel
def _can_reuse(pace, inertia):
    """Return whether the matrix of a convergence history serves a step of such inertia (1/s^2)."""
    alike = (
        inertia < _MAX_INERTIA_RATIO * pace.inertia and pace.inertia < _MAX_INERTIA_RATIO * inertia
    )
    return alike and (pace.kept < _MAX_REUSE_CONTRACTION or pace.kept == 1.0)


@kernel
def _take_contacts(model, loads, f, fraction, work):
    """Take contacts for as linear as the matrix has them, in the right-hand side."""
    linearise_contacts(model, loads.contacts, f, fraction, work.now.points.nodes, work)


@kernel
def _solve(model, loads, f, kept, turns, work):
    """The step that the matrix, corrected by so many steps since, gives where contacts press as
    they will, after so many turns; to the right-hand side. Returns of how many steps the matrix
    still knows."""
    system, secants, closing, right = work.system, work.secants, work.closing, work.system.right
    copy_values(right, closing.right)
    begin_pair(kept, right, secants)
    solve_corrected(system.band, kept, secants, right)
    contacts = loads.contacts
    for _ in range(turns):
        if switch_contacts(model, contacts, f, right, False, work) == 0:
            break
        copy_values(closing.band, system.band)
        definite = factorise(system.band, system.panel)
        if not definite:
            # what a contact held may not hold itself
            switch_contacts(model, contacts, f, right, True, work)
            copy_values(closing.band, system.band)
            factorise(system.band, system.panel)
        kept = 0
        copy_values(closing.right, right)
        begin_pair(kept, right, secants)
        solve_corrected(system.band, kept, secants, right)
        if not definite:
            break
    store_step(kept, right, secants)
    return kept


@kernel
def _factorise_stored(model, loads, f, fraction, work):
    """Have contacts in a matrix that was kept without them, and factorise; returns whether it is
    definite."""
    now, system, kept = work.now, work.system, work.kept
    if kept.plain.shape[0] == 0:
        return False
    barb_jacobians(model.shapes, now, work.axes, work.jacobian)
    turn_contact_axes(kept.made, now.rotation, work.closing)
    copy_values(kept.plain, system.band)
    add_contacts_to_matrix(model, loads.contacts, f, fraction, now.points.nodes, True, work)
    return factorise(system.band, system.panel)


@kernel
def _reuse_matrix(model, loads, f, fraction, factors, first, work):
    """Minus the gradient at work.now for the matrix that is kept, in its coordinates, and, at the
    first solve with one that knows no contacts (first), these in it; returns whether it serves."""
    now, right = work.now, work.system.right
    assemble(model, loads, f, fraction, factors, FORCES_ONLY, 0.0, work)
    turn_rows(work.kept.made, now.rotation, right)
    serves = not first or _factorise_stored(model, loads, f, fraction, work)
    _take_contacts(model, loads, f, fraction, work)
    return serves


@kernel
def _new_matrix(model, loads, f, fraction, factors, last, before, work):
    """A matrix made and kept at work.now, and minus the gradient for it; arguments and what is
    returned as of _assemble_definite."""
    made = work.kept.made
    copy_values(work.now.rotation, made)
    turn_contact_axes(made, made, work.closing)
    shift = _assemble_definite(model, loads, f, fraction, factors, last, before, work)
    if shift != _INDEFINITE:
        _take_contacts(model, loads, f, fraction, work)
    return shift


@shared_kernel(NewtonResult)
def minimise(model, loads, f, fraction, factors, goal, work):
    """Bring the pose work.now to the minimum of step_energy.

    fraction: of the frame. goal: Goal. Returns NewtonResult.
    """
    now, right, secants, made = work.now, work.system.right, work.secants, work.kept.made
    begin, end = followed_contacts(model, loads.contacts, f)
    touches = turning = end > begin
    pace, tolerance = goal.pace, goal.tolerance
    reused, unfactored = _can_reuse(pace, factors.inertia), pace.pairs == _UNFACTORED
    energy = evaluate(model, loads, f, fraction, factors, now, work.around)
    if not isfinite(energy):
        return NewtonResult(NOT_FINITE, 0, 0, 0.0, UNKNOWN_CONVERGENCE)
    shrink, first, slowest, longest = pace.shrink**_CONTRACTION_MEMORY, pace.first, 1.0, 0.0
    inertia, kept = pace.inertia, 0
    if reused:
        slowest, longest = pace.kept**_CONTRACTION_MEMORY, pace.longest
        kept = pace.pairs if 0 <= pace.pairs < MAX_SECANT_PAIRS - 2 else 0
    before, left, shift, stable, matrices = 0.0, inf, 0.0, 0, 0
    crept, fresh = False, not reused
    for iteration in range(1, goal.limit + 1):
        if not fresh:
            first_of_it = iteration == 1 and unfactored
            fresh = not _reuse_matrix(model, loads, f, fraction, factors, first_of_it, work)
            if iteration > 1:
                fresh = not end_pair(kept, right, secants)
                kept += 1
        if fresh:
            last, begun = (
                shift if crept or shift == STABILISED_ONLY else STABILISED,
                turning and iteration == 1,
            )
            shift = _new_matrix(model, loads, f, fraction, factors, last, begun, work)
            if shift == _INDEFINITE:
                return NewtonResult(NOT_DEFINITE, iteration, matrices, left, UNKNOWN_CONVERGENCE)
            kept, matrices, slowest, longest = 0, matrices + 1, 1.0, 0.0
            inertia = factors.inertia if shift == 0.0 else 0.0
            stable += 1 if shift == STABILISED else 0
            if stable == _MAX_STABILISED_ITERATIONS:
                crept, shift = True, 0.0
        kept = _solve(model, loads, f, kept, _MAX_CONTACT_SWITCHES if turning else 0, work)
        level = energy, 0.0 if goal.firm else _slope(work.closing.right, right)
        if not fresh:
            turn_rows(now.rotation, made, right)
        new, move, scale = _search(model, loads, f, fraction, factors, level, tolerance, work)
        if scale == 0.0 and turning:
            turning, fresh = False, True
            continue
        if scale == 0.0:
            if fresh and ((crept and shift == STABILISED) or shift > MAX_SHIFT):
                move *= 1.0 + max(shift, 0.0)
                return NewtonResult(NOT_CONVERGED, iteration, matrices, move, UNKNOWN_CONVERGENCE)
            if fresh:
                crept, shift = crept or shift == STABILISED, _stiffer(shift, goal.firm)
            fresh = True
            continue
        copy_pose(work.trial, now)
        # what rounding lets it rise by does not add up
        energy = min(energy, new)
        # inertia that was added makes moves shorter
        move *= 1.0 + max(shift, 0.0)
        left, turning = move, touches and scale == 1.0
        if fresh and scale < (0.5 if shift > 0.0 else _MIN_STEP_FRACTION):
            crept, shift = crept or shift == STABILISED, _stiffer(shift, goal.firm)
        if scale == 1.0:
            left = _distance_left(move, before, fresh)
            if iteration == 1:
                left = _first_left(move, reused, pace) if not touches else move
            elif before > 0.0 and not fresh:
                slowest, longest = move / before, before
            if iteration == 2 and before > 0.0 and not reused:
                shrink, first = move / before, before
            if left < tolerance:
                pairs = _UNFACTORED if touches else kept
                found = ConvergenceHistory(shrink, first, slowest, longest, inertia, pairs)
                return NewtonResult(CONVERGED, iteration, matrices, left, found)
        slow = not fresh and before > 0.0 and move > _MAX_REUSE_CONTRACTION * before
        fresh = slow or scale < 1.0 or shift != 0.0 or kept + 1 == MAX_SECANT_PAIRS
        before = move if scale == 1.0 else 0.0
    return NewtonResult(NOT_CONVERGED, goal.limit, matrices, left, UNKNOWN_CONVERGENCE)


@kernel
def accept_nearly_solved(solved, error, allowed):
    """Its status, or CONVERGED where Newton ended close to the minimum.

    error: m, of the step, far above its distance from the solution; within a part of the tolerance
    alone, short steps would end with accelerations, and energy in them, that are not there.
    allowed: m, a distance that is close enough whatever the error.
    """
    if solved.status == NOT_CONVERGED and solved.move <= max(_NEARLY_SOLVED_RATIO * error, allowed):
        return CONVERGED
    return solved.status
