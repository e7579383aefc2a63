"""Python's search for cycles that nothing holds, put off while much is made that stays."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock

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
