"""The JSON Schemas judge files as the reader does."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from commands import invoke
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from places import ROOT

from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.places import Named, Preset
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import (
    ArrayOf,
    Either,
    Number,
    Partial,
    Table,
    Tables,
    Text,
    ValueType,
)
from featherfx.shot.read.keys import SHOT_FILE
from featherfx.shot.read.read import check_file
from featherfx.shot.read.reference import schema

FILES = [*sorted((ROOT / "samples").glob("*/*.toml")), *sorted((ROOT / "presets").rglob("*.toml"))]


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def family_of(path: Path) -> str:
    """Family of a preset; empty for a sample."""
    folder = path.relative_to(ROOT).parent
    return folder.relative_to("presets").as_posix() if folder.parts[0] == "presets" else ""


def validator_of(path: Path) -> Draft202012Validator:
    family = family_of(path)
    is_flock = not family and "flock" in tomllib.loads(path.read_text())
    kind = "flock" if is_flock else "groom" if path.stem == "groom" else "shot"
    kind = "preset" if family else kind
    return Draft202012Validator(schema(kind, family))


@pytest.mark.parametrize("path", FILES, ids=name_of)
def test_samples_and_presets_are_valid(path: Path) -> None:
    raw = tomllib.loads(path.read_text())
    assert [error.message for error in validator_of(path).iter_errors(raw)] == []
    if family_of(path):
        assert Draft202012Validator(schema("preset")).is_valid(raw)


@pytest.mark.parametrize("kind", ["groom", "shot", "flock", "preset"])
def test_command_prints_a_schema_with_meanings_units_and_ranges(kind: str) -> None:
    result = invoke("schema", kind)
    assert result.exit_code == 0
    printed = json.loads(result.stdout)
    Draft202012Validator.check_schema(printed)
    assert printed["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    length = schema("preset", "feather")["$defs"]["feather"]["properties"]["length"]
    assert length == {
        "type": "number",
        "minimum": 1e-3,
        "maximum": 5,
        "description": "Arc length of the rachis with the calamus. Unit: m.",
    }


def test_command_takes_a_family_of_presets_alone() -> None:
    printed = json.loads(invoke("schema", "preset", "--family", "wind").stdout)
    assert Draft202012Validator(printed).is_valid({"speed": 3.0})
    assert not Draft202012Validator(printed).is_valid({"gust": 0.1})
    wrong = invoke("schema", "preset", "--family", "wnd")
    assert wrong.exit_code == 2
    assert "'wnd' is none of feather, material/vane," in wrong.stderr
    assert invoke("schema", "shot", "--family", "wind").exit_code == 2


def changed(raw: Any, path: tuple[Any, ...]) -> Iterator[tuple[str, str, Any]]:
    """(what was done, key, file) with one key unknown, lost, of a wrong type or out of range."""
    value = raw
    for step in path:
        value = value[step]
    if isinstance(value, dict):
        yield "unknown", dotted(*path, "colour"), with_value(raw, (*path, "colour"), 1)
        for key in value:
            yield "lost", dotted(*path, key), without(raw, (*path, key))
    else:
        wrong = "text" if isinstance(value, int | float) and value is not True else 3.5
        yield "type", dotted(*path), with_value(raw, path, wrong)
        if isinstance(value, int | float) and not isinstance(value, bool):
            beyond = 10**16 if isinstance(value, int) else 1e16
            yield "range", dotted(*path), with_value(raw, path, beyond)
    if isinstance(value, dict | list):
        for item in value if isinstance(value, dict) else range(min(len(value), 2)):
            yield from changed(raw, (*path, item))


def dotted(*path: Any) -> str:
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in path).removeprefix(".")


def with_value(raw: Any, path: tuple[Any, ...], value: Any) -> Any:
    result = deepcopy(raw)
    holder = result
    for step in path[:-1]:
        holder = holder[step]
    holder[path[-1]] = value
    return result


def without(raw: Any, path: tuple[Any, ...]) -> Any:
    result = with_value(raw, path, None)
    holder = result
    for step in path[:-1]:
        holder = holder[step]
    del holder[path[-1]]
    return result


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


GROOM = """
name = "groom"
[[joint]]
name = "left_hip"
position = [0, 0, 0]
mirror = "y"
[[feather]]
id = "tail"
kind = "tail_feather"
position = [0, 0, 0]
rotation = [0, 10, 0]
overrides = { rachis.camber = 5, vane_material = { base = "swan_vane", thickness = 1e-4 } }
[[row]]
id = "primary"
kind = ["swan_primary", "swan_secondary"]
count = 2
scale = [1, 0.5]
first = { position = [0, -1, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
last = { position = [0, -2, 0], direction = [-1, 0, 0], up = [0, 0, 1] }
[overrides]
"primary_*" = { calamus = 0.2, roll = 3, vane_material = "plume_vane" }
[variation]
seed = 3
length = 0.1
"""
SHOT = """
name = "shot"
groom = "groom.toml"
frames = [1, 5]
gravity = [0, 0, -1]
sleep = false
quality = "draft"
[motion]
kind = "keys"
keyframes = [{ time = 0, position = [0, 0, 0] }, { time = 1.5, rotation = [0, 1, 0] }]
[wind]
base = "breeze"
direction = [0, 1, 0]
[contact]
friction = 0.2
[[grip]]
feather = "tail"
row = 1
displacement = [0, 0, 1]
end = 1
stiffness = 100
[[force]]
feather = "tail"
force = [0, 0, 1]
keys = [[0, 1], [1, 0]]
[[detail]]
level = "full"
[[shelter]]
share = 0.5
"""
PRESETS = [each for each in FILES if family_of(each)]


def judged_alike(file: Path, raw: dict[str, Any], validator: Draft202012Validator) -> None:
    """Whether reader and schema agree on a file and all changes of it. file: where to write."""
    assert validator.is_valid(raw)
    for what, path, mutated in changed(raw, ()):
        file.write_text("".join(f"{json.dumps(k)} = {toml(v)}\n" for k, v in mutated.items()))
        problems = check_file(file)
        if what == "lost":
            problems = [each for each in problems if each.message.startswith("missing, expects")]
        assert validator.is_valid(mutated) == (not problems), (what, mutated, problems)
        # told by its key, or that of the value that it is a part of
        keys = [each.key.replace('"', "") for each in problems if what != "lost"]
        assert not keys or any(path.startswith(key) for key in keys if key), (what, path, keys)


@pytest.mark.parametrize("path", {family_of(each): each for each in PRESETS}.values(), ids=name_of)
def test_schema_and_reader_judge_changed_presets_alike(path: Path, tmp_path: Path) -> None:
    folder = tmp_path / family_of(path)
    folder.mkdir(parents=True)
    judged_alike(folder / path.name, tomllib.loads(path.read_text()), validator_of(path))


@pytest.mark.parametrize(("name", "text"), [("groom", GROOM), ("shot", SHOT)])
def test_schema_and_reader_judge_changed_files_alike(name: str, text: str, tmp_path: Path) -> None:
    (tmp_path / "groom.toml").write_text(GROOM[: GROOM.index("overrides")])
    file = tmp_path / f"{name}.toml"
    file.write_text(text)
    assert check_file(file) == []
    judged_alike(file, tomllib.loads(text), Draft202012Validator(schema(name)))


def value_types() -> dict[str, list[ValueType]]:
    """Every type of value that a file may hold, each once, by its class."""
    found: dict[str, ValueType] = {}
    left: list[ValueType] = [SHOT_FILE, GROOM_FILE, *PRESET_FAMILIES.values()]
    while left:
        each = left.pop()
        if repr(each) in found:
            continue
        found[repr(each)] = each
        if isinstance(each, Table | Preset):
            left += [key.type for key in each.keys.values()]
        elif isinstance(each, ArrayOf | Named):
            left.append(each.item)
        elif isinstance(each, Either):
            left += each.options.values()
        elif isinstance(each, Partial | Tables):
            left.append(each.table)
    by_class: dict[str, list[ValueType]] = {}
    for kind in found.values():
        by_class.setdefault(type(kind).__name__, []).append(kind)
    return by_class


# a float without a fraction is an integer to JSON Schema, and none to TOML
NUMBERS = st.integers() | st.floats(allow_nan=False).filter(lambda x: not x.is_integer())
VALUES = st.recursive(
    NUMBERS | st.booleans() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=6,
)


def around(kind: Number) -> list[float]:
    """Bounds of a number, and what lies just beyond them."""
    step = 1 if kind.whole else 1e-3 * (kind.high - kind.low)
    return [kind.low, kind.high, kind.low - step, kind.high + step]


def near(kind: ValueType) -> st.SearchStrategy[Any]:
    """Values of about the kind, good ones and bad."""
    if isinstance(kind, Number):
        within = st.floats(kind.low, kind.high)
        return st.sampled_from(around(kind)) | (within.map(round) if kind.whole else within)
    if isinstance(kind, Text):
        return st.sampled_from(["", "a", *kind.choices])
    if isinstance(kind, ArrayOf):
        return st.lists(near(kind.item), min_size=max(kind.least - 1, 0), max_size=kind.least + 1)
    if isinstance(kind, Either):
        return st.one_of([near(each) for each in kind.options.values()])
    if isinstance(kind, Partial):
        return near(kind.table)
    if isinstance(kind, Preset):
        keys = {name: key for name, key in kind.extended.keys.items() if name != "kind"}
        return st.just("a") | near(Table(keys))
    if isinstance(kind, Table):
        names = st.lists(st.sampled_from(sorted(kind.keys)), max_size=3, unique=True)
        return names.flatmap(
            lambda some: st.fixed_dictionaries({name: near(kind.keys[name].type) for name in some})
        )
    return VALUES


DEFINED = {"$defs": {each.name: each.definition() for each in PRESET_FAMILIES.values()}}


@pytest.mark.parametrize("kinds", value_types().values(), ids=value_types())
def test_schema_of_every_type_accepts_what_its_check_accepts(kinds: list[ValueType]) -> None:
    for kind in kinds:
        judged_alike = judge_of(kind)
        if isinstance(kind, Number):
            for value in (*around(kind), True, "1", [], {}, [1], {"a": 1}, 0.5, -7, 3):
                judged_alike(value)
        else:
            drawn = given(near(kind) | VALUES)(judged_alike)
            settings(max_examples=10, deadline=None)(drawn)()


def judge_of(kind: ValueType) -> Callable[[Any], None]:
    validator = Draft202012Validator(DEFINED | kind.schema(True))

    def judged_alike(value: Any) -> None:
        # what a preset must hold besides is judged where files are read
        problems = Problems()
        kind.check(value, Place("", "", problems), True)
        assert validator.is_valid(value) == (not len(problems)), (kind, value)

    return judged_alike


def test_a_wrong_value_is_told_by_itself() -> None:
    """Not as a whole table that fits none of several: editors show the message as it is."""
    raw = tomllib.loads(SHOT) | {"quality": {"base": "final", "rows": 2}, "wind": ""}
    errors = {
        error.json_path: error for error in Draft202012Validator(schema("shot")).iter_errors(raw)
    }
    assert errors.keys() == {"$.quality.rows", "$.wind"}
    assert "2 is less than the minimum of 3" in errors["$.quality.rows"].message
