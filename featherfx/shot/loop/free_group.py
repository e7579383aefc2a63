"""A batch of feathers that push nothing: each is stepped by itself.

Feathers in balance before the first frame, or in full flutter where the wind allows no balance.

Across a wind of 20 m/s a swan primary flutters for good: no pose is at rest, and one that starts
from any pose in mid-wind is thrown. Such feathers live through some time before the first frame,
their roots held, in the wind of the first frame: its gusts stand still, as they do for feathers
that find a balance, so that one that just misses it starts where it would have been.

That time is PRE_ROLL seconds, after which the flutter of a primary is as strong as two seconds
later, and no more than _MAX_CONVECTIVE_TIMES L/U, of a feather's length and the wind's speed: a
flapping sheet has a period of about 2 to 5 L/U. Source: Shelley and Zhang 2011.

Feathers at rest are skipped until something wakes them.

A feather falls asleep after a frame at whose end nothing in it moves: both its velocity v and its
acceleration a are so small that v T and a T^2, T the frame's duration, stay far below the
error tolerance (a vibration that is just turning round has v = 0, but not a), or below what contact
forces are off by in a frame. It sleeps on while
what acts on it is what acted when it fell asleep: its root stands still where it stood, gravity
and steady wind are the same, no gust blows and its grips do not move. Anything else wakes it in
the same frame, before the step, so that no motion is missed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array, Flags, Indices
from featherfx.algebra.vectors import dots
from featherfx.feather.types import turned
from featherfx.mechanics.model import Loads
from featherfx.shot.loop.groups import ALONE, Bounds, FeatherGroup
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.motion.motion import root_path
from featherfx.shot.roots import RootFrames, Roots
from featherfx.solver.solver import Solver, overload_describer, raise_if_failed
from featherfx.solver.state import RootPath, State, hold_roots
from featherfx.solver.types import NO_REST, SEVERAL_RESTS

# s of motion before the first frame, and of one of its intervals
PRE_ROLL, INTERVAL = 0.5, 1.0 / 24.0
# L/U, of that motion at most; ratio of the time of one that takes the same steps as another
_MAX_CONVECTIVE_TIMES, _TIME_RATIO = 100.0, 2.0
# of the length, way in an INTERVAL at the end of that motion that shows that a feather flutters
_MIN_FLUTTER_RATIO = 0.05


class SettledFeathers(NamedTuple):
    """Feathers as the first frame finds them: state, and indices of those with several rest poses,
    and of those that have none and flutter."""

    state: State
    several: Indices
    fluttering: Indices


def settled(
    solver: Solver,
    state: State,
    loads: Loads,
    names: Sequence[str],
    feathers: Sequence[int] | None = None,
) -> SettledFeathers:
    """The feathers as the first frame finds them under its loads. feathers: indices, default all.

    At rest where there is a rest; else in motion. Raises SimulationError where one cannot be
    solved; its time is below 0 in the motion before the first frame.
    """
    state, status, _ = solver.equilibrium(state, loads, feathers=feathers)
    rests = np.isin(status, (NO_REST, SEVERAL_RESTS))
    raise_if_failed(np.where(rests, 0, status), state.time, names)
    restless = np.flatnonzero(status == NO_REST)
    if len(restless):
        state = _in_motion(solver, state, loads, names, restless)
    speed = np.linalg.norm(state.velocity.nodes[restless], axis=-1).max(axis=(1, 2), initial=0.0)
    way = INTERVAL * speed
    flutters = way > _MIN_FLUTTER_RATIO * solver.model.length[restless].sum(axis=1)
    return SettledFeathers(state, np.flatnonzero(status == SEVERAL_RESTS), restless[flutters])


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
    start, path = state.time[chosen].copy(), hold_roots(state)
    loads = standing(loads, float(start.max(initial=0.0)))
    wind = np.broadcast_to(np.linalg.norm(loads.wind_mean, axis=-1), solver.model.feathers)[chosen]
    most_times = _MAX_CONVECTIVE_TIMES * solver.model.length[chosen].sum(axis=1)
    share = np.minimum(1.0, most_times / np.maximum(PRE_ROLL * wind, 1e-300))
    halvings = np.ceil(np.log(1.0 / share) / np.log(_TIME_RATIO)).astype(int)
    most, steps = solver.settings.max_iterations, round(PRE_ROLL / INTERVAL)
    for number in np.unique(halvings):
        members, interval = chosen[halvings == number], INTERVAL * _TIME_RATIO**-number
        state.time[members] -= steps * interval
        for _ in range(steps):
            state, report = solver.step(state, loads, path, interval, members.tolist())
            cause_of = overload_describer(solver.model, state)
            raise_if_failed(report.status, state.time, names, most, cause_of)
    state.time[chosen] = start
    return state


class FreeRootPaths:
    """Paths of the roots of all batches that push nothing, found at once for each span."""

    def __init__(self, groups: Sequence[FeatherGroup], motion: Roots) -> None:
        members = [np.zeros(0, dtype=np.int64), *(group.members for group in groups)]
        self._motion, self._members = motion, np.unique(np.concatenate(members))
        self._known: tuple[tuple[float, float], RootPath] | None = None

    def path(self, group: FeatherGroup, start: float, end: float) -> RootPath:
        """Return the path of the roots of a group from start to end (s)."""
        if self._known is None or self._known[0] != (start, end):
            self._known = (start, end), root_path(self._motion, self._members, start, end)
        own = np.searchsorted(self._members, group.members)
        samples, base = (each[own] for each in self._known[1])
        return RootPath(samples, base)


class FreeGroup:
    """One batch, whose state it brings on. paths: of the roots of all such batches."""

    def __init__(self, run: ShotRun, group: FeatherGroup, paths: FreeRootPaths) -> None:
        self.groups: Sequence[FeatherGroup] = (group,)
        self._run, self._group, self._paths = run, group, paths

    @property
    def bounds(self) -> Bounds:
        """Tolerance and limits of its steps."""
        options = self._group.options
        return Bounds(options.tolerance, {"max_substeps": options.max_substeps})

    def settle(self) -> None:
        """Bring the feathers to rest where the shot begins."""
        group, run = self._group, self._run
        loads = run.loads(group, run.first)
        found = settled(group.solver, group.state, loads, group.names)
        group.state, group.several, group.fluttering = found

    def advance(self, index: int) -> int:
        """Bring the feathers from the sample before to a sample; return how many nothing stirred.

        Raises SimulationError.
        """
        group, run, duration = self._group, self._run, self._run.time(1)
        loads = run.loads(group, index)
        path = self._paths.path(group, run.time(index - 1), run.time(index))
        sleeping = self._sleeping(path, loads, duration) & ~group.stirred
        stepped = np.flatnonzero(~sleeping).tolist()
        group.state, report = group.solver.step(group.state, loads, path, duration, stepped)
        if sleeping.any():
            group.state = skip_frame(group.state, sleeping, duration)
        group.loads, group.report = loads, report
        cause_of = overload_describer(group.solver.model, group.state)
        most = group.solver.settings.max_iterations
        raise_if_failed(report.status, group.state.time, group.names, most, cause_of)
        return int(sleeping.sum())

    def _sleeping(self, path: RootPath, loads: Loads, duration: float) -> Flags:
        """(F,) feathers that sleep through a frame."""
        group = self._group
        if not self._run.shot.sleep or group.is_flying:
            return np.zeros(len(group.members), dtype=np.bool_)
        quiet = is_undisturbed(group.state, path, loads, group.loads)
        if not quiet.any():  # seldom otherwise in gusts, and what follows looks at all nodes
            return quiet
        tolerance = group.options.tolerance
        return np.asarray(quiet & is_at_rest(group.state, tolerance, duration))


def free_groups(run: ShotRun) -> list[FreeGroup]:
    """Batches of a shot that push nothing."""
    groups = [group for group in run.groups if group.island == ALONE]
    paths = FreeRootPaths(groups, run.motion)
    return [FreeGroup(run, group, paths) for group in groups]


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
