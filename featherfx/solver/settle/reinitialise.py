"""Rows of one feather set to a given pose and motion, from which its steps begin anew."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.rotation import along_rows, frames_to_quats, quats_to_frames
from featherfx.algebra.rotation_kernels import conjugate, multiply, normalised
from featherfx.algebra.types import Array, Flags
from featherfx.feather.types import RowPoints
from featherfx.mechanics.model import Model
from featherfx.solver.state import State
from featherfx.solver.step.pose_kernels import complete_pose, load_pose
from featherfx.solver.step.root_path import RootPath
from featherfx.solver.work import make_scratch


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
    velocity (featherfx/solver/step/start_kernels.py).
    """
    state.rotation[f] = along_rows(frames_to_quats(frames))
    state.centre[f], state.coefficient[f] = centres, coefficients
    for rate in state.rates():
        rate[f] = 0.0
    state.velocity.at(f).assign(velocity)
    state.step[f] = state.proposal[f] = 0.0
    state.time[f] = time
    work = make_scratch(model)
    load_pose(model, f, state, work.now)
    complete_pose(model, f, work.now, work.around.reference)
    state.points.at(f).assign(work.now.points)
    for step in range(2):
        state.strains.at(f, step).assign(work.now.strains)


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
    move = multiply(path.base[f], conjugate(state.rotation[f, 0]))
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
