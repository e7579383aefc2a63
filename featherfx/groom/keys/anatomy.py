"""Keys of wings, tails, crests and birds, and of the presets of wings."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated

from featherfx.groom.keys.places import Named, Preset
from featherfx.groom.keys.values import ArrayOf, Default, Flag, Key, Number, Table, Text, keys_of
from featherfx.groom.materials import Colour, Shade

_LENGTH = Number(1e-3, 5, "m")
_SPREAD_FOLDED = ArrayOf(Number(-180, 180, "deg"), 2, 2)
_BAND_EDGES = ArrayOf(Number(-3, 3), 2, 2)  # shares of a vane, which may lie beyond it
MAX_ROW_FEATHERS = 200


@dataclass(frozen=True)
class FlightRow:
    """Flight feathers side by side."""

    count: Annotated[int, Number(0, MAX_ROW_FEATHERS, whole=True), "How many feathers."]
    lengths: Annotated[
        tuple[float, ...],
        ArrayOf(_LENGTH, 1, MAX_ROW_FEATHERS),
        "Lengths from the innermost to the outermost, spread evenly over the row.",
    ]
    kind: Annotated[str, Text(), "Feather preset."]
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0


@dataclass(frozen=True)
class CovertRow:
    """A row of coverts, one for each flight feather and parallel to it."""

    name: Annotated[str, Text(), "Part of ids and, with `s`, label: greater_covert."]
    kind: Annotated[str, Text(), "Feather preset."]
    length: Annotated[float, Number(0.01, 2), "Length as a share of the flight feather's."]
    chord_position: Annotated[
        float, Number(0, 1), "Where the roots stand between the bone (0) and the leading edge (1)."
    ]
    gap: Annotated[float, Number(0, 0.1, "m"), "Distance from the row that it covers."]
    side: Annotated[str, Text(("above", "below")), "Upper or lower side of the wing."] = "above"
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0
    hand: Annotated[
        float,
        Number(0, 2),
        "Factor of the length over the outer half of the hand, reached evenly from the wrist; 0: "
        "the row ends at the wrist.",
    ] = 1.0
    loose: Annotated[
        bool,
        Flag(),
        "Whether the coat of a layout rises onto the row, as onto folded wings that do not open.",
    ] = False


@dataclass(frozen=True, kw_only=True)
class WingBand:
    """A band that runs straight through feathers of a wing where it is folded."""

    rows: Annotated[
        tuple[str, ...],
        ArrayOf(Text(), 1, 10),
        'Rows that have it, from the body outwards: "tertials", "secondaries", "primaries", or the '
        "names of coverts.",
    ]
    colour: Annotated[Shade, ArrayOf(Number(0, 1), 3, 3), "Red, green and blue (sRGB)."]
    inner: Annotated[
        tuple[float, float],
        _BAND_EDGES,
        "Where it begins and ends on the innermost feather of these rows.",
    ]
    outer: Annotated[tuple[float, float], _BAND_EDGES, "The same on the outermost."]
    soft: Annotated[float, Number(0, 1), "Share of its width over which its borders fade."] = 0.2


_FLIGHT = Table(keys_of(FlightRow), "table of flight feathers")


@dataclass(frozen=True, kw_only=True)
class WingType:
    """A wing as a species has it, spread and folded. Angles in deg, lengths in m.

    Pairs are values of the spread and of the folded wing. Directions of feathers between innermost,
    middle and outermost are interpolated, and each turns with the wrist in proportion, as tracked
    feathers of pigeons do (Chang et al. 2020, Science Robotics 5: eaay1246).
    """

    humerus: Annotated[float, _LENGTH, "Length of the upper arm."]
    forearm: Annotated[float, _LENGTH, "Length of the forearm."]
    hand: Annotated[float, _LENGTH, "Length of the hand, wrist to the tip of its bones."]
    primaries: Annotated[FlightRow, _FLIGHT, "Flight feathers of the hand."]
    secondaries: Annotated[FlightRow, _FLIGHT, "Flight feathers of the forearm."]
    tertials: Annotated[FlightRow, _FLIGHT, "Flight feathers of the upper arm."]
    alula: Annotated[FlightRow, _FLIGHT, "Feathers of the thumb."]
    coverts: Annotated[
        tuple[CovertRow, ...],
        ArrayOf(Table(keys_of(CovertRow), "table of a row of coverts"), 0, 40),
        "Rows of coverts; on either side each lies over the one before it.",
    ] = ()
    bands: Annotated[
        tuple[WingBand, ...],
        ArrayOf(Table(keys_of(WingBand), "table of a band"), 0, 20),
        "Marks over those of the feathers that run through the folded wing.",
    ] = ()
    shoulder: Annotated[
        tuple[float, float], _SPREAD_FOLDED, "Upper arm, turned back from sideways."
    ]
    elbow: Annotated[tuple[float, float], _SPREAD_FOLDED, "Angle between both arm bones."]
    wrist: Annotated[tuple[float, float], _SPREAD_FOLDED, "Angle between forearm and hand."]
    roof: Annotated[
        tuple[float, float],
        _SPREAD_FOLDED,
        "Turn of the wing about the body's long axis, down along the flank.",
    ]
    tuck: Annotated[
        tuple[float, float],
        _SPREAD_FOLDED,
        "Turn of the wing about the body's upright axis, its trailing end inwards.",
        Default((0.0, 0.0)),
    ] = (0.0, 0.0)
    bow: Annotated[
        float,
        Number(0, 150, "deg"),
        "How far the folded wing bends round the body, from its innermost feather to the wrist.",
    ] = 0.0
    back_gap: Annotated[
        float,
        Number(-0.5, 1),
        "Of the longest feather: from the middle of the back to a folded wing; 0: both meet.",
    ] = 0.0
    tip_gap: Annotated[
        float,
        Number(-0.5, 1),
        "Of the longest feather: from the middle of the tail to the tip of a folded wing.",
    ] = 0.12
    body_clearance: Annotated[
        float,
        Number(0, 1),
        "Of the longest feather: how far the shafts of a folded wing stay off the body.",
    ] = 0.029
    innermost: Annotated[
        tuple[float, float], _SPREAD_FOLDED, "Innermost feather, against the forearm."
    ]
    middle: Annotated[
        tuple[float, float], _SPREAD_FOLDED, "Feathers at the wrist, against the forearm."
    ]
    outermost: Annotated[
        tuple[float, float], _SPREAD_FOLDED, "Outermost primary, against the hand."
    ]
    depth: Annotated[
        float, Number(0, 1), "From the bones of the hand to its leading edge, in lengths of it."
    ] = 0.15
    roll: Annotated[
        float, Number(-90, 90, "deg"), "How far leading vanes are lifted over the next feather."
    ] = 4.0
    lift: Annotated[
        float, Number(0, 0.1, "m"), "How much deeper each feather's root is than the next inner."
    ] = 2e-4
    camber: Annotated[
        float,
        Number(-360, 360, "deg"),
        "Turning of the longest feather's shaft; all others are as curved, so that they nest.",
    ] = 6.0


# parts of a body that carry feathers, from the beak to the tail
TRACTS = (
    *("face", "crown", "throat", "nape", "foreneck", "breast", "mantle", "scapular"),
    *("back", "flank", "belly", "thigh", "rump", "vent"),
)


@dataclass(frozen=True)
class PartOfBody:
    """The coat of a part of the body."""

    kind: Annotated[str, Text(), "Feather preset."]
    length: Annotated[float, Number(1e-3, 5, "m"), "Length of the feathers."]
    relative_density: Annotated[
        float, Number(0, 100), "Feathers on a square as wide as they are long; 0: bare."
    ] = 9.0
    cites: Annotated[
        tuple[str, ...],
        ArrayOf(Text(), 0, 20),
        "Publications that its figures come from, and which; others are set by eye.",
    ] = ()
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0
    tilt: Annotated[float, Number(-90, 90, "deg"), "Angle between shaft and skin."] = 4.0
    curl: Annotated[float, Number(-360, 360, "deg"), "Added to the camber of the shafts."] = 3.0
    length_variation: Annotated[
        float, Number(0, 0.3), "Standard deviation of lengths, relative; 50 deg of it of turns."
    ] = 0.03


_PART = Table(keys_of(PartOfBody), "table of a tract")
_CHEEK = Key(
    _PART,
    "Below and behind the eyes, if these are among the landmarks; without it others meet there.",
    None,
)


@dataclass(frozen=True)
class TailCovertRow:
    """A row of tail coverts, one for each tail feather, with which it fans."""

    name: Annotated[str, Text(), "Part of ids and, with `s`, label: upper_tail_covert."]
    length: Annotated[float, Number(0.01, 10), "Length as a share of the tail feather's."]
    ahead: Annotated[
        float, Number(0, 1), "From root to root towards the body, in lengths of the tail feather."
    ]
    height: Annotated[
        float,
        Number(0, 1),
        "Of the roots over the row before, in lengths of the tail feather; its tip lies on it.",
    ]
    kind: Annotated[str, Text(), "Feather preset."] = "tail_covert"
    side: Annotated[str, Text(("above", "below")), "Upper or lower side of the tail."] = "above"
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0


# each tail feather has a greater covert above and below (Lucas and Stettenheim 1972, "Avian
# Anatomy: Integument"); rows and shares are chosen by eye, so that they fair the tail into the body
_TAIL_COVERTS = tuple(
    asdict(TailCovertRow(name, length, ahead, height, side=side))
    for side, name, length, ahead, height in (
        ("above", "upper_tail_covert_1", 0.5, 0.02, 0.02),
        ("above", "upper_tail_covert_2", 0.36, 0.1, 0.025),
        ("below", "under_tail_covert_1", 0.6, 0.0, 0.02),
        ("below", "under_tail_covert_2", 0.42, 0.0, 0.03),
        ("below", "under_tail_covert_3", 0.34, 0.12, 0.05),
    )
)
TAIL_COVERTS = ArrayOf(Table(keys_of(TailCovertRow), "table of a row of tail coverts"), 0, 40)


@dataclass(frozen=True)
class TailOfBird:
    """The tail of a bird; the same keys of [[tail]]."""

    count: Annotated[int, Number(0, MAX_ROW_FEATHERS, whole=True), "Feathers, in pairs; 0: none."]
    lengths: Annotated[
        tuple[float, ...],
        ArrayOf(_LENGTH, 1, MAX_ROW_FEATHERS),
        "Lengths from the central to the outermost, spread evenly.",
    ]
    root_width: Annotated[float, Number(0, 1, "m"), "From the outermost root to the other."]
    kind: Annotated[str, Text(), "Feather preset."] = "rectrix"
    angles: Annotated[
        tuple[float, float],
        ArrayOf(Number(-360, 360, "deg"), 2, 2),
        "Angle of the whole fan, closed and open.",
        Default((10.0, 110.0)),
    ] = (10.0, 110.0)
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0
    arch: Annotated[float, Number(0, 170, "deg"), "How far the closed tail is bent to a roof."] = (
        0.0
    )
    droop: Annotated[
        float, Number(-180, 180, "deg"), "How far the tail points below the line of the back."
    ] = 0.0
    coverts: Annotated[
        tuple[TailCovertRow, ...],
        TAIL_COVERTS,
        "Rows of coverts; on either side each lies over the one before it.",
        Default(_TAIL_COVERTS),
    ] = ()


@dataclass(frozen=True)
class CrestOfBird:
    """The crest of a bird, from the middle of forehead and crown to the nape."""

    count: Annotated[int, Number(0, MAX_ROW_FEATHERS, whole=True), "Feathers; 0: none."] = 0
    lengths: Annotated[
        tuple[float, ...],
        ArrayOf(_LENGTH, 1, MAX_ROW_FEATHERS),
        "Lengths from front to back, spread evenly.",
        Default((0.03,)),
    ] = (0.03,)
    kind: Annotated[str, Text(), "Feather preset."] = "body_contour"
    angles: Annotated[
        tuple[float, float],
        ArrayOf(Number(-360, 360, "deg"), 2, 2),
        "Angle of the foremost feather above the skull, flat and raised.",
        Default((8.0, 80.0)),
    ] = (8.0, 80.0)
    width: Annotated[float, Number(0.01, 100), "Factor of the vanes' widths."] = 1.0


@dataclass(frozen=True)
class DiscOfBird:
    """The disc of an owl's face: feathers that point away from either eye, and their rim."""

    radius: Annotated[float, Number(0, 1, "m"), "From an eye to the rim; 0: no disc."] = 0.0
    kind: Annotated[str, Text(), "Feather preset of the disc."] = "auricular"
    length: Annotated[float, _LENGTH, "Length of its feathers."] = 0.014
    relative_density: Annotated[float, Number(0, 100), "As of a tract."] = 20.0
    tilt: Annotated[float, Number(-90, 90, "deg"), "Angle between shaft and skin."] = 10.0
    rim: Annotated[str, Text(), "Feather preset of the rim."] = "contour"
    rim_length: Annotated[float, _LENGTH, "Length of its feathers."] = 0.012
    rim_relative_density: Annotated[float, Number(0, 100), "As of a tract."] = 20.0
    rim_tilt: Annotated[float, Number(-90, 90, "deg"), "Angle between shaft and skin."] = 45.0


