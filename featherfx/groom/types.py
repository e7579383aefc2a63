"""Feathers and their places, as an artist writes them down.

Units are SI (metres, kilograms, seconds, pascals) and angles are in degrees, as in the files.
The feather frame: x leaves the follicle along the rachis, y points to the leading vane, z is
dorsal (the upper side of the vane).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from featherfx.algebra.types import Array, ByValue
from featherfx.errors import count_feathers
from featherfx.groom.document import Document, Documented
from featherfx.groom.keys.places import POINT, Preset
from featherfx.groom.keys.values import ArrayOf, Default, Key, Number, Table, Text, keys_of
from featherfx.groom.materials import (
    PROFILE_MEANING,
    PROFILE_POINTS,
    SHADING,
    BarbLook,
    Colour,
    Curve,
    RachisMaterial,
    VaneMaterial,
)

# least share of the barbs that a split is deep
MIN_SPLIT_DEPTH = 0.01

_TURNING = Number(-360, 360, "deg")
_HALF_TURNING = Number(-180, 180, "deg")
_BENT = Number(-120, 120, "deg")
BARB_ANGLE = Number(5, 120, "deg")


@dataclass(frozen=True)
class RachisShape:
    """The shaft at rest. Angles are total turnings of the tangent from base to tip.

    taper: p of diameter d(s) = tip + (base - tip) (1 - s)^p, s = arc length / length. camber turns
    to -z, sweep to -y; twist is right-handed.
    """

    diameter_base: Annotated[float, Number(1e-5, 0.1, "m"), "Outer diameter at the follicle."]
    diameter_tip: Annotated[float, Number(1e-6, 0.1, "m"), "Outer diameter at the tip."]
    taper: Annotated[
        float, Number(0.1, 5), "Exponent of the diameter: 1 is a cone, less stays thick."
    ] = 1.0
    camber: Annotated[float, _TURNING, "Turning of the shaft towards ventral."] = 0.0
    sweep: Annotated[float, _HALF_TURNING, "Turning of the shaft towards the trailing side."] = 0.0
    twist: Annotated[float, _HALF_TURNING, "Turning of the vane about the shaft."] = 0.0
    course: Annotated[
        tuple[tuple[float, float, float, float], ...],
        ArrayOf(ArrayOf(Number(-360, 360), 4, 4), 0, 200),
        "For a shaft that is no arc, what it turns by besides, in degrees from the base: [share of "
        "its length, camber, sweep, twist] in ascending shares, smooth between.",
    ] = ()
    diameter_profile: Annotated[
        Curve,
        PROFILE_POINTS,
        f"Factors of the diameter along the shaft's length: {PROFILE_MEANING}",
    ] = ()
    above_vane: Annotated[
        float,
        Number(0, 1),
        "Share of its height that is drawn dorsal of the vane; 0: barbs leave its upper edge.",
    ] = 0.5


# of [rachis]: its fields, and a line that stands for some of them
RACHIS_KEYS = keys_of(RachisShape) | {
    "line": Key(
        ArrayOf(ArrayOf(Number(-1e4, 1e4), 2, 3), 0, 200),
        "Centre line of the shaft in place of `camber`, `sweep` and `course`: a smooth curve "
        "through points [x, y] or [x, y, z] from the follicle to the tip, y to the leading side, z "
        "dorsal, in any unit, since `length` says how long it is. It is followed within 1 % of "
        "the length, and turned so that it leaves the follicle along x. Empty: none.",
        (),
    )
}


@dataclass(frozen=True)
class BarbGuide:
    """A barb that the artist drew; barbs between two guides are interpolated.

    The vane's length runs from the first barb (0) to the tip (1). curl turns within the vane,
    camber to -z, both from the barb's root to its end.
    """

    position: Annotated[float, Number(0, 1), "Root of the barb as a share of the vane's length."]
    angle: Annotated[float, BARB_ANGLE, "Barb angle between rachis and barb, at the root."]
    curl: Annotated[float, _BENT, "Turning of the barb towards the rachis tip."] = 0.0
    camber: Annotated[float, _BENT, "Turning of the barb towards ventral."] = 0.0
    course: Annotated[
        tuple[tuple[float, float, float], ...],
        ArrayOf(ArrayOf(Number(-360, 360), 3, 3), 0, 200),
        "For a barb that is no arc, what it turns by besides, in degrees from its root: [share of "
        "its length, curl, camber] in ascending shares, smooth between.",
    ] = ()


# of a guide: its fields, and a line that stands for some of them
GUIDE_KEYS = keys_of(BarbGuide)
GUIDE_KEYS |= {
    "angle": replace(
        GUIDE_KEYS["angle"],
        meaning=GUIDE_KEYS["angle"].meaning + " Given wherever there is no `line`.",
        default=None,
    ),
    "line": Key(
        ArrayOf(ArrayOf(Number(-1e4, 1e4), 2, 2), 0, 200),
        "The barb in place of `angle`, `curl` and `course`: a smooth curve through points [x, y] "
        "from its root on, seen from above, x along the shaft to the tip, y away from it, in any "
        "unit, since the outline says where it ends. It is followed within 1 % of its length. "
        "Empty: none.",
        (),
    ),
}


_PLACE = Number(0, 1)
_CURVE = ArrayOf(ArrayOf(_PLACE, 2, 2), 0, 50)


@dataclass(frozen=True)
class Hooked:
    """Share of barbules that are hooked: a curve along the shaft times one along the barbs.

    Each is straight between its points and constant beyond them; without points it is 1.
    """

    rachis: Annotated[
        tuple[tuple[float, float], ...],
        _CURVE,
        "Share of barbules that are hooked, along the shaft: points [share of the vane's length, "
        "share hooked]; empty: all.",
    ] = ()
    barb: Annotated[
        tuple[tuple[float, float], ...],
        _CURVE,
        "The same along each barb from its root (0) to its end (1); both are multiplied.",
    ] = ()


@dataclass(frozen=True)
class Splits:
    """Gaps of a vane that are open from the start, as if torn and never preened.

    pattern: which of the variants is drawn; a groom takes it from the feather's id.
    """

    places: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(_PLACE, 2, 2), 0, 50),
        "Splits at given places: [share of the vane's length, share of the barbs that is split, "
        "from the edge on].",
    ] = ()
    count: Annotated[int, Number(0, 50, whole=True), "Splits that are drawn at random."] = 0
    depth: Annotated[
        float,
        Number(MIN_SPLIT_DEPTH, 1),
        "Share of the barbs that those split, from the vane's edge on.",
    ] = 0.6
    where: Annotated[
        tuple[float, float],
        ArrayOf(_PLACE, 2, 2),
        "Stretch of the vane's length that those are spread over.",
        Default((0.15, 0.9)),
    ] = (0.15, 0.9)
    width: Annotated[
        float,
        Number(0, 0.1),
        "How far all splits gape at the vane's edge at rest, a share of the feather's length.",
    ] = 0.004
    irregularity: Annotated[
        float,
        _PLACE,
        "How unevenly drawn splits are spread, and how much their depths and widths differ.",
    ] = 0.5
    seed: Annotated[int, Number(0, 2**31 - 1, whole=True), "Seed of what is drawn."] = 1
    variants: Annotated[
        int,
        Number(1, 1000, whole=True),
        "Different draws among feathers of a groom, each by its id; few are built faster.",
    ] = 8
    pattern: int = 0


@dataclass(frozen=True)
class VaneShape:
    """One vane at rest, on the flattened feather (before camber, sweep and twist of the rachis).

    guides: at least one where there is an outline. What is made in code has the square ends that
    its outline has; files round them unless they say otherwise. wrap: length of the feather over
    the radius of a sheet across it that barbs lie on, in place of their camber; 0: none.
    """

    outline: Annotated[
        tuple[tuple[float, float], ...],
        ArrayOf(ArrayOf(Number(-0.5, 1.5), 2, 2), 0, 200),
        "Edge of the vane from base to tip as points [x, y]: x is the share of the vane's "
        "length, y (0 or more) the distance from the rachis as a share of the feather's length. "
        "Empty: no vane on this side.",
    ]
    guides: Annotated[
        tuple[BarbGuide, ...],
        ArrayOf(Table(GUIDE_KEYS, "table of a guide"), 0, 100),
        "Barb guides in ascending position; barbs in between are interpolated.",
    ] = ()
    rounded_base: Annotated[
        float,
        Number(0, 1),
        "Share of the vane's length, from where its outline begins, over which barbs grow to the "
        "outline, so that the vane rises from the shaft in a curve; 0: the first barb is whole.",
        Default(0.15),
    ] = 0.0
    rounded_tip: Annotated[
        float,
        Number(0, 1),
        "Share of the vane's length over which an outline that ends away from the shaft is led to "
        "it in a curve; 0: closed square by a straight edge.",
        Default(0.08),
    ] = 0.0
    hooked: Annotated[Hooked, "How much of the vane is hooked together.", Default({})] = Hooked()
    splits: Annotated[Splits, "What of the vane is split from the start.", Default({})] = Splits()
    wrap: float = 0.0

    @property
    def is_split(self) -> bool:
        """True if it has splits from the start."""
        return bool(self.splits.places or self.splits.count)


@dataclass(frozen=True, kw_only=True)
class FeatherKind:
    """A feather at rest, with its materials; every preset and override is already merged."""

    name: str
    length: Annotated[float, Number(1e-3, 5, "m"), "Arc length of the rachis with the calamus."]
    calamus: Annotated[
        float, Number(0, 0.8), "Share of the length that is bare, from the follicle on."
    ] = 0.1
    barb_spacing: Annotated[
        float, Number(1e-5, 0.02, "m"), "Distance of real barbs along the rachis."
    ] = 5e-4
    barb_spacing_exponent: Annotated[
        float,
        Number(0, 1),
        "Power of its size with which the distance of barbs grows where a feather is scaled.",
    ] = 0.0
    thickness_exponent: Annotated[
        float,
        Number(0, 1),
        "Power of its size with which the vane and the shaft's wall thicken where it is scaled.",
    ] = 1.0
    scaling: Annotated[
        str,
        Text(("similar", "behaviour", "fixed_vane")),
        "What follows where a feather is scaled: similar, all thicknesses, of the same keratin "
        "(droop over length goes as the size, frequencies as 1 / size, with a thickness_exponent "
        "of 1); behaviour, moduli grow too, so that it hangs and moves as before, at 1 / "
        "sqrt(size) of the rate; fixed_vane, the shaft alone, and the vane's figures stay as "
        "written.",
    ] = "similar"
    vane_material: Annotated[
        VaneMaterial, Preset("material/vane", keys_of(VaneMaterial)), "Material of both vanes."
    ]
    rachis_material: Annotated[
        RachisMaterial, Preset("material/rachis", keys_of(RachisMaterial)), "Material of the shaft."
    ]
    rachis: Annotated[RachisShape, Table(RACHIS_KEYS), "Shape of the shaft at rest."]
    leading: Annotated[VaneShape, "The leading vane."]
    trailing: Annotated[VaneShape, "The trailing vane."]
    colour: Annotated[Colour, "How it is coloured.", Default({})] = Colour()
    barbs: Annotated[
        BarbLook, "How barbs that are drawn (`--barbs`) differ from smooth ones.", Default({})
    ] = BarbLook()

    @cached_property
    def uncoloured(self) -> FeatherKind:
        """The same without its looks, which nothing that moves or touches depends on."""
        if self.colour == Colour() and self.barbs == BarbLook():
            return self
        return replace(self, colour=Colour(), barbs=BarbLook())

    @property
    def width(self) -> float:
        """m, of both vanes together where each is widest."""
        outlines = (self.leading.outline, self.trailing.outline)
        return self.length * sum(max((y for _, y in each), default=0.0) for each in outlines)

    @property
    def is_split(self) -> bool:
        """True if one of its vanes has splits from the start."""
        return self.leading.is_split or self.trailing.is_split

    @property
    def may_part(self) -> bool:
        """True if its vanes ever have open gaps."""
        return self.vane_material.hooks == "open" or self.is_split

    @property
    def drawn_look(self) -> BarbLook:
        """The look of its barbs in images; vanes that may part are drawn smooth."""
        return BarbLook() if self.may_part else self.barbs

    @property
    def barb_count(self) -> int:
        """Real barbs along each vane."""
        return self.count_barbs(1.0)

    def count_barbs(self, size: float) -> int:
        """Real barbs along each vane of a feather `size` times as large."""
        exponent = 0.0 if self.scaling == "fixed_vane" else self.barb_spacing_exponent
        vane, spacing = self.length * (1.0 - self.calamus), self.barb_spacing
        return max(round(size ** (1.0 - exponent) * vane / spacing), 1)


@dataclass(frozen=True, eq=False)
class Joint(ByValue):
    """A node of the skeleton that carries roots.

    position: (3,). side: +1 on the bird's left, -1 on its right, 0 in the middle (mirrors the
    flap). hinge: (3,) rad, rotation vector against the parent from open (fold 0) to folded (1);
    None where it does not fold. fold: at rest. bone: (3,) m, the middle of a wing's bone that turns
    about it; None: it is no wing's. offset: (3,) m, by which a wing that hangs on a shoulder
    stands off it on the body as it is folded, in the groom's frame.
    """

    name: Annotated[str, "Name, unique in the groom."]
    position: Annotated[Array, POINT, "Pivot at rest."]
    parent: Annotated[str, Text(empty=True), "Name of the parent joint; empty: none."] = ""
    role: Annotated[
        str, Text(("body", "shoulder", "elbow", "wrist")), "What a flap drives it as."
    ] = "body"
    side: Annotated[
        int, Text(("left", "right", "middle")), "Side of the bird.", Default("middle")
    ] = 0
    hinge: Array | None = None
    fold: float = 0.0
    bone: Array | None = None
    offset: Array | None = None


@dataclass(frozen=True, eq=False)
class Turning(ByValue):
    """Turn of a follicle between two joints, while the feather's joint carries its anchor.

    joints: names. fraction: 0 turns with the first, 1 with the second. anchor: (3,) m, in the
    groom's frame at rest; the root turns about it. bow: (6,) screw (rad, m) in the groom's frame
    at rest, of the whole bow of a wing whose second joint is folded (groom/anatomy/sheet.py), which
    the feather carries along; None: it stays flat.
    """

    joints: tuple[str, str]
    fraction: float
    anchor: Array
    bow: Array | None = None


@dataclass(frozen=True, eq=False)
class Placement(ByValue):
    """One feather of a groom.

    id: unique name. kind: merged kind. region: free label, written to USD.
    position: (3,) m, and rotation: (3, 3), columns the feather's x, y, z axes, in the groom's
        frame at rest. joint: name of the joint that carries the root ("" : the groom itself).
    mirrored: whether the feather belongs to the left wing: its leading vane lies at -y of its
        frame, and the rest shape is mirrored at y = 0 (sweep, twist); camber stays ventral.
    skin: path of the mesh that the root sits on ("": the shot's). skin_uv: place on it in texture
        space, instead of the closest one.
    prototype, size: the kind is the prototype `size` times as large; feathers that share a
        prototype differ in size only (None: kind itself).
    rank: place in the order of the stacking values of its coat, a higher one over a lower; -1
        without a leaf.
    grown: whether a region makes it, so that it may grow in a coat.
    turning: how the root turns where it does not go with its joint alone.
    leaf: its leaf in the groom's coat (feather/leaves.py), None: its shape is that of its kind.
    """

    id: str
    kind: FeatherKind
    region: str
    position: Array
    rotation: Array
    joint: str = ""
    mirrored: bool = False
    skin: str = ""
    skin_uv: tuple[float, float] | None = None
    prototype: FeatherKind | None = field(default=None, repr=False)
    size: float = 1.0
    rank: int = -1
    grown: bool = False
    turning: Turning | None = None
    leaf: Any = None


@dataclass(frozen=True)
class Layout:
    """Layering of feathers at rest: the coat that feathers of regions make."""

    thickness: Annotated[
        float,
        Number(0.01, 0.5),
        "Height of the coat over the skin, a share of the length of its feathers: more stands up "
        "steeper, and has room for more layers. Places get 0.75 to 1.2 times as much, by what "
        "their feathers need.",
    ] = 0.08
    gap: Annotated[
        float,
        Number(0, 0.05),
        "Gap between feathers that overlap, a share of their length; where there is no room for "
        "it, it is smaller.",
    ] = 0.0025


@dataclass(frozen=True, repr=False, eq=False)
class Groom(ByValue, Documented):
    """Feathers and their places. Frame: z up, metres.

    layout: None where feathers stay as they were placed. coat: of the feathers of regions, that a
    layout makes (feather/leaves.py), None without. skin: corners (T, 3, 3) m of the meshes that
    regions grow on, None where there are none. drawn_gravity: (3,) m/s^2, under which the
    drawn pose is the balance, None where it is the unloaded shape. inputs: what its files say, by
    key (toml_file.py), for messages. skin_keys: checked keys of [skin], None without it. forward:
    (3,) of the creature, level. document: the tables that it was read from, None after
    `dataclasses.replace`.
    """

    document_kind = "groom"

    name: str
    source: Path
    feathers: tuple[Placement, ...]
    joints: tuple[Joint, ...] = field(default=())
    layout: Layout | None = None
    skin: Array | None = None
    coat: Any = None
    drawn_gravity: Array | None = None
    inputs: Mapping[str, str] = field(default_factory=dict)
    skin_keys: Mapping[str, Any] | None = None
    forward: tuple[float, float, float] = (1.0, 0.0, 0.0)
    document: Document | None = field(default=None, init=False, compare=False)

    def __repr__(self) -> str:
        return f"Groom({self.name!r}, {count_feathers(len(self.feathers))})"


def shading_of(kinds: Iterable[FeatherKind]) -> tuple[str, ...]:
    """Names of SHADING that any of the kinds has."""
    found = {name for kind in kinds for name in kind.colour.shading}
    return tuple(name for name in SHADING if name in found)
