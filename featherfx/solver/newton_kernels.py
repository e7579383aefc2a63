"""Minimise the energy of one implicit step: Gauss-Newton with a line search on the full energy."""

from math import isfinite, sqrt

from featherfx.compiled import kernel
from featherfx.solver.assembly_kernels import assemble
from featherfx.solver.banded_kernels import factorise, solve_factored
from featherfx.solver.energy_kernels import feather_strains, step_energy
from featherfx.solver.pose_kernels import (
    add_increment,
    barb_jacobians,
    material_points,
    rachis_strains,
)

CONVERGED, NOT_CONVERGED, NOT_FINITE, NOT_DEFINITE = 0, 1, 2, 3
HALVINGS = 8


@kernel
def largest_move(before, after):
    """Largest distance between two sets of material points (n, P, 3), directors left out."""
    worst = 0.0
    for i in range(before.shape[0]):
        for p in range(before.shape[1]):
            if p == 1 or p == 2:
                continue
            square = 0.0
            for k in range(3):
                square += (after[i, p, k] - before[i, p, k]) ** 2
            worst = max(worst, square)
    return sqrt(worst)


@kernel
def _evaluate(model, loads, f, share, factors, turn, centre, coefficient, points, work):
    """Points, strains and energy of a pose; work.trial_halfway, trial_rachis, trial_strains."""
    material_points(model, f, turn, centre, coefficient, points)
    rachis_strains(model, f, turn, centre, work.trial_halfway, work.trial_rachis)
    feather_strains(model, f, coefficient, points, work.trial_rachis, work.trial_strains)
    return step_energy(
        model,
        loads,
        f,
        share,
        factors[0],
        factors[1],
        factors[2],
        points,
        work.trial_strains,
        work,
    )


@kernel
def _adopt(turn, centre, coefficient, points, work):
    """Make the trial pose the present one."""
    turn[:] = work.turn
    centre[:] = work.centre
    coefficient[:] = work.coefficient
    points[:] = work.points
    _adopt_strains(work)


@kernel
def _adopt_strains(work):
    work.halfway[:] = work.trial_halfway
    work.rachis[:] = work.trial_rachis
    work.strains[:] = work.trial_strains


@kernel
def minimise(
    model, loads, f, share, factors, turn, centre, coefficient, points, tolerance, limit, work
):
    """Bring the pose (in place) to the minimum of step_energy.

    factors: (inertia, rate, strain rate) of the integrator. tolerance: m, the move of a Newton
    step that counts as converged. limit: most iterations. Returns (status, iterations, last move).
    """
    energy = _evaluate(model, loads, f, share, factors, turn, centre, coefficient, points, work)
    _adopt_strains(work)
    if not isfinite(energy):
        return NOT_FINITE, 0, 0.0
    move = 0.0
    for iteration in range(1, limit + 1):
        barb_jacobians(model, f, turn, coefficient, work)
        assemble(
            model, loads, f, share, factors[0], factors[1], factors[2], centre, points, work
        )
        if not factorise(work.band):
            return NOT_DEFINITE, iteration, move
        solve_factored(work.band, work.right)
        scale = 1.0
        accepted = False
        for _ in range(HALVINGS):
            add_increment(model, f, turn, centre, coefficient, work.right, scale, work)
            trial = _evaluate(
                model,
                loads,
                f,
                share,
                factors,
                work.turn,
                work.centre,
                work.coefficient,
                work.points,
                work,
            )
            move = largest_move(points, work.points) / scale
            slack = 1e-9 * (abs(energy) + abs(trial))
            if isfinite(trial) and (trial <= energy + slack or move < tolerance):
                accepted = True
                break
            scale *= 0.5
        if not accepted:
            return NOT_CONVERGED, iteration, move
        _adopt(turn, centre, coefficient, points, work)
        energy = trial
        if move < tolerance:
            return CONVERGED, iteration, move
    return NOT_CONVERGED, limit, move
