"""Memory of the process: what of it is free, and its address space, which job schedulers limit."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Lock
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.limits import MIN_ADDRESS_SPACE, as_size, process_limit

_lock = Lock()
_within, _before = 0, gc.get_threshold()


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Within it, in any thread, Python seldom looks for cycles to free: of what a shot is read and
    built into nearly all stays, and looking takes a fifteenth of the time; of what a kernel is
    compiled from, a seventh. Never to look takes 200 MB more."""
    global _within, _before
    with _lock:
        _within += 1
        if _within == 1:
            _before = gc.get_threshold()
            gc.set_threshold(_before[0] and 100_000, 10, 1000)  # 0: somebody wants it off
    try:
        yield
    finally:
        with _lock:
            _within -= 1
            if _within == 0:
                gc.set_threshold(*_before)


@contextmanager
def set_aside() -> Iterator[None]:
    """Within it Python no longer looks for cycles among what is there already: of 2,000 feathers
    that takes 0.14 s each time, in which no thread runs Python. What can be freed is freed first.
    """
    if gc.get_freeze_count():  # somebody else's, which leaving would undo
        yield
        return
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


# of mallopt (malloc.h): what is larger comes from the system by itself, bytes; number of heaps
_MMAP_THRESHOLD, _LARGE = -3, 1 << 18
_ARENA_MAX = -8
# of the address space (`ulimit -v`)
_LIMIT = "RLIMIT_AS"


def give_back_memory() -> None:
    """Let the system have what is free, where that can be asked: what one thread has freed is else
    of no use to others, and the next work takes as much again."""
    system: Any = ctypes
    with suppress(AttributeError, OSError, TypeError):
        system.CDLL(None).malloc_trim(0)


def keep_arrays_apart() -> None:
    """From now on let every array of more than 256 kB go back to the system when it is freed, where
    that can be asked: among smaller ones that stay, what is free is soon too small for the next."""
    _set_allocator(_MMAP_THRESHOLD, _LARGE)


def share_one_heap() -> None:
    """Let threads that start from now on share one heap, where that can be asked."""
    _set_allocator(_ARENA_MAX, 1)


def _set_allocator(parameter: int, value: int) -> None:
    if sys.platform == "linux":
        system: Any = ctypes
        with suppress(AttributeError, OSError):
            system.CDLL(None).mallopt(parameter, value)


def spare_address_space() -> None:
    """Share one heap among threads where the address space has a limit, before numpy is loaded:
    each thread else reserves 64 MB, or as much again for products of matrices."""
    if process_limit(_LIMIT) < math.inf:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        share_one_heap()


def refuse_small_address_space() -> None:
    """Raise InputError where the limit of the address space is too small to load OpenUSD, which
    crashes instead of reporting an error."""
    limit = process_limit(_LIMIT)
    if limit < MIN_ADDRESS_SPACE:
        sizes = f"allows {as_size(limit)}, but at least {as_size(MIN_ADDRESS_SPACE)} are needed"
        text = f"{sizes}, most of them by OpenUSD. Raise it, or limit resident memory instead"
        raise InputError(Problem("limit of the address space (ulimit -v)", "", text))
