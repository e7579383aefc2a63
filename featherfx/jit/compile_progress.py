"""Compiling is told as a phase of whatever work needs the code.

How many kernels are still to come, and how long they take, follows from seconds.json, which
`featherfx lab measure compiling --write` writes: of the kernels of a layout, of a bake and of one
with contact. Those whose code is stored need no compiling, unless for other types, for which the
crew is asked then. Waiting for what another process compiles is compiling, too. Seconds of another
machine become those of this one by what has been compiled so far.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from featherfx.jit import shipped
from featherfx.jit.cache import ROOT, cache_folder, warn_if_unkept
from featherfx.jit.compile_workers import LISTENERS, WAITING, Need, crew
from featherfx.phases import Account, accounts

COMPILING = "compiling"
SECONDS = Path(__file__).with_name("seconds.json")
# of a kernel that seconds.json does not know
_UNKNOWN = 1.0
# s of compiling that count as having taken as long as expected: the first kernel loads the compiler
_BELIEVED = 3.0


@cache
def measured_seconds() -> dict[str, dict[str, float]]:
    """Processor seconds of compiling, by what is done, then by kernel (module and name)."""
    found: dict[str, dict[str, float]] = json.loads(SECONDS.read_text(encoding="utf-8"))
    return found


def name_of(function: Any) -> str:
    """Module and name of a kernel."""
    return f"{function.__module__}.{function.__qualname__}"


def is_stored(name: str) -> bool:
    """Whether machine code is kept of a kernel, or, of name#2, of a second one of its name for
    other types; true of one that is no more."""
    name, _, number = name.partition("#")
    module, _, own = name.rpartition(".")
    source = ROOT.parent.joinpath(*module.split(".")).with_suffix(".py")
    if not source.is_file():
        return True
    folder = cache_folder(source)
    came = shipped.FOLDER / folder.name if shipped.fitting() else folder
    names = {each.name for place in (folder, came) for each in place.glob(f"*.{own}-*")}
    return len(names) >= int(number or 1)


def seconds_to_come(*works: str) -> float:
    """Processor seconds of compiling what some works need and is not stored, on the machine of
    seconds.json."""
    return sum(_missing(works).values())


def _missing(works: Iterable[str]) -> dict[str, float]:
    """Seconds by kernel of what some works need and is not stored."""
    kernels = {name: s for work in works for name, s in measured_seconds()[work].items()}
    return {name: seconds for name, seconds in kernels.items() if not is_stored(name)}


class Compiling:
    """Tells all open accounts of the kernels that are compiled, one after another.

    works: what is about to be done, by its names in seconds.json. inner.py has it hear of events.
    """

    def __init__(self) -> None:
        self.works: tuple[str, ...] = ()
        self._lock = threading.Lock()
        self._phases: list[tuple[Account, Any]] = []
        self._depth, self._since, self._spent = 0, 0.0, 0.0
        # seconds that were expected of what has been compiled
        self._done: dict[str, float] = {}

    def on_start(self, event: Any) -> None:
        warn_if_unkept()
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._since = time.perf_counter()
            to_come = self._to_come(_name_of(event))
            count, total = len(self._done), len(self._done) + len(to_come)
            left = self._left(to_come)
            self._phases = [
                (each, each.open(COMPILING, total, count, left=left)) for each in accounts()
            ]

    def on_end(self, event: Any) -> None:
        with self._lock:
            self._depth -= 1
            now = time.perf_counter()
            self._spent, self._since = self._spent + now - self._since, now
            name = _name_of(event)
            to_come = self._to_come(name) if event.kind == WAITING else self._one_done(name)
            for account, own in self._phases if self._depth == 0 else ():
                account.close(own, complete=not to_come)

    def compiled_elsewhere(self, need: Need) -> None:
        """A helper has compiled a kernel."""
        with self._lock:
            self._one_done(f"{need.module}.{need.name}")

    def _one_done(self, name: str) -> dict[str, float]:
        """Tell of a kernel that it is compiled; what is still to come."""
        to_come, numbered = self._to_come(name), self._numbered(name)
        self._done[numbered] = to_come.pop(numbered)
        for account, own in self._phases if self._depth else ():
            account.advance(own, len(self._done), self._left(to_come))
        return to_come

    def _numbered(self, name: str) -> str:
        """Name of a kernel that is yet to be done, numbered where it is not the first of it."""
        return _numbered(name, self._done)

    def _to_come(self, name: str) -> dict[str, float]:
        """Seconds by kernel of what is to be compiled, a named one among them."""
        name = self._numbered(name)
        works = [work for work in self.works if work in measured_seconds()] or [
            min(
                (each for each in measured_seconds() if name in measured_seconds()[each]),
                key=lambda each: len(measured_seconds()[each]),
                default="",
            )
        ]
        known = {k: s for each in measured_seconds().values() for k, s in each.items()}
        missing = _missing(each for each in works if each)
        asked = {each: known.get(each.partition("#")[0], _UNKNOWN) for each in _asked_for()}
        to_come = {k: s for k, s in (asked | missing).items() if k not in self._done}
        return {name: known.get(name, _UNKNOWN), **to_come}

    def _left(self, to_come: dict[str, float]) -> float:
        """s that kernels will take, on this machine as far as it is known."""
        expected = sum(self._done.values())
        return sum(to_come.values()) * (self._spent + _BELIEVED) / (expected + _BELIEVED)


def _name_of(event: Any) -> str:
    if event.kind == WAITING:
        return f"{event.data.module}.{event.data.name}"
    return name_of(event.data["dispatcher"].py_func)


def _asked_for() -> list[str]:
    """Names of the shared kernels that were not stored when they were needed, numbered where one is
    for several types."""
    names: list[str] = []
    for name in (f"{need.module}.{need.name}" for need in crew().asked):
        names.append(_numbered(name, names))
    return names


def _numbered(name: str, before: Iterable[str]) -> str:
    """Name of a kernel, numbered where others of it come before."""
    count = sum(each.partition("#")[0] == name for each in before)
    return f"{name}#{count + 1}" if count else name


TELLER = Compiling()
LISTENERS.append(TELLER.compiled_elsewhere)
