"""Processes that compile shared kernels while this one goes on.

A kernel that calls a shared one needs only its types to be compiled; machine code is needed when
that of the caller is loaded. So a shared kernel of which no machine code is stored is asked of
helpers (`Crew.ask`), and waited for only then (`Crew.wait_for`). A helper stores what it compiles;
what it calls in turn, it asks of the process that it works for. Who waits compiles what nobody has
begun, so all goes on without helpers too, where they cannot be started or die.

Helpers are processes and not threads, because numba compiles one kernel at a time in a process.
"""

from __future__ import annotations

import atexit
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from featherfx.errors import InputError, Problem
from featherfx.jit.cache import root_folder
from featherfx.jit.threads import cores

# more would mostly wait for the largest kernel
MOST_COMPILERS = 4
VARIABLE = "FEATHERFX_COMPILERS"
# numba's event of this name lasts while somebody waits for what a helper compiles; its data: Need
WAITING = "featherfx:waiting"
# s that a helper waits for more to do before it ends, so that it does not hold memory
PATIENCE = 5.0
# are told of every kernel that a helper has compiled
LISTENERS: list[Callable[[Need], None]] = []
SERVE = "import sys; sys.path[:] = sys.argv[1:]; from featherfx.jit import serve; serve.main()"


class Need(NamedTuple):
    """A shared kernel for some types of arguments."""

    module: str
    name: str
    args: tuple[Any, ...]


def compilers() -> int:
    """Processes that compile at once, this one among them: $FEATHERFX_COMPILERS, else as many as
    there are cores, at most MOST_COMPILERS. Raises InputError."""
    given = os.environ.get(VARIABLE, "").strip()
    if not given:
        # elsewhere sys.executable is the program that hosts this one
        python = Path(sys.executable or "").stem.startswith("python")
        return min(cores(), MOST_COMPILERS) if python else 1
    if not given.isdecimal() or not 1 <= int(given) <= 64:
        raise InputError(Problem(VARIABLE, "", f"is {given!r}, allowed: 1 to 64"))
    return int(given)


def send(stream: BinaryIO, message: Any) -> None:
    """Write a message to the other end of a pipe."""
    pickle.dump(message, stream)
    stream.flush()


def received(stream: BinaryIO) -> Any:
    """The next message; None where the other end is gone."""
    try:
        return pickle.load(stream)
    except (EOFError, OSError, pickle.UnpicklingError):
        return None


class Crew:
    """Helpers, and what is asked of them.

    folder: where machine code is stored.
    """

    def __init__(self, helpers: int, folder: Path) -> None:
        self._most, self._folder = helpers, folder
        self._changed = threading.Condition()
        self._asked: dict[Need, None] = {}
        self._waiting: list[Need] = []
        self._begun: set[Need] = set()
        self._helpers = self._idle = 0
        self._processes: set[subprocess.Popen[bytes]] = set()
        atexit.register(self.end)

    def end(self) -> None:
        """Stop all helpers, whatever they are at."""
        for each in tuple(self._processes):
            self._end(each)

    @property
    def asked(self) -> list[Need]:
        """All that were not stored when they were first needed, done since or not."""
        return list(self._asked)

    def ask(self, need: Need) -> None:
        """Have it compiled; each kernel is asked for once."""
        with self._changed:
            if need in self._asked:
                return
            self._asked[need] = None
            self._waiting.append(need)
            if self._idle < len(self._waiting) and self._helpers < self._most:
                self._helpers += 1
                threading.Thread(target=self._help, daemon=True).start()
            self._changed.notify_all()

    def wait_for(self, need: Need, compile_here: Callable[[Need], None]) -> None:
        """Return when a kernel is stored, or is not and nobody is at it: then it is the caller's.

        compile_here: does so with another one, while a helper is at this one.
        """
        with self._changed:
            self._asked[need] = None
            if need in self._waiting:
                self._waiting.remove(need)
            if need not in self._begun:
                return
        from numba.core import event

        with event.trigger_event(WAITING, need):
            self._wait(need, compile_here)

    def _wait(self, need: Need, compile_here: Callable[[Need], None]) -> None:
        while True:
            with self._changed:
                if need not in self._begun:
                    return
                if not self._waiting:
                    self._changed.wait()
                    continue
                other = self._waiting.pop(0)
            compile_here(other)

    def _help(self) -> None:
        """One helper's life: it gets what is asked for, until nothing has been for a while."""
        helper = self._start()
        well = helper is not None
        while well and (need := self._next()) is not None:
            well = self._compile(helper, need)
            with self._changed:
                self._begun.discard(need)
                self._changed.notify_all()
            for listener in LISTENERS if well else ():
                listener(need)
        with self._changed:
            self._helpers -= 1
            if not well:
                self._most = 0  # what ended this one would end others
        if helper is not None:
            self._end(helper)

    def _next(self) -> Need | None:
        """What to do next; None where there has been nothing for a while."""
        with self._changed:
            self._idle += 1
            self._changed.wait_for(lambda: bool(self._waiting), PATIENCE)
            self._idle -= 1
            if not self._waiting:
                return None
            need = self._waiting.pop(0)
            self._begun.add(need)
            return need

    def _compile(self, helper: Any, need: Need) -> bool:
        """Have a helper compile a kernel; false where it could not."""
        try:
            send(helper.stdin, need)
        except OSError:
            return False
        while isinstance(message := received(helper.stdout), Need):
            self.ask(message)
        return message is True

    def _start(self) -> subprocess.Popen[bytes] | None:
        try:
            helper = subprocess.Popen(
                [sys.executable, "-c", SERVE, *sys.path],
                env=os.environ | {"FEATHERFX_CACHE": str(self._folder)},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError:
            return None
        self._processes.add(helper)
        return helper

    def _end(self, helper: subprocess.Popen[bytes]) -> None:
        self._processes.discard(helper)
        helper.kill()
        helper.wait()


@cache
def crew() -> Any:
    """Who compiles shared kernels beside this process. Raises InputError of what is asked for."""
    return _worked_for[0] if _worked_for else Crew(compilers() - 1, root_folder())


# in a helper: what it works for
_worked_for: list[Any] = []


def work_for(upstream: Any) -> None:
    """Be a helper from here on: compile and store, load nothing."""
    _worked_for.append(upstream)


def is_helper() -> bool:
    """Whether this process only compiles for another one."""
    return bool(_worked_for)
