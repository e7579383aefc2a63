"""Worker processes that compile shared kernels while this process goes on.

Who calls a shared kernel needs only its types; its machine code is needed when that of the caller
is loaded. So the pool hands a shared kernel that is not stored to a worker, which stores it. Who
waits compiles what no worker has begun. All goes on without workers where they cannot be started
or die. Workers are processes because numba compiles one kernel at a time in a process.

Compiling is a phase of the work that needs the code. Its parts are the seconds of kernels in
seconds.json, which `featherfx lab measure compiling --write` measures.
"""

from __future__ import annotations

import atexit
import json
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, wait
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from queue import Empty, PriorityQueue
from typing import Any, BinaryIO, NamedTuple

from featherfx.errors import InputError, Problem
from featherfx.files.process import count_cores
from featherfx.jit.code_cache import EXPECTED_WORKS, code_folder, explain_unsaved, is_stored
from featherfx.phases import Account, accounts

COMPILING = "compiling"
SECONDS = Path(__file__).with_name("seconds.json")
_UNKNOWN_SECONDS = 1.0  # of a kernel that is not in seconds.json


@cache
def measured_seconds() -> dict[str, dict[str, float]]:
    """CPU seconds of compiling, by work, then by kernel (module and name)."""
    found: dict[str, dict[str, float]] = json.loads(SECONDS.read_text(encoding="utf-8"))
    return found


def predict_seconds(*works: str) -> float:
    """CPU seconds of compiling what some works need and is not stored."""
    return sum(_find_missing(works).values())


def _find_missing(works: Iterable[str]) -> dict[str, float]:
    kernels = {name: s for work in works for name, s in measured_seconds().get(work, {}).items()}
    return {name: seconds for name, seconds in kernels.items() if not is_stored(name)}


class CompileProgress:
    """Reports to all open accounts how much of what is expected to be compiled is done."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._phases: list[tuple[Account, Any]] = []
        self._depth, self._since, self._spent = 0, 0.0, 0.0
        # expected seconds of what is to be and what has been compiled
        self._to_come: dict[str, float] = {}
        self._done: dict[str, float] = {}

    @contextmanager
    def compiling(self, name: str) -> Iterator[None]:
        """Within it a kernel is compiled, here or by another process that this one waits for."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                self._since = time.process_time()
                known = measured_seconds()
                own = sorted((w for w in known if name in known[w]), key=lambda w: len(known[w]))
                self.expect(name, *_find_missing(EXPECTED_WORKS or own[:1]))
                done, left = sum(self._done.values()), sum(self._to_come.values())
                self._phases = [
                    (each, each.open(COMPILING, round(done + left), round(done), left=left))
                    for each in accounts()
                ]
        try:
            yield
        finally:
            with self._lock:
                self._depth -= 1
                self.note_compiled(name)
                if self._depth == 0:
                    self._spent += time.process_time() - self._since
                    for account, own in self._phases:
                        account.close(own, complete=not self._to_come)

    def cpu_seconds(self) -> float:
        """CPU seconds of this process while it compiled."""
        with self._lock:
            return self._spent + (time.process_time() - self._since if self._depth else 0.0)

    def note_compiled(self, name: str) -> None:
        """Report a kernel as compiled."""
        with self._lock:
            if name in self._to_come:
                self._done[name] = self._to_come.pop(name)
                for account, own in self._phases if self._depth else ():
                    account.advance(own, round(sum(self._done.values())))

    def expect(self, *names: str) -> None:
        """Add kernels that are to be compiled."""
        known = {key: s for work in measured_seconds().values() for key, s in work.items()}
        with self._lock:
            for each in names:
                if each not in self._done:
                    self._to_come.setdefault(each, known.get(each, _UNKNOWN_SECONDS))


PROGRESS = CompileProgress()


def working_time() -> float:
    """CPU seconds of this process apart from those in which it compiled."""
    return time.process_time() - PROGRESS.cpu_seconds()


# more would mostly wait for the largest kernel
MAX_COMPILERS = 4
VARIABLE = "FEATHERFX_COMPILERS"
# s that a worker without work lives on, and between two looks for work of a thread that waits
_IDLE_SECONDS, _POLL_SECONDS = 5.0, 0.02
SERVE = (
    "import sys; sys.path[:] = sys.argv[1:]; from featherfx.jit import compile_workers, compiler;"
)
SERVE += "compile_workers.serve(compiler.compile_request)"
# in a worker: the stream by which it asks the process that it compiles for
_upstream: list[BinaryIO] = []


