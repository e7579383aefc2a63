"""How long frames still take, by what those so far took."""

from __future__ import annotations

import time
from typing import NamedTuple

from featherfx.files.background import Background


class _Mark(NamedTuple):
    """Samples simulated, and s on the clock, of the processors, and of those beside, until then."""

    simulated: int
    seconds: float
    worked: float
    beside: float


class Pace:
    """Time left of samples that are simulated while those before are finished beside.

    Either takes the processor time that it took so far, which passes as fast as it did; after the
    last sample, finishing takes its own time. simulated, finished: parts done of either.
    """

    def __init__(self, simulating: int, finishing: int) -> None:
        """simulating: samples in all, with those that only others depend on. finishing: parts of
        what is done beside: each sample is taken up, and those that are wanted are laid, maybe some
        samples later."""
        self._simulating, self._finishing = simulating, finishing
        self.simulated = self.finished = 0
        self._first: _Mark | None = None

    def left(self, beside: Background) -> float | None:
        """s until the last sample is finished, by this; None while it is not known."""
        worked = beside.processor_seconds
        now = _Mark(self.simulated, time.perf_counter(), time.process_time(), worked)
        # the first sample may cost nothing, as those do that all feathers are settled at, and the
        # second loads what all others need
        if self._first is None:
            self._first = now if self.simulated > 1 else None
            return None
        first, parts = self._first, max(self.finished, 1)
        worked = now.worked - first.worked
        each = (worked - now.beside + first.beside) / (now.simulated - first.simulated)
        samples, to_finish = self._simulating - self.simulated, self._finishing - self.finished
        meanwhile = min(2 * samples, to_finish)
        todo = each * samples + now.beside / parts * meanwhile
        alone = beside.seconds / parts * (to_finish - meanwhile)
        return todo * (now.seconds - first.seconds) / max(worked, 1e-9) + alone
