"""Reference of what users name: docs/reference.md of all keys, JSON Schemas, and presets.

    python -m featherfx.shot.read.reference > docs/reference.md

A JSON Schema of shots, grooms or presets judges keys, types and ranges as the reader does. What
depends on other keys (the end of a grip after its start), on other files, or on what a `base`
holds, `featherfx check` alone finds."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

from featherfx import limits
from featherfx.groom.keys import groom as groom_keys
from featherfx.groom.keys import plumage as plumage_keys
from featherfx.groom.keys import preset as preset_keys
from featherfx.groom.keys.anatomy import (
    CovertRow,
    CrestOfBird,
    FlightRow,
    PartOfBody,
    TailCovertRow,
    TailOfBird,
)
from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.places import Preset
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.problems import Problems
from featherfx.groom.keys.values import REQUIRED, Either, JsonSchema, Key, Table, Tables, keys_of
from featherfx.groom.materials import BarbLook, Colour, Pattern, Profile
from featherfx.groom.presets.library import Library, Sourced, Tree, plain
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.read.toml_text import toml_of
from featherfx.groom.types import GUIDE_KEYS, RACHIS_KEYS, Hooked, Splits, VaneShape
from featherfx.shot.flock import FLOCK_FILE, FLOCK_KEYS
from featherfx.shot.read import keys as shot_keys
from featherfx.shot.read.keys import SHOT_FILE

_HEAD = """# Reference: every key of shots, grooms and presets

This page is generated from the declarations that check the files
(`python -m featherfx.shot.read.reference`), so what it says is what is enforced. Units are SI;
angles are in degrees. The groom's frame has x forward, y to the left and z up. A key whose default
is *required* must be given. `featherfx check FILE` prints all problems of a file at once.

A key that takes a preset takes its name (`wind = "breeze"`) or a table that starts from it and
changes some values (`wind = { base = "breeze", gust = 0.4 }`).

`featherfx schema groom|shot|preset` prints the same declarations as a JSON Schema, by which editors
complete, explain and check the files. Even Better TOML (VS Code) and other editors that use Taplo
take the schema that a file's first line names: `featherfx schema shot > shot.schema.json`, then
`#:schema ./shot.schema.json` at the top of the shot. A preset does not say of which family it is:
`featherfx schema preset --family feather` checks it as one of them, else as any.

A feather's own frame: x leaves the follicle along the rachis, y points to the leading vane, z is
dorsal. With x forward and z up this is a feather of the right wing; feathers with
`side = "left"` are its mirror image, with the leading vane at -y.
"""

_PRESETS = """## Presets

