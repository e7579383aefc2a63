"""Minimise the energy of one implicit step: Newton with a line search on the full energy.

Where the matrix is indefinite, only the stabilising part of the geometric stiffness is taken. That
is definite, but may be so much stiffer that the feather creeps: after CREPT such iterations,
inertia is added to the whole matrix instead, as if the step were shorter, as much as it takes.

It stops where the distance to the minimum is below the tolerance. With moves d_1, d_2, ... of full
steps that shrink by t = d_k / d_(k-1) < 1/2, that distance is at most d_k t / (1 - t) if they go on
to shrink like that (Newton's shrink faster); else it is taken as d_k itself.
"""

from math import isfinite, sqrt

from featherfx.compiled import kernel, shared_kernel
from featherfx.mechanics.copy_kernels import copy_values
from featherfx.solver.assembly_kernels import assemble
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.energy_kernels import feather_strains, step_energy
from featherfx.solver.pose_kernels import (
    add_increment,
    barb_jacobians,
    material_points,
    rachis_strains,
)

CONVERGED, NOT_CONVERGED, NOT_FINITE, NOT_DEFINITE, TOO_MUCH_WORK = 0, 1, 2, 3, 4
HALVINGS = 8
# shares of the inertia that are added to an indefinite matrix; what is done beyond the last
FIRST_SHIFT, GROWTH, LAST_SHIFT = 0.25, 4.0, 100.0
STABLE, NONE = -1.0, -2.0
CREPT = 4


@kernel
def largest_move(before, after, arm):
    """Largest distance between two sets of material points (n, P, 3), m.

    Directors are unit vectors; arm (m) is the lever at which their turn counts.
    """
    worst = 0.0
    for i in range(before.shape[0]):
        for p in range(before.shape[1]):
            square = 0.0
            for k in range(3):
                square += (after[i, p, k] - before[i, p, k]) ** 2
            if p == 1 or p == 2:
                square *= arm * arm
            worst = max(worst, square)
    return sqrt(worst)


@shared_kernel
def evaluate(model, loads, f, share, factors, pose, around):
    """Points and strains of a pose from its coordinates, and its energy (J)."""
    material_points(model, f, pose.turn, pose.centre, pose.coefficient, pose.points)
    rachis_strains(model.length[f], pose.turn, pose.centre, pose.halfway, pose.rachis)
    feather_strains(
        model, f, pose.coefficient, pose.points, pose.rachis, around.reference, pose.strains
    )
    return step_energy(model, loads, f, share, factors, pose, around)


@kernel
def copy_pose(source, target):
    """All arrays of one pose to another's."""
    copy_values(source.turn, target.turn)
    copy_values(source.centre, target.centre)
    copy_values(source.coefficient, target.coefficient)
    copy_values(source.points, target.points)
    copy_values(source.halfway, target.halfway)
    copy_values(source.rachis, target.rachis)
    copy_values(source.strains, target.strains)


@kernel
def _factorised(model, loads, f, share, factors, last, work):
    """Assemble at work.now and factorise; returns the shift that made the matrix definite.

    last: shift of the iteration before. STABLE: only the stabilising part of the geometric
    stiffness is in the matrix; NONE: not even that is definite.
    """
    system = work.system
    shift = last / GROWTH if last > FIRST_SHIFT * GROWTH else 0.0
    while True:
        assemble(model, loads, f, share, factors, shift != STABLE, max(shift, 0.0), work)
        if factorise(system.band, system.panel):
            return shift
        if shift == STABLE:
            return NONE
        shift = GROWTH * shift if shift > 0.0 else FIRST_SHIFT
        if last == STABLE or shift > LAST_SHIFT:
            shift = STABLE


@shared_kernel
def minimise(model, loads, f, share, factors, tolerance, limit, work):
    """Bring the pose work.now to the minimum of step_energy.

    factors: (inertia, rate, strain rate) of the integrator. tolerance: m, distance from the
    minimum that counts as converged. limit: most iterations. Returns (status, iterations, distance
    as estimated).
    """
    now, trial, system = work.now, work.trial, work.system
    energy = evaluate(model, loads, f, share, factors, now, work.around)
    if not isfinite(energy):
        return NOT_FINITE, 0, 0.0
    move, before, left, shift, stable = 0.0, 0.0, 0.0, 0.0, 0
    crept = False
    for iteration in range(1, limit + 1):
        barb_jacobians(model, f, now, work.frame, work.spin, work.jacobian)
        shift = _factorised(model, loads, f, share, factors, shift if crept else STABLE, work)
        if shift == NONE:
            return NOT_DEFINITE, iteration, move
        solve_factored(system.band, system.right)
        stable += 1 if shift == STABLE else 0
        if stable == CREPT:
            crept, shift = True, 0.0
        scale = 1.0
        for _ in range(HALVINGS):
            add_increment(
                model.length[f], now, system.right, scale, trial, work.beam.gradient, work.stretch
            )
            new = evaluate(model, loads, f, share, factors, trial, work.around)
            move = largest_move(now.points, trial.points, model.length[f, 0]) / scale
            slack = 1e-9 * (abs(energy) + abs(new))
            if isfinite(new) and (new <= energy + slack or move < tolerance):
                break
            scale *= 0.5
        else:
            if shift == STABLE:
                return NOT_CONVERGED, iteration, move
            shift = STABLE
            continue
        if shift > 0.0 and scale < 0.5:
            shift *= GROWTH * GROWTH
        copy_pose(trial, now)
        energy = new
        full = scale == 1.0
        left = move
        if full and move < 0.5 * before:
            left = move * move / (before - move)
        before = move if full else 0.0
        if left < tolerance:
            return CONVERGED, iteration, left
    return NOT_CONVERGED, limit, left
