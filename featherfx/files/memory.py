"""Memory that the process holds, and what of it is free."""

from __future__ import annotations

import ctypes
from contextlib import suppress
from typing import Any


def give_back_memory() -> None:
    """Let the system have what is free, where that can be asked: what one thread has freed is else
    of no use to others, and the next work takes as much again."""
    system: Any = ctypes
    with suppress(AttributeError, OSError, TypeError):
        system.CDLL(None).malloc_trim(0)