class KernelRequest(NamedTuple):
    """A shared kernel (module and name) for some types of arguments."""

    name: str
    args: tuple[Any, ...]


def count_compilers() -> int:
    """Number of processes that compile, this one among them. Raises InputError.

    $FEATHERFX_COMPILERS, else as many as there are cores, at most MAX_COMPILERS.
    """
    given = os.environ.get(VARIABLE, "").strip()
    if not given:
        # elsewhere sys.executable is the program that hosts this one
        is_python = Path(sys.executable or "").stem.startswith("python")
        return min(count_cores(), MAX_COMPILERS) if is_python else 1
    if not given.isdecimal() or not 1 <= int(given) <= 64:
        raise InputError(Problem(VARIABLE, "", f"is {given!r}. Give 1 to 64"))
    return int(given)


class CompilePool:
    """Worker processes and the kernels that they were asked for."""

    def __init__(self, workers: int) -> None:
        self._max_workers, self._workers = workers, 0
        self._lock = threading.Lock()
        self._futures: dict[KernelRequest, Future[None]] = {}
        self._queue: PriorityQueue[tuple[bool, int, KernelRequest]] = PriorityQueue()

    def submit(self, request: KernelRequest, later: bool = False) -> None:
        """Ask for a kernel; each once. later: after those that are not."""
        if _upstream:
            _send(_upstream[0], request)
            return
        with self._lock:
            if request in self._futures:
                return
            PROGRESS.expect(request.name)
            self._futures[request] = Future()
            self._queue.put((later, len(self._futures), request))
            if self._workers < self._max_workers:
                self._workers += 1
                threading.Thread(target=self._run_worker, daemon=True).start()

    def wait_for(
        self, request: KernelRequest, compile_here: Callable[[KernelRequest], None]
    ) -> None:
        """Return when a worker has compiled a kernel, or at once where none has begun.

        compile_here: compiles another kernel meanwhile.
        """
        future = self._futures.get(request)
        if future is None or future.done() or self._take(request):
            return
        with PROGRESS.compiling(request.name):
            while not future.done():
                other = next((each for each in list(self._futures) if self._take(each)), None)
                if other is not None:
                    compile_here(other)
                else:
                    wait([future], _POLL_SECONDS)

    def _take(self, request: KernelRequest) -> bool:
        """Take a kernel from the workers; false where one has begun or it was taken before."""
        with self._lock:
            return not self._futures[request].done() and self._futures[request].cancel()

    def _run_worker(self) -> None:
        """Hand kernels to one worker process until there are none for a while, or it dies."""
        process: Any = None
        try:
            while True:
                _, _, request = self._queue.get(timeout=_IDLE_SECONDS)
                future = self._futures[request]
                if not future.set_running_or_notify_cancel():
                    continue
                try:
                    process = process or self._start()
                    _send(process.stdin, request)
                    while (needed := pickle.load(process.stdout)) is not None:
                        self.submit(needed)
                finally:
                    future.set_result(None)
                PROGRESS.note_compiled(request.name)
        except Empty:
            pass
        except (OSError, EOFError, pickle.UnpicklingError):
            self._max_workers = 0  # what ended this worker would end others
        with self._lock:
            self._workers -= 1
        if process is not None:
            process.kill()
            process.wait()

    def _start(self) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-c", SERVE, *sys.path],
            env=os.environ | {"FEATHERFX_CACHE": str(code_folder())},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        atexit.register(process.kill)
        return process


@cache
def compile_pool() -> CompilePool:
    """The pool of this process. Raises InputError for a number of compilers that cannot be."""
    return CompilePool(0 if explain_unsaved() else count_compilers() - 1)


def is_worker() -> bool:
    """Return whether this process only compiles for another one, and runs no kernel."""
    return bool(_upstream)


def serve(compile_request: Callable[[KernelRequest], None]) -> None:
    """Compile the kernels that come on the standard input, until it ends."""
    _upstream.append(answers := os.fdopen(os.dup(sys.stdout.fileno()), "wb"))
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        compile_request(request)
        _send(answers, None)


def _send(stream: BinaryIO, message: KernelRequest | None) -> None:
    pickle.dump(message, stream)
    stream.flush()
