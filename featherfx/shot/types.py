"""A shot: what happens to a groom over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, ByValue
from featherfx.errors import count_feathers, require_type
from featherfx.files.content import shot_settings
from featherfx.groom.document import Document, Documented
from featherfx.groom.keys.preset import PRESET_FAMILIES, UNSCALED_CLOCK, Clock, Quality, Wind
from featherfx.groom.keys.values import ArrayOf, Default, Number, Text, vector
from featherfx.groom.types import Groom
from featherfx.limits import MAX_CLUMPS
from featherfx.shot.frames import MAX_RATE, MIN_RATE, NO_CUTS, FrameCuts
from featherfx.shot.roots import NO_RUN_UP, RunUp

if TYPE_CHECKING:
    from featherfx.shot.skin import BoundSkin, SkinSurfaces
    from featherfx.shot.sources import TimedCamera, TimedSurface, TimedWind

LEVELS = ("full", "coarse", "rachis", "guided", "rigid")
# those at which nothing is solved
UNSOLVED_LEVELS = LEVELS[3:]

_PART = Number(0, 1)
_PATTERNS = ArrayOf(Text(), 1, 1000)
_PIXELS = Number(0, 1e6)
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
        int,
        Number(1, MAX_CLUMPS, whole=True),
        "Number of clumps along each vane; a look control.",
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


@dataclass(frozen=True)
class LevelOfDetail:
    """Levels of detail by size in the image (featherfx/shot/detail/guides.py).

    camera: None: all feathers are seen at pixels_per_metre.
    """

    camera: TimedCamera | None = None
    pixels_per_metre: Annotated[
        float | None,
        Number(1e-3, 1e9, "1/m"),
        "Without a camera: all feathers are seen at this scale.",
    ] = None
    image_height: Annotated[float, Number(1, 100_000), "Height of the image in pixels."] = 1080.0
    coarse_below: Annotated[
        float,
        _PIXELS,
        "Feathers that are shorter than this in all frames, in pixels of the image, are coarse.",
    ] = 80.0
    rachis_below: Annotated[float, _PIXELS, "Of shorter ones only the shaft is simulated."] = 0.0
    guided_below: Annotated[
        float, _PIXELS, "Shorter ones follow simulated feathers of their region."
    ] = 30.0
    rigid_below: Annotated[float, _PIXELS, "Shorter ones follow their roots."] = 6.0
    outside: Annotated[
        str, Text(LEVELS), "Level of feathers that are outside the image in all frames."
    ] = "rigid"
    margin: Annotated[
        float, Number(0, 10), "Fraction of the image by which it is widened on every side."
    ] = 0.1
    motion: Annotated[
        float,
        Number(0, 100),
        "Sizes count 1 + this times the acceleration of root or tip, in gravities; 0: only what is "
        "seen counts.",
    ] = 0.5


@dataclass(frozen=True)
class Contact:
    """Contact of feathers with each other, the skin and colliders."""

    thickness: Annotated[
        float | None,
        Number(1e-6, 0.1, "m"),
        "Distance of the middle surfaces of two vanes that touch; default: the vanes' thickness.",
    ] = None
    friction: Annotated[float, Number(0, 2), "Coulomb's coefficient of friction."] = 0.3
    steps: Annotated[
        int,
        Number(0, 10_000, whole=True),
        "Steps per frame that all feathers take together; 0: by the quality's tolerance.",
    ] = 0
    max_steps: Annotated[
        int,
        Number(1, 4096, whole=True),
        "Most regular steps per frame where `steps` is 0, and most that a feather divides one "
        "of them into; more for what tears or is struck.",
    ] = 32
    regions: Annotated[
        tuple[str, ...],
        _PATTERNS,
        "Regions whose feathers touch, with * and ? as wild cards; others pass through everything.",
    ] = ("*",)
    kinds: Annotated[
        tuple[str, ...], _PATTERNS, "Kinds whose feathers touch, as regions; both must fit."
    ] = ("*",)
    skin: Annotated[
        bool,
        "Whether feathers are kept off the skin that they grow on, where a shot has one: pushed by "
        "it, and laid above it in what is written.",
    ] = True
    obstacles: Annotated[
        bool,
        "Whether guided and rigid feathers push those that are simulated, but for the guides that "
        "they follow; nothing pushes them.",
    ] = True


@dataclass(frozen=True)
class Motion:
    """kind: one of groom.keys.preset.MOTIONS, or "skin"; values: the merged values of that kind,
    the `parts` of an act being Motions."""

    kind: str
    values: dict[str, Any]
    clock: Clock = UNSCALED_CLOCK

    @property
    def of_limbs(self) -> bool:
        """Return whether it may stand beside a skin, which moves the body: of it the limbs
        count."""
        return self.kind in ("fold", "flap", "act")

    @property
    def moves_skin(self) -> bool:
        """Return whether it carries a skin, or drives the joints of its skeleton."""
        values = self.values if self.kind == "act" else {}
        return values.get("body") == "act" or bool(values.get("joints"))


class MeasuredGrid(NamedTuple):
    """Levels of SPACE and TIME (shot/options) that a feather was measured to need, its error there
    over the length, and whether finer settings come nearer to each other."""

    space: int
    time: int
    error: float
    is_unique: bool


@dataclass(frozen=True, repr=False, eq=False)
class Shot(ByValue, Documented):
    """All that a bake needs. first_frame, last_frame: both baked. gravity: (3,).

    skin: the groom's roots on their skin, where the motion is of kind "skin"; surfaces: what they
    are to be bound to, until shot/loop/placement.py has done so. exposure: (F,) to the wind, of
    feathers on a skin (loop/shelter.py). wind_source: added to wind. time_codes_per_second: of
    what is written; None: frames_per_second.
    colliders: meshes that feathers touch where there is contact. contact: None: feathers pass
    through each other and through colliders. run_up: how what moves is brought up from rest before
    0. frame_cuts: those that are named or found, in the frame loop.
    level_of_detail: None: levels do not follow a camera. grids: by the ids of feathers, instead of
    measuring them. inputs: what the shot's files say, by key
    (groom/read/toml_text.py). document: the tables that it was read from, None after
    `dataclasses.replace`.
    """

    document_kind = "shot"

    name: str
    source: Path
    groom: Groom
    first_frame: int
    last_frame: int
    frames_per_second: Annotated[
        float,
        Number(MIN_RATE, MAX_RATE, "1/s"),
        "Frames per second; default: the time codes per second of the skin's stage, or of the "
        "first other stage, else 24.",
        Default(None),
    ]
    motion: Annotated[
        Motion,
        PRESET_FAMILIES["motion"],
        "Motion of the roots: a preset, or a table with or without base.",
        Default("hold"),
    ]
    wind: Annotated[
        Wind,
        PRESET_FAMILIES["wind"],
        "Wind: a preset, or a table with or without base.",
        Default("calm"),
    ]
    quality: Annotated[
        Quality,
        PRESET_FAMILIES["quality"],
        "Resolution: a preset, or a table with or without base.",
        Default("preview"),
    ]
    gravity: Annotated[
        Array,
        vector(-1000, 1000, "m/s^2"),
        "Acceleration of free fall.",
        Default((0.0, 0.0, -9.81)),
    ]
    grips: tuple[Grip, ...] = field(default=())
    forces: tuple[Force, ...] = field(default=())
    details: tuple[Detail, ...] = field(default=())
    sleep: Annotated[
        bool, "Whether feathers at rest are skipped until root, wind, grip or force wakes them."
    ] = True
    cycle: Annotated[
        int,
        Number(0, 1_000_000, "frames", whole=True),
        "Frames after which the motion repeats: a flock replays so many of this bird. 0: all.",
    ] = 0
    settle: Annotated[
        bool, "Whether feathers hang in balance at the first frame, instead of at rest."
    ] = True
    preroll: Annotated[
        int,
        Number(0, 1000, "frames", whole=True),
        "Frames before the first in which roots that move there are brought up from rest: from the "
        "first frame's pose a fifth of these frames back along the way that leads to it, and "
        "forth. 0: feathers begin in balance, carried by their roots.",
    ] = 12
    handles: Annotated[
        int,
        Number(0, 100, "frames", whole=True),
        "Frames that are written beyond both ends, for shutters that open before a frame or close "
        "after it. The cache's range stays that of `frames`.",
    ] = 0
    cuts: Annotated[
        tuple[int, ...] | None,
        ArrayOf(Number(-1_000_000, 1_000_000, whole=True), 0, 1000),
        "Frames at which everything is cut to another pose, the first of each; default: those that "
        "no smooth motion explains. []: there are none.",
    ] = None
    run_up: RunUp = NO_RUN_UP
    frame_cuts: FrameCuts = NO_CUTS
    skin: BoundSkin | None = None
    surfaces: SkinSurfaces | None = None
    exposure: Array | None = None
    wind_source: TimedWind | None = None
    time_codes_per_second: float | None = None
    colliders: tuple[TimedSurface, ...] = ()
    contact: Contact | None = None
    level_of_detail: LevelOfDetail | None = None
    shelters: tuple[Shelter, ...] = ()
    preens: tuple[Preen, ...] = ()
    wets: tuple[Wet, ...] = ()
    detachments: tuple[Detachment, ...] = ()
    channels: tuple[Channel, ...] = ()
    targets: tuple[Target, ...] = ()
    grids: Mapping[str, MeasuredGrid] | None = None
    inputs: Mapping[str, str] = field(default_factory=dict)
    document: Document | None = field(default=None, init=False, compare=False)

    def __repr__(self) -> str:
        frames = f"frames {self.first_frame} to {self.last_frame}"
        return f"Shot({self.name!r}, {count_feathers(len(self.groom.feathers))}, {frames})"

    def with_quality(self, quality: str | Quality) -> Shot:
        """Return it at another quality, a preset's name or a value. Raises InputError."""
        require_type("quality", quality, str | Quality, "a preset's name, or a Quality")
        if not isinstance(quality, str):
            return replace(self, quality=quality)
        from featherfx.groom.presets.presets import read_quality

        document = self.written_document().with_tables({"quality": quality})
        chosen = read_quality(quality, document.preset_folders)
        return replace(self, quality=chosen).documented(document)

    @cached_property
    def settings(self) -> dict[str, str]:
        """Everything that its simulation depends on, by key; takes as long as a frame."""
        return shot_settings(self)

    @property
    def has_coat_on_skin(self) -> bool:
        """Return whether feathers lie on the leaves of a coat, on a skin."""
        return self.skin is not None and self.groom.coat is not None

    @property
    def has_moving_roots(self) -> bool:
        """Return whether anything moves roots."""
        return self.skin is not None or self.motion.kind != "hold" or bool(self.channels)

    @property
    def has_slipping_hooks(self) -> bool:
        """Return whether hooks of any feather may slip."""
        kinds = (feather.kind for feather in self.groom.feathers)
        return any(kind.vane_material.hooks != "closed" or kind.is_split for kind in kinds)

    @property
    def has_sheltered_feathers(self) -> bool:
        """Return whether some feathers lie so that less of the wind reaches them."""
        return self.exposure is not None and bool((self.exposure != 1.0).any())

    def skin_corners(self) -> Array | None:
        """(T, 3, 3) m, at rest: what regions grow on, or else what roots are bound to."""
        if self.groom.skin is not None:
            return np.asarray(self.groom.skin)
        if self.skin is None:
            return None
        surfaces = {id(part.surface): part.surface for part in self.skin.parts}
        return np.concatenate([each.rest[each.triangles] for each in surfaces.values()])

    def time_of(self, frame: float | None) -> float:
        """s since the first frame; None: the first."""
        return 0.0 if frame is None else (frame - self.first_frame) / self.frames_per_second
