"""Memory that the process holds, and what of it is free."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from typing import Any

# of mallopt (malloc.h): what is larger comes from the system by itself, bytes; number of heaps
_MMAP_THRESHOLD, _LARGE = -3, 1 << 18
_ARENA_MAX = -8


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
