"""Wind on feathers that a plumage shelters (see loads/wind.py)."""

from __future__ import annotations

from collections.abc import Hashable
from functools import lru_cache

import numpy as np

from featherfx.algebra.types import Array
from featherfx.mechanics.model import Loads
from featherfx.shot.loads.loads import exposures
from featherfx.shot.loop.groups import FeatherGroup, GroupLoad
from featherfx.shot.loop.run import ShotLoad, ShotRun
from featherfx.shot.roots import RootFrames, arrived

# m/s, to which roots' velocities are rounded, so that even motion gives equal winds
_DIGITS = 9


class ShelterLoads(ShotLoad):
    """The shelter that a plumage gives its feathers."""

    def __init__(self, run: ShotRun) -> None:
        super().__init__(run)
        self._exposures = exposures(run.shot).tolist()
        self._solved = run.solved[run.options.simulated[run.solved]]
        kinds = [run.shot.groom.feathers[f].kind for f in self._solved]
        middles = [0.5 * kind.length * (1.0 + kind.calamus) for kind in kinds]
        self._middles = np.array(middles)[:, None] * np.array([1.0, 0.0, 0.0])
        self.place = {f: k for k, f in enumerate(self._solved.tolist())}
        self.root_rates = lru_cache(1)(self._root_rates)

    def key(self, feather: int) -> Hashable:
        """Exposure."""
        return self._exposures[feather]

    def on(self, group: FeatherGroup) -> GroupLoad | None:
        """The shelter of a batch; None where all of the wind reaches it."""
        exposure = self._exposures[group.members[0]]
        return None if exposure == 1.0 else _Shelter(exposure, self)

    def _carried(self, roots: RootFrames) -> Array:
        """(S, 3) m, the middles of vanes as their roots carry them."""
        return roots.positions + np.einsum("fij,fj->fi", roots.rotations, self._middles)

    def _own(self, roots: RootFrames) -> RootFrames:
        return RootFrames(*(each[self._solved] for each in roots))

    def _root_rates(self, start: float, end: float, changing: bool) -> tuple[Array, Array]:
        """(S, 3) m/s, velocities from start to end (s) of the middles of simulated vanes as their
        roots carry them, and (S, 3) m/s^2, their change since the span before; 0 where that is not
        asked for."""
        duration, motion, own = end - start, self.run.motion, self._own
        begin, reached = own(arrived(motion, start)), own(motion.frames(start))
        way = self._carried(own(motion.frames(end))) - self._carried(begin)
        change = np.zeros_like(way)
        if not duration > 0.0:
            return change, change
        if changing:
            # a cut turns the velocity before it with the root
            before = self._carried(reached) - self._carried(own(arrived(motion, start - duration)))
            turned = np.einsum("fij,fkj,fk->fi", begin.rotations, reached.rotations, before)
            change = np.round((way - turned) / duration**2, _DIGITS)
        return np.round(way / duration, _DIGITS), change


class _Shelter(GroupLoad):
    """Shelter of a batch, as long as it is on its roots."""

    def __init__(self, exposure: float, shelter: ShelterLoads) -> None:
        self._exposure, self._shelter = exposure, shelter

    def added(self, loads: Loads, group: FeatherGroup, start: float, end: float) -> Loads:
        """Loads with the part of the wind that reaches the batch."""
        if group.is_flying:
            return loads
        velocity, change = self._shelter.root_rates(start, end, loads.added_mass.size > 0)
        own = [self._shelter.place[f] for f in group.members.tolist()]
        return sheltered(loads, self._exposure, velocity[own], change[own])


def sheltered(loads: Loads, exposure: float, velocity: Array, change: Array) -> Loads:
    """Loads of a batch whose feathers all have one exposure.

    velocity: (F, 3) m/s, of the roots. change: (F, 3) m/s^2, of that since the loads before.
    """
    return loads._replace(
        wind_mean=exposure * loads.wind_mean + (1.0 - exposure) * velocity,
        wind_change=exposure * loads.wind_change + (1.0 - exposure) * change,
        wind_amplitude=exposure * loads.wind_amplitude,
        added_mass=exposure**2 * loads.added_mass,
    )
