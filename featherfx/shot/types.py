"""A shot: what happens to a groom over time, and what comes out of it frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from featherfx.groom.types import Groom
from featherfx.shot.scenes import Surface, TimedWind
from featherfx.shot.skin_motion import BoundSkin

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Quality:
    """How finely a feather is resolved.

    rows: rachis rows, columns: barb columns a side, coefficients: curvature coefficients per
    barb and direction (0: rigid barbs; -1: chosen by the solver). tolerance: m, error per frame
    that the sub-stepping aims at. max_substeps: most sub-steps per frame.
    """

    name: str
    rows: int
    columns: int
    coefficients: int
    tolerance: float
    max_substeps: int


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
class Motion:
    """kind: "hold", "flap", "shake", "keys" or "skin"; values: the merged numbers of that kind."""

    kind: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Shot:
    """All that a bake needs. frames: first and last, inclusive. gravity: (3,) m/s^2.

    skin: the groom's roots on their skin, where the motion is of kind "skin". wind_source: added to
    wind. colliders: meshes that feathers touch where there is contact. contact: None: feathers pass
    through each other and through colliders.
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
    settle: bool = True
    sleep: bool = True
    skin: BoundSkin | None = None
    wind_source: TimedWind | None = None
    colliders: tuple[Surface, ...] = ()
    contact: Contact | None = None


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
