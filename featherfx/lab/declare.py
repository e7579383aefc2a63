"""Values of experiments, each declared once with its meaning, unit, range and default.

The options of `featherfx lab` are made of the declarations; out_of_range checks values by them.
"""

from __future__ import annotations

from dataclasses import MISSING, field, fields
from math import inf, isfinite
from typing import Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

from featherfx.errors import Problem

MEANING, _ALLOWED, OPTION = "meaning", "allowed", "option"
WITHOUT, DEFAULTS = "without", "defaults"


class Range(NamedTuple):
    """Finite numbers from low to high. above, below: whether that bound itself is left out."""

    low: float = -inf
    high: float = inf
    above: bool = False
    below: bool = False
    unit: str = ""

    def holds(self, number: float) -> bool:
        """Return whether a number is in the range."""
        over = number > self.low if self.above else number >= self.low
        under = number < self.high if self.below else number <= self.high
        return isfinite(number) and over and under

    def __str__(self) -> str:
        if self.low == -inf and self.high == inf:
            return "any finite number"
        words = f"{'above ' * self.above}{self.low:.12g}"
        if self.high < inf:
            words += f" to {'below ' * self.below}{self.high:.12g}"
        elif not self.above:
            words += " or more"
        return f"{words} {self.unit}".rstrip()


FINITE, POSITIVE, NOT_NEGATIVE = Range(), Range(0.0, above=True), Range(0.0)


def value(
    meaning: str, default: Any = MISSING, allowed: Range | None = None, *, option: str = ""
) -> Any:
    """A field of an experiment. meaning: with its unit. option: on the command line, where it has
    another name than the field."""
    return field(default=default, metadata={MEANING: meaning, _ALLOWED: allowed, OPTION: option})


def part(*without: str, **defaults: Any) -> Any:
    """A field that is made of values itself, which become options of the whole.

    without: values that are left as they are. defaults: other ones than its own.
    """
    return field(metadata={WITHOUT: without, DEFAULTS: defaults})


def out_of_range(
    item: Any, source: str = "", form: str = "{value:g} is not allowed. Give {allowed}"
) -> list[Problem]:
    """Every value of a dataclass that is none of its choices, or out of its declared range; None is
    in every one."""
    problems, hints = [], get_type_hints(type(item))
    for each in fields(item):
        found, allowed = getattr(item, each.name), each.metadata.get(_ALLOWED)
        choices = get_args(hints[each.name]) if get_origin(hints[each.name]) is Literal else ()
        if choices and found not in choices:
            message = f"'{found}' is not one of {', '.join(choices)}"
            problems.append(Problem(source, each.name, message))
        elif allowed is not None and found is not None and not allowed.holds(found):
            problems.append(Problem(source, each.name, form.format(value=found, allowed=allowed)))
    return problems
