"""Compiling as a phase of the work that needs the code, with kernels and seconds to come.

seconds.json holds the seconds of the kernels of a layout, a bake, one with contact and a bird, as
`featherfx lab measure compiling --write` measures them.
Seconds of another machine become those of this one by what was compiled so far.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from featherfx.jit.code_cache import EXPECTED_WORKS, is_stored
from featherfx.phases import Account, accounts

COMPILING = "compiling"
SECONDS = Path(__file__).with_name("seconds.json")
# s of a kernel that is not in seconds.json
_UNKNOWN_SECONDS = 1.0
# s that count as having taken as long as expected: the first kernel loads the compiler
_TRUSTED_SECONDS = 3.0


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


def _find_works(name: str) -> list[str]:
    """The smallest work that needs a kernel; none where it is not known."""
    table = measured_seconds()
    return sorted((work for work in table if name in table[work]), key=lambda w: len(table[w]))[:1]


class CompileProgress:
    """Reports to all open accounts which kernels are compiled, one after another."""

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._phases: list[tuple[Account, Any]] = []
        self._depth, self._since, self._spent = 0, 0.0, 0.0
        self._cpu_since, self._cpu_spent = 0.0, 0.0
        # expected seconds of what is to be and what has been compiled
        self._to_come: dict[str, float] = {}
        self._done: dict[str, float] = {}

    @contextmanager
    def compiling(self, name: str) -> Iterator[None]:
        """Within it a kernel is compiled, here or by another process that this one waits for."""
        with self._lock:
            self._depth += 1
            if self._depth == 1:
                self._since, self._cpu_since = time.perf_counter(), time.process_time()
                self._expect(name, *_find_missing(EXPECTED_WORKS or _find_works(name)))
                done, left = len(self._done), self._predict()
                total = done + len(self._to_come)
                self._phases = [
                    (each, each.open(COMPILING, total, done, left=left)) for each in accounts()
                ]
        try:
            yield
        finally:
            with self._lock:
                self._depth -= 1
                now = time.perf_counter()
                self._spent, self._since = self._spent + now - self._since, now
                self.note_compiled(name)
                if self._depth == 0:
                    self._cpu_spent += time.process_time() - self._cpu_since
                    for account, own in self._phases:
                        account.close(own, complete=not self._to_come)

    def cpu_seconds(self) -> float:
        """CPU seconds of this process while it compiled."""
        with self._lock:
            current = time.process_time() - self._cpu_since if self._depth else 0.0
            return self._cpu_spent + current

    def request(self, name: str) -> None:
        """Expect a kernel that was found missing."""
        with self._lock:
            self._expect(name)

    def note_compiled(self, name: str) -> None:
        """Report a kernel as compiled."""
        with self._lock:
            if name in self._to_come:
                self._done[name] = self._to_come.pop(name)
                for account, own in self._phases if self._depth else ():
                    account.advance(own, len(self._done), self._predict())

    def _expect(self, *names: str) -> None:
        """Add kernels that are to be compiled."""
        known = {key: s for work in measured_seconds().values() for key, s in work.items()}
        for each in names:
            if each not in self._done:
                self._to_come.setdefault(each, known.get(each, _UNKNOWN_SECONDS))

    def _predict(self) -> float:
        """Seconds that kernels will take on this machine."""
        expected = sum(self._done.values())
        rate = (self._spent + _TRUSTED_SECONDS) / (expected + _TRUSTED_SECONDS)
        return sum(self._to_come.values()) * rate


PROGRESS = CompileProgress()


def working_time() -> float:
    """CPU seconds of this process apart from those in which it compiled."""
    return time.process_time() - PROGRESS.cpu_seconds()
