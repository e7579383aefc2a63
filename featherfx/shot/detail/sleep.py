"""Feathers at rest are skipped until something wakes them.

A feather falls asleep after a frame at whose end nothing in it moves: both its velocity v and its
acceleration a are so small that v T and a T^2, T the frame's duration, stay far below the
error tolerance (a vibration that is just turning round has v = 0, but not a). It sleeps on while
what acts on it is what acted when it fell asleep: its root stands still where it stood, gravity
and steady wind are the same, no gust blows and its grips do not move. Anything else wakes it in
the same frame, before the step, so that no motion is missed.

The same holds against a root that moves evenly on a straight line: seen from there, the feather is
at rest and the wind is steady. Such a feather coasts: it is carried along with its root. Where
there is air, even means to rounding, because a speed that creeps up would change the drag; in
vacuum the path may be off the straight line by as much, which is what the neglected
acceleration would move the feather by.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.algebra.vectors import dots
from featherfx.mechanics.model import Loads
from featherfx.solver.state import State
from featherfx.solver.step.root_path import RootPath

# over the tolerance, what a sleeping feather would move in a frame at most
STILL = 1e-3
# of the size of its coordinates, by which an even motion may differ from one
EVEN = 1e-12


def at_rest(state: State, path: RootPath, tolerance: float, duration: float) -> Flags:
    """(F,) which feathers move against their roots by next to nothing against a tolerance (m)
    in a frame (s)."""
    limit = STILL * tolerance
    velocity = state.velocity.nodes - (_way(path) / duration)[:, None, None]
    quiet = _largest(velocity) * duration < limit
    return quiet & (_largest(state.acceleration.nodes) * duration**2 < limit)


def _largest(rates: Array) -> Array:
    """(F,) largest length of (F, n, 1 + 2 m, 3) rates."""
    return np.asarray(np.linalg.norm(rates, axis=3).max(axis=(1, 2)))


def _way(path: RootPath) -> Array:
    """(F, 3) m, from the start of a path to its end."""
    return np.asarray(path.samples[:, -1, :3] - path.samples[:, 0, :3])


def _straight(path: RootPath, slack: float) -> Flags:
    """(F,) which roots move evenly on a straight line to within slack (m), without turning."""
    fraction = np.linspace(0.0, 1.0, path.samples.shape[1])
    even = path.samples[:, :1, :3] + fraction[:, None] * _way(path)[:, None]
    apart = np.abs(path.samples[:, :, :3] - even).max(axis=(1, 2))
    size = np.abs(path.samples[:, :, :3]).max(axis=(1, 2))
    turning = np.ptp(path.samples[:, :, 3:], axis=1).max(axis=1)
    return np.asarray((apart <= slack + EVEN * (1.0 + size)) & (turning <= EVEN))


def undisturbed(
    state: State, path: RootPath, loads: Loads, before: Loads | None, coast: float | None = None
) -> Flags:
    """(F,) which feathers are loaded as in the frame before, by nothing that changes within it.

    coast: m, tolerance where roots may move evenly on straight lines; None: they must stand still.
    """
    count = len(state.rotation)
    if before is None or not _same_air(loads, before):
        return np.zeros(count, dtype=np.bool_)
    still = np.ptp(path.samples, axis=1).max(axis=1) == 0.0
    if coast is not None:
        still |= _straight(path, 0.0 if loads.air[0] > 0.0 else STILL * coast)
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
    """Whether gravity and wind are steady and those of the frame before."""
    same = all(
        np.array_equal(getattr(loads, name), getattr(before, name))
        for name in ("gravity", "air", "wind_amplitude")
    )
    return same and not (loads.air[0] > 0.0 and np.any(loads.wind_amplitude))


def asleep(state: State, sleeping: Flags, path: RootPath, duration: float) -> State:
    """The state after a frame (s) in which some feathers slept or coasted: their time goes on, and
    nothing moves against the roots."""
    new = state.copy()
    for rates in new.rates():
        rates[sleeping] = 0.0
    new.time[sleeping] += duration
    way = _way(path)
    moved = sleeping & (way != 0.0).any(axis=1)
    if moved.any():
        new.centre[moved] += way[moved, None]
        new.centre[moved, 0] = path.samples[moved, -1, :3]
        new.points.nodes[moved] += way[moved, None, None]
        new.velocity.nodes[moved] += way[moved, None, None] / duration
    return new
