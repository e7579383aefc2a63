"""Named phases of long work, timed, and reported to listeners.

Work that takes long says so where it happens,

    with phase("layout", total=12) as done:
        for number in range(12):
            ...
            done(number + 1)

and costs nothing unless an Account is open around it. Phases may lie within each other; time
belongs to the innermost, so that the seconds of all phases add up to the time since the account
began.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Any, NamedTuple, Self, TypeVar, cast

from featherfx.errors import require_type

_STARTING = "starting"
_SECONDS_BETWEEN_LINES = 1.0
_Part = TypeVar("_Part")
_Function = TypeVar("_Function", bound=Callable[..., Any])

# what a phase is told of its progress: parts done, and seconds left where it knows better
ReportDone = Callable[..., None]


class PhaseState(NamedTuple):
    """State of a phase. name: of it. done, total: parts; a total of 0 is not known. seconds: spent
    in it, without those of phases within it. left: s until its end, None: not known. ended: over,
    complete or not."""

    name: str
    done: float
    total: float
    seconds: float
    left: float | None
    ended: bool


Listener = Callable[[PhaseState], object]


@dataclass
class _Phase:
    """An open phase. first: parts done when it began, and from its first news on those done then,
    after so many seconds (begin): what comes first loads what all others need, and tells little of
    them. silent: timed, not told. at_most, whole: as of phase."""

    name: str
    total: float
    first: float
    done: float
    seconds: float = 0.0
    begin: float | None = None
    silent: bool = False
    at_most: bool = False
    whole: bool = False
    left: float | None = None


def time_left(first: float, done: float, total: float, seconds: float) -> float | None:
    """s that the parts from done to total take if they go on as those from first on did in seconds;
    None before there are any."""
    return seconds * (total - done) / (done - first) if done > first else None


class Account:
    """Account of the time of one piece of work; a context manager that phases in it report to.

    listener: is told of every phase. begin: reading of time.perf_counter from which time counts,
    default now; until the first phase it belongs to _STARTING. failed: name of the innermost phase
    that an exception left, empty: none.
    """

    def __init__(self, listener: Listener | None = None, begin: float | None = None) -> None:
        self._listener = listener
        self._lock = threading.RLock()
        self._open = [_Phase(_STARTING, 0.0, 0.0, 0.0)]
        self._mark = time.perf_counter() if begin is None else begin
        self._begin = self._mark
        self._seconds: dict[str, float] = {}
        # of a command the processor time counts from the start of the process
        self._worked = time.process_time() if begin is None else 0.0
        self._processor: dict[str, float] = {}
        self.failed = ""

    def __enter__(self) -> Self:
        self._token = _current.set(self)
        _open_accounts.append(self)
        return self

    def __exit__(self, *_: object) -> None:
        _open_accounts.remove(self)
        _current.reset(self._token)

    def seconds(self) -> dict[str, float]:
        """s spent so far, by name of phase; they add up to the time since the beginning."""
        with self._lock:
            self._spend()
            return dict(self._seconds)

    def processor_seconds(self) -> dict[str, float]:
        """s of processor time, of all threads of the process, by name of the phase meanwhile."""
        with self._lock:
            self._spend()
            return dict(self._processor)

    def spent(self, *names: str) -> float:
        """s spent so far in some phases."""
        seconds = self.seconds()
        return sum(seconds.get(name, 0.0) for name in names)

    def left(self, name: str) -> float | None:
        """s that are left of an open phase as it was told; None where it told nothing."""
        with self._lock:
            return next((own.left for own in self._open if own.name == name), None)

    @property
    def is_whole(self) -> bool:
        """Return whether phases that begin now are told of as the one that they are in."""
        with self._lock:
            return self._open[-1].whole

    @property
    def elapsed(self) -> float:
        """s since the beginning."""
        return time.perf_counter() - self._begin

    def open(
        self,
        name: str,
        total: float = 0.0,
        first: float = 0.0,
        silent: bool = False,
        left: float | None = None,
        at_most: bool = False,
        whole: bool = False,
    ) -> _Phase:
        """Begin a phase within those that are open; of any thread. left: as of advance. The rest:
        as of phase."""
        with self._lock:
            self._spend()
            own = _Phase(name, total, first, first, silent=silent, at_most=at_most, whole=whole)
            self._open.append(own)
        self._tell(own, left)
        return own

    def advance(self, own: _Phase, done: float, left: float | None = None) -> None:
        """Tell how far a phase is. left: s, where it is better known than by the parts done."""
        with self._lock:
            self._spend()
            own.done, own.left = done, left
            if own.begin is None and done > own.first:
                own.first, own.begin = done, own.seconds
            if own.total:
                # more parts have turned up than were known
                own.total = max(own.total, done)
        self._tell(own, left)

    def close(self, own: _Phase, failed: bool = False, complete: bool = True) -> None:
        """End a phase, its time being that until now. failed: by an exception. complete: whether
        all of its parts are done."""
        with self._lock:
            self._spend()
            self._open.remove(own)
            if failed and not self.failed:
                self.failed = own.name
            if complete and not failed and own.total:
                own.done = own.total
        self._tell(own, ended=True)

    def _spend(self) -> None:
        now, top = time.perf_counter(), self._open[-1]
        top.seconds += now - self._mark
        self._seconds[top.name] = self._seconds.get(top.name, 0.0) + now - self._mark
        self._mark = now
        worked = time.process_time()
        self._processor[top.name] = self._processor.get(top.name, 0.0) + worked - self._worked
        self._worked = worked

    def _tell(self, own: _Phase, left: float | None = None, ended: bool = False) -> None:
        if self._listener is None or own.silent:
            return
        if left is None and not own.at_most:
            is_done = own.total > 0.0 and own.done >= own.total
            spent = own.seconds - (own.begin or 0.0)
            left = 0.0 if is_done else time_left(own.first, own.done, own.total, spent)
        self._listener(PhaseState(own.name, own.done, own.total, own.seconds, left, ended))


_current: ContextVar[Account | None] = ContextVar("account", default=None)
_open_accounts: list[Account] = []


def account() -> Account | None:
    """The account that this thread's work is told to."""
    return _current.get()


