"""Changes of level without a pop: both levels are simulated while one passes into the other.

A feather's points are (1 - w) a + w b, a those of the level that it leaves and b those of the one
that it takes up. From one sample to the next w grows by at most

    min(1 / N, JUMP length / (samples a frame) / |b - a|),

N the samples of a fade and |b - a| the largest distance of any point, so what a change adds to the
motion of a and b, dw |b - a|, is below JUMP of the feather's length a frame, however far the levels
are apart; the fade takes longer then. The rate of w is part of the velocities.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.shot.detail.levels import LevelPlan
from featherfx.shot.detail.rigid import FeatherPose

Array = NDArray[np.float64]
Numbers = NDArray[np.int8]
Flags = NDArray[np.bool_]

# of a feather's length, what a change may add to the way of a point within a frame
JUMP = 0.004


@dataclass(frozen=True)
class Change:
    """A feather that takes up a new level. before, after: numbers of levels."""

    feather: int
    before: int
    after: int


class Fades:
    """The levels of all feathers while the shot goes on.

    lengths: (F,) m. samples: of a fade at least. per_frame: samples in a frame. duration: s, of a
    sample. now, to: (F,) the level and the one that is taken up, the same where none is; share:
    (F,) w, and grown: (F,) what the last sample added to it.
    """

    def __init__(
        self, plan: LevelPlan, lengths: Array, samples: int, per_frame: int, duration: float
    ) -> None:
        self.plan, self._lengths, self._per_frame = plan, lengths, per_frame
        self._most, self._duration = 1.0 / max(samples, 1), duration
        self.now: Numbers = plan.at(0).copy()
        self.to: Numbers = self.now.copy()
        self.share, self.grown = np.zeros(len(lengths)), np.zeros(len(lengths))

    def begin(self, index: int) -> list[Change]:
        """End the fades that are through and begin those to the levels of a sample."""
        through = self.share >= 1.0
        self.now[through] = self.to[through]
        self.share[through] = self.grown[through] = 0.0
        wanted = self.plan.at(-(-index // self._per_frame))
        starting = np.flatnonzero((self.now == self.to) & (wanted != self.now))
        self.to[starting] = wanted[starting]
        return [Change(int(f), int(self.now[f]), int(self.to[f])) for f in starting]

    def active(self, members: NDArray[np.int64], level: int) -> Flags:
        """(M,) which of some feathers are to be computed at a level."""
        return np.asarray((self.now[members] == level) | (self.to[members] == level))

    @property
    def fading(self) -> NDArray[np.int64]:
        """Feathers that change."""
        return np.flatnonzero(self.now != self.to)

    def grow(self, feathers: Sequence[int], poses: Mapping[tuple[int, int], FeatherPose]) -> None:
        """Move fades on by a sample. poses: by feather and level."""
        for f in feathers:
            before, after = (poses[f, int(level)].points for level in (self.now[f], self.to[f]))
            apart = float(np.linalg.norm(np.delete(after - before, (1, 2), axis=1), axis=2).max())
            allowed = JUMP * self._lengths[f] / self._per_frame
            self.grown[f] = min(self._most, allowed / max(apart, 1e-30), 1.0 - self.share[f])
            self.share[f] += self.grown[f]

    def blended(self, f: int, poses: Mapping[tuple[int, int], FeatherPose]) -> FeatherPose:
        """A feather's pose from those of its levels."""
        first = poses[f, int(self.now[f])]
        share = self.share[f]
        if share == 0.0:
            return first
        second = poses[f, int(self.to[f])]
        way = second.points - first.points
        rate = self.grown[f] / self._duration
        change = second.velocities - first.velocities
        return FeatherPose(
            first.points + share * way,
            first.velocities + share * change + rate * way,
            first.accelerations
            + share * (second.accelerations - first.accelerations)
            + 2.0 * rate * change,
        )

    def memory(self) -> dict[str, Any]:
        """What is kept between frames, for checkpoints."""
        names = ("now", "to", "share", "grown")
        return {name: getattr(self, name).copy() for name in names}

    def restore(self, memory: Mapping[str, Any]) -> None:
        """Take over what `memory` gave."""
        for name, array in memory.items():
            getattr(self, name)[:] = array
