"""Threads that work together inside compiled code: shared tickets, and barriers.

All threads of a team call the same kernel. Work is numbered, and each thread takes the next number
when it is free (`ticket`). Where all must be done before anyone goes on, they `meet`; where one
part must be, they wait for that (`say_done`, `wait_for`). After a while a waiting thread sleeps for
moments, so that its core can run another thread of the team.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.jit.kernel_calls import Intrinsic

# counters of one cache line, so that threads do not disturb each other
_LINE = 8
# looks at a counter before a thread sleeps, and microseconds of its sleep
_LOOKS, _MOMENT = 4000, 20
# counters of a team before its tickets: threads that have arrived, and meetings so far
_ARRIVED, _MET, _TICKETS = 0, 1, 2

_fetch_add = Intrinsic("featherfx.algebra.intrinsics", "fetch_add")
_sleep = Intrinsic("featherfx.algebra.intrinsics", "sleep")


def new_team(kinds: int) -> NDArray[np.int64]:
    """Counters of a team with so many kinds of tickets, all at zero."""
    return np.zeros((_TICKETS + kinds) * _LINE, dtype=np.int64)


@kernel
def ticket(team, kind):
    """The next number of a kind, from 0 on; each is given to one thread."""
    return _fetch_add(team, (_TICKETS + kind) * _LINE, 1)


@kernel
def forget_tickets(team, kind):
    """Begin again at 0; by one thread, while none takes tickets of this kind."""
    team[(_TICKETS + kind) * _LINE] = 0


@kernel
def meet(team, size):
    """Wait until all threads of a team of this size are here."""
    if size == 1:
        return
    before = _fetch_add(team, _MET * _LINE, 0)
    if _fetch_add(team, _ARRIVED * _LINE, 1) == size - 1:
        _fetch_add(team, _ARRIVED * _LINE, -size)
        _fetch_add(team, _MET * _LINE, 1)
        return
    looks = 0
    while _fetch_add(team, _MET * _LINE, 0) == before:
        looks += 1
        if looks >= _LOOKS:
            _sleep(_MOMENT)


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
        if looks >= _LOOKS:
            _sleep(_MOMENT)
