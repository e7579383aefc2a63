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

    simulating: samples in all, with those that only others depend on. finishing: parts of what is
    done beside: each sample is taken up, and those that are wanted are laid, some samples later.
    Either takes the processor time that it took so far, and that passes as fast as it did.
    """

    def __init__(self, simulating: int, finishing: int) -> None:
        self._simulating, self._finishing = simulating, finishing
        self._first: _Mark | None = None

    def left(self, simulated: int, finished: int, beside: Background) -> float | None:
        """s until the last sample is finished; None while it is not known.

        simulated: samples so far. finished: parts done of what is done beside.
        """
        now = _Mark(simulated, time.perf_counter(), time.process_time(), beside.processor_seconds)
        # the first sample may cost nothing, as those do that all feathers are settled at, and the
        # second loads what all others need
        if self._first is None:
            self._first = now if simulated > 1 else None
            return None
        first = self._first
        worked = now.worked - first.worked
        each = (worked - now.beside + first.beside) / (simulated - first.simulated)
        part = now.beside / max(finished, 1)
        todo = each * (self._simulating - simulated) + part * (self._finishing - finished)
        return todo * (now.seconds - first.seconds) / max(worked, 1e-9)
