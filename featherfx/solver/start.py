"""Acceleration of a feather whose steps are yet to begin."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from featherfx.mechanics.model import Loads, Model
from featherfx.solver.newton_kernels import minimise
from featherfx.solver.pose_kernels import load_pose
from featherfx.solver.state import State
from featherfx.solver.step_kernels import KNOWN
from featherfx.solver.work import Work

if TYPE_CHECKING:
    from featherfx.solver.nodal_state import NodalState

Array = NDArray[np.float64]

# the instant over which the first acceleration is taken, as a share of the step, and the Newton
# iterations that it gets: the second one only corrects for the curved paths of barbs and frames
<<<<<<< HEAD
INSTANT, START_ITERATIONS = 0.1, 3
# how far the first acceleration may carry a point in the first step, as a share of the shaft
RESOLVED = 0.02
=======
INSTANT, START_ITERATIONS = 1.0, 3
>>>>>>> bench


def start_acceleration(
    model: Model, loads: Loads, f: int, duration: float, state: State, work: Work
) -> None:
    """Set the accelerations of feather f, in place, to those that its pose and velocity give.

    One implicit Euler step over the duration (s), a = (x - x0 - h v0) / h^2, which is then taken
    back. What vibrates faster than that is left at rest: with a tenth of the duration, vibrations
    that the first step does not resolve would double their energy in it (radius 0; with a fifth
    or more a linear one never gains, with the whole no crumpled feather was seen to). With wrong
    accelerations the time integration would lose its second order at once.

    A feather that they would carry far in the first step (it was let go crumpled, say) is not
    resolved by that step: it is marked as UNKNOWN and begins with implicit Euler, which can only
    lose energy.
    """
    h = INSTANT * duration
    now, around = work.now, work.around
    load_pose(state.turn[f], state.centre[f], state.coefficient[f], model.length[f], now)
    around.target[:] = state.points[f] + h * state.velocity[f]
    around.reference[:] = state.strains[f, 0]
    factors = (1.0 / (h * h), 0.0, 0.0)
    minimise(model, loads, f, 0.0, factors, 0.0, START_ITERATIONS, work)
    begin(f, duration, float(model.length[f].sum()), now.points - around.target, state)


def begin(f: int, duration: float, length: float, move: Array, state: State | NodalState) -> None:
    """Take over accelerations from a move (n, P, 3) over the first instant, if it is short.

    duration: s, of the step. length: m, of the shaft.
    """
    acceleration = move / (INSTANT * duration) ** 2
    places = np.delete(acceleration, (1, 2), axis=1)
    reach = 0.5 * duration**2 * float(np.linalg.norm(places, axis=2).max())
    if not reach <= RESOLVED * length:
        return
    state.acceleration[f] = acceleration
    state.smoothed[f] = acceleration
    state.step[f] = KNOWN
