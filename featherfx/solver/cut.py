"""A root that a path takes up elsewhere than the state left it: the feather is carried along."""

from __future__ import annotations

import numpy as np

from featherfx.mechanics.model import Model
from featherfx.mechanics.turns import turns_to_frames
from featherfx.solver.root_path import RootPath
from featherfx.solver.state import State

# m and rad; what a path may differ from the state by round-off
SAME = 1e-9


def carry_to(model: Model, state: State, path: RootPath) -> None:
    """Move held feathers rigidly, in place, to where their paths begin.

    A jump in no time is a cut in the animation, not a motion: taken as one it would throw the
    feather with its length over the step, and shorter steps would throw it harder. Velocities and
    accelerations turn with the feather. Feathers that are there already are not touched.
    """
    move = path.samples[:, 0, :3] - state.centre[:, 0]
    apart = 1.0 - np.abs(np.einsum("fk,fk->f", path.base, state.turn[:, 0]))
    cut = model.held & ((np.abs(move).max(axis=1) > SAME) | (apart > 0.125 * SAME))
    for f in np.flatnonzero(cut):
        _carry(int(f), state, path)


def _carry(f: int, state: State, path: RootPath) -> None:
    from scipy.spatial.transform import Rotation

    before, after = turns_to_frames(np.stack([state.turn[f, 0], path.base[f]]))
    turn = after @ before.T
    old, new = state.centre[f, 0].copy(), path.samples[f, 0, :3]
    state.centre[f] = new + (state.centre[f] - old) @ turn.T
    directors = state.points[f, :, 1:3] @ turn.T
    state.points[f] = new + (state.points[f] - old) @ turn.T
    state.points[f, :, 1:3] = directors
    for rate in (state.velocity, state.acceleration, state.smoothed, state.spin):
        rate[f] = rate[f] @ turn.T
    rows = Rotation.from_matrix(turn) * Rotation.from_quat(np.roll(state.turn[f], -1, axis=-1))
    turns = np.roll(rows.as_quat(), 1, axis=-1)
    # the signs of neighbours belong together (rachis_kernels), the root's follows theirs
    state.turn[f] = turns
    state.turn[f, 0] = np.copysign(1.0, turns[0] @ path.base[f]) * path.base[f]
