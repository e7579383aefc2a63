"""Provenance: which prims of stages were taken as what, and which were left out, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property
from typing import Any

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


Listener = Callable[[StageRead], object]
_LISTENERS: ContextVar[tuple[Listener, ...]] = ContextVar("listeners", default=())


def note_read(read: StageRead) -> None:
    """Hand what was read to everyone who listens."""
    for listener in _LISTENERS.get():
        listener(read)


@contextmanager
def listen_to_reads(listener: Listener) -> Iterator[None]:
    """Call a listener with everything that is read within the block."""
    token = _LISTENERS.set((*_LISTENERS.get(), listener))
    try:
        yield
    finally:
        _LISTENERS.reset(token)
