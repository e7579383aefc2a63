"""Scenes as tables, each key of them changed within its range, and what a bake shows of it."""

import hashlib
import json
import re
import warnings
from copy import deepcopy

import featherfx
from featherfx.errors import InputError, SimulationError
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.places import (
    _POINT,
    SPHERE_TABLE,
    Named,
    PartPreset,
    Point,
    Preset,
    Sphere,
)
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.values import (
    REQUIRED,
    ArrayOf,
    Either,
    Flag,
    Number,
    Partial,
    Table,
    Tables,
    Text,
)
from featherfx.shot.read.keys import SHOT_FILE

# what the program notes about a cache beside its prims: keys are copied there as they are
_NOTES = re.compile(r"    customLayerData = \{.*?\n    \}\n", re.DOTALL)


def declared_keys():
    """Path of every declared key, of grooms, shots and presets, by its name and meaning."""
    kinds = [(GROOM_FILE, "groom"), (SHOT_FILE, "shot")]
    kinds += [(each, each.family.replace("/", "_")) for each in PRESET_FAMILIES.values()]
    found, seen = {}, set()
    while kinds:
        kind, path = kinds.pop(0)
        tables = list(_tables(kind))
        for keys in tables:
            if id(keys) not in seen:
                seen.add(id(keys))
                for name, key in keys.items():
                    found.setdefault((name, key.meaning), f"{path}.{name}")
                    kinds.append((key.type, f"{path}.{name}"))
        if not tables:
            kinds += [(part, path) for part in _parts(kind)]
    return found


def _tables(kind):
    """The tables of keys of a type itself."""
    if isinstance(kind, Table):
        yield kind.keys
    elif isinstance(kind, PartPreset | Preset):
        preset = getattr(kind, "preset", kind)
        yield from preset.kinds.values() or [preset.keys]
    elif isinstance(kind, Point):
        yield _POINT.options[dict].keys
    elif isinstance(kind, Sphere):
        yield SPHERE_TABLE.keys


def _parts(kind):
    """The types within a type that is no table."""
    if isinstance(kind, Tables | Partial):
        return [kind.table]
    if isinstance(kind, Named | ArrayOf):
        return [kind.item]
    return list(kind.options.values()) if isinstance(kind, Either) else []


def keys_in(kind, raw, path=()):
    """(path, key) of every declared key of the tables that a value holds."""
    if isinstance(raw, dict) and not isinstance(kind, Named):
        kind = kind.table if isinstance(kind, Partial | Tables) else kind
        kind = kind.options[dict] if isinstance(kind, Either) else kind
        tables = list(_tables(kind))
        if isinstance(kind, PartPreset | Preset):
            preset = getattr(kind, "preset", kind)
            tables = [preset.kinds[raw["kind"]] if "kind" in raw else preset.keys]
        for name, key in tables[0].items():
            yield (*path, name), key
            if name in raw:
                yield from keys_in(key.type, raw[name], (*path, name))
    elif isinstance(raw, dict):
        for name, value in raw.items():
            yield from keys_in(kind.item, value, (*path, name))
    elif isinstance(raw, list) and not isinstance(kind, Point | Sphere):
        kind = kind.options.get(list) if isinstance(kind, Either) else kind
        for number, value in enumerate(raw):
            if isinstance(value, dict):
                part = kind.table if isinstance(kind, Tables) else kind.item
                yield from keys_in(part, value, (*path, number))


def value_at(raw, path, default):
    """The value that a file has for a key, or its default."""
    for part in path:
        if isinstance(raw, dict) and part not in raw:
            return None if default is REQUIRED else default
        raw = raw[part]
    return raw


def with_value(raw, path, value):
    """The same file with another value."""
    result = deepcopy(raw)
    holder = result
    for part in path[:-1]:
        holder = holder[part]
    holder[path[-1]] = value
    return result


def other_values(kind, value):
    """Values of a type that differ from one, the likeliest to show first."""
    if isinstance(kind, Either):
        kind = kind.options.get(type(value), kind)
    if isinstance(kind, Number):
        yield from _other_numbers(kind, value)
    elif isinstance(kind, Flag):
        yield not value
    elif isinstance(kind, Text):
        yield from (each for each in kind.choices if each != value)
    elif isinstance(kind, ArrayOf) and isinstance(value, list | tuple) and value:
        for k, part in enumerate(value):
            for other in list(other_values(kind.item, part))[:3]:
                yield [*value[:k], other, *value[k + 1 :]]
        if len(value) > kind.least:
            yield list(value[:-1])
    elif isinstance(kind, ArrayOf) and isinstance(kind.item, Number) and kind.least:
        yield [next(other_values(kind.item, None))] * kind.least
    elif isinstance(value, list) and value and isinstance(value[0], int | float):
        # points and directions
        yield [value[0] + 0.1 * (value[0] or 1.0), *value[1:]]
        yield [*value[:-1], value[-1] + 0.3]


def _other_numbers(kind, value):
    low, high = kind.low, kind.high
    if kind.whole:
        near = [value + 1, value + 3, value - 1, value - 2] if value is not None else [1, 2, 3]
    elif value:
        near = [1.6 * value, 0.4 * value, low, high]
    else:
        span = min(high, 1e3) - max(low, 0.0)
        near = [max(low, 0.0) + share * span for share in (0.5, 0.05, 0.003)]
    yield from dict.fromkeys(each for each in near if low <= each <= high and each != value)


def toml(raw):
    """A table as a TOML file."""
    return "".join(f"{name} = {_text(value)}\n" for name, value in raw.items())


def _text(value):
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    return json.dumps(value)


def bake(folder, groom, shot, **options):
    """What a bake writes and warns of, as a digest; None where its input is refused."""
    (folder / "groom.toml").write_text(toml(groom))
    (folder / "shot.toml").write_text(toml(shot))
    output = folder / "out.usda"
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            featherfx.bake(folder / "shot.toml", output, jobs=1, overwrite=True, **options)
        except (InputError, SimulationError):
            return None
    text = _NOTES.sub("", output.read_text()) + "".join(
        sorted({str(each.message) for each in told})
    )
    return hashlib.sha256(text.encode()).hexdigest()
