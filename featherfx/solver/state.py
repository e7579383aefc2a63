"""State of a batch, paths of its roots, what a step reports, and poses set from outside."""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import along_rows, frames_to_quats, quats_to_frames
from featherfx.feather.types import RowPoints
from featherfx.jit.compiled import KernelModule
from featherfx.mechanics.model import Gaps, Model
from featherfx.solver.scratch import make_gaps, make_points, make_pose, make_scratch, make_strains
from featherfx.solver.types import Strains

vector_kernels = KernelModule("featherfx.algebra.vector_kernels")
pose_kernels = KernelModule("featherfx.solver.step.pose_kernels")


class State(NamedTuple):
    """Generalised coordinates and rates of F feathers at one time (see Model for F, n, C).

    rotation: (F, n, 4) row frames as quaternions. centre: (F, n, 3) m. coefficient: (F, 2, n, 2 C)
    rad. points: (F, ...) nodes and directors, velocity and acceleration: their rates; smoothed: the
    integrator's averaged acceleration. spin: (F, n, 3) rad/s and coefficient_rate:
    (F, 2, n, 2 C) rad/s of the last step, for the next predictor. strains: (F, 2 + B, ...) after
    the last step, after the one before, and of the dashpots (step/strain_kernels). step: (F,)
    s, its length, 0 before the first. proposal: (F,) s, length that the error control wants next.
    time: (F,) s. gaps: (F, ...).
    """

    rotation: Array
    centre: Array
    coefficient: Array
    points: RowPoints
    velocity: RowPoints
    acceleration: RowPoints
    smoothed: RowPoints
    spin: Array
    coefficient_rate: Array
    strains: Strains
    step: Array
    proposal: Array
    time: Array
    gaps: Gaps

    def copy(self) -> State:
        return State.from_arrays({name: array.copy() for name, array in self.arrays().items()})

    def rates(self) -> tuple[Array, ...]:
        """Arrays that are zero where nothing moves."""
        points = *self.velocity, *self.acceleration, *self.smoothed
        return *points, self.spin, self.coefficient_rate

    def take(self, other: State, f: int) -> None:
        """Set feather f, in place, to what it is in another state."""
        given = other.arrays()
        for name, array in self.arrays().items():
            array[f] = given[name][f]

    def part(self, some: slice) -> State:
        """Some feathers, the same memory."""
        return State.from_arrays({name: array[some] for name, array in self.arrays().items()})

    def gaps_of(self, f: int) -> Gaps:
        """Gaps of one feather, the same memory."""
        return Gaps(*(array[f] for array in self.gaps))

    @staticmethod
    def names() -> list[str]:
        """Names of all arrays, those of structures as structure.array."""
        return list(_GETTERS)

    def arrays(self) -> dict[str, Array]:
        """All arrays by name."""
        return {name: get(self) for name, get in _GETTERS.items()}

    @staticmethod
    def from_arrays(arrays: Mapping[str, Array]) -> State:
        """The state of its `arrays`; KeyError where one is missing."""
        fields: dict[str, Any] = {}
        for name, *within in _PATHS:
            if within:
                fields.setdefault(name, {})[within[0]] = arrays[f"{name}.{within[0]}"]
            else:
                fields[name] = arrays[name]
        fields |= {k: kind(**fields[k]) for k, kind in _STRUCTURES.items()}
        return State(**fields)


# fields of a state that hold several arrays, and the ways to all arrays
_STRUCTURES: dict[str, type[RowPoints] | type[Strains] | type[Gaps]] = {
    "points": RowPoints,
    "velocity": RowPoints,
    "acceleration": RowPoints,
    "smoothed": RowPoints,
    "strains": Strains,
    "gaps": Gaps,
}
_PATHS = [
    (name, *within)
    for name in State._fields
    for within in ([(each,) for each in _STRUCTURES[name]._fields] if name in _STRUCTURES else [()])
]
_GETTERS = {name: attrgetter(name) for name in map(".".join, _PATHS)}


class StepReport(NamedTuple):
    """Counts and errors of one call, per feather: (F,) arrays.

    steps, iterations, matrices, rejected, failed, fallbacks: counts of accepted substeps, Newton
    iterations (linear solves), new matrices among them, steps repeated for their error, attempts
    that Newton gave up, implicit Euler steps. Of steps accepted because none shorter is allowed,
    forced: those whose local error is above the tolerance; passed, slipped: those in which loose
    barbs pass through each other, and in which hooks slip by more than a step should
    (gap_kernels). error: m, largest accepted local error. move: m, largest distance of a step from
    its solution, as Newton's last moves tell. status: 0, or why the feather stopped
    (featherfx/solver/types.py).
    """

    steps: Array
    iterations: Array
    matrices: Array
    rejected: Array
    failed: Array
    fallbacks: Array
    forced: Array
    passed: Array
    slipped: Array
    error: Array
    move: Array
    status: Array

    def too_long(self) -> NDArray[np.bool_]:
        """(F,) feathers of which a step was longer than its errors allow."""
        return np.asarray((self.forced > 0.0) | (self.passed > 0.0) | (self.slipped > 0.0))


# of a report: what a step was longer for than it should be, and figures of which the largest counts
LONG_STEP_COUNTS, LARGEST_FIGURES = ("forced", "passed", "slipped"), ("error", "move", "status")