def accounts() -> tuple[Account, ...]:
    """All that are open, for work that the whole process waits for."""
    return tuple(_open_accounts)


@contextmanager
def phase(
    name: str,
    total: float = 0.0,
    first: float = 0.0,
    silent: bool = False,
    at_most: bool = False,
    whole: bool = False,
) -> Iterator[ReportDone]:
    """Work under a name; call what this gives with the parts done so far.

    total: parts, 0: not known. first: those done before. silent: timed, not told. at_most: whether
    the work may be over long before the total, so that parts say nothing of the time left. whole:
    whether phases within it are neither told nor timed by themselves.
    """
    current = _current.get()
    if current is None or current.is_whole:
        yield lambda done, left=None: None
        return
    own = current.open(name, total, first, silent, at_most=at_most, whole=whole)
    try:
        yield lambda done, left=None: current.advance(own, done, left)
    except BaseException:
        current.close(own, failed=True)
        raise
    current.close(own)


Progress = bool | Callable[[Any, Any], Any]


def listener_of(progress: Progress, name: str) -> Callable[[Any, Any], Any] | None:
    """Return what hears of parts that are done and their number: the given function, for True one
    that prints a line a second with a name on stderr, for False none. Raises TypeError."""
    require_type("progress", progress, bool | Callable, "True, or a function of two numbers")
    if not isinstance(progress, bool):
        return progress
    return _Lines(name) if progress else None


