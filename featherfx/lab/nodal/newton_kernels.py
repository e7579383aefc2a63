"""Minimise the energy of one implicit step in the nodal kinematics.

Two methods. The improved one takes full Newton steps, because a line search on an energy with
stiff barbs accepts only steps that hardly stretch them. Points do not move along straight lines:
rachis and barbs are rebuilt from the root outwards with the directions of the increment but the
stretch of its linear part, so that turning stretches nothing and the iterations hardly depend on
the stiffness. What keeps it safe is that a step in time that does not converge is repeated in
halves. The textbook one is projected Newton: Hessian with
the geometric stiffness of the current stresses, its negative part left out, and a line search on
the whole energy; it is kept to measure the improved one against.

Inextensible barbs: the method of multipliers (Hestenes 1969, Powell 1969). Stretch keeps the
stiffness of its modulus, and whenever Newton has converged, every segment's multiplier p takes
over its stress, p += k e, until no strain is left; the result does not depend on k. A constraint
that is eliminated instead would couple all nodes of a barb: that is the barb-curvature kinematics.
"""

from math import isfinite, sqrt
from typing import NamedTuple

from featherfx.algebra.vector_kernels import add, copy_values, dot, scale, store, sub
from featherfx.jit.compiled import kernel, shared_kernel
from featherfx.lab.nodal.assembly_kernels import nodal_assemble
from featherfx.lab.nodal.energy_kernels import nodal_step_energy, nodal_strains, sections
from featherfx.mechanics.rachis_kernels import rachis_gradient
from featherfx.mechanics.row_kernels import copy_points
from featherfx.solver.status import CONVERGED, NOT_CONVERGED, NOT_DEFINITE, NOT_FINITE
from featherfx.solver.step.banded_kernels import factorise, solve_factored
from featherfx.solver.step.newton_kernels import (
    MAX_LINE_SEARCH_TRIALS,
    UNKNOWN_CONVERGENCE,
    NewtonResult,
    largest_move,
)
from featherfx.solver.step.pose_kernels import chain, rotate_by, store_directors


class Minimiser(NamedTuple):
    """Options of a solve: tolerance (m), the move of a Newton step that counts as converged; most
    iterations; textbook: which method."""

    tolerance: float
    iterations: int
    textbook: bool


# largest strain of an inextensible segment
_INEXTENSIBLE = 1e-10
# of the diagonal, where the stiffness is singular
_SHIFT = 1e-8


@kernel
def set_directors(pose):
    """Directors of all rows from their frames."""
    for i in range(pose.rotation.shape[0]):
        store_directors(pose.rotation[i], pose.points.directors[i])


@kernel
def gather(present, nodes):
    """Nodes (n, 1 + 2 m, 3) of absent barbs to their rachis points; present: (2, n)."""
    columns = nodes.shape[1] // 2
    for side in range(2):
        for i in range(nodes.shape[0]):
            if not present[side, i]:
                for p in range(1 + side * columns, 1 + (side + 1) * columns):
                    for k in range(3):
                        nodes[i, p, k] = nodes[i, 0, k]


@kernel
def _rebuild_rachis(length, slot, frame_slot, factor, work):
    """Rachis points rebuilt from the first one, so that stretch and shear change linearly."""
    now, trial, step = work.now, work.trial, work.system.right
    beam, stretch = work.element.beam, work.element.stress
    for i in range(slot.shape[0] - 1):
        if slot[i + 1, 0] < 0 or frame_slot[i + 1] < 0:
            continue
        a, b = now.points.nodes[i, 0], now.points.nodes[i + 1, 0]
        rachis_gradient(a, b, length[i], now.halfway[i], now.rachis[i], beam)
        for k in range(3):
            change = 0.0
            for node in range(4):
                row = i + node // 2
                at = slot[row, 0] if node % 2 == 0 else frame_slot[row]
                for x in range(3 if at >= 0 else 0):
                    change += beam[k, 3 * node + x] * step[at + x]
            stretch[k] = now.rachis[i, k] + factor * change
        chain(
            trial.rotation[i],
            trial.rotation[i + 1],
            stretch,
            length[i],
            trial.points.nodes[i, 0],
            trial.points.nodes[i + 1, 0],
        )


@kernel
def _barb(first, slot, now, step, factor, trial):
    """Nodes of one barb rebuilt from the rachis, so that every stretch e changes linearly.

    first: of its nodes. slot: (1 + 2 m,), now, trial: (1 + 2 m, 3) of the row.
    """
    columns = slot.shape[0] // 2
    # what the straight move of the node before and its rebuilt place are
    before, q = (0.0, 0.0, 0.0), 0
    if slot[0] >= 0:
        before = scale(factor, step[slot[0] :])
    for p in range(first, first + columns):
        at = slot[p]
        if at < 0:
            return
        move, span = scale(factor, step[at:]), sub(now[p], now[q])
        change = sub(move, before)
        wanted = dot(span, span) + 2.0 * dot(span, change)
        span = add(span, change)
        square = dot(span, span)
        # a segment that would vanish keeps the straight move
        stretch = sqrt(wanted / square) if wanted > 0.0625 * square else 1.0
        store(trial[p], add(trial[q], scale(stretch, span)))
        before, q = move, p


