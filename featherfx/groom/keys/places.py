"""Values that name something else: points of a skin, and presets of a family.

Points, directions and lengths in the space of a groom are numbers, or landmarks of its skin. Their
types say where in the tables they stand, so that `featherfx/groom/read/space.py` finds them all and
turns them into metres of the groom's frame. A preset is a name, or a table that extends one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from typing import Any

from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.keys.values import (
    REQUIRED,
    ArrayOf,
    Either,
    JsonSchema,
    Key,
    Number,
    Table,
    Text,
    ValueType,
    one_of_types,
    shown,
    vector,
    whole_type,
)
from featherfx.limits import MAX_PATTERNS

_COORDINATE = Number(-1e4, 1e4, "m")


@dataclass(frozen=True)
class Direction:
    """Three numbers that are not all zero; a unit vector when checked."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        numbers = _DIRECTION.check(value, place, partial)
        if numbers is INVALID:
            return INVALID
        norm = math.hypot(*numbers)
        if norm < 1e-9:
            return place.fail("a direction cannot be zero. Give a vector with a length")
        return tuple(each / norm for each in numbers)

    def describe(self) -> tuple[str, str, str]:
        return "array of 3 numbers", "", "not zero; made a unit vector"

    def schema(self, partial: bool) -> JsonSchema:
        return _DIRECTION.schema(partial) | {"not": {"items": {"enum": [0]}}}


_DIRECTION = vector(-1e6, 1e6, "")


@dataclass(frozen=True)
class Length(Number):
    """A length along the skin's space, as opposed to the size of a feather, which is in metres."""


RADIUS_LENGTH = Length(0, 1e4, "m")

_LANDMARK_KEYS = {
    "vertex": Key(Number(0, 2**31 - 1, whole=True), "Point of the skin by its number.", None),
    "joint": Key(
        Text(), "Joint of the skin's skeleton, by path or last name, in the bind pose.", None
    ),
    "primvar": Key(
        Text(), "Scalar primvar of the skin: the middle of where it is, by how much it is.", None
    ),
    "offset": Key(
        vector(-1e4, 1e4, "m"), "Added to it, along the axes of the space.", (0.0, 0.0, 0.0)
    ),
    "prim": Key(Text(), "Path of the mesh; default: that of [skin].", None),
}


@dataclass(frozen=True)
class Point:
    """Three coordinates, or a table that names a landmark."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        return _POINT.check(value, place, partial)

    def describe(self) -> tuple[str, str, str]:
        return _POINT.describe()

    def schema(self, partial: bool) -> JsonSchema:
        return _POINT.schema(partial)


_POINT = Either(
    {list: ArrayOf(_COORDINATE, 3, 3), dict: Table(_LANDMARK_KEYS, "table of a landmark")}
)


@dataclass(frozen=True)
class Sphere:
    """Centre and radius: four numbers, or a table; a table when checked."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        found = _SPHERE.check(value, place, partial)
        if isinstance(found, tuple):
            return {"centre": found[:3], "radius": found[3]}
        return found

    def describe(self) -> tuple[str, str, str]:
        return _SPHERE.describe()

    def schema(self, partial: bool) -> JsonSchema:
        return _SPHERE.schema(partial)


POINT = Point()
SPHERE_TABLE = Table(
    {"centre": Key(POINT, "Centre."), "radius": Key(RADIUS_LENGTH, "Radius.")}, "table of a sphere"
)
_SPHERE = Either({list: ArrayOf(_COORDINATE, 4, 4), dict: SPHERE_TABLE})

SPACE_KEYS = {
    "of": Key(
        Text(("groom", "stage", "skin", "body")),
        "What the groom's points, directions, boxes, spheres, ranges and planes of mirrors are in. "
        "groom: metres, x forward, y to the left, z up. stage: units and axes of the skin's file. "
        "skin: those of the skin's own prim at rest, its transforms left out. body: the skin's own "
        "axes, from the middle of its box at rest, in lengths of the box's diagonal. Sizes of "
        "feathers are in metres in all of them.",
        "groom",
    ),
    "left": Key(
        Text(("x", "y", "z", "-x", "-y", "-z")),
        "Axis of that space that points to the body's left; needed where it is not the groom's.",
        None,
    ),
}


_BASE = Key(
    Text(),
    "Preset of the same family that this one starts from. In a user's folder, a preset that "
    "names itself extends the shipped one.",
    None,
)


