"""Feathers whose motion has become periodic are replayed, not stepped.

A shot that says after how many frames it repeats (`cycle`) drives its feathers towards a periodic
motion. With d_k the largest distance of a feather's points from where they were a cycle before,
over the k-th cycle, and q = d_k / d_(k-1), all that the following cycles would still change is
d_k q / (1 - q) if the distances go on to shrink like that. Once d_k and that are below the error
tolerance, the last cycle is played again, for as long as what acts on the feather is what acted a
cycle before: its root goes the same way (from wherever it is by now), and gravity, wind, grips and
forces are the same. Anything else lets it be stepped again, in the same frame.

Feathers that may touch each other act on each other: all of an island are replayed together or
none, and only where all roots have gone the same way since.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.algebra.rotation import quats_to_frames
from featherfx.algebra.types import Array, Flags
from featherfx.errors import as_figure, warn_input
from featherfx.mechanics.model import Loads
from featherfx.shot.loop.run import Arrays, Stage, prefixed, under
from featherfx.solver.state import RootPath, State

# by which what acts may differ from what acted a cycle before, in SI units and of its size: skins
# are sampled in single precision
SLACK = 1e-6
# forces are compared in micronewtons, because single points carry so little
MICRO = 1e6


class _Sample(NamedTuple):
    """A group after a sample. inputs: (F, K) what acted on the way there, not finite where that
    can't repeat. place: (F, 3) m, of the roots."""

    state: State
    inputs: Array
    place: Array


