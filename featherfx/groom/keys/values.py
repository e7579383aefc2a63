"""Declarations of keys: type, unit, range, default and meaning.

The same declarations check what users write, fill defaults in, and generate docs/reference.md and
the JSON Schemas. Keys that become fields of a dataclass are declared there (see `keys_of`).
Checking never stops at the first fault: everything that is wrong goes to one list.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from itertools import islice
from types import SimpleNamespace
from typing import Any, Protocol, get_args, get_type_hints

from featherfx.errors import CONTROL
from featherfx.groom.keys.problems import INVALID, Place, Problems, closest
from featherfx.limits import MAX_CHARACTERS

REQUIRED = object()
_FEW_KEYS = 5  # of a table, as an example


JsonSchema = dict[str, Any]


def one_of_types(*schemas: JsonSchema) -> JsonSchema:
    """Return a schema of what fits one of several schemas, each for another type of value.

    In one, not as anyOf: keywords apply to values of their own type only, and what does not fit is
    told by its own message. An enum of texts would apply to all, so it becomes a pattern.
    """
    found: JsonSchema = {}
    for schema in schemas:
        found |= schema
        if choices := found.pop("enum", ()):
            found["pattern"] = f"^({'|'.join(map(re.escape, choices))})$"
    return found | {"type": list(dict.fromkeys(schema["type"] for schema in schemas))}


class ValueType(Protocol):
    """Check and description of one value.

    partial: whether keys of a table may be left out, as in what extends a preset.
    """

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        """The value as the program uses it, or INVALID after place.fail()."""

    def describe(self) -> tuple[str, str, str]:
        """Type, unit and allowed range, for people."""

    def schema(self, partial: bool) -> JsonSchema:
        """The same as JSON Schema, in words that drafts 4 to 2020-12 share."""


def shown(value: Any) -> str:
    """A value as a TOML author would recognise it, shortened."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return f"{value:g}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


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
            kind = "an integer" if self.whole else "a number"
            return place.fail(f"{shown(value)} is not {kind}. Give {self.allowed()}")
        if isinstance(value, float) and not math.isfinite(value):
            return place.fail(f"{shown(value)} is not a finite number")
        if not self.low <= value <= self.high:
            return place.fail(f"{shown(value)} is out of range. Give {self.allowed()}")
        return int(value) if self.whole else float(value)

    def is_beyond(self, value: Any) -> bool:
        """Return True for a number outside of the range."""
        sound = isinstance(value, (int, float)) and math.isfinite(value)
        return sound and not self.low <= value <= self.high

    def allowed(self) -> str:
        return self._range() + (f" {self.unit}" if self.unit else "")

    def describe(self) -> tuple[str, str, str]:
        return "integer" if self.whole else "number", self.unit, self._range()

    def schema(self, partial: bool) -> JsonSchema:
        kind = "integer" if self.whole else "number"
        return {"type": kind, "minimum": self.low, "maximum": self.high}

    def _range(self) -> str:
        return f"{self.low:.10g} to {self.high:.10g}"