@dataclass(frozen=True)
class Preset:
    """A preset of a family by its name, or a table that extends one: a table with `base`, checked.

    keys: of the family. kinds: where a preset has a `kind`, the keys of each, which are no other
    kind's.
    """

    family: str
    keys: Mapping[str, Key]
    kinds: Mapping[str, Mapping[str, Key]] = field(default_factory=dict)

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if isinstance(value, str):
            value = {"base": value}
        if not isinstance(value, dict | list):
            told = "Give its name in quotes, or a table that extends one"
            return place.fail(f"{shown(value)} is not a {self.family} preset. {told}")
        return self.extended.check(value, place, True)

    def describe(self) -> tuple[str, str, str]:
        return f"name of a {self.family} preset, or a table that extends one", "", ""

    @cached_property
    def extended(self) -> Table:
        """The table of a preset file: the keys and `base`, of which any may be left out."""
        return Table({"base": _BASE, **self.keys}, f"{self.family} preset")

    def finished(self, kind: str = "") -> Table:
        """The keys that a preset must have once it is merged with its bases."""
        if kind in self.kinds:
            return Table(self.kinds[kind], f"{self.family} of kind {kind}")
        return Table(self.keys, f"{self.family} preset")

    def schema(self, partial: bool) -> JsonSchema:
        parts = [self.reference()] if partial else [self.reference(), self.complete()]
        return one_of_types(Text().schema(partial), {"type": "object", "allOf": parts})

    @property
    def name(self) -> str:
        """The family's name without slashes."""
        return self.family.replace("/", "_")

    def reference(self) -> JsonSchema:
        """JSON Schema that refers to the definition."""
        return {"$ref": f"#/$defs/{self.name}"}

    def definition(self) -> JsonSchema:
        """JSON Schema of a preset file that may lack any key, to refer to by the family's name."""
        result = self.extended.schema(True) | {"title": f"{self.family} preset"}
        del result["type"]  # a name may stand for the table
        if self.kinds:
            kinds = [self._only(kind) for kind in self.kinds]
            result["anyOf"] = [{"not": {"required": ["kind"]}}, *kinds]
        return result

    def _only(self, kind: str) -> JsonSchema:
        names: JsonSchema = {name: {} for name in ("base", *self.kinds[kind])}
        return {"properties": names | {"kind": {"enum": [kind]}}, "additionalProperties": False}

    def complete(self) -> JsonSchema:
        """JSON Schema of what a preset file must hold besides: a base, or all without default."""
        kinds = [
            {"properties": {"kind": {"enum": [kind]}}} | _needed(self.finished(kind))
            for kind in self.kinds
        ]
        return {"anyOf": [{"required": ["base"]}, *(kinds or [_needed(self.finished())])]}


@dataclass(frozen=True)
class PartPreset:
    """A preset in an array of them; what it must hold is judged where the array is read."""

    preset: Preset

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        return self.preset.check(value, place, partial)

    def describe(self) -> tuple[str, str, str]:
        return self.preset.describe()

    def schema(self, partial: bool) -> JsonSchema:
        return self.preset.schema(True)


def _needed(table: Table) -> JsonSchema:
    """JSON Schema that asks for a table's keys without default, and no more."""
    result: JsonSchema = {
        "required": [name for name, key in table.keys.items() if key.default is REQUIRED]
    }
    within: dict[str, JsonSchema] = {}
    for name, key in table.keys.items():
        if isinstance(key.type, Table):
            within[name] = _needed(key.type)
        elif isinstance(key.type, Preset):
            within[name] = key.type.complete()
    return result | ({"properties": within} if within else {})


@dataclass(frozen=True)
class TextsByName:
    """A table of texts whose names are free."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        if not isinstance(value, dict):
            return place.fail(f"{shown(value)} is not a table of texts")
        found = {name: Text().check(each, place.child(name), False) for name, each in value.items()}
        return INVALID if any(each is INVALID for each in found.values()) else found

    def describe(self) -> tuple[str, str, str]:
        return "table of texts", "", ""

    def schema(self, partial: bool) -> JsonSchema:
        return {"type": "object", "additionalProperties": Text().schema(False)}


class LazyKeys(Mapping[str, Key]):
    """Keys of a table that another module declares; they are imported on first use."""

    def __init__(self, module: str, name: str):
        self._home = module, name

    @cached_property
    def _keys(self) -> Mapping[str, Key]:
        module, name = self._home
        found: Mapping[str, Key] = getattr(import_module(module), name)
        return found

    def __getitem__(self, name: str) -> Key:
        return self._keys[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)


@dataclass(frozen=True)
class Named:
    """A table whose keys are free names and whose values are all of one type.

    When checked, those that are sound: a wrong one leaves the others.
    """

    item: ValueType

    def check(self, value: Any, place: Place, partial: bool) -> dict[str, Any]:
        if not isinstance(value, dict):
            place.fail(f"{shown(value)} is not a table")
            return {}
        if len(value) > MAX_PATTERNS:
            place.fail(f"has {len(value)} keys. Give at most {MAX_PATTERNS}")
            return {}
        result = {}
        for name, each in value.items():
            at = place.child(f'"{name}"')
            if not isinstance(each, dict) and name in getattr(whole_type(self.item), "keys", {}):
                told = f'Write [{place.key}."NAME"] above it, with a name or pattern'
                result[name] = at.fail(f"stands below no name. {told} such as *")
            else:
                result[name] = self.item.check(each, at, partial)
        return {name: each for name, each in result.items() if each is not INVALID}

    def describe(self) -> tuple[str, str, str]:
        return "table", "", ""

    def schema(self, partial: bool) -> JsonSchema:
        return {"type": "object", "additionalProperties": self.item.schema(partial)}


def the_one(names: Sequence[str], table: dict[str, Any], place: Place) -> str:
    """Return the only one of some keys in a checked table. Raises InputError unless it is one."""
    given = [name for name in names if table[name] is not None]
    if len(given) != 1:
        place.refuse(f"holds {' and '.join(given) or 'none'}, expects one of {', '.join(names)}")
    return given[0]


def names_or_list(item: ValueType, most: int) -> Either:
    """One text, or an array of them."""
    return Either({str: Text(), list: ArrayOf(item, 1, most)})