A preset is a file `FAMILY/NAME.toml`. Folders are searched in this order, and the first that holds
the name wins: folders given to the command, those in the environment variable
`FEATHERFX_PRESETS`, `~/.config/featherfx/presets`, and the presets shipped with featherfx.
`base = "NAME"` starts from another preset of the same family; a preset in a folder of your own
whose `base` is its own name extends the shipped one. A table within a preset is merged key by key,
an array is replaced as a whole, and a table that names a `base` replaces what it covers.
`featherfx presets show NAME` prints the merged values and the file that each came from.
"""


def _headed(keys: Mapping[str, Key]) -> Iterator[tuple[str, Mapping[str, Key]]]:
    """The tables that keys take."""
    for name, key in keys.items():
        if isinstance(key.type, Table):
            yield f"### [{name}]", key.type.keys
        elif isinstance(key.type, Tables):
            yield f"### [[{name}]]", key.type.table.keys


_SHOT = (
    ("## Shot file", shot_keys.SHOT),
    ("### [groom] of a shot", shot_keys.GROOM_USD),
    *_headed(shot_keys.SHOT),
)
_FLOCK = (("## Flock file", FLOCK_KEYS), *_headed(FLOCK_KEYS))
_GROOM = (
    ("## Groom file", groom_keys.GROOM_KEYS),
    ("### [[joint]]", groom_keys.JOINT_KEYS),
    ("### [[feather]]", groom_keys.FEATHER_ENTRY_KEYS),
    ("### [[row]]", groom_keys.ROW_KEYS),
    ("### first and last of a [[row]]", groom_keys.ROOT_KEYS),
    ("### [bird]", plumage_keys.BIRD_KEYS),
    ("### [bird.landmarks]", plumage_keys.LANDMARK_KEYS),
    ("### [[wing]]", plumage_keys.WING_KEYS),
    ("### [[tail]]", plumage_keys.TAIL_KEYS),
    ("### [[crest]]", plumage_keys.CREST_KEYS),
    ("### [[table]]", groom_keys.TABLE_KEYS),
    ("### [[usd]]", groom_keys.USD_KEYS),
    ("### names of [[usd]]", groom_keys.USD_NAME_KEYS),
    ("### [skin] of a groom", plumage_keys.SKIN_KEYS),
    ("### [[region]]", plumage_keys.REGION_KEYS),
    ("### kind of a [[region]]", plumage_keys.REGION_KIND_KEYS),
    ("### where of a [[region]]", plumage_keys.WHERE_KEYS),
    ("### nearest of a where", plumage_keys.NEAREST_KEYS),
    ("### flow of a [[region]]", plumage_keys.FLOW_KEYS),
    ("### variation of a [[region]]", plumage_keys.SPREAD_KEYS),
    ("### [layout]", plumage_keys.LAYOUT_KEYS),
    ("### [variation]", groom_keys.VARIATION_KEYS),
)
_FAMILIES = (
    ("### feather preset", preset_keys.FEATHER_KEYS),
    ("### [rachis] of a feather preset", RACHIS_KEYS),
    ("### [leading] and [trailing] of a feather preset", keys_of(VaneShape)),
    ("### guides of a vane", GUIDE_KEYS),
    ("### [hooked] of a vane", keys_of(Hooked)),
    ("### [splits] of a vane", keys_of(Splits)),
    ("### [colour] of a feather preset", keys_of(Colour)),
    ("### patterns of a colour", keys_of(Pattern)),
    ("### [barbs] of a feather preset", keys_of(BarbLook)),
    *(
        (f"### {family} preset", preset_keys.PRESET_FAMILIES[family].keys)
        for family in ("material/vane", "material/rachis", "quality", "wind")
    ),
    ("### profiles of a vane's material", keys_of(Profile)),
    ("### motion preset", {"kind": preset_keys.MOTION_KIND_KEY} | keys_of(preset_keys.Clock)),
    *(
        (f"### motion of kind {kind}", keys)
        for kind, keys in preset_keys.MOTION_KEYS.items()
        if keys
    ),
    ("### folds of a motion", preset_keys.FOLD_KEYS),
    ("### keyframes of a motion", preset_keys.KEYFRAME_KEYS),
    ("### wing preset", preset_keys.PRESET_FAMILIES["wing"].keys),
    ("### flight feathers of a wing", keys_of(FlightRow)),
    ("### coverts of a wing", keys_of(CovertRow)),
    ("### bird preset", preset_keys.PRESET_FAMILIES["bird"].keys),
    ("### [tail] of a bird", keys_of(TailOfBird)),
    ("### coverts of a tail", keys_of(TailCovertRow)),
    ("### [crest] of a bird", keys_of(CrestOfBird)),
    ("### tracts of a bird", keys_of(PartOfBody)),
)


_LIMITS = (
    (
        "Size of a TOML file",
        f"{limits.MAX_TOML_BYTES / 1e6:g} MB",
        "a [[table]] holds many feathers",
    ),
    ("Tables and arrays within each other", str(limits.MAX_NESTING), ""),
    ("Characters of a text", str(limits.MAX_CHARACTERS), ""),
    ("Presets that extend each other", str(limits.MAX_BASES), "merge some of them"),
    ("Feathers of a groom", str(limits.MAX_FEATHERS), "share them among grooms"),
    (
        "Pairs of feathers that touch, are laid or sheltered, within half a length of each other",
        f"{limits.CROWD_PAIRS}, or {limits.MAX_NEIGHBOURS} neighbours a feather",
        "place them apart",
    ),
    ("Patterns of [overrides]", str(limits.MAX_PATTERNS), ""),
    ("One array of an NPZ file", f"{limits.MAX_ARRAY_BYTES / 1e6:g} MB", "share it among tables"),
    ("Problems told of one file", str(limits.MAX_LISTED), "the others are counted"),
    ("Shapes that `check` builds of a groom", str(limits.MAX_TRIED), "evenly chosen"),
    ("`--jobs`", str(limits.MAX_JOBS), "never more threads than feathers"),
    ("`--render-rows`, `--render-columns`", f"{limits.MAX_ROWS}, {limits.MAX_COLUMNS}", ""),
    ("`--barbs`", str(limits.MAX_BARBS), ""),
    ("`--barbules`", str(limits.MAX_BARBULES), ""),
    ("`--subframes`", str(limits.MAX_SUBFRAMES), ""),
    ("Shares of a bake", str(limits.MAX_SHARES), ""),
    ("Side of a picture", f"{limits.MAX_SIDE} pixels", ""),
    ("Pictures a second of a film", f"{limits.MAX_FILM_RATE}", ""),
    (
        "Layouts, models and the like in the cache folder",
        f"{limits.MAX_KEPT_BYTES / 1e9:g} GB",
        "what was used least lately is removed; `FEATHERFX_CACHE_SIZE`, in GB, sets another limit",
    ),
    (
        "Pixels of all pictures of a call",
        f"{limits.MAX_PIXELS / 1e6:g} million",
        "draw fewer frames at a time",
    ),
    (
        "Memory that a bake, a groom's export or `check` may plan to use",
        "that of the machine",
        f"the environment variable `{limits.MEMORY_VARIABLE}`, in GB, sets another limit",
    ),
    (
        "Address space of a process (`ulimit -v`)",
        f"no less than {limits.MIN_ADDRESS_SPACE / 1e9:g} GB",
        "OpenUSD reserves most of it",
    ),
)


def _limits() -> Iterator[str]:
    yield "## Limits"
    yield ""
    yield (
        "What is beyond is refused before it is read or made. Inputs are regular files; pipes and "
        "devices are refused."
    )
    yield ""
    yield "| what | at most | |"
    yield "|---|---|---|"
    for row in _LIMITS:
        yield "| " + " | ".join(row) + " |"


def reference() -> str:
    """The whole page as Markdown."""
    lines = [_HEAD]
    for parts in (_SHOT, _FLOCK, _GROOM, _FAMILIES):
        lines += [_PRESETS] if parts is _FAMILIES else []
        for title, keys in parts:
            lines += [title, "", *_table(keys)]
    lines += _limits()
    return "\n".join(lines).rstrip() + "\n"


def _table(keys: Mapping[str, Key]) -> Iterator[str]:
    yield "| key | type | unit | default | allowed | meaning |"
    yield "|---|---|---|---|---|---|"
    for name, key in keys.items():
        kind, unit, allowed = key.type.describe()
        cells = (f"`{name}`", kind, unit, _default(key.default), allowed, key.meaning)
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""


def _default(value: Any) -> str:
    if value is REQUIRED:
        return "*required*"
    if value is None or value == () or value == {}:
        return "none"
    if isinstance(value, dict):
        return "that of its keys"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        if isinstance(value[0], dict):
            return f"{len(value)} tables"
        return f"`[{', '.join(_default(each).strip('`') for each in value)}]`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"`{value:g}`"


if __name__ == "__main__":
    sys.stdout.write(reference())


_DIALECT = {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def schema(kind: str, family: str = "") -> JsonSchema:
    """The JSON Schema (draft 2020-12) of a flock, groom, shot or preset as TOML readers load it.

    family: of a preset, one of FAMILIES; empty: a preset of any family, which a preset file does
    not name itself (its folder does).
    """
    name = f"{family or 'any'} preset" if kind == "preset" else kind
    head = _DIALECT | {
        "$id": "urn:featherfx:" + name.replace(" ", ":"),
        "title": f"featherfx {name}",
    }
    if kind == "preset":
        files = [
            {"type": "object", "allOf": [each.reference(), each.complete()]}
            for each in PRESET_FAMILIES.values()
            if family in ("", each.family)
        ]
        body = {"anyOf": files} if len(files) > 1 else files[0]
    else:
        body = {"flock": FLOCK_FILE, "groom": GROOM_FILE, "shot": SHOT_FILE}[kind].schema(False)
    return head | body | {"$defs": _definitions(body)}


def _definitions(body: JsonSchema) -> dict[str, JsonSchema]:
    """Schemas of all preset families that a schema refers to, and that these refer to."""
    found: dict[str, JsonSchema] = {}
    text = json.dumps(body)
    while missing := [
        each
        for each in PRESET_FAMILIES.values()
        if each.name not in found and json.dumps(each.reference()) in text
    ]:
        found |= {each.name: each.definition() for each in missing}
        text += json.dumps(found)
    return found


# beside presets of birds: feathers by species and tract, which tests/bird_counts.py writes
COUNTS_FILE = "counts.json"
_TRACT_KEYS = "length", "relative_density", "cites"
# of a number that is shown: what was scaled to unit length may be scaled once more
_DIGITS = 12


@dataclass(frozen=True)
class PresetFile:
    """A preset that can be named. summary: the first sentence of its file's first
    comment, without what stands in parentheses. cites: publications that its figures come from.
    by_eye: whether what none is cited for is set by eye."""

    family: str
    name: str
    path: Path
    summary: str
    cites: tuple[str, ...] = ()
    by_eye: bool = False

    def __str__(self) -> str:
        return f"{self.family}/{self.name}"


def list_presets(preset_folders: Iterable[str | Path] = ()) -> tuple[PresetFile, ...]:
    """All presets that can be named, by family and name, with the files that win."""
    library = Library(preset_folders, Problems())
    found = []
    for family in PRESET_FAMILIES:
        for name in sorted(library.names(family)):
            located = library.find(family, name)
            if located is not None:
                sources = _sources(located[0]) if family == "motion" else ((), False)
                found.append(PresetFile(family, name, located[0], _summary(located[0]), *sources))
    return tuple(found)


def _sources(path: Path) -> tuple[tuple[str, ...], bool]:
    """Publications that a preset's file cites, and whether the rest is set by eye."""
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return (), False
    return tuple(map(str, values.get("cites", ()))), bool(values.get("by_eye", False))


