"""Keys of tables that name a stage: its variants, and the prims of it that are drawn."""

from __future__ import annotations

from featherfx.groom.keys.values import ArrayOf, Flag, Key, Text, TextsByName

_PURPOSES = ("default", "render", "proxy", "guide")

VARIANT_KEYS = {
    "variant_sets": Key(
        TextsByName(),
        'Variants to choose, by variant set: { look = "bird" }; default: those of the stage.',
        {},
    ),
}
SURFACE_KEYS = {
    "subdivision": Key(
        Flag(),
        "Whether a mesh is the subdivided surface that renderers draw, or its cage.",
        True,
    ),
}
PICTURE_KEYS = {
    "uv": Key(Text(), "Primvar of the mesh that holds texture coordinates.", "st"),
    "wrap": Key(
        Text(("black", "clamp", "repeat", "mirror")),
        "Pictures outside of 0 to 1: 0, their edge, again, or again turned round. A name with "
        "<UDIM> is a set of tiles, outside of which is 0.",
        "black",
    ),
}
DRAWN_KEYS = VARIANT_KEYS | {
    "purposes": Key(
        ArrayOf(Text(_PURPOSES), 1, len(_PURPOSES)),
        "Purposes of the prims that are read where no path names them.",
        ("default", "render"),
    ),
    "invisible": Key(
        Flag(), "Whether invisible prims are read, too, where no path names them.", False
    ),
}
