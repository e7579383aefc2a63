"""Entries of shots about some feathers, and patterns of ids, regions and kinds that select them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Annotated, NamedTuple

from featherfx.algebra.types import Array, ByValue
from featherfx.groom.keys.values import ArrayOf, Number, Text, vector
from featherfx.groom.types import Placement
from featherfx.limits import MAX_CLUMPS

LEVELS = ("full", "coarse", "rachis", "guided", "rigid")
# those at which nothing is solved
UNSOLVED_LEVELS = LEVELS[3:]

_PART = Number(0, 1)
_FRAME = Number(-1_000_000, 1_000_000, whole=True)


_COLUMN = "Place along the barb: 0 the rachis, 1 the barb's end."
_VANES = Text(("leading", "trailing"))
_VANE = "Vane that the barb belongs to."


@dataclass(frozen=True, kw_only=True, eq=False)
class Grip(ByValue):
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
    max_force: Annotated[
        float | None,
        Number(1e-9, 1e7, "N"),
        "Most that the spring pulls with; beyond it the point stays behind, and a warning says so. "
        "Default: what stretches the thinnest part of the rachis, from its base to the row, by 5 "
        "%, half of what keratin breaks at.",
    ] = None


@dataclass(frozen=True, kw_only=True)
class SomeFeathers:
    """Feathers that all three patterns fit, but for those that are excluded."""

    feathers: Annotated[str, "Ids, with * and ? as wild cards."] = "*"
    region: Annotated[str, "Regions, with * and ? as wild cards."] = "*"
    kind: Annotated[str, "Kinds, with * and ? as wild cards."] = "*"
    exclude: Annotated[
        tuple[str, ...],
        ArrayOf(Text(), 0, 1000),
        "Ids of feathers that it leaves out, with * and ? as wild cards.",
    ] = ()


@dataclass(frozen=True, kw_only=True)
class Detail(SomeFeathers):
    """Level of detail of some feathers, whatever their length."""

    level: Annotated[
        str,
        Text(LEVELS),
        "full: as the quality says; coarse: half the rows and columns, one coefficient; rachis: "
        "the shaft alone, with rigid barbs; guided: follows simulated feathers of its region; "
        "rigid: not simulated, follows its root.",
    ]
    every: Annotated[
        int,
        Number(0, 100_000, whole=True),
        "Of guided feathers, every n-th of each region is simulated and guides the others; 0: "
        "only feathers that are simulated anyway guide.",
    ] = 8
    spacing: Annotated[
        float | None,
        Number(1e-6, 100, "m"),
        "Of guided feathers, no more guides than leave none farther from one; `every = 1` lets the "
        "spacing alone decide.",
    ] = None


@dataclass(frozen=True, kw_only=True)
class Shelter(SomeFeathers):
    """Part of the air's motion against the roots that the plumage keeps off some feathers."""

    share: Annotated[
        float,
        _PART,
        "Share of the air's velocity against the roots that the plumage around keeps off: 0 none, "
        "as for a feather that stands alone; 1 all.",
    ]


_WETNESS = ArrayOf(Number(-1e5, 1e5), 2, 2)


@dataclass(frozen=True, kw_only=True)
class Wet(SomeFeathers):
    """Wetness of some feathers over time, and its effects."""

    keys: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(_WETNESS, 1, 10_000),
        "Wetness, 0 to 1, at times: [time in s, wetness]; linear between, constant outside.",
    ]
    water: Annotated[
        float,
        Number(0, 100),
        "Water that the vane holds at wetness 1, in masses of the dry vane; an estimate.",
    ] = 1.0
    hooks: Annotated[
        float,
        Number(0.01, 1),
        "Share of the yield and strength of hooks that is left at wetness 1; an estimate.",
    ] = 0.5
    drag: Annotated[
        float,
        _PART,
        "Share of the air's force on the vane that is left at wetness 1; a look control.",
    ] = 0.7
    clump: Annotated[
        float,
        _PART,
        "How far the ends of barbs that are drawn come together at wetness 1, a share of their "
        "distance; a look control.",
    ] = 0.8
    clump_count: Annotated[
        int, Number(1, MAX_CLUMPS, whole=True), "Number of clumps along each vane; a look control."
    ] = 24


@dataclass(frozen=True, kw_only=True)
class Preen(SomeFeathers):
    """A stroke that closes open gaps between barbs, of vanes whose hooks may slip."""

    start: Annotated[float, Number(0, 1e5, "s"), "When the stroke begins."]
    end: Annotated[float, Number(0, 1e5, "s"), "When it is done; later than start."]
    direction: Annotated[
        str,
        Text(("barbs", "rachis")),
        "Its way: along all barbs at once, from the rachis to their ends, or from the base of the "
        "feather to its tip.",
    ] = "barbs"
    closed_fraction: Annotated[
        float, Number(1e-3, 1), "Share of what is open, and of what has slipped, that it closes."
    ] = 1.0
    max_gap: Annotated[
        float, Number(0, 0.1, "m"), "Gaps whose edges are farther apart stay open."
    ] = 2e-3