def _summary(path: Path) -> str:
    try:
        lines = path.read_text(encoding="utf-8-sig").split("\n")
    except (OSError, UnicodeDecodeError):
        return ""
    comment = " ".join(each.lstrip("# ") for each in takewhile(lambda s: s.startswith("#"), lines))
    return re.sub(r"\s*\([^()]*\)", "", comment).split(". ", 1)[0].strip().rstrip(".")


def show(name: str, preset_folders: Iterable[str | Path] = ()) -> str:
    """The merged preset as TOML lines, each with its unit and the file that it came from.

    name: "swan_vane" or, with its family, "material/vane/swan_vane". Raises InputError.
    """
    family, tree = load_preset(name, preset_folders)
    kind = tree["kind"].value if "kind" in tree else ""
    lines = list(_lines(PRESET_FAMILIES[family].finished(kind), tree, ""))
    width = min(48, max(len(text) for text, _ in lines))
    shown = [f"{text.ljust(width)}  # {note}" for text, note in lines]
    return "\n".join([f"# {family} preset {name.rpartition('/')[2]}", *shown])


def describe_preset(name: str, preset_folders: Iterable[str | Path] = ()) -> dict[str, Any]:
    """Return family, name, values, the file of each, and of birds their tracts.

    The count of a tract are the feathers that it grows on the body that was made for the species,
    its wings folded (COUNTS_FILE); None of presets without such a body. name: as of show. Raises
    InputError.
    """
    family, tree = load_preset(name, preset_folders)
    short, values = name.rpartition("/")[2], plain(tree)
    found = {"family": family, "name": short, "values": values, "sources": _sources_of(tree)}
    if family == "bird":
        located = Library(preset_folders, Problems()).find(family, short)
        counts = located[0].with_name(COUNTS_FILE) if located else Path(COUNTS_FILE)
        known = json.loads(counts.read_text()).get(short, {}) if counts.is_file() else {}
        found["tracts"] = {
            part: {"count": known.get(part)} | {key: each[key] for key in _TRACT_KEYS}
            for part, each in values["tracts"].items()
            if each
        }
    return found


def _sources_of(tree: Tree) -> dict[str, Any]:
    """A tree with the file of each value instead."""
    return {k: _sources_of(v) if isinstance(v, dict) else v.source for k, v in tree.items()}


def _lines(table: Table, tree: Tree, prefix: str) -> Iterator[tuple[str, str]]:
    for name, key in table.keys.items():
        if name not in tree:
            continue  # of a table that is one of several types
        value: Any = tree[name]
        inner = key.type.finished() if isinstance(key.type, Preset) else key.type
        if isinstance(inner, Either) and isinstance(value, dict):
            inner = inner.options[dict]
        if isinstance(value, Sourced) and value.value in (None, {}):
            continue  # TOML has no word for what is not given
        if isinstance(value, Sourced):
            unit = key.type.describe()[1]
            note = f"{unit}, {value.source}" if unit else value.source
            yield f"{prefix}{name} = {toml_of(value.value, _DIGITS)}", note
        elif isinstance(inner, Table):
            yield from _lines(inner, value, f"{prefix}{name}.")
