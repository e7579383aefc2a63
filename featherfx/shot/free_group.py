"""A batch of feathers that push nothing, in the frame loop: each is stepped by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.mechanics.model import Loads
from featherfx.shot.counts import Advanced, Bounds
from featherfx.shot.detail.sleep import is_at_rest, is_undisturbed, skip_frame
from featherfx.shot.groups import Group
from featherfx.shot.motion.motion import root_path
from featherfx.shot.motion.roots import Roots
from featherfx.shot.settled import settled
from featherfx.shot.types import Shot
from featherfx.solver.solver import RootPath, overload_describer, raise_if_failed


class FreeRootPaths:
    """Paths of the roots of all batches that push nothing, found at once for each span."""

    def __init__(self, groups: Sequence[Group], motion: Roots) -> None:
        members = [np.zeros(0, dtype=np.int64), *(group.members for group in groups)]
        self._motion, self._members = motion, np.unique(np.concatenate(members))
        self._known: tuple[tuple[float, float], RootPath] | None = None

    def path(self, group: Group, start: float, end: float) -> RootPath:
        """Return the path of the roots of a group from start to end (s)."""
        if self._known is None or self._known[0] != (start, end):
            self._known = (start, end), root_path(self._motion, self._members, start, end)
        own = np.searchsorted(self._members, group.members)
        samples, base = (each[own] for each in self._known[1])
        return RootPath(samples, base)


class Alone:
    """One batch, whose state it brings on. paths: of the roots of all such batches. duration: s,
    between two samples."""

    def __init__(self, shot: Shot, group: Group, paths: FreeRootPaths, duration: float) -> None:
        self._shot, self._group, self._paths, self._duration = shot, group, paths, duration

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
        group.state = settled(group.solver, group.state, acting, group.names)

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
        group, (acting,), duration = self._group, loads, self._duration
        path, cycle = self._paths.path(group, start, end), group.cycle if begun else None
        sleeping = self._sleeping(path, acting, duration) & ~stirred[0]
        repeating = np.zeros_like(sleeping)
        if cycle is not None:
            repeating = cycle.repeating(path, acting) & ~sleeping
        stepped = np.flatnonzero(~sleeping & ~repeating).tolist()
        group.state, report = group.solver.step(group.state, acting, path, duration, stepped)
        if sleeping.any():
            group.state = skip_frame(group.state, sleeping, duration)
        if cycle is not None:
            if repeating.any():
                group.state = cycle.replayed(group.state, repeating, path, duration)
            cycle.keep(group.state, path, acting)
        group.loads = acting
        cause_of = overload_describer(group.solver.model, group.state)
        raise_if_failed(report.status, group.state.time, group.names, cause_of=cause_of)
        return Advanced([report], int(sleeping.sum()), int(repeating.sum()))

    def _sleeping(self, path: RootPath, loads: Loads, duration: float) -> Flags:
        """(F,) feathers that sleep through a frame."""
        group = self._group
        if not self._shot.sleep or group.flying:
            return np.zeros(len(group.members), dtype=np.bool_)
        quiet = is_undisturbed(group.state, path, loads, group.loads)
        if not quiet.any():  # seldom otherwise in gusts, and what follows looks at all nodes
            return quiet
        tolerance = group.solver.settings.tolerance
        return np.asarray(quiet & is_at_rest(group.state, tolerance, duration))