@dataclass(frozen=True, kw_only=True)
class Detachment(SomeFeathers):
    """When some feathers leave their roots, as in moult; from then on they fall and fly alone."""

    frame: Annotated[
        int | None,
        _FRAME,
        "Frame at which they leave their roots, with the velocity that they have then; default: "
        "the first. From there on nothing holds them, and they touch nothing.",
    ] = None


class Dial(NamedTuple):
    """Range of a channel's value, in its unit, and the value that changes nothing."""

    least: float
    most: float
    neutral: float


CHANNELS = {
    "ruffle": Dial(-120, 120, 0),
    "sleek": Dial(-120, 120, 0),
    "turn": Dial(-180, 180, 0),
    "fan": Dial(-360, 360, 0),
    "fold": Dial(0, 1, 0),
    "puff": Dial(-0.5, 0.5, 0),
    "stiffness": Dial(0.01, 100, 1),
    "damping": Dial(0, 100, 1),
    "wind": Dial(0, 10, 1),
    "gravity": Dial(-10, 10, 1),
    "follow": Dial(0, 3, 1),
}


@dataclass(frozen=True, eq=False)
class Force(ByValue):
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


@dataclass(frozen=True, kw_only=True)
class Channel(SomeFeathers):
    """Direction of some feathers over time (featherfx/shot/direction).

    factors: by feather id, of its map; None: without one.
    """

    name: Annotated[
        str,
        Text(tuple(CHANNELS)),
        "ruffle: degrees by which follicles raise the shafts, a coat by 80 at most; sleek: press "
        "them down, a coat by half of the way to its skin at most; turn: about the shaft, leading "
        "vane up, in a coat as far as there is room; fan: spread "
        "the feathers apart, in all; fold: 0 to 1, how far all come to their mean direction; "
        "puff: m by which tips of a coat rise, and roots of others; stiffness, damping, wind, "
        "gravity: times what it is; follow: share of the simulated deviation from the rest shape "
        "that is shown, 0 rigid, 1 all, above 1 exaggerated.",
    ]
    keys: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(Number(-1e6, 1e6), 2, 2), 1, 10_000),
        "[frame, value] in ascending frames; smooth between them, constant outside.",
    ]
    soft: Annotated[
        float,
        Number(0, 100, "m"),
        "Border within which it fades, by the distance of a root to the nearest outside.",
    ] = 0.0
    map: Annotated[
        str | None,
        Text(),
        "How far it acts, 0 to 1, where roots are on the shot's skin: a scalar primvar, or a grey "
        "picture in its texture space (a name with a dot, as seen from the shot file's folder).",
    ] = None
    factors: Mapping[str, float] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Target(ByValue, SomeFeathers):
    """A shape that some feathers are brought to (featherfx/shot/direction/targets.py).

    points: by feather id, (V, 3) m, of the meshes in `shape`; lines: (k, 3) m, of curves for their
    shafts. Both None: the rest shape.
    """

    shape: Annotated[
        str,
        Text(),
        "rest, or a USD file with the meshes of the feathers as this shot draws them, or with "
        "curves for their shafts.",
    ] = "rest"
    frame: Annotated[
        int | None,
        _FRAME,
        "Frame whose roots the file's shapes stand on, and time code in the file; default: "
        "those of the groom, and the default pose.",
    ] = None
    keys: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(Number(-1e6, 1e6), 2, 2), 1, 10_000),
        "[frame, hold] in ascending frames, hold 0 (free) to 1 (in the shape); smooth between.",
    ]
    tolerance: Annotated[
        float, Number(0.01, 100, "%"), "Of a feather's length, how far off it may be in full hold."
    ] = 1.0
    within: Annotated[
        float,
        Number(0, 10, "m"),
        "How far each point is free around its place in the shape: keeps an outline, not a pose.",
    ] = 0.0
    points: Mapping[str, Array] | None = None
    lines: Mapping[str, Array] | None = None


def fits(entry: SomeFeathers, placement: Placement) -> bool:
    """Return whether an entry is about a feather."""
    return (
        fnmatchcase(placement.id, entry.feathers)
        and fnmatchcase(placement.region, entry.region)
        and fnmatchcase(placement.kind.name, entry.kind)
        and not any(fnmatchcase(placement.id, each) for each in entry.exclude)
    )


def last_fitting(entries: Sequence[SomeFeathers], placements: Sequence[Placement]) -> list[int]:
    """Find the number of the last entry that is about each feather; -1 for none."""
    found = [-1] * len(placements)
    for number, entry in enumerate(entries):
        for f, placement in enumerate(placements):
            if fits(entry, placement):
                found[f] = number
    return found
