"""Changing data of a batch, and what a step reports."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import frames_to_quats
from featherfx.mechanics.model import Model
from featherfx.solver.step.pose_kernels import rest_pose
from featherfx.solver.step.strain_kernels import Strains
from featherfx.solver.work import make_pose, no_strains

Array = NDArray[np.float64]


class State(NamedTuple):
    """Generalised coordinates and rates of F feathers at one time (see Model for F, n, C, P).

    rotation: (F, n, 4) row frames as quaternions. centre: (F, n, 3) m. coefficient: (F, 2, n, 2 C)
    rad. points: (F, n, P, 3) material points, velocity and acceleration: their rates; smoothed:
    the integrator's averaged acceleration. spin: (F, n, 3) rad/s and coefficient_rate:
    (F, 2, n, 2 C) rad/s of the last step, for the next predictor. strains: (F, 2, ...) after the
    last step and the one before. step: (F,) s, its length, 0 before the first. proposal: (F,) s,
    length that the error control wants next. time: (F,) s.
    """

    rotation: Array
    centre: Array
    coefficient: Array
    points: Array
    velocity: Array
    acceleration: Array
    smoothed: Array
    spin: Array
    coefficient_rate: Array
    strains: Strains
    step: Array
    proposal: Array
    time: Array

    def copy(self) -> State:
        return State.of({name: array.copy() for name, array in self.arrays().items()})

    def take(self, other: State, f: int) -> None:
        """Set feather f, in place, to what it is in another state."""
        given = other.arrays()
        for name, array in self.arrays().items():
            array[f] = given[name][f]

    @staticmethod
    def names() -> list[str]:
        """Names of all arrays, those of the strains, too."""
        own = [name for name in State._fields if name != "strains"]
        return own + [f"strains.{name}" for name in Strains._fields]

    def arrays(self) -> dict[str, Array]:
        """All arrays by name."""
        fields: dict[str, Any] = self._asdict()
        strains: Strains = fields.pop("strains")
        return dict(zip(State.names(), (*fields.values(), *strains), strict=True))

    @staticmethod
    def of(arrays: Mapping[str, Array]) -> State:
        """The state of its `arrays`; KeyError where one is missing."""
        fields: dict[str, Any] = {name: arrays[name] for name in State.names()}
        strains = Strains(*(fields.pop(f"strains.{name}") for name in Strains._fields))
        return State(strains=strains, **fields)


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
        rotation=np.zeros((count, n, 4)),
        centre=np.zeros((count, n, 3)),
        coefficient=np.zeros((count, 2, n, 2 * c)),
        points=np.zeros(nodes),
        velocity=np.zeros(nodes),
        acceleration=np.zeros(nodes),
        smoothed=np.zeros(nodes),
        spin=np.zeros((count, n, 3)),
        coefficient_rate=np.zeros((count, 2, n, 2 * c)),
        strains=no_strains(model, count, 2),
        step=np.zeros(count),
        proposal=np.zeros(count),
        time=np.zeros(count),
    )
    roots = np.ascontiguousarray(positions, dtype=float)
    quats = frames_to_quats(np.asarray(rotations, dtype=float))
    rest_pose(model, roots, quats, state, make_pose(model))
    return state
