"""Presets of a family as values of keys: a name, or a table that extends one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from featherfx.groom.keys.problems import Place
from featherfx.groom.keys.values import REQUIRED, JsonSchema, Key, Table, Text, one_of_types, shown

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
