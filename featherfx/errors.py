"""Errors that a user can cause, as data: one problem per line, all of them at once."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

# control characters and what else ends a line; a problem is told in one
CONTROL = re.compile("[\\x00-\\x1f\\x7f-\\x9f\\u2028\\u2029]")


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with an input.

    source: file (or prim, or option) in which it stands.
    key: dotted path of the key, empty when the file as a whole is meant.
    message: what is wrong, with the value and the allowed range where there is one.
    """

    source: str
    key: str
    message: str

    def __str__(self) -> str:
        line = ": ".join(part for part in (self.source, self.key, self.message) if part)
        return CONTROL.sub(lambda found: repr(found[0])[1:-1], line)


def as_sentence(text: str) -> str:
    """Return a text that ends with a period, unless another mark ends it."""
    return text if text.endswith((".", "?", "!", ":")) else f"{text}."


def count_feathers(count: int) -> str:
    """Say how many feathers, one or several."""
    return f"{count} feather{'' if count == 1 else 's'}"


def some_of(texts: Sequence[str], most: int = 5, between: str = ", ") -> str:
    """List the first texts, and say how many more there are."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return between.join(texts[:most]) + more


def as_figure(value: float, digits: int = 2) -> str:
    """Write a number with so many figures, or all of those before its point."""
    return f"{value:.0f}" if abs(value) >= 10.0 ** (digits - 1) else f"{value:.{digits}g}"


class InputError(Exception):
    """An input is wrong; holds every problem that was found, not the first only."""

    def __init__(self, *problems: Problem) -> None:
        self.problems: tuple[Problem, ...] = problems
        super().__init__("\n".join(str(problem) for problem in problems))

    def __reduce__(self) -> Any:
        # errors of workers go from process to process
        return type(self), self.problems


def require(*problems: Problem) -> None:
    """Raises InputError if there are problems."""
    if problems:
        raise InputError(*problems)


def require_type(name: str, value: object, kinds: Any, expected: str) -> None:
    """Raises TypeError, which says what to give, for an argument of another type."""
    if not isinstance(value, kinds):
        raise TypeError(
            f"{name}: {value!r:.60} is of type {type(value).__name__}. Give {expected}."
        )


def all_of(*tasks: Callable[[], Any]) -> list[Any]:
    """Results of all tasks; raises one InputError with the problems of all of them."""
    results: list[Any] = []
    problems: list[Problem] = []
    for task in tasks:
        try:
            results.append(task())
        except InputError as error:
            problems += error.problems
    require(*dict.fromkeys(problems))
    return results


class SimulationError(Exception):
    """A feather could not be advanced; names feather, time or frame, and reason.

    time: s since the first frame, negative while feathers are brought to rest before it. frame:
    number of the frame that it was on its way to, None where there are no frames.
    """

    def __init__(self, feather: str, time: float, reason: str, frame: float | None = None) -> None:
        self.feather, self.time, self.reason, self.frame = feather, time, reason, frame
        if frame is None:
            place = f"at t = {time:.6g} s"
        elif time < 0.0:
            place = f"before frame {frame:g}"
        else:
            place = f"at frame {frame:g} (t = {time:.6g} s)"
        super().__init__(f"feather {feather} {place}: {reason}")

    def __reduce__(self) -> Any:
        return type(self), (self.feather, self.time, self.reason, self.frame)


class InputWarning(UserWarning):
    """An input may not be what its author meant; the work goes on."""


def warn_input(text: str, level: int = 2) -> None:
    """Give an InputWarning. level: of the caller that it is about, as warnings.warn counts them."""
    warnings.warn(text, InputWarning, stacklevel=level + 1)
