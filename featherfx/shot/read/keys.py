"""Every key of a shot file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from featherfx.groom.keys.groom import (
    DRAWN_KEYS,
    GROOM_KEYS,
    PICTURE_KEYS,
    SURFACE_KEYS,
    USD_KEYS,
    VARIANT_KEYS,
)
from featherfx.groom.keys.problems import Place
from featherfx.groom.keys.values import (
    ArrayOf,
    Either,
    Flag,
    JsonSchema,
    Key,
    Number,
    Table,
    Text,
    keys_of,
    tables,
)
from featherfx.shot.patterns import (
    Channel,
    Detachment,
    Detail,
    Force,
    Grip,
    Preen,
    Shelter,
    Target,
    Wet,
)
from featherfx.shot.types import Contact, LevelOfDetail, Shot

GRIP = keys_of(Grip)
FORCE = keys_of(Force)
DETAIL = keys_of(Detail)
SHELTER = keys_of(Shelter)
PREEN = keys_of(Preen)
WET = keys_of(Wet)
DETACHMENT = keys_of(Detachment)
CHANNEL = keys_of(Channel)
TARGET = keys_of(Target)

_FILE = Key(Text(), "USD file, as seen from the shot file's folder.")
_START = Key(
    Number(-1e9, 1e9),
    "Time code of the stage at the first frame; default: that of the frame's number.",
    None,
)
_TIME = Key(
    Text(("codes", "seconds")),
    "What a frame is where the stage's time codes per second are not frames_per_second: codes, "
    "frame N is time code N; seconds, as USD composes layers of other rates. Without it rates that "
    "differ are an error.",
    None,
)

_INTERPOLATION = Key(
    Text(("smooth", "linear")),
    "Motion between whole frames: smooth through the poses there, or as the stage has it, for "
    "stages whose samples are finer than frames.",
    "smooth",
)


@dataclass(frozen=True)
class GroomTables(Table):
    """Table that says what to read of a USD file; or the tables of a groom, with its name, which
    its reader checks."""

    def check(self, value: Any, place: Place, partial: bool) -> Any:
        return (
            value
            if isinstance(value, dict) and "name" in value
            else super().check(value, place, partial)
        )

    def schema(self, partial: bool) -> JsonSchema:
        return {"type": "object", "if": {"required": ["name"]}, "else": super().schema(partial)}


GROOM_USD = {"usd": _FILE} | {name: key for name, key in USD_KEYS.items() if name != "file"}

_SKIN = {
    "usd": _FILE,
    "prim": Key(
        Text(),
        "Path of the mesh that the roots follow, where a feather names no other; or of a Skeleton.",
    ),
    "rest": Key(
        Number(-1e9, 1e9),
        "Time code at which the groom fits the skin; default: the bind pose of a skinned mesh, the "
        "default values, or the first samples.",
        None,
    ),
    "start": _START,
    "time": _TIME,
    "tolerance": Key(
        Number(0, 1000, "m"), "Roots that are farther from the skin give a warning.", 0.01
    ),
    "smoothing_radius": Key(
        Number(0, 100, "m"),
        "Distance within which the skin turns a root, besides the faces at its own; default: the "
        "distance of neighbouring roots, at most the feather's width.",
        None,
    ),
    "extrapolation": Key(
        Text(("error", "hold")), "What a shot that is longer than the skin's samples does.", "error"
    ),
    "interpolation": _INTERPOLATION,
    "on_collapse": Key(
        Text(("borrow", "error")),
        "Roots on a face without area: borrow, the skin around turns them, with a warning; error.",
        "borrow",
    ),
    **VARIANT_KEYS,
    **SURFACE_KEYS,
    **PICTURE_KEYS,
}

WIND_USD = {
    "usd": _FILE,
    "prim": Key(Text(), "Path of points with velocities, or of the prim with the attribute."),
    "attribute": Key(
        Text(), "Attribute that holds one vector for the whole space, not a field of points.", None
    ),
    "start": _START,
    "time": _TIME,
    "scale": Key(Number(-1e6, 1e6), "Factor of the velocities, in stage units per second.", 1.0),
}

_COLLIDER = {
    "usd": _FILE,
    "prims": Key(ArrayOf(Text(), 0, 10_000), "Paths, or names with * and ?, of meshes.", ()),
    "collection": Key(Text(), "Collection, such as /Bird.collection:colliders.", None),
    "start": _START,
    "time": _TIME,
    "interpolation": _INTERPOLATION,
    "map": Key(
        Text(), "Primvar, or picture, of what is touched: faces below a half are not.", None
    ),
    **DRAWN_KEYS,
    **SURFACE_KEYS,
    **PICTURE_KEYS,
}

CONTACT = {"enabled": Key(Flag(), "Whether feathers touch each other.", True), **keys_of(Contact)}

LEVEL_OF_DETAIL = {
    "enabled": Key(Flag(), "Whether levels follow from what is seen.", True),
    "usd": Key(Text(), "USD file of the camera, as seen from the shot file's folder.", None),
    "prim": Key(Text(), "Path of the camera.", None),
    "start": _START,
    "time": _TIME,
} | keys_of(LevelOfDetail)

SHOT = {
    "name": Key(Text(), "Name of the shot."),
    "groom": Key(
        Either({dict: GroomTables(GROOM_USD), str: Text()}),
        "Groom file, TOML or USD, as seen from the shot file's folder, a table that says what to "
        "read of a USD file, or the tables of a groom.",
    ),
    "overrides": GROOM_KEYS["overrides"],
    "skin": Key(Table(_SKIN), "Animated skin that moves the roots.", None),
    "frames": Key(
        ArrayOf(Number(-1_000_000, 1_000_000, whole=True), 2, 2),
        "First and last frame, both baked.",
    ),
    **keys_of(Shot),
    "wind_usd": Key(Table(WIND_USD), "Wind of a USD scene, added to `wind`.", None),
    "contact": Key(Table(CONTACT), "Contact of feathers with each other and colliders.", None),
    "collider": tables(_COLLIDER, "Meshes of USD scenes."),
    "grip": tables(GRIP, "Points led along a path."),
    "detail": tables(
        DETAIL,
        "Level of detail by feather, before the quality's lengths; the last one that fits holds.",
    ),
    "shelter": tables(
        SHELTER,
        "Which feathers the wind reaches less, because they lie within plumage; the last one that "
        "fits holds. The others are sheltered by how they lie on each other and on a skin; "
        "`share = 0` of all feathers switches that off.",
    ),
    "level_of_detail": Key(
        Table(LEVEL_OF_DETAIL), "Levels of detail by what is seen in the frames of the shot.", None
    ),
    "wet": tables(WET, "Which feathers are wet, and when; the last one that fits holds."),
    "detach": tables(
        DETACHMENT, "Which feathers leave their roots, and when; the last one that fits holds."
    ),
    "channel": tables(CHANNEL, "What feathers are made to do: angles add up, factors multiply."),
    "target": tables(TARGET, "Shapes that feathers are brought to and held in.", most=1000),
    "preen": tables(PREEN, "Strokes that close what has split."),
    "force": tables(FORCE, "Dead forces on points and lines."),
}

SHOT_FILE = Table(SHOT, "shot")
