"""What pulls feathers at a point or along a line: grips and dead forces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from featherfx.algebra.types import Array
from featherfx.groom.keys.values import ArrayOf, Number, Text, vector

_COLUMN = "Place along the barb: 0 the rachis, 1 the barb's end."
_VANES = Text(("leading", "trailing"))
_VANE = "Vane that the barb belongs to."
_PART = Number(0, 1)


@dataclass(frozen=True, kw_only=True)
class Grip:
    """A node that is led along a path by a stiff spring.

    displacement: (3,), reached with zero velocity at start and end.
    """

    feather: Annotated[str, "Id of the feather."]
    row: Annotated[float, _PART, "Place along the rachis: 0 the base, 1 the tip."] = 1.0
    column: Annotated[float, _PART, _COLUMN] = 0.0
    side: Annotated[str, _VANES, _VANE] = "leading"
    displacement: Annotated[
        Array,
        vector(-100, 100, "m"),
        "Way of the gripped point in the groom's frame, from start to end with rest at both.",
    ]
    start: Annotated[float, Number(0, 1e5, "s"), "When the grip starts to move."] = 0.0
    end: Annotated[float, Number(0, 1e5, "s"), "When it has arrived; later than start."]
    stiffness: Annotated[
        float, Number(1e-6, 1e7, "N/m"), "Stiffness of the spring that leads the point."
    ]


@dataclass(frozen=True)
class Force:
    """A dead force. force: (3,). Of a barb's line the row alone counts."""

    feather: Annotated[str, "Id of the feather."]
    force: Annotated[
        Array,
        vector(-1e6, 1e6, "N"),
        "Force in the groom's frame, which the feather does not turn; N/m along a line.",
    ]
    line: Annotated[
        str,
        Text(("point", "rachis", "barb")),
        "Where it acts: at a point, along the rachis, or along the barb at `row`.",
    ] = "point"
    row: Annotated[float, _PART, "Place along the rachis by arc length: 0 the base, 1 the tip."] = (
        1.0
    )
    column: Annotated[float, _PART, _COLUMN] = 0.0
    side: Annotated[str, _VANES, _VANE] = "leading"
    span: Annotated[
        tuple[float, float], ArrayOf(_PART, 2, 2), "Of a line: first and last share that it covers."
    ] = (0.0, 1.0)
    keys: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(Number(-1e6, 1e6), 2, 2), 0, 10_000),
        "[time in s, factor of the force] in ascending time, linear between them and constant "
        "outside. None: the whole force at all times.",
    ] = ()