@shared_kernel(None)
def move_by(model, nodal, f, factor, straight, work):
    """Pose work.now plus factor times the increment work.system.right, to work.trial.

    straight: points move along straight lines. Otherwise, where there is a rachis, rachis and barbs
    are rebuilt so that their stretch changes by exactly its linear increment.
    """
    now, trial, step, slot = work.now, work.trial, work.system.right, nodal.slot[f]
    before, after, frame_slot = now.points.nodes, trial.points.nodes, nodal.frame_slot[f]
    for i in range(slot.shape[0]):
        at = frame_slot[i]
        if at >= 0:
            rotate_by(now.rotation[i], step[at : at + 3], factor, trial.rotation[i])
        else:
            for k in range(4):
                trial.rotation[i, k] = now.rotation[i, k]
        for p in range(slot.shape[1]):
            at = slot[i, p]
            for k in range(3):
                move = factor * step[at + k] if at >= 0 else 0.0
                after[i, p, k] = before[i, p, k] + move
    if nodal.has_rachis and not straight:
        _rebuild_rachis(model.length[f], slot, frame_slot, factor, work)
        columns = model.joints.shape[3]
        for i in range(slot.shape[0]):
            for side in range(2):
                if nodal.present[f, side, i]:
                    start = 1 + side * columns
                    _barb(start, slot[i], before[i], step, factor, after[i])
    gather(nodal.present[f], after)
    set_directors(trial)


@shared_kernel(float)
def evaluate(model, nodal, loads, f, fraction, factors, pose, work):
    """Strains of a pose from its points and frames, and its energy (J)."""
    nodal_strains(model, nodal, f, pose, work.element.frame)
    return nodal_step_energy(model, nodal, loads, f, fraction, factors, pose, work)


@kernel
def _copy_pose(source, target):
    copy_values(source.rotation, target.rotation)
    copy_points(source.points, target.points)
    copy_values(source.halfway, target.halfway)
    copy_values(source.rachis, target.rachis)
    copy_values(source.strains, target.strains)


@kernel
def _raise_multipliers(nodal, f, strains, multiplier):
    """Multipliers take over the stress of stretch; returns the largest strain."""
    at, end, _, _ = sections(multiplier.shape[1], multiplier.shape[2])
    stiffness, price = nodal.stretch_stiffness[f].flat, multiplier.flat
    worst = 0.0
    for a in range(end - at):
        price[a] += stiffness[a] * strains[at + a]
        if stiffness[a] > 0.0:
            worst = max(worst, abs(strains[at + a]))
    return worst


@kernel
def _solve(model, nodal, loads, f, fraction, factors, textbook, work):
    """Increment of the unknowns to work.system.right; returns whether it could be had."""
    system = work.system
    if textbook:
        copy_values(work.now.strains, work.before)
    for attempt in range(1 if textbook else 0, 3):
        nodal_assemble(model, nodal, loads, f, fraction, factors, attempt == 0, work)
        if attempt == 2:
            # what nothing holds, such as a strip turning about its pinned end, is rounding error
            for a in range(system.right.shape[0]):
                system.band[a, 0] *= 1.0 + _SHIFT
        if factorise(system.band, system.panel):
            solve_factored(system.band, system.right)
            return True
    return False


@shared_kernel(NewtonResult)
def nodal_minimise(model, nodal, loads, f, fraction, factors, method, work):
    """Bring the pose work.now to the minimum of nodal_step_energy.

    work.before: strains of the last converged pose. fraction: of the frame. method: Minimiser.
    Returns Solved; each iteration has a matrix of its own, and no pace is kept.
    """
    now, trial, textbook, tolerance = work.now, work.trial, method.textbook, method.tolerance
    energy = evaluate(model, nodal, loads, f, fraction, factors, now, work)
    move = 0.0
    for iteration in range(1, method.iterations + 1):
        if not isfinite(energy):
            return NewtonResult(NOT_FINITE, iteration, iteration, move, UNKNOWN_CONVERGENCE)
        if not _solve(model, nodal, loads, f, fraction, factors, textbook, work):
            return NewtonResult(NOT_DEFINITE, iteration, iteration, move, UNKNOWN_CONVERGENCE)
        factor = 1.0
        for _ in range(MAX_LINE_SEARCH_TRIALS if textbook else 1):
            move_by(model, nodal, f, factor, textbook, work)
            new = evaluate(model, nodal, loads, f, fraction, factors, trial, work)
            move = largest_move(now.points, trial.points, model.length[f, 0]) / factor
            slack = 1e-9 * (abs(energy) + abs(new))
            if isfinite(new) and (new <= energy + slack or move < tolerance):
                break
            factor *= 0.5
        copy_values(now.strains, work.before)
        _copy_pose(trial, now)
        energy = new
        if move < tolerance:
            if not nodal.inextensible:
                return NewtonResult(CONVERGED, iteration, iteration, move, UNKNOWN_CONVERGENCE)
            if _raise_multipliers(nodal, f, now.strains, work.multiplier) < _INEXTENSIBLE:
                return NewtonResult(CONVERGED, iteration, iteration, move, UNKNOWN_CONVERGENCE)
    return NewtonResult(
        NOT_CONVERGED, method.iterations, method.iterations, move, UNKNOWN_CONVERGENCE
    )
