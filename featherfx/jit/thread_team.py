"""Threads that work together inside compiled code: shared tickets, and places to meet.

All threads of a team call the same kernel. What is to be done is numbered, and each thread takes
the next number when it is free (`ticket`); where all must be done before anyone goes on, they
`meet`, and where one part must be, they wait for that (`say_done`, `wait_for`). A thread that waits
sleeps for moments after a while: to a core that has nothing to run comes a thread of the team that
stands in line at another one, behind one that lays or writes.
"""

from __future__ import annotations

import ctypes
import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.jit.lazy_import import Late, give

# numbers of one cache line, so that counters do not disturb each other
LINE = 8
# looks at a meeting before a thread sleeps, and for how many millionths of a second then
LOOKS, MOMENT = 4000, 20
# counters of a team that are not tickets: who has arrived, and how often all have met
ARRIVED, MET, OWN = 0, 1, 2

_SYSTEM: Any = ctypes
# Windows sleeps for thousandths at the least, so its threads give way, however long they are told
_SLEEP = _SYSTEM.windll.kernel32.SwitchToThread if os.name == "nt" else _SYSTEM.CDLL(None).usleep
SLEEP, SLEEP_SYMBOL = ctypes.cast(_SLEEP, ctypes.c_void_p).value or 0, "featherfx_sleep"
give(SLEEP_SYMBOL, SLEEP)


def new_team(kinds: int) -> NDArray[np.int64]:
    """Counters of a team with so many kinds of tickets, all at zero."""
    return np.zeros((OWN + kinds) * LINE, dtype=np.int64)


_fetch_add = Late("featherfx.jit.thread_team_types", "fetch_add")
_sleep = Late("featherfx.jit.thread_team_types", "sleep")


@kernel
def ticket(team, kind):
    """The next number of a kind, from 0 on; each is given to one thread."""
    return _fetch_add(team, (OWN + kind) * LINE, 1)


@kernel
def forget_tickets(team, kind):
    """Begin again at 0; by one thread, while none takes tickets of this kind."""
    team[(OWN + kind) * LINE] = 0


@kernel
def meet(team, size):
    """Wait until all threads of a team of this size are here."""
    if size == 1:
        return
    before = _fetch_add(team, MET * LINE, 0)
    if _fetch_add(team, ARRIVED * LINE, 1) == size - 1:
        _fetch_add(team, ARRIVED * LINE, -size)
        _fetch_add(team, MET * LINE, 1)
        return
    looks = 0
    while _fetch_add(team, MET * LINE, 0) == before:
        looks += 1
        if looks >= LOOKS:
            _sleep(MOMENT)


@kernel
def say_done(done, part):
    """Say that a part is done, once more. done: (P,) int64, how often each is; zeros at first."""
    _fetch_add(done, part, 1)


@kernel
def wait_for(done, part, times):
    """Wait until a part is done so many times, by threads that have begun it."""
    looks = 0
    while _fetch_add(done, part, 0) < times:
        looks += 1
        if looks >= LOOKS:
            _sleep(MOMENT)
