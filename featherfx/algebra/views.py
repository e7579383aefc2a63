"""Named tuples of arrays by address: one kernel reaches batches of many shapes through a table.

A compiled function is made for the types of its arguments, and a list of batches would be a type
of its own for every number of them. Here each batch is a line of words, as a StructPointer's
(kernel_types.py). Inside a kernel `viewed` makes the named tuple of a line again, without copying.

Four numbers side by side that kernels calculate with as with one: a vector of the processor.

LLVM makes vectors of loops over arrays by itself, but not of sums that are kept in registers over a
loop, nor of what is shared by several of its turns. There kernels say so: `load` takes four
neighbouring numbers of a line, + - * /, sqrt, ceil, max and min work on each, a plain number stands
for four equal ones, and `put` writes them. What takes tuples of numbers (vec3_kernels, and slopes
of energies) takes tuples of lanes as well. A line is (.,), or an array in order, place by place.

Threads that work together inside compiled code: shared tickets, and barriers.

All threads of a team call the same kernel. Work is numbered, and each thread takes the next number
when it is free (`ticket`). Where all must be done before anyone goes on, they `meet`; where one
part must be, they wait for that (`say_done`, `wait_for`). After a while a waiting thread sleeps for
moments, so that its core can run another thread of the team.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from featherfx.jit.compiled import kernel
from featherfx.jit.kernel_calls import Intrinsic, TupleKind

COUNT = 4
# where it is said what each of these does
_TYPES = "featherfx.algebra.intrinsics"
load = Intrinsic(_TYPES, "load")
put = Intrinsic(_TYPES, "put")
spread = Intrinsic(_TYPES, "spread")
lane = Intrinsic(_TYPES, "lane")
increase = Intrinsic(_TYPES, "increase")
follow = Intrinsic(_TYPES, "follow")
transposed = Intrinsic(_TYPES, "transposed")
totals = Intrinsic(_TYPES, "totals")
where_there = Intrinsic(_TYPES, "where_there")
chosen = Intrinsic(_TYPES, "chosen")


class Views(NamedTuple):
    """Tuples of one kind whose arrays have any shapes; words: (N, W), each as a line."""

    kind: TupleKind
    words: NDArray[np.int64]


class ViewedTuples(NamedTuple):
    """Views, and the tuples whose memory they point to; these must live as long as the views."""

    views: Views
    tuples: tuple[Any, ...]


_KINDS: dict[Any, TupleKind] = {}


def views_of(tuples: Sequence[Any]) -> ViewedTuples:
    """Make views of named tuples of arrays, nested or not.

    Arrays that are not contiguous are copied.
    """
    whole = tuple(_map_arrays(_make_contiguous, each) for each in tuples)
    lines = [[word for array in _arrays(each) for word in _words(array)] for each in whole]
    form = _describe(whole[0])
    if form not in _KINDS:
        _KINDS[form] = TupleKind(_map_arrays(_make_empty, whole[0]))
    return ViewedTuples(Views(_KINDS[form], np.array(lines, dtype=np.int64)), whole)


def _map_arrays(function: Callable[[Any], Any], value: Any) -> Any:
    """A tuple of the same type with every array replaced."""
    if isinstance(value, np.ndarray):
        return function(value)
    parts = [_map_arrays(function, each) for each in value]
    return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)


def _make_contiguous(array: NDArray[Any]) -> NDArray[Any]:
    # np.require tells the same in eight times as long
    return array if array.flags.carray else np.require(array, requirements=("C", "W"))


def _make_empty(array: NDArray[Any]) -> NDArray[Any]:
    return np.empty((0,) * array.ndim, dtype=array.dtype)


def _describe(value: Any) -> Any:
    """Return the part that two tuples of one kind share."""
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim
    return type(value), tuple(_describe(each) for each in value)


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    if isinstance(value, np.ndarray):
        yield value
        return
    for each in value:
        yield from _arrays(each)


def _words(array: NDArray[Any]) -> tuple[int, ...]:
    return (array.ctypes.data, *array.shape, *array.strides)


_viewed = Intrinsic("featherfx.algebra.intrinsics", "viewed")
# an array in order (its numbers) in another shape of as many (a tuple)
shaped = Intrinsic("featherfx.algebra.intrinsics", "shaped")


@kernel
def viewed(views, line):
    """The named tuple of a line of views."""
    return _viewed(views.kind, views.words, line)


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
