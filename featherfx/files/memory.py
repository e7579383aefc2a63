"""Memory of the process: what of it is free, and its address space, which job schedulers limit."""

from __future__ import annotations

import ctypes
import math
import os
import sys
from contextlib import suppress
from typing import Any

from featherfx.errors import InputError, Problem
from featherfx.limits import MIN_ADDRESS_SPACE, as_size, process_limit

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
