"""Feathers at rest are skipped until something wakes them.

A feather falls asleep after a frame at whose end nothing in it moves: both its velocity v and its
acceleration a are so small that v T and a T^2, T the frame's duration, stay far below the
error tolerance (a vibration that is just turning round has v = 0, but not a), or below what contact
forces are off by in a frame. It sleeps on while
what acts on it is what acted when it fell asleep: its root stands still where it stood, gravity
and steady wind are the same, no gust blows and its grips do not move. Anything else wakes it in
the same frame, before the step, so that no motion is missed.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import dots
from featherfx.mechanics.model import Loads
from featherfx.solver.state import RootPath, State

# over the tolerance, what a sleeping feather would move in a frame at most
_MAX_MOTION_RATIO = 1e-3


def is_at_rest(state: State, tolerance: float, duration: float, left: Array | float = 0.0) -> Flags:
    """(F,) which feathers move by next to nothing against a tolerance (m) in a frame (s), or by no
    more than contact forces leave, (F,) m."""
    limit = np.maximum(_MAX_MOTION_RATIO * tolerance, left)
    quiet = _largest(state.velocity.nodes) * duration < limit
    return quiet & (_largest(state.acceleration.nodes) * duration**2 < limit)


def _largest(rates: Array) -> Array:
    """(F,) largest length of (F, n, 1 + 2 m, 3) rates."""
    return np.asarray(np.linalg.norm(rates, axis=3).max(axis=(1, 2)))


def is_undisturbed(state: State, path: RootPath, loads: Loads, before: Loads | None) -> Flags:
    """(F,) which feathers are loaded as in the frame before, by nothing that changes within it."""
    count = len(state.rotation)
    if before is None or not _same_air(loads, before):
        return np.zeros(count, dtype=np.bool_)
    still = np.ptp(path.samples, axis=1).max(axis=1) == 0.0
    still &= (path.samples[:, 0, :3] == state.centre[:, 0]).all(axis=1)
    still &= np.abs(dots(path.base, state.rotation[:, 0])) > 1.0 - 1e-14
    if loads.grip_stiffness.shape != before.grip_stiffness.shape:
        return np.zeros(count, dtype=np.bool_)
    if loads.grip_stiffness.shape[1]:
        still &= (loads.grip_start == loads.grip_end).all(axis=(1, 2))
        still &= (loads.grip_start == before.grip_end).all(axis=(1, 2))
        still &= (loads.grip_stiffness == before.grip_stiffness).all(axis=1)
    if loads.force.size:
        still &= (loads.force == _last_force(before)).all(axis=(1, 2, 3))
        still &= (_last_force(loads) == loads.force).all(axis=(1, 2, 3))
    still &= (loads.wind_mean == before.wind_mean).all(axis=1)
    return np.asarray(still)


def _last_force(loads: Loads) -> Array:
    """(F, n, 1 + 2 m, 3) N, dead forces at the end of a frame."""
    return loads.force + loads.force_change if loads.force_change.size else loads.force


def _same_air(loads: Loads, before: Loads) -> bool:
    """Return whether gravity and wind are steady and those of the frame before."""
    same = all(
        np.array_equal(getattr(loads, name), getattr(before, name))
        for name in ("gravity", "air", "wind_amplitude")
    )
    return same and not (loads.air[0] > 0.0 and np.any(loads.wind_amplitude))


def skip_frame(state: State, sleeping: Flags, duration: float) -> State:
    """Return the state after a frame (s) in which some feathers slept: their time goes on, and
    nothing moves."""
    new = state.copy()
    for rates in new.rates():
        rates[sleeping] = 0.0
    new.time[sleeping] += duration
    return new
