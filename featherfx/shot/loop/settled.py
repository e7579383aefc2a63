"""Feathers in balance before the first frame, or in full flutter where the wind allows no balance.

Across a wind of 20 m/s a swan primary flutters for good: no pose is at rest, and one that starts
from any pose in mid-wind is thrown. Such feathers live through PRE_ROLL seconds before the first
frame, their roots held, in the wind of the first frame: its gusts stand still, as they do for
feathers that find a balance, so that one that just misses it starts where it would have been. After
half a second the flutter is as strong as two seconds later.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Indices
from featherfx.feather.types import turned
from featherfx.mechanics.model import Loads
from featherfx.shot.roots import RootFrames
from featherfx.solver.solver import Solver, State, overload_describer, raise_if_failed
from featherfx.solver.state import hold_roots
from featherfx.solver.status import NO_REST, SEVERAL_RESTS

# s of motion before the first frame, and of one of its intervals
PRE_ROLL, INTERVAL = 0.5, 1.0 / 24.0


def settled(
    solver: Solver,
    state: State,
    loads: Loads,
    names: Sequence[str],
    feathers: Sequence[int] | None = None,
) -> tuple[State, Indices]:
    """The feathers as the first frame finds them under its loads. feathers: indices, default all.

    At rest where there is a rest; else in motion, after PRE_ROLL seconds. Returns also the indices
    of those with several rest poses. Raises SimulationError where one cannot be solved; its time is
    below 0 in the motion before the first frame.
    """
    state, status, _ = solver.equilibrium(state, loads, feathers=feathers)
    rests = np.isin(status, (NO_REST, SEVERAL_RESTS))
    raise_if_failed(np.where(rests, 0, status), state.time, names)
    fluttering = np.flatnonzero(status == NO_REST)
    if len(fluttering):
        state = _in_motion(solver, state, loads, names, fluttering)
    return state, np.flatnonzero(status == SEVERAL_RESTS)


def moving_with_roots(state: State, rates: tuple[RootFrames, ...]) -> State:
    """Feathers that move as their roots do, all of a piece.

    rates: of the roots of these feathers, and their first and second rates (see root_rates).
    """
    new, (now, first, second) = state.copy(), rates
    local = turned(now.rotations[:, None], state.points.shifted(-now.positions))
    for values, rate in ((new.velocity, first), (new.acceleration, second)):
        moved = turned(np.swapaxes(rate.rotations, -1, -2)[:, None], local)
        values.assign(moved.shifted(rate.positions))
    new.smoothed.assign(new.acceleration)
    return new


def standing(loads: Loads, time: float) -> Loads:
    """Loads whose gusts stay as they are at a time (s)."""
    phase = loads.wind_phase - loads.wind_rate * time
    return loads._replace(wind_rate=np.zeros_like(loads.wind_rate), wind_phase=phase)


def _in_motion(
    solver: Solver, state: State, loads: Loads, names: Sequence[str], chosen: np.ndarray
) -> State:
    start, path, members = state.time[chosen].copy(), hold_roots(state), chosen.tolist()
    loads = standing(loads, float(start.max(initial=0.0)))
    state.time[chosen] -= PRE_ROLL
    for _ in range(round(PRE_ROLL / INTERVAL)):
        state, report = solver.step(state, loads, path, INTERVAL, members)
        most, cause_of = solver.settings.max_iterations, overload_describer(solver.model, state)
        raise_if_failed(report.status, state.time, names, most, cause_of)
    state.time[chosen] = start
    return state