@dataclass(frozen=True)
class Flag:
    """true or false."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, bool):
            return place.fail(f"{shown(value)} is not true or false")
        return value

    def describe(self) -> tuple[str, str, str]:
        return "boolean", "", "true, false"

    def schema(self, partial: bool) -> JsonSchema:
        return {"type": "boolean"}


@dataclass(frozen=True)
class Text:
    """A text, one of `choices` where there are any, else not empty unless `empty` is set."""

    choices: tuple[str, ...] = ()
    empty: bool = False

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, str):
            return place.fail(f"{shown(value)} is not a text in quotes")
        if self.choices and value not in self.choices:
            return place.unknown(f"{shown(value)} is not allowed", value, self.choices)
        if len(value) > MAX_CHARACTERS:
            return place.fail(f"has {len(value)} characters. Give at most {MAX_CHARACTERS}")
        if CONTROL.search(value):
            return place.fail(f"{shown(value)} holds a line break or a control character")
        if not value and not self.empty and not self.choices:
            return place.fail("the text is empty. Give at least one character")
        return value

    def describe(self) -> tuple[str, str, str]:
        return "text", "", ", ".join(f'"{choice}"' for choice in self.choices)

    def schema(self, partial: bool) -> JsonSchema:
        if self.choices:
            return {"type": "string", "enum": list(self.choices)}
        control: JsonSchema = {"type": "string", "pattern": CONTROL.pattern}
        found: JsonSchema = {"type": "string", "maxLength": MAX_CHARACTERS, "not": control}
        return found if self.empty else {**found, "minLength": 1}


@dataclass(frozen=True)
class ArrayOf:
    """An array of equal items, its length within [least, most]; a tuple when checked."""

    item: ValueType
    least: int
    most: int

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, list):
            return place.fail(f"{shown(value)} is not an array. Give {self._items()} in [ ]")
        if not self.least <= len(value) <= self.most:
            return place.fail(
                f"has {len(value)} item{'s' * (len(value) != 1)}. Give {self._items()}"
            )
        if value and isinstance(self.item, ArrayOf) and not any(type(x) is list for x in value):
            rows = ", ".join([f"[{', '.join(map(shown, value[: self.item.least]))}]", "..."])
            return place.fail(f"{shown(value)} holds no arrays. Give {self._items()}: [{rows}]")
        if isinstance(self.item, Number) and sum(map(self.item.is_beyond, value)) > 1:
            return place.fail(f"{shown(value)} is out of range. Give {self.item.allowed()} in each")
        items = tuple(self.item.check(each, place.item(i), False) for i, each in enumerate(value))
        return INVALID if any(each is INVALID for each in items) else items

    def describe(self) -> tuple[str, str, str]:
        return f"array of {self._items()}", *self.item.describe()[1:]

    def schema(self, partial: bool) -> JsonSchema:
        sizes = {"minItems": self.least, "maxItems": self.most}
        return {"type": "array", "items": self.item.schema(False)} | sizes

    def _items(self) -> str:
        kind = self.item.describe()[0]
        return f"{self._count()} {kind}" if self.most == 1 else f"{self._count()} {_plural(kind)}"

    def _count(self) -> str:
        return str(self.least) if self.least == self.most else f"{self.least} to {self.most}"


def _plural(kinds: str) -> str:
    """Return kinds of values such as "number or array of 3 numbers" in the plural."""
    return " or ".join(re.sub(r"^\w+", r"\g<0>s", kind) for kind in kinds.split(" or "))


def vector(low: float, high: float, unit: str) -> ArrayOf:
    """Three numbers."""
    return ArrayOf(Number(low, high, unit), 3, 3)


@dataclass(frozen=True)
class Either:
    """One of several types, each for another kind of TOML value."""

    options: Mapping[type, ValueType]

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        option = self.options.get(type(value))
        if option is not None:
            return option.check(value, place, partial)
        names = self.describe()[0]
        return place.fail(f"{shown(value)} is not allowed here, expects {names}")

    def describe(self) -> tuple[str, str, str]:
        parts = [option.describe() for option in self.options.values()]
        units = dict.fromkeys(part[1] for part in parts if part[1])
        ranges = dict.fromkeys(part[2] for part in parts if part[2])
        kinds = dict.fromkeys(part[0] for part in parts)
        return " or ".join(kinds), " or ".join(units), "; ".join(ranges)

    def schema(self, partial: bool) -> JsonSchema:
        return one_of_types(*(option.schema(partial) for option in self.options.values()))


@dataclass(frozen=True)
class Key:
    """One key of a table. default: REQUIRED, or the value when the key is left out."""

    type: ValueType
    meaning: str
    default: Any = REQUIRED

    def schema(self, partial: bool) -> JsonSchema:
        """JSON Schema of the value, with meaning, unit and default."""
        unit = self.type.describe()[1]
        result = self.type.schema(partial)
        result["description"] = f"{self.meaning} Unit: {unit}." if unit else self.meaning
        if self.default is not REQUIRED and self.default is not None:
            result["default"] = self.default
        return result


@dataclass(frozen=True)
class Default:
    """Default of a key whose field holds another kind of object."""

    value: Any


def keys_of(declared: type) -> dict[str, Key]:
    """The keys that the fields of a dataclass declare.

    A field is a key where it is Annotated with its meaning, and with a value type unless it is a
    bool, a text or a dataclass of keys. Its default is the field's, or that of a Default.
    """
    hints: dict[str, Any] = {}
    for base in reversed(declared.__mro__):
        annotated = {
            name: text
            for name, text in vars(base).get("__annotations__", {}).items()
            if str(text).startswith("Annotated[")
        }
        own, names = SimpleNamespace(__annotations__=annotated), vars(sys.modules[base.__module__])
        hints |= get_type_hints(own, names, include_extras=True)
    return {
        each.name: _declared_key(each, hints[each.name])
        for each in fields(declared)
        if each.name in hints
    }


def _declared_key(declared: Field[Any], hint: Any) -> Key:
    held, *notes = get_args(hint)
    default = REQUIRED if declared.default is MISSING else declared.default
    kind: ValueType | None = None
    for note in notes:
        if isinstance(note, str):
            meaning = note
        elif isinstance(note, Default):
            default = note.value
        else:
            kind = note
    return Key(kind or _plain_type(held), meaning, default)


def _plain_type(held: type) -> ValueType:
    if is_dataclass(held):
        return Table(keys_of(held))
    return Flag() if held is bool else Text()


@dataclass(frozen=True)
class Table:
    """A table with known keys. A dict when checked, defaults filled in unless partial."""

    keys: Mapping[str, Key]
    title: str = "table"

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            return place.fail(f"is an array of tables. Write [{place.key}] with one bracket")
        if not isinstance(value, dict):
            holds = self.examples()
            given = "{ }" if "[" in place.key else f"{{ }} or a table [{place.key}]"
            return place.fail(f"{shown(value)} is not a table. Give {given}{holds}")
        parts = self.parts(value, place, partial)
        return INVALID if any(each is INVALID for each in parts.values()) else parts

    def examples(self) -> str:
        """Return the end of a sentence: the keys that it needs, or some that it may have."""
        needed = [name for name, key in self.keys.items() if key.default is REQUIRED]
        some = sorted(self.keys)[:_FEW_KEYS]
        return f" of {', '.join(needed)}" if needed else f" of keys such as {', '.join(some)}"

    def parts(self, value: dict[str, Any], place: Place, partial: bool = False) -> dict[str, Any]:
        """The value of each key as it is checked, INVALID where it is wrong."""
        result: dict[str, Any] = {}
        for name, each in value.items():
            at = place.child(name)
            if name in self.keys:
                inner = replace(at, around=self.keys)
                result[name] = self.keys[name].type.check(each, inner, partial)
            else:
                result |= {name: INVALID, **self._refuse(name, place, value)}
        for name, key in self.keys.items() if not partial else ():
            if name in result:
                continue
            if key.default is not REQUIRED:
                result[name] = key.default
            elif closest(name, [each for each in value if each not in self.keys], 1):
                result[name] = INVALID  # misspelt, so not missing, too
            else:
                result[name] = place.child(name).fail(f"missing, expects {expected(key.type)}")
        return result

    def _refuse(self, name: str, place: Place, value: dict[str, Any]) -> dict[str, Any]:
        """Tell of a key that there is not; the value of the key that replaced it, if one did."""
        from featherfx.groom.keys.renamed import explain_old_key  # for wrong files alone

        at = place.child(name)
        if old := explain_old_key(at.key, self.keys):
            at.fail(old.message)
            replacing = self.keys.get(old.new)
            if replacing is None or old.new in value:
                return {}
            is_required = replacing.default is REQUIRED
            return {old.new: INVALID if is_required else replacing.default}
        if meant := self._meant(name, value):
            at.fail(f"unknown key, did you mean '{meant}'?")
            return {meant: INVALID}
        below, around = (_keys_below(each, name) for each in (self.keys, place.around))
        if around and not below and not at.problems.closest(name, list(self.keys)):
            below = around
        near = at.problems.closest(
            name, [*self.keys, *{name for own in _tables_among(self.keys).values() for name in own}]
        )
        at.unknown_key(self.keys, below, _keys_below(self.keys, near) if near else [])
        return {}

    def _meant(self, name: str, value: dict[str, Any]) -> str:
        """Return the key that an unknown one stands for, where it is no near name; "" for none.

        That is one of SYNONYMS, or the one key that is missing, if the value fits it.
        """
        from featherfx.groom.keys.renamed import SYNONYMS

        if (known := SYNONYMS.get(name, "")) in self.keys and known not in value:
            return known
        lacking = [
            each for each, key in self.keys.items() if key.default is REQUIRED and each not in value
        ]
        unknown = (each for each in value if each not in self.keys)
        if [*islice(unknown, 2)] != [name] or len(lacking) != 1:
            return ""
        if closest(name, list(self.keys), 1) or _keys_below(self.keys, name):
            return ""
        at = Place("", lacking[0], Problems())
        fits = self.keys[lacking[0]].type.check(value[name], at, False) is not INVALID
        return lacking[0] if fits else ""

    def describe(self) -> tuple[str, str, str]:
        return self.title, "", ""

    def schema(self, partial: bool) -> JsonSchema:
        required = [name for name, key in self.keys.items() if key.default is REQUIRED]
        return {
            "type": "object",
            "properties": {name: key.schema(partial) for name, key in self.keys.items()},
            "additionalProperties": False,
        } | ({"required": required} if required and not partial else {})


@dataclass(frozen=True)
class Tables:
    """Tables of which each stands by itself, as [[row]] in a file: a wrong one leaves the others.

    When checked, the places and tables that are sound. single: whether one may stand without array.
    """

    table: Table
    most: int = 10_000
    single: bool = False

    def check(self, value: Any, place: Place, partial: bool) -> list[tuple[Place, Any]]:
        if self.single and isinstance(value, dict):
            found = [(place, self.table.check(value, place, partial))]
        elif self.single and not isinstance(value, list):
            place.fail(f"{shown(value)} is not allowed here, expects {self.describe()[0]}")
            return []
        elif isinstance(value, dict):
            place.fail(f"is one table. Write [[{place.key}]] with two brackets")
            return []
        elif not isinstance(value, list) or len(value) > self.most:
            ArrayOf(self.table, 0, self.most).check(value, place, partial)
            return []
        else:
            places = [place.item(index) for index in range(len(value))]
            found = [
                (at, self.table.check(each, at, False))
                for at, each in zip(places, value, strict=True)
            ]
        return [(at, table) for at, table in found if table is not INVALID]

    def describe(self) -> tuple[str, str, str]:
        several = f"array of 0 to {self.most} tables"
        return f"{several} or table" if self.single else several, "", ""

    def schema(self, partial: bool) -> JsonSchema:
        several = ArrayOf(self.table, 0, self.most).schema(partial)
        return one_of_types(several, self.table.schema(partial)) if self.single else several


def _tables_among(keys: Mapping[str, Key]) -> dict[str, Mapping[str, Key]]:
    """Return the keys of tables among some keys."""
    return {key: getattr(whole_type(each.type), "keys", {}) for key, each in keys.items()}


def _keys_below(keys: Mapping[str, Key], name: str) -> list[str]:
    """Return the dotted keys of tables among some keys that end with a name."""
    return [f"{key}.{name}" for key, own in _tables_among(keys).items() if name in own]


def whole_type(kind: ValueType) -> ValueType:
    """Return the type of which a value may be a part."""
    return kind.table if isinstance(kind, Partial) else kind


def tables(keys: Mapping[str, Key], meaning: str, **limits: Any) -> Key:
    """A key of any number of tables. limits: other fields of Tables."""
    return Key(Tables(Table(keys), **limits), meaning, ())


@dataclass(frozen=True)
class Partial:
    """A table of which any keys may be left out, without defaults taking their place."""

    table: Table

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        return self.table.check(value, place, True)

    def describe(self) -> tuple[str, str, str]:
        return self.table.describe()

    def schema(self, partial: bool) -> JsonSchema:
        return self.table.schema(True)


def expected(kind: ValueType) -> str:
    """A type with its unit and range in one phrase."""
    name, unit, allowed = kind.describe()
    article = "an" if name[0] in "aeiou" else "a"
    tail = " ".join(part for part in (allowed, unit) if part)
    name += kind.examples() if name == "table" and isinstance(kind, Table) else ""
    return f"{article} {name}, {tail}" if tail else f"{article} {name}"
