"""JSON Schemas of shots, grooms and presets, from the declarations that check the files.

A schema judges keys, types and ranges as the reader does. What depends on other keys (the end of a
grip after its start), on other files, or on what a `base` holds, `featherfx check` alone finds.
"""

from __future__ import annotations

import json

from featherfx.groom.keys.groom import GROOM_FILE
from featherfx.groom.keys.preset import PRESET_FAMILIES
from featherfx.groom.keys.values import JsonSchema
from featherfx.shot.read.keys import SHOT_FILE

_HEAD = {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def schema(kind: str, family: str = "") -> JsonSchema:
    """The JSON Schema (draft 2020-12) of a "groom", "shot" or "preset" as TOML readers load it.

    family: of a preset, one of FAMILIES; empty: a preset of any family, which a preset file does
    not name itself (its folder does).
    """
    name = f"{family or 'any'} preset" if kind == "preset" else kind
    head = _HEAD | {"$id": "urn:featherfx:" + name.replace(" ", ":"), "title": f"featherfx {name}"}
    if kind == "preset":
        files = [
            {"type": "object", "allOf": [each.reference(), each.complete()]}
            for each in PRESET_FAMILIES.values()
            if family in ("", each.family)
        ]
        body = {"anyOf": files} if len(files) > 1 else files[0]
    else:
        body = {"groom": GROOM_FILE, "shot": SHOT_FILE}[kind].schema(False)
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
