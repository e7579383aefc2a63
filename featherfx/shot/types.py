"""A shot: what happens to a groom over time, and what comes out of it frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.types import Groom
from featherfx.shot.detail.view import TimedCamera
from featherfx.shot.motion.skin import BoundSkin
from featherfx.shot.read.sources import TimedSurface, TimedWind

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Quality:
    """How finely a feather is resolved.

    rows: rachis rows, columns: barb columns a side, of the meshes and, where nothing else is said,
    of what is simulated. coefficients: curvature coefficients per barb and direction (0: rigid
    barbs; -1: chosen by the solver). tolerance: m, error per frame that the sub-stepping aims at.
    max_substeps: most sub-steps per frame. radius: of the integrator, 0 to 0.9
    (featherfx/solver/solver.py). simulated_rows: 0: as the meshes; -1: chosen by the
    solver, at most as many. coarse_below, rachis_below, guided_below, rigid_below: m, feathers
    shorter than that are simulated with less detail (shot/detail/detail.py). guided_every: of
    those that are guided by their length, every n-th is a guide.
    """

    name: str
    rows: int
    columns: int
    coefficients: int
    tolerance: float
    max_substeps: int
    simulated_rows: int = 0
    coarse_below: float = 0.0
    rachis_below: float = 0.0
    rigid_below: float = 0.0
    radius: float = 0.0
    guided_below: float = 0.0
    guided_every: int = 8


@dataclass(frozen=True)
class Detail:
    """How finely some feathers are simulated, whatever their length.

    feathers, region, kind: patterns with * and ? as wild cards; all three must fit. level: "full",
    "coarse", "rachis", "guided" or "rigid". every, spacing: of guided feathers, every n-th is a
    guide (0: none), and, with a spacing (m), no more guides than leave no feather farther from one.
    """

    feathers: str
    level: str
    region: str = "*"
    kind: str = "*"
    every: int = 8
    spacing: float | None = None


@dataclass(frozen=True)
class Shelter:
    """How much of the air's motion against the roots the plumage keeps off some feathers.

    share: 0 (none) to 1. feathers, region, kind: patterns, as in Detail.
    """

    feathers: str
    share: float
    region: str = "*"
    kind: str = "*"


@dataclass(frozen=True)
class LevelOfDetail:
    """How levels of detail follow what is seen (featherfx/shot/detail/levels.py).

    camera: None: all feathers are seen at pixels_per_metre. image_height: pixels. coarse_below,
    rachis_below, guided_below, rigid_below: pixels of a feather's length in the picture. outside:
    level of feathers outside the picture, widened by margin (share of it) on every side. motion:
    weight of the root's acceleration in gravities. fade: frames of a change, at least.
    """

    camera: TimedCamera | None
    pixels_per_metre: float
    image_height: float
    coarse_below: float
    rachis_below: float
    guided_below: float
    rigid_below: float
    outside: str
    margin: float
    motion: float
    fade: int


@dataclass(frozen=True)
class Wind:
    """A wind field: a mean wind with seeded gusts that travel with it.

    direction: (3,) unit. speed: m/s. gust: share of the speed, root mean square of the gusts.
    gust_length: m, size of the eddies. air_density: kg/m^3. seed: of the gusts.
    drag_normal, drag_tangential: force coefficients of the vane across and along its surface.
    """

    direction: Array
    speed: float
    gust: float
    gust_length: float
    air_density: float
    drag_normal: float
    drag_tangential: float
    seed: int


@dataclass(frozen=True)
class Grip:
    """A material point that is led along a path by a stiff spring.

    feather: id. row: rachis row as a share 0..1. column: share 0..1 of the barb (0: the rachis).
    side: "leading" or "trailing". displacement: (3,) m in the groom's frame, reached from start
    to end (s) with zero velocity at both. stiffness: N/m.
    """

    feather: str
    row: float
    column: float
    side: str
    displacement: Array
    start: float
    end: float
    stiffness: float


@dataclass(frozen=True)
class Contact:
    """How feathers touch each other.

    thickness: m, distance of two vanes' middle surfaces that touch; None: by the vanes' materials.
    friction: Coulomb's coefficient. steps: common steps of all feathers per frame; 0: by the
    quality's tolerance.
    """

    thickness: float | None
    friction: float
    steps: int


@dataclass(frozen=True)
class Force:
    """A dead force: it keeps its direction, however the feather turns.

    feather: id. force: (3,) N in the groom's frame, of a line N/m. line: "point", "rachis" or
    "barb". row: share 0..1 of the rachis's arc length, and column: share 0..1 of the barb there
    (0: the rachis), of a point; of a barb the row alone. side: "leading" or "trailing". span:
    shares of rachis or barb between which a line's force acts. keys: ((s, factor), ...), ascending
    times, linear between them and constant outside; none: always the whole force.
    """

    feather: str
    force: Array
    line: str
    row: float
    column: float
    side: str
    span: tuple[float, float]
    keys: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Motion:
    """kind: "hold", "flap", "shake", "keys" or "skin"; values: the merged numbers of that kind."""

    kind: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Shot:
    """All that a bake needs. frames: first and last, inclusive. gravity: (3,) m/s^2.

    skin: the groom's roots on their skin, where the motion is of kind "skin". wind_source: added to
    wind. colliders: meshes that feathers touch where there is contact. contact: None: feathers pass
    through each other and through colliders. level_of_detail: None: levels do not change. cycle:
    frames after which what acts repeats, 0 where it does not.
    """

    name: str
    source: Path
    groom: Groom
    first_frame: int
    last_frame: int
    frames_per_second: float
    motion: Motion
    wind: Wind
    quality: Quality
    gravity: Array
    grips: tuple[Grip, ...] = field(default=())
    forces: tuple[Force, ...] = field(default=())
    details: tuple[Detail, ...] = field(default=())
    settle: bool = True
    sleep: bool = True
    coast: bool = True
    cycle: int = 0
    skin: BoundSkin | None = None
    wind_source: TimedWind | None = None
    colliders: tuple[TimedSurface, ...] = ()
    contact: Contact | None = None
    level_of_detail: LevelOfDetail | None = None
    shelters: tuple[Shelter, ...] = ()


@dataclass(frozen=True)
class Frame:
    """One frame of every feather, world frame, handed to a sink.

    number: frame number; fractional between two frames. time: s since the first frame.
    points, velocities, accelerations: per feather (n, P, 3), the material points
        (featherfx/feather/types.py) and their first and second rates per second; accelerations
        may be empty.
    """

    number: float
    time: float
    points: tuple[Array, ...]
    velocities: tuple[Array, ...]
    accelerations: tuple[Array, ...] = field(default=())


def sample_number(first: int, index: int, subframes: int) -> float:
    """Frame number of a sample, 0 at the first frame; the same for the same place in time.

    Whole frames are integers. The fraction is divided by itself, so that the number does not
    depend on where the counting began.
    """
    whole, part = divmod(index, subframes)
    return first + whole + part / subframes if part else first + whole
