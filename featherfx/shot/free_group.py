"""A batch of feathers that push nothing, in the frame loop: each is stepped by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.mechanics.model import Loads
from featherfx.shot.counts import Advanced, Bounds
from featherfx.shot.detail.level_run import LevelRun
from featherfx.shot.detail.sleep import asleep, at_rest, undisturbed
from featherfx.shot.detail.symmetry import Twins, twins_of
from featherfx.shot.groups import Group
from featherfx.shot.settled import settled
from featherfx.shot.types import Shot
from featherfx.solver.overload import overload_describer
from featherfx.solver.solver import RootPath, State, hold_roots, raise_if_failed


class Alone:
    """One batch, whose state it brings on. levels: of detail; what is computed at another one is
    left as it is."""

    def __init__(self, shot: Shot, group: Group, levels: LevelRun) -> None:
        self._shot, self._group, self._levels = shot, group, levels
        # the state that was reached last, and its images of others
        self._reached: tuple[State, Twins] | None = None

    @property
    def groups(self) -> Sequence[Group]:
        """The batch."""
        return (self._group,)

    @property
    def bounds(self) -> Bounds:
        """What its steps are held to."""
        settings = self._group.solver.settings
        return Bounds(settings.tolerance, {"max_substeps": settings.max_substeps})

    def settle(self, loads: Sequence[Loads]) -> None:
        """Bring the feathers to rest. loads: on the batch."""
        group, (acting,) = self._group, loads
        active = self._levels.active(group)
        twins = self._twins(hold_roots(group.state), acting, active)
        chosen = twins.stepped(active).tolist()
        state = settled(group.solver, group.state, acting, group.names, chosen)
        group.state = twins.written(state)

    def advance(
        self,
        start: float,
        end: float,
        loads: Sequence[Loads],
        stirred: Sequence[Flags],
        begun: bool,
    ) -> Advanced:
        """Bring the feathers from start to end (s); arguments as of Together.advance.

        Raises SimulationError.
        """
        group, (acting,), duration = self._group, loads, self._levels.duration
        active, cycle = self._levels.active(group), group.cycle if begun else None
        path = self._levels.path(group, start, end)
        moving = np.ptp(path.samples, axis=1).max(axis=1) > 0.0
        sleeping = self._sleeping(path, acting, duration) & active & ~stirred[0]
        repeating = np.zeros_like(active)
        if cycle is not None:
            repeating = cycle.repeating(path, acting) & active & ~sleeping
        awake = active & ~sleeping & ~repeating
        twins = self._twins(path, acting, awake)
        stepped = twins.stepped(awake).tolist()
        state, report = group.solver.step(group.state, acting, path, duration, stepped)
        group.state = twins.written(state, report)
        if sleeping.any():
            group.state = asleep(group.state, sleeping, path, duration)
        if cycle is not None:
            if repeating.any():
                group.state = cycle.replayed(group.state, repeating, path, duration)
            cycle.keep(group.state, path, acting, active & ~self._levels.fresh(group))
        self._reached, group.loads = (group.state, twins), acting
        cause_of = overload_describer(group.solver.model, group.state)
        raise_if_failed(report.status, group.state.time, group.names, cause_of=cause_of)
        resting, coasting = int((sleeping & ~moving).sum()), int((sleeping & moving).sum())
        return Advanced([report], resting, coasting, int(repeating.sum()), len(twins.own))

    def _twins(self, path: RootPath, loads: Loads, awake: Flags) -> Twins:
        """Feathers that become images of others over a frame, of those that are awake."""
        group = self._group
        if group.alike is None or group.flying or group.changes or group.pulls is not None:
            return Twins.none()
        written = None
        # gaps are preened in place
        if self._reached and self._reached[0] is group.state and not group.solver.model.hooked:
            written = self._reached[1]
        return twins_of(group.alike, group.state, path, loads, awake, written)

    def _sleeping(self, path: RootPath, loads: Loads, duration: float) -> Flags:
        """(F,) feathers that sleep or coast through a frame."""
        group = self._group
        if not self._shot.sleep or group.flying:
            return np.zeros(len(group.members), dtype=np.bool_)
        tolerance = group.solver.settings.tolerance
        coast = tolerance if self._shot.coast else None
        quiet = undisturbed(group.state, path, loads, group.loads, coast)
        if not quiet.any():  # seldom otherwise in gusts, and what follows looks at all nodes
            return quiet
        return np.asarray(quiet & at_rest(group.state, path, tolerance, duration))
