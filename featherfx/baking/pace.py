"""How long frames still take, by what those so far took."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from featherfx.files.background import Background


class _Mark(NamedTuple):
    """Samples simulated, and s on the clock, of the processors, and of those beside, until then."""

    simulated: int
    seconds: float
    worked: float
    beside: float


class Pace:
    """Time left of samples that are simulated while those before are finished beside.

    A sample takes the processor time between the mean and the median of those so far, since a few
    are often many times as hard as the others; what is done beside takes its mean. Of that as much
    passes in a second as did while the last third of the work was done; after the last sample
    finishing goes on alone. simulated, finished: parts done of either.
    """

    def __init__(self, simulating: int, finishing: int) -> None:
        """simulating: samples in all, with those that only others depend on. finishing: parts of
        what is done beside: each sample is taken up, and those that are wanted are laid, maybe some
        samples later."""
        self._simulating, self._finishing = simulating, finishing
        self.simulated = self.finished = 0
        self._marks: list[_Mark] = []

    def left(self, beside: Background) -> float | None:
        """s until the last sample is finished, by this; None while it is not known."""
        # the first sample may cost nothing, as those do that all feathers are settled at, and the
        # second loads what all others need
        if self.simulated < 2:
            return None
        # not its clock, which goes on while it waits for the interpreter
        worked = beside.processor_seconds
        now = _Mark(self.simulated, time.perf_counter(), time.process_time(), worked)
        self._marks.append(now)
        if len(self._marks) < 2:
            return None
        costs = [
            (end.worked - end.beside - start.worked + start.beside)
            / (end.simulated - start.simulated)
            for start, end in zip(self._marks[:-1], self._marks[1:], strict=True)
        ]
        each, part = 0.5 * (np.mean(costs) + np.median(costs)), worked / max(self.finished, 1)
        samples = max(self._simulating - self.simulated, 0)
        to_finish = max(self._finishing - self.finished, 0)
        meanwhile, slowness = min(2 * samples, to_finish), self._slowness(now)
        alone = part * (to_finish - meanwhile) * max(slowness, 1.0)
        return float((each * samples + part * meanwhile) * slowness + alone)

    def _slowness(self, now: _Mark) -> float:
        """s on the clock for one of the processors, in the last third of the work."""
        first = self._marks[0]
        since = now.worked - (now.worked - first.worked) / 3.0
        late = next(each for each in reversed(self._marks[:-1]) if each.worked <= since)
        return (now.seconds - late.seconds) / max(now.worked - late.worked, 1e-9)
