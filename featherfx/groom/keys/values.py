"""What a file may hold, as data: each key with its type, unit, range, default and meaning.

The same declarations check what users write, fill defaults in, and generate docs/reference.md.
Checking never stops at the first fault: everything that is wrong goes to one list.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from featherfx.errors import InputError, Problem

REQUIRED = object()
INVALID = object()


class Problems:
    """Collects problems in the order in which they are found, each once."""

    def __init__(self) -> None:
        self._found: dict[Problem, None] = {}

    def add(self, source: object, key: str, message: str) -> None:
        self._found[Problem(str(source), key, message)] = None

    def __len__(self) -> int:
        return len(self._found)

    def listed(self) -> list[Problem]:
        return list(self._found)

    def raise_any(self) -> None:
        """Raises InputError with all that was collected, if anything was."""
        if self._found:
            raise InputError(*self._found)


@dataclass(frozen=True)
class Place:
    """Where a value stands: a file, a dotted key, and the list that takes its problems."""

    source: str
    key: str
    problems: Problems

    def child(self, name: str) -> Place:
        """The place of a key below this one (itself for an empty name)."""
        if not name:
            return self
        return Place(self.source, f"{self.key}.{name}" if self.key else name, self.problems)

    def item(self, index: int) -> Place:
        return Place(self.source, f"{self.key}[{index}]", self.problems)

    def fail(self, message: str) -> Any:
        self.problems.add(self.source, self.key, message)
        return INVALID


class ValueType(Protocol):
    """How one value is checked and described."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        """The value as the program uses it, or INVALID after place.fail()."""

    def describe(self) -> tuple[str, str, str]:
        """Type, unit and allowed range, for people."""


def shown(value: Any) -> str:
    """A value as a TOML author would recognise it, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def nearest(name: str, names: Iterable[str]) -> str:
    """Half a sentence that names the likeliest meant name, or all of them."""
    known = sorted(names)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    if close:
        return f"did you mean '{close[0]}'?"
    return "known: " + ", ".join(known) if known else "there are none"


@dataclass(frozen=True)
class Number:
    """A finite number within [low, high]; integers where whole is set."""

    low: float
    high: float
    unit: str = ""
    whole: bool = False

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        kinds = int if self.whole else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds):
            return place.fail(f"{shown(value)} is not {self._noun()}")
        if isinstance(value, float) and not math.isfinite(value):
            return place.fail(f"{shown(value)} is not a finite number")
        if not self.low <= value <= self.high:
            return place.fail(f"{shown(value)} is out of range, allowed {self.allowed()}")
        return int(value) if self.whole else float(value)

    def allowed(self) -> str:
        return self._range() + (f" {self.unit}" if self.unit else "")

    def describe(self) -> tuple[str, str, str]:
        return "integer" if self.whole else "number", self.unit, self._range()

    def _range(self) -> str:
        return f"{self.low:.10g} to {self.high:.10g}"

    def _noun(self) -> str:
        return "an integer" if self.whole else "a number"


@dataclass(frozen=True)
class Flag:
    """true or false."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, bool):
            return place.fail(f"{shown(value)} is not true or false")
        return value

    def describe(self) -> tuple[str, str, str]:
        return "boolean", "", "true, false"


@dataclass(frozen=True)
class Text:
    """A text, one of `choices` where there are any, else not empty unless `empty` is set."""

    choices: tuple[str, ...] = ()
    empty: bool = False

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, str):
            return place.fail(f"{shown(value)} is not a text in quotes")
        if self.choices and value not in self.choices:
            return place.fail(f"'{value}' is not allowed, {nearest(value, self.choices)}")
        if not value and not self.empty and not self.choices:
            return place.fail("the text is empty")
        return value

    def describe(self) -> tuple[str, str, str]:
        return "text", "", ", ".join(f'"{choice}"' for choice in self.choices)


@dataclass(frozen=True)
class Array:
    """An array of equal items, its length within [least, most]; a tuple when checked."""

    item: ValueType
    least: int
    most: int

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, list):
            return place.fail(f"{shown(value)} is not an array")
        if not self.least <= len(value) <= self.most:
            return place.fail(f"has {len(value)} items, allowed {self._count()}")
        items = tuple(self.item.check(each, place.item(i), False) for i, each in enumerate(value))
        return INVALID if any(each is INVALID for each in items) else items

    def describe(self) -> tuple[str, str, str]:
        kind, unit, allowed = self.item.describe()
        return f"array of {self._count()} {kind}", unit, allowed

    def _count(self) -> str:
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"


@dataclass(frozen=True)
class Direction:
    """Three numbers that are not all zero; a unit vector when checked."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        vector = Array(Number(-1e6, 1e6), 3, 3).check(value, place, partial)
        if vector is INVALID:
            return INVALID
        norm = math.hypot(*vector)
        if norm < 1e-9:
            return place.fail("a direction cannot be zero")
        return tuple(each / norm for each in vector)

    def describe(self) -> tuple[str, str, str]:
        return "array of 3 number", "", "not zero; made a unit vector"


