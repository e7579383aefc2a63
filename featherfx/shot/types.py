"""A shot: what happens to a groom over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np

from featherfx.algebra.types import Array, ByValue, Indices
from featherfx.errors import count_feathers, require_type
from featherfx.files.disk_cache import shot_settings
from featherfx.groom.document import Document, Documented
from featherfx.groom.keys.preset import PRESET_FAMILIES, UNSCALED_CLOCK, Clock, Quality, Wind
from featherfx.groom.keys.values import ArrayOf, Default, Number, Text, vector
from featherfx.groom.types import Groom, Placement
from featherfx.shot.frames import MAX_RATE, MIN_RATE, NO_CUTS, FrameCuts
from featherfx.shot.patterns import (
    LEVELS,
    Channel,
    Detachment,
    Detail,
    Force,
    Grip,
    Preen,
    Shelter,
    Target,
    Wet,
    last_fitting,
)
from featherfx.shot.roots import NO_RUN_UP, RunUp

if TYPE_CHECKING:
    from featherfx.shot.skin import BoundSkin, SkinSurfaces
    from featherfx.shot.sources import TimedCamera, TimedSurface, TimedWind

_PATTERNS = ArrayOf(Text(), 1, 1000)
_PIXELS = Number(0, 1e6)


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


def may_touch(shot: Shot, contact: Contact) -> list[bool]:
    """Return of every feather whether it touches others: not those that leave their roots."""
    placements = shot.groom.feathers
    detachments = last_fitting(shot.detachments, placements)
    return [
        touches(contact, p) and rule < 0 for p, rule in zip(placements, detachments, strict=True)
    ]


def touches(contact: Contact, placement: Placement) -> bool:
    """Return whether a feather touches others and colliders."""
    return any(fnmatchcase(placement.region, each) for each in contact.regions) and any(
        fnmatchcase(placement.kind.name, each) for each in contact.kinds
    )


def part_of(shot: Shot, chosen: Indices) -> Shot:
    """The shot with some of its feathers, by their numbers (K,) in ascending order."""
    groom = replace(shot.groom, feathers=tuple(shot.groom.feathers[k] for k in chosen))
    skin = shot.skin and shot.skin.some(chosen)
    exposure = None if shot.exposure is None else shot.exposure[chosen]
    return replace(shot, groom=groom, skin=skin, exposure=exposure)
