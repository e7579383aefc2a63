"""A batch of feathers that push nothing: each is stepped by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from featherfx.algebra.types import Flags
from featherfx.mechanics.model import Loads
from featherfx.shot.loop.counts import Advanced, Bounds
from featherfx.shot.loop.groups import ALONE, FeatherGroup
from featherfx.shot.loop.run import ShotRun
from featherfx.shot.loop.settled import settled
from featherfx.shot.loop.sleep import is_at_rest, is_undisturbed, skip_frame
from featherfx.shot.motion.motion import root_path
from featherfx.shot.roots import Roots
from featherfx.solver.solver import RootPath, overload_describer, raise_if_failed


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

    def advance(self, index: int) -> Advanced:
        """Bring the feathers from the sample before to a sample. Raises SimulationError."""
        group, run, duration = self._group, self._run, self._run.time(1)
        loads = run.loads(group, index)
        path = self._paths.path(group, run.time(index - 1), run.time(index))
        sleeping = self._sleeping(path, loads, duration) & ~group.stirred
        repeating, cycle = np.zeros_like(sleeping), group.cycle if index > 0 else None
        if cycle is not None:
            repeating = cycle.repeating(path, loads) & ~sleeping
        stepped = np.flatnonzero(~sleeping & ~repeating).tolist()
        group.state, report = group.solver.step(group.state, loads, path, duration, stepped)
        if sleeping.any():
            group.state = skip_frame(group.state, sleeping, duration)
        if cycle is not None:
            if repeating.any():
                group.state = cycle.replayed(group.state, repeating, path, duration)
            cycle.keep(group.state, path, loads)
        group.loads, group.report = loads, report
        cause_of = overload_describer(group.solver.model, group.state)
        most = group.solver.settings.max_iterations
        raise_if_failed(report.status, group.state.time, group.names, most, cause_of)
        return Advanced(int(sleeping.sum()), int(repeating.sum()))

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