def make_report(feathers: int) -> StepReport:
    """The report of a call that has done nothing yet."""
    return StepReport(*(np.zeros(feathers) for _ in StepReport._fields))


def rest_state(model: Model, positions: Array, rotations: Array) -> State:
    """Feathers at rest in their rest shape, roots at positions (F, 3), rotations (F, 3, 3)."""
    n, m, c, count = model.rows, model.columns, model.coefficients, model.feathers
    state = State(
        rotation=np.zeros((count, n, 4)),
        centre=np.zeros((count, n, 3)),
        coefficient=np.zeros((count, 2, n, 2 * c)),
        points=make_points(n, m, count),
        velocity=make_points(n, m, count),
        acceleration=make_points(n, m, count),
        smoothed=make_points(n, m, count),
        spin=np.zeros((count, n, 3)),
        coefficient_rate=np.zeros((count, 2, n, 2 * c)),
        strains=make_strains(model, count, 2 + model.relaxation_time.shape[2]),
        step=np.zeros(count),
        proposal=np.zeros(count),
        time=np.zeros(count),
        gaps=make_gaps(model, count),
    )
    roots = np.ascontiguousarray(positions, dtype=float)
    quats = frames_to_quats(np.asarray(rotations, dtype=float))
    pose_kernels.rest_pose(model, roots, quats, state, make_pose(model))
    return state


class RootPath(NamedTuple):
    """Paths of the roots during a frame.

    samples: (F, K, 6) position (m) and rotation vector (rad) relative to the first sample, at K
    evenly spaced fractions of the frame. base: (F, 4) quaternion of the first sample.
    """

    samples: Array
    base: Array

    def part(self, some: slice) -> RootPath:
        """The paths of some feathers, the same memory."""
        return RootPath(self.samples[some], self.base[some])


def hold_roots(state: State) -> RootPath:
    """A path that keeps all roots where they are."""
    samples = np.zeros((len(state.rotation), 2, 6))
    samples[:, :, :3] = state.centre[:, None, 0]
    return RootPath(samples, state.rotation[:, 0].copy())


def set_pose(
    model: Model,
    state: State,
    f: int,
    frames: Array,
    centres: Array,
    coefficients: Array,
    velocity: RowPoints,
    time: float,
) -> None:
    """Put feather f of the state into a pose, in place.

    frames: (n, 3, 3) row frames. centres: (n, 3) m. coefficients: (2, n, 2 C). velocity: of nodes
    and directors. time: s. The first step then finds the accelerations that belong to pose and
    velocity (featherfx/solver/step/step_control_kernels.py).
    """
    state.rotation[f] = along_rows(frames_to_quats(frames))
    state.centre[f], state.coefficient[f] = centres, coefficients
    for rate in state.rates():
        rate[f] = 0.0
    state.velocity.at(f).assign(velocity)
    state.step[f] = state.proposal[f] = 0.0
    state.time[f] = time
    work = make_scratch(model)
    pose_kernels.load_pose(model, f, state, work.now)
    pose_kernels.complete_pose(model, f, work.now, work.around.angles)
    state.points.at(f).assign(work.now.points)
    for each in range(state.strains.rachis.shape[1]):
        state.strains.at(f, each).assign(work.now.strains)


# m and rad; what a path may differ from the state by round-off
_SAME_PLACE = 1e-9


def carry_to(held: Flags, state: State, path: RootPath) -> None:
    """Move held feathers (F,) rigidly, in place, to where their paths begin.

    A jump in no time is a cut in the animation, not a motion: taken as one it would throw the
    feather with its length over the step, and shorter steps would throw it harder. Velocities and
    accelerations turn with the feather. Feathers that are there already are not touched.
    """
    move = np.abs(path.samples[:, 0, :3] - state.centre[:, 0])
    near = np.abs(np.einsum("fk,fk->f", path.base, state.rotation[:, 0]))
    if move.max(initial=0.0) <= _SAME_PLACE and near.min(initial=1.0) >= 1.0 - 0.125 * _SAME_PLACE:
        return
    cut = held & ((move.max(axis=1) > _SAME_PLACE) | (near < 1.0 - 0.125 * _SAME_PLACE))
    for f in np.flatnonzero(cut):
        _carry(int(f), state, path)


def _carry(f: int, state: State, path: RootPath) -> None:
    multiply, normalised = vector_kernels.multiply, vector_kernels.normalised
    move = multiply(path.base[f], vector_kernels.conjugate(state.rotation[f, 0]))
    turn = quats_to_frames(np.array(move))
    old, new = state.centre[f, 0].copy(), path.samples[f, 0, :3]
    state.centre[f] = new + (state.centre[f] - old) @ turn.T
    state.points.nodes[f] = new + (state.points.nodes[f] - old) @ turn.T
    rates = *state.velocity, *state.acceleration, *state.smoothed, state.spin
    for turned in (state.points.directors, *rates):
        turned[f] = turned[f] @ turn.T
    # the signs of neighbours belong together (rachis_kernels)
    state.rotation[f] = [normalised(multiply(move, row)) for row in state.rotation[f]]
    state.rotation[f, 0] = path.base[f]