WING_TYPE = keys_of(WingType)

BIRD_TYPE = {
    "length": Key(Number(1e-3, 100, "m"), "From the tip of the beak to the root of the tail."),
    "wing": Key(Preset("wing", WING_TYPE), "Its wings."),
    "tail": Key(Table(keys_of(TailOfBird), "table of a tail"), "Its tail."),
    "crest": Key(Table(keys_of(CrestOfBird), "table of a crest"), "Its crest.", {}),
    "disc": Key(Table(keys_of(DiscOfBird), "table of a disc"), "The disc of its face.", {}),
    "neck": Key(
        Number(0.4, 1.0),
        "Uppermost middle of the mantle, of the way from the nape to the shoulders; feathers of "
        "the nape reach 0.2 less far.",
        0.75,
    ),
    "bill": Key(
        Number(0.0, 0.9),
        "How far the bill reaches, of the way from the tip of the beak to the crown: no feathers "
        "grow before that, nor where `bare` of [bird] says so.",
        0.42,
    ),
    "tracts": Key(
        Table({name: Key(_PART, f"The {name}.") for name in TRACTS} | {"cheek": _CHEEK}),
        "Its coat.",
    ),
    "colours": Key(
        Named(Table(keys_of(Colour))),
        'Its colours by feather id, with * and ? as wild cards: "breast*" = { base = [1, 1, 1] }. '
        "Applied in order, before the groom's overrides.",
        {},
    ),
}