class Cycle:
    """Motion of a batch over one cycle; `repeating` before a sample, `keep` after it.

    period: samples. tolerance: m. It holds as many states as a cycle has samples.
    """

    def __init__(self, period: int, tolerance: float, feathers: int) -> None:
        self.period, self.tolerance = period, tolerance
        self._kept: deque[_Sample] = deque(maxlen=period)
        # (F,) m, distances from a cycle before, of two cycles
        self._changes: deque[Array] = deque(maxlen=2 * period)
        self._playing = np.zeros(feathers, dtype=np.bool_)
        # whether what acts has repeated, and whether anything was replayed
        self.met = self.played = False

    def repeating(self, path: RootPath, loads: Loads) -> Flags:
        """(F,) which feathers replay the sample that a path leads to."""
        if len(self._kept) < self.period:
            return self._playing
        changes = np.stack(self._changes)
        now = changes[-self.period :].max(axis=0)
        before = changes[: -self.period].max(axis=0, initial=0.0)
        if len(changes) < 2 * self.period:
            before[:] = np.inf
        known = np.isfinite(now) & np.isfinite(before)
        ratio = np.divide(now, before, out=np.ones_like(now), where=known & (before > 0.0))
        ratio[known & (now == 0.0)] = 0.0
        # where they do not shrink, the limit is that of no change at all
        left = now * ratio / np.maximum(1.0 - ratio, 1e-12)
        steady = known & (now <= self.tolerance) & (left <= self.tolerance)
        self._playing = self._same(_inputs(path, loads)) & (self._playing | steady)
        return self._playing

    def play(self, playing: bool) -> None:
        """Have all feathers replayed or none, whatever each would do by itself."""
        self._playing[:] = playing

    def ways(self, path: RootPath) -> Array:
        """(F, 3) m, from where roots were a cycle before to where a path leads them."""
        return np.asarray(path.samples[:, -1, :3] - self._kept[0].place)

    def replayed(self, state: State, flags: Flags, path: RootPath, duration: float) -> State:
        """The state after a sample, s later, that the feathers with a flag replay."""
        old, new = self._kept[0], state.copy()
        self.played |= bool(flags.any())
        for array, past in zip(new.arrays().values(), old.state.arrays().values(), strict=True):
            array[flags] = past[flags]
        new.time[flags] = state.time[flags] + duration
        way = self.ways(path)[flags]
        new.centre[flags] += way[:, None]
        new.points.nodes[flags] += way[:, None, None]
        return new

    def keep(self, state: State, path: RootPath, loads: Loads) -> None:
        """Note the state at a sample."""
        inputs, place = _inputs(path, loads), path.samples[:, -1, :3].copy()
        change = np.full(len(place), np.inf)
        if len(self._kept) == self.period:
            same = self._same(inputs)
            self.met |= bool(same.any())
            old = self._kept[0]
            way = state.points.nodes - old.state.points.nodes - (place - old.place)[:, None, None]
            apart = np.linalg.norm(way, axis=3).max(axis=(1, 2))
            change = np.where(same, apart, np.inf)
        self._changes.append(change)
        self._kept.append(_Sample(state, inputs, place))

    def changes(self) -> Array:
        """(F,) m, by which feathers changed over the last cycle; infinite where something else
        acted on them."""
        return np.asarray(np.stack(tuple(self._changes)[-self.period :]).max(axis=0))

    def _same(self, inputs: Array) -> Flags:
        """(F,) whether what acts is what acted a cycle before."""
        past = self._kept[0].inputs
        with np.errstate(invalid="ignore"):
            near = np.abs(inputs - past) <= SLACK * (1.0 + np.abs(past))
        return np.asarray(near.all(axis=1))

    def memory(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are kept between frames, for checkpoints."""
        found: dict[str, NDArray[Any]] = {"playing": self._playing, "met": np.array(self.met)}
        found["played"] = np.array(self.played)
        if self._kept:
            states, inputs, places = zip(*self._kept, strict=True)
            found |= {"changes": np.stack(self._changes), "inputs": np.stack(inputs)}
            kept = [state.arrays() for state in states]
            found |= {name: np.stack([each[name] for each in kept]) for name in State.names()}
            found["places"] = np.stack(places)
        return found

    def restore(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `memory` gave."""
        self._playing, self.met = memory["playing"], bool(memory["met"])
        self.played = bool(memory["played"])
        if "inputs" in memory:
            stacked = zip(*(memory[name] for name in State.names()), strict=True)
            states = (
                State.from_arrays(dict(zip(State.names(), each, strict=True))) for each in stacked
            )
            self._changes.extend(memory["changes"])
            self._kept.extend(map(_Sample, states, memory["inputs"], memory["places"]))


def repeats_together(
    cycles: Sequence[Cycle | None], paths: Sequence[RootPath], loads: Sequence[Loads]
) -> bool:
    """Return whether all feathers of some batches replay the sample that paths lead to."""
    flags = [
        None if cycle is None else cycle.repeating(path, acting)
        for cycle, path, acting in zip(cycles, paths, loads, strict=True)
    ]
    playing = all(each is not None and bool(each.all()) for each in flags)
    if playing:
        known = zip((cycle for cycle in cycles if cycle is not None), paths, strict=True)
        ways = np.concatenate([cycle.ways(path) for cycle, path in known])
        playing = bool((np.ptp(ways, axis=0) <= SLACK * (1.0 + np.abs(ways).max())).all())
    for cycle in cycles:
        if cycle is not None:
            cycle.play(playing)
    return playing


class CycleStage(Stage):
    """The cycles of a shot that says that it repeats. Batches that may repeat have one; what slips,
    dries, is directed or leaves its root does not."""

    name = "cycles"

    def prepare(self) -> None:
        """Give cycles to batches."""
        period = self.run.shot.cycle * self.run.subframes
        for group in self.run.groups:
            if not (group.changes_model or group.solver.model.hooked):
                tolerance, count = group.options.tolerance, len(group.members)
                group.cycle = Cycle(period, tolerance, count)

    def finish(self, index: int) -> None:
        """Warn if nothing was replayed."""
        cycles = [group.cycle for group in self.run.groups]
        _warn_if_never(cycles, self.run.shot.cycle, index // self.run.subframes)

    def checkpoint(self) -> Arrays:
        """Samples that the cycles of batches hold."""
        found: Arrays = {}
        for g, group in enumerate(self.run.groups):
            if group.cycle is not None:
                found |= prefixed(f"{g}.", group.cycle.memory())
        return found

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from a checkpoint."""
        for g, group in enumerate(self.run.groups):
            if group.cycle is not None:
                group.cycle.restore(under(f"{g}.", arrays))


def _warn_if_never(cycles: Sequence[Cycle | None], frames: int, done: int) -> None:
    """Warn if nothing was replayed after a cycle of so many frames, of done in all."""
    if not frames or done <= 2 * frames:
        return
    known = [cycle for cycle in cycles if cycle is not None]
    if not known:
        message = "cycle: hooks that slip do not repeat, so no feather is replayed. Leave it out"
        warn_input(message)
    elif not any(cycle.met for cycle in known):
        message = f"cycle: root, wind and forces of no feather repeat after {frames} frames"
        warn_input(message)
    elif not any(cycle.played for cycle in known):
        changes = np.concatenate([cycle.changes() for cycle in known])
        changes = changes[np.isfinite(changes)]
        # what only sleeps needs no word
        if changes.any():
            low, high = (as_figure(1e3 * change) for change in (changes.min(), changes.max()))
            message = (
                f"cycle: no feather is replayed: within {done} frames none has become periodic."
                f" Over the last {frames} they changed by {low} to {high} mm, more than"
                f" {as_figure(1e3 * known[0].tolerance)} (the tolerance of the quality),"
                " all of those that may touch together"
            )
            warn_input(message)


def _inputs(path: RootPath, loads: Loads) -> Array:
    """(F, K) numbers that tell what acts on each feather in a frame, places seen from its root."""
    count = len(path.base)
    start = path.samples[:, 0, :3]
    way = path.samples.copy()
    way[:, :, :3] -= start[:, None]
    amplitude = loads.wind_amplitude if loads.air[0] > 0.0 else np.zeros(0)
    # a gust never repeats
    gusts = np.array([np.inf if np.any(amplitude) else 0.0])
    common = np.concatenate([loads.gravity, loads.air, gusts])
    parts = (
        way,
        quats_to_frames(path.base),
        np.broadcast_to(common, (count, common.size)),
        np.broadcast_to(loads.wind_mean, (count, 3)),
        loads.wind_change if loads.added_mass.size else np.zeros((count, 0)),
        np.broadcast_to(loads.added_mass if loads.added_mass.size else 0.0, (count,)),
        loads.grip_node,
        loads.grip_start - start[:, None],
        loads.grip_end - start[:, None],
        loads.grip_stiffness,
        MICRO * loads.force,
        MICRO * (loads.force_change if loads.force_change.size else np.zeros((count, 0))),
    )
    return np.concatenate([np.reshape(part, (count, -1)) for part in parts], axis=1)
