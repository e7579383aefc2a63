"""The process: its memory, and work that overlaps in threads.

Memory is what is free, and the address space, which job schedulers limit. Work that overlaps is one
function called in order by a thread of its own. How many threads may work changes no result.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Queue
from threading import Lock, Thread
from typing import Any, Self

from featherfx.errors import InputError, Problem
from featherfx.limits import MAX_JOBS, MIN_ADDRESS_SPACE, as_size, process_limit

_lock = Lock()
_within, _before = 0, gc.get_threshold()


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Within it, in any thread, Python seldom looks for cycles to free, and hardly ever among what
    has stayed: of 2,000 feathers that takes 0.14 s each time, in which no thread runs Python. Of
    what a shot is read and built into nearly all stays; of what a kernel is compiled from, looking
    takes a seventh of the time. Never to look takes 200 MB more."""
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
        _set_allocator(_ARENA_MAX, 1)


def refuse_small_address_space() -> None:
    """Raise InputError where the limit of the address space is too small to load OpenUSD, which
    crashes instead of reporting an error."""
    limit = process_limit(_LIMIT)
    if limit < MIN_ADDRESS_SPACE:
        sizes = f"allows {as_size(limit)}, but at least {as_size(MIN_ADDRESS_SPACE)} are needed"
        text = f"{sizes}, most of them by OpenUSD. Raise it, or limit resident memory instead"
        raise InputError(Problem("limit of the address space (ulimit -v)", "", text))


_allowed_threads = [MAX_JOBS]


def allow_threads(threads: int) -> None:
    """Allow so many threads from now on: other processes of this machine have begun or ended."""
    _allowed_threads[0] = threads


def limit_threads(jobs: int) -> int:
    """Threads of so many that may be taken now, at least one."""
    return max(1, min(jobs, _allowed_threads[0]))


def count_cores() -> int:
    """Cores that this process may use, of those that the machine has."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Background:
    """Calls a function in another thread while the caller goes on; a context manager.

    room: calls that may wait; one more makes the caller wait, so that memory stays bounded. An
    exception of the function is raised by the caller's next call or at the end, and no later call
    is made. Where a block of it raises itself, calls that wait are made all the same: a bake that
    is interrupted keeps what it has simulated. seconds: spent in the function so far, and
    processor_seconds: of its thread.
    """

    def __init__(self, function: Callable[..., object], room: int = 2) -> None:
        self._function = function
        self._queue: Queue[tuple[Any, ...] | None] = Queue(room)
        self._error: BaseException | None = None
        self.seconds = self.processor_seconds = 0.0
        self._thread = Thread(target=self._run, name="featherfx writer", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __call__(self, *arguments: Any) -> None:
        self._raise()
        self._queue.put(arguments)

    def wait(self) -> None:
        """Return when all calls so far are done; raises as the next call would."""
        self._queue.join()
        self._raise()

    def close(self) -> None:
        """As wait; and no more calls."""
        self._end()
        self._raise()

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self._end()

    def _end(self) -> None:
        if self._thread.is_alive():
            self._queue.put(None)
            self._thread.join()

    def _run(self) -> None:
        # After an error the queue is still emptied, so that no caller waits for room for ever.
        while (arguments := self._queue.get()) is not None:
            if self._error is None:
                begin, worked = time.perf_counter(), time.thread_time()
                try:
                    self._function(*arguments)
                except BaseException as error:
                    self._error = error
                self.seconds += time.perf_counter() - begin
                self.processor_seconds += time.thread_time() - worked
            # a frame of a plumage is large, and the next call may be far
            del arguments
            self._queue.task_done()

    def _raise(self) -> None:
        if self._error is not None:
            raise self._error
