"""Points, directions and lengths in the space of a groom: numbers, or landmarks of its skin.

Their types say where in the tables they stand, so that `featherfx/groom/read/space.py` finds them
all and turns them into metres of the groom's frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from featherfx.groom.keys.problems import INVALID, Place
from featherfx.groom.keys.values import (
    ArrayOf,
    Either,
    JsonSchema,
    Key,
    Number,
    Table,
    Text,
    vector,
)

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