class _Lines:
    """Lines of what is done of something with a name, on a terminal one that changes."""

    def __init__(self, name: str) -> None:
        self._name, self._last = name, -math.inf

    def __call__(self, done: float, total: float) -> None:
        now = time.monotonic()
        if done < total and now - self._last < _SECONDS_BETWEEN_LINES:
            return
        self._last = now
        end = "\n" if done >= total or not sys.stderr.isatty() else "\r"
        print(f"{self._name}: {done:g} of {total:g}", end=end, file=sys.stderr, flush=True)


def tells_progress(function: _Function) -> _Function:
    """Let a function tell how far it is by its keyword `progress`, which it does not use itself.

    progress: True prints lines on stderr; a function is called with the parts done and their number
    in each phase of the work, one phase after the other.
    """

    @wraps(function)
    def told(*arguments: Any, progress: Progress = False, **options: Any) -> Any:
        listener_of(progress, "")
        if progress is False:
            return function(*arguments, **options)
        listeners: dict[str, Any] = {}

        def listen(state: PhaseState) -> None:
            if state.total:
                if state.name not in listeners:
                    listeners[state.name] = listener_of(progress, state.name)
                listeners[state.name](state.done, state.total)

        with Account(listen):
            return function(*arguments, **options)

    return cast(_Function, told)


def counted(name: str, parts: Iterable[_Part], total: int) -> Iterator[_Part]:
    """The parts of some work, told as a phase while they are gone through."""
    with phase(name, total) as done:
        for number, part in enumerate(parts, 1):
            yield part
            done(number)


_MAX_NAMED = 3  # prims that are left out for one reason and named in a line


@dataclass(frozen=True)
class LeftOut:
    """A prim that was not read. kind: its type. reason: a phrase."""

    path: str
    kind: str
    reason: str


@dataclass(frozen=True)
class StageRead:
    """Account of one reading. file: of the stage. path: prim that was named, or the root.

    role: purpose, such as skin. taken: number of prims. describe: returns what there is to tell
    besides, such as its motion; called where the account is shown.
    """

    file: str
    path: str
    role: str
    taken: int
    left: tuple[LeftOut, ...] = ()
    describe: Callable[[], str] = str

    @cached_property
    def motion(self) -> str:
        """Return the motion in words; empty where there is nothing to tell."""
        return self.describe()

    def as_json(self) -> dict[str, Any]:
        """Return the entry of a report."""
        left = [{"path": each.path, "reason": each.reason} for each in self.left]
        found = {"path": self.path, "file": self.file, "as": self.role, "taken": self.taken}
        return {**found, "motion": self.motion, "left": left}

    def __str__(self) -> str:
        several = self.role if self.taken == 1 else f"{self.role}s"
        line = f"{self.file}: {self.path}: {self.taken} {several}"
        line += f", {self.motion}" if self.motion else ""
        kinds = Counter((each.kind, each.reason) for each in self.left)
        parts = []
        for (kind, reason), count in kinds.items():
            own = [each.path for each in self.left if (each.kind, each.reason) == (kind, reason)]
            more = ", ..." if count > _MAX_NAMED else ""
            named = f"{', '.join(own[:_MAX_NAMED])}{more}"
            parts.append(f"{count} {kind} that {reason} ({named})")
        return f"{line}; left {'; '.join(parts)}" if parts else line


def list_entries(reads: Iterable[StageRead]) -> list[dict[str, Any]]:
    """Return the entries of a report, each once."""
    entries = {str(each): each.as_json() for each in reads}
    return list(entries.values())


ReadListener = Callable[[StageRead], object]
_LISTENERS: ContextVar[tuple[ReadListener, ...]] = ContextVar("listeners", default=())


def note_read(read: StageRead) -> None:
    """Hand what was read to everyone who listens."""
    for listener in _LISTENERS.get():
        listener(read)


@contextmanager
def listen_to_reads(listener: ReadListener) -> Iterator[None]:
    """Call a listener with everything that is read within the block."""
    token = _LISTENERS.set((*_LISTENERS.get(), listener))
    try:
        yield
    finally:
        _LISTENERS.reset(token)
