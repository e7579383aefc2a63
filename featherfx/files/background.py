"""Work that overlaps: one function called in order by a thread of its own, and how many threads of
a process may work, which changes no result."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from queue import Queue
from threading import Thread
from typing import Any, Self

from featherfx.limits import MAX_JOBS

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
