"""How many threads of a process may work just now, which changes no result."""

from __future__ import annotations

import os

from featherfx.limits import MOST_JOBS

_allowed = [MOST_JOBS]


def allow(threads: int) -> None:
    """From now on so many threads at most, whatever number work was given: other processes of this
    machine have begun or ended."""
    _allowed[0] = threads


def allowed(jobs: int) -> int:
    """Threads of so many that may be taken now, at least one."""
    return max(1, min(jobs, _allowed[0]))


def cores() -> int:
    """Cores that this process may use, of those that the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
