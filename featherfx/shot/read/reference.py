"""docs/reference.md, generated from the declarations that check users' files.

python -m featherfx.shot.read.reference > docs/reference.md
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from typing import Any

from featherfx.groom.keys import groom as groom_keys
from featherfx.groom.keys import preset as preset_keys
from featherfx.groom.keys import regions as region_keys
from featherfx.groom.keys.values import REQUIRED, Key, keys_of
from featherfx.groom.types import BarbGuide, RachisShape, VaneShape
from featherfx.shot.read import keys as shot_keys

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
`#:schema ./shot.schema.json` at the top of the shot. Most presets need a `--family`.

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

_SHOT_PARTS = {
    "groom": ("[groom] of a shot", shot_keys.GROOM_USD),
    "skin": ("[skin]", shot_keys.SKIN),
    "wind_usd": ("[wind_usd]", shot_keys.WIND_USD),
    "collider": ("[[collider]]", shot_keys.COLLIDER),
    "contact": ("[contact]", shot_keys.CONTACT),
    "grip": ("[[grip]]", shot_keys.GRIP),
    "force": ("[[force]]", shot_keys.FORCE),
    "detail": ("[[detail]]", shot_keys.DETAIL),
    "shelter": ("[[shelter]]", shot_keys.SHELTER),
    "level_of_detail": ("[level_of_detail]", shot_keys.LEVEL_OF_DETAIL),
}
_GROOM_PARTS = {
    "joint": ("[[joint]]", groom_keys.JOINT),
    "feather": ("[[feather]]", groom_keys.FEATHER_ENTRY),
    "row": ("[[row]]", groom_keys.ROW),
    "root": ("first and last of a [[row]]", groom_keys.ROOT),
    "table": ("[[table]]", groom_keys.TABLE),
    "usd": ("[[usd]]", groom_keys.USD),
    "names": ("names of [[usd]]", groom_keys.USD_NAMES),
    "skin": ("[skin] of a groom", region_keys.SKIN),
    "region": ("[[region]]", region_keys.REGION),
    "region_kind": ("kind of a [[region]]", region_keys.REGION_KIND),
    "where": ("where of a [[region]]", region_keys.WHERE),
    "flow": ("flow of a [[region]]", region_keys.FLOW),
    "spread": ("variation of a [[region]]", region_keys.SPREAD),
    "layout": ("[layout]", region_keys.LAYOUT),
    "variation": ("[variation]", groom_keys.VARIATION),
}


def reference() -> str:
    """The whole page as Markdown."""
    lines = [_HEAD, "## Shot file", "", *_table(shot_keys.SHOT)]
    lines += _parts(_SHOT_PARTS)
    lines += ["## Groom file", "", *_table(groom_keys.GROOM)]
    lines += _parts(_GROOM_PARTS)
    lines += [_PRESETS, *_feather()]
    for family in ("material/vane", "material/rachis", "quality", "wind"):
        lines += [f"### {family} preset", "", *_table(preset_keys.FAMILIES[family].keys)]
    lines += _motion()
    return "\n".join(lines).rstrip() + "\n"


def _parts(parts: Mapping[str, tuple[str, Mapping[str, Key]]]) -> Iterator[str]:
    for title, keys in parts.values():
        yield from (f"### {title}", "", *_table(keys))


def _feather() -> Iterator[str]:
    yield from ("### feather preset", "", *_table(preset_keys.FEATHER))
    yield from ("### [rachis] of a feather preset", "", *_table(keys_of(RachisShape)))
    yield from ("### [leading] and [trailing] of a feather preset", "")
    yield from _table(keys_of(VaneShape))
    yield from ("### guides of a vane", "", *_table(keys_of(BarbGuide)))


def _motion() -> Iterator[str]:
    yield from ("### motion preset", "", *_table({"kind": preset_keys.KIND}))
    for kind, keys in preset_keys.MOTIONS.items():
        if keys:
            yield from (f"### motion of kind {kind}", "", *_table(keys))
    yield from ("### keyframes of a motion", "", *_table(preset_keys.KEYFRAME))


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
        return "`[" + ", ".join(f"{each:g}" for each in value) + "]`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"`{value:g}`"


if __name__ == "__main__":
    sys.stdout.write(reference())
