"""Changing data of a batch, and what a step reports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import frames_to_quats, quats_to_frames
from featherfx.mechanics.model import Model
from featherfx.solver.rest_kernels import rest_pose
from featherfx.solver.work import strain_count

Array = NDArray[np.float64]


class State(NamedTuple):
    """Generalised coordinates and rates of F feathers at one time (see Model for F, n, C, P).

    turn: (F, n, 4) row frames as quaternions. centre: (F, n, 3) m. coefficient: (F, 2, n, 2 C)
    rad. points: (F, n, P, 3) material points, velocity and acceleration: their rates; smoothed:
    the integrator's averaged acceleration. spin: (F, n, 3) rad/s and coefficient_rate:
    (F, 2, n, 2 C) rad/s of the last step, for the next predictor. strains: (F, 2, S) after the
    last step and the one before. step: (F,) s, its length, 0 before the first. proposal: (F,) s,
    length that the error control wants next. time: (F,) s.
    """

    turn: Array
    centre: Array
    coefficient: Array
    points: Array
    velocity: Array
    acceleration: Array
    smoothed: Array
    spin: Array
    coefficient_rate: Array
    strains: Array
    step: Array
    proposal: Array
    time: Array

    def copy(self) -> State:
        return State(*(array.copy() for array in self))

    def take(self, other: State, f: int) -> None:
        """Set feather f, in place, to what it is in another state."""
        for array, given in zip(self, other, strict=True):
            array[f] = given[f]


class StepReport(NamedTuple):
    """What one call did, per feather: (F,) arrays.

    steps, iterations, matrices, rejected, failed, fallbacks: counts of accepted sub-steps, Newton
    iterations (linear solves), new matrices among them, steps repeated for their error, attempts
    that Newton gave up, implicit Euler steps. forced: steps accepted above the tolerance because
    none shorter is allowed. error: m, largest accepted local error. move: m, largest distance of a
    step from its solution, as Newton's last moves tell. status: 0, or why the feather stopped
    (featherfx/solver/status.py).
    """

    steps: Array
    iterations: Array
    matrices: Array
    rejected: Array
    failed: Array
    fallbacks: Array
    forced: Array
    error: Array
    move: Array
    status: Array


def no_steps(feathers: int) -> StepReport:
    """The report of a call that has done nothing yet."""
    return StepReport(*(np.zeros(feathers) for _ in StepReport._fields))


def rest_state(model: Model, positions: Array, rotations: Array) -> State:
    """Feathers at rest in their rest shape, roots at positions (F, 3), rotations (F, 3, 3)."""
    n, c, size = model.rows, model.coefficients, 3 + 2 * model.columns
    count = model.feathers
    nodes = (count, n, size, 3)
    state = State(
        turn=np.zeros((count, n, 4)),
        centre=np.zeros((count, n, 3)),
        coefficient=np.zeros((count, 2, n, 2 * c)),
        points=np.zeros(nodes),
        velocity=np.zeros(nodes),
        acceleration=np.zeros(nodes),
        smoothed=np.zeros(nodes),
        spin=np.zeros((count, n, 3)),
        coefficient_rate=np.zeros((count, 2, n, 2 * c)),
        strains=np.zeros((count, 2, strain_count(model))),
        step=np.zeros(count),
        proposal=np.zeros(count),
        time=np.zeros(count),
    )
    rest_pose(
        model,
        np.ascontiguousarray(positions, dtype=float),
        frames_to_quats(np.asarray(rotations, dtype=float)),
        state.turn,
        state.centre,
        state.coefficient,
        np.zeros((2, n, model.columns, 4)),
        state.points,
    )
    return state


def row_rotations(state: State) -> Array:
    """(F, n, 3, 3) row frames."""
    return quats_to_frames(state.turn)
