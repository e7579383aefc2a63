"""The state of feathers whose rest shape has become another one while they move."""

from __future__ import annotations

import numpy as np

from featherfx.algebra.rotation import along_rows, frames_to_quats, quats_to_frames
from featherfx.algebra.types import Array
from featherfx.mechanics.model import Model
from featherfx.solver.state import State, rest_state, set_pose
from featherfx.solver.work import make_gaps


def reshaped(before: Model, after: Model, state: State) -> State:
    """A state of feathers as it is in their new shapes.

    before, after: models of one grid. Rows keep the turns by which they differ from rest, barbs
    their coefficients, points their velocities. What keeps its shape keeps its state.
    """
    same = [
        np.array_equal(getattr(before, name), getattr(after, name))
        for name in ("length", "rachis_rest", "clamp", "joints", "segment", "cell_rest")
    ]
    if all(same):
        gaps = make_gaps(after, after.feathers)
        return state if bool(gaps) == bool(state.gaps) else state._replace(gaps=gaps)
    roots = state.centre[:, 0], quats_to_frames(state.rotation[:, 0])
    was, new = (rest_state(model, *roots) for model in (before, after))
    turns = quats_to_frames(state.rotation) @ quats_to_frames(was.rotation).swapaxes(-1, -2)
    frames = turns @ quats_to_frames(new.rotation)
    for f in range(after.feathers):
        centres = _chained(after, f, frames[f], state.centre[f, 0])
        velocity = state.velocity.at(f)
        rest = state.coefficient[f], velocity, float(state.time[f])
        set_pose(after, new, f, frames[f], centres, *rest)
    return new


def _chained(model: Model, feather: int, frames: Array, root: Array) -> Array:
    """(n, 3) points of an unstretched shaft with these row frames (n, 3, 3)."""
    quats = along_rows(frames_to_quats(frames))
    middle = quats_to_frames(quats[1:] + quats[:-1])  # which makes them unit quaternions
    ways = np.einsum("nij,nj->ni", middle, model.rachis_rest[feather, :, :3])
    return root + np.concatenate(
        [np.zeros((1, 3)), np.cumsum(model.length[feather, :, None] * ways, axis=0)]
    )
