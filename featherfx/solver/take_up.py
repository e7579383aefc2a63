"""Rows of one feather set to a given pose and motion, from which its steps begin anew."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Model
from featherfx.mechanics.turns import along_rows, frames_to_turns
from featherfx.solver.state import State
from featherfx.solver.take_up_kernels import take_up_pose
from featherfx.solver.work import make_work

Array = NDArray[np.float64]


def take_up(
    model: Model,
    state: State,
    f: int,
    frames: Array,
    centres: Array,
    coefficients: Array,
    velocity: Array,
    time: float,
) -> None:
    """Put feather f of the state into a pose, in place.

    frames: (n, 3, 3) row frames. centres: (n, 3) m. coefficients: (2, n, 2 C). velocity:
    (n, P, 3) m/s of the material points. time: s. The first step then finds the accelerations that
    belong to pose and velocity (featherfx/solver/start.py).
    """
    state.turn[f] = along_rows(frames_to_turns(frames))
    state.centre[f], state.coefficient[f] = centres, coefficients
    for fresh in (state.acceleration, state.smoothed, state.spin, state.coefficient_rate):
        fresh[f] = 0.0
    state.velocity[f] = velocity
    state.step[f] = state.proposal[f] = 0.0
    state.time[f] = time
    work = make_work(model)
    points, strains = state.points[f], state.strains[f, 0]
    pose = state.turn[f], state.centre[f], state.coefficient[f]
    take_up_pose(model, f, *pose, points, work.now, work.around.reference, strains)
    state.strains[f, 1] = strains