@dataclass(frozen=True)
class Either:
    """The first of several types whose kind of value fits (decided by `fits`)."""

    options: tuple[tuple[Callable[[Any], bool], ValueType], ...]

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        for fits, option in self.options:
            if fits(value):
                return option.check(value, place, partial)
        names = " or ".join(option.describe()[0] for _, option in self.options)
        return place.fail(f"{shown(value)} is not allowed here, expects {names}")

    def describe(self) -> tuple[str, str, str]:
        parts = [option.describe() for _, option in self.options]
        units = dict.fromkeys(part[1] for part in parts if part[1])
        ranges = dict.fromkeys(part[2] for part in parts if part[2])
        return " or ".join(part[0] for part in parts), " or ".join(units), "; ".join(ranges)


@dataclass(frozen=True)
class Key:
    """One key of a table. default: REQUIRED, or the value when the key is left out."""

    type: ValueType
    meaning: str
    default: Any = REQUIRED


@dataclass(frozen=True)
class Table:
    """A table with known keys. A dict when checked, defaults filled in unless partial."""

    keys: Mapping[str, Key]
    title: str = "table"

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, dict):
            return place.fail(f"{shown(value)} is not a table")
        result: dict[str, Any] = {}
        whole = True
        for name, each in value.items():
            if name not in self.keys:
                place.child(name).fail(f"unknown key, {nearest(name, self.keys)}")
                whole = False
                continue
            checked = self.keys[name].type.check(each, place.child(name), partial)
            whole = whole and checked is not INVALID
            result[name] = checked
        if not partial:
            whole = self._complete(value, result, place) and whole
        return result if whole else INVALID

    def _complete(self, value: dict[str, Any], result: dict[str, Any], place: Place) -> bool:
        whole = True
        for name, key in self.keys.items():
            if name in value:
                continue
            if key.default is REQUIRED:
                place.child(name).fail(f"missing, expects {expected(key.type)}")
                whole = False
            result[name] = key.default
        return whole

    def describe(self) -> tuple[str, str, str]:
        return self.title, "", ""


@dataclass(frozen=True)
class Named:
    """A table whose keys are free names and whose values are all of one type."""

    item: ValueType
    title: str = field(default="table")

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, dict):
            return place.fail(f"{shown(value)} is not a table")
        result = {
            name: self.item.check(each, place.child(f'"{name}"'), partial)
            for name, each in value.items()
        }
        return INVALID if any(each is INVALID for each in result.values()) else result

    def describe(self) -> tuple[str, str, str]:
        return self.title, "", ""


@dataclass(frozen=True)
class Partial:
    """A table of which any keys may be left out, without defaults taking their place."""

    table: Table

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        return self.table.check(value, place, True)

    def describe(self) -> tuple[str, str, str]:
        return self.table.describe()


def expected(kind: ValueType) -> str:
    """A type with its unit and range in one phrase."""
    name, unit, allowed = kind.describe()
    article = "an" if name[0] in "aeiou" else "a"
    tail = " ".join(part for part in (allowed, unit) if part)
    return f"{article} {name}, {tail}" if tail else f"{article} {name}"
