"""Flat plates as feathers, and shots of them.

A plate is a straight shaft that carries all bending stiffness EI, with a rectangular vane of rigid
barbs that carries all mass, clamped at x = 0. Plates of a stack lie on each other, a thickness
apart, and bend as one beam of the sum of their stiffnesses. With line weight q and length L, the
tip of a slender cantilever droops by

    w = q L^4 / (8 EI),     and swings at     f = 1.8751^2 / (2 pi) sqrt(EI / (m L^4))

(Timoshenko and Young 1961), m its line mass.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path

import numpy as np

from featherfx.api import read_quality
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, Groom, Placement, RachisShape, VaneShape
from featherfx.shot.types import Contact, Motion, Shot, Wind

LENGTH, WIDTH = 0.2, 0.04
# N m^2; m, diameter of the shaft that has it; kg/m^3, of a shaft that weighs nothing
BENDING = 1.2355e-4
_DIAMETER, _WEIGHTLESS = 1e-3, 1.0
# rigid barbs, and barbules that bear nothing
_RIGID_BARB, _SOFT = 1e-2, 1e-6
# eigenvalue of the first mode of a cantilever
_FIRST_MODE = 1.8751040687


@dataclass(frozen=True)
class Plate:
    """A plate. bending: N m^2. density: kg/m^2. height: m, of its middle at rest."""

    bending: float
    density: float
    height: float

    @property
    def line_mass(self) -> float:
        """kg/m."""
        return self.density * WIDTH + _WEIGHTLESS * 0.25 * pi * _DIAMETER**2

    @property
    def mass(self) -> float:
        """kg."""
        return self.line_mass * LENGTH


def droop_of(plates: Sequence[Plate], gravity: float) -> float:
    """Return the droop (m, upwards) of the tip of plates that bend as one."""
    load, stiffness = sum(p.line_mass for p in plates), sum(p.bending for p in plates)
    return -load * gravity * LENGTH**4 / (8.0 * stiffness)


def frequency_of(plates: Sequence[Plate]) -> float:
    """Return the first frequency (Hz) of plates that bend as one."""
    mass, stiffness = sum(p.line_mass for p in plates), sum(p.bending for p in plates)
    return _FIRST_MODE**2 / (2.0 * pi) * sqrt(stiffness / (mass * LENGTH**4))


def make_kind(plate: Plate, thickness: float, loss: float) -> FeatherKind:
    """Return the feather kind of a plate. thickness: m, of the vane. loss: loss factor."""
    young = plate.bending * 64.0 / (pi * _DIAMETER**4)
    barbs = (BarbGuide(position=0.0, angle=90.0), BarbGuide(position=1.0, angle=90.0))
    edge = 0.5 * WIDTH / LENGTH
    vane = VaneShape(outline=((0.0, edge), (1.0, edge)), guides=barbs)
    return FeatherKind(
        name="plate",
        length=LENGTH,
        calamus=0.0,
        vane_material=VaneMaterial(
            modulus_along_barbs=1e6,
            modulus_across_barbs=_SOFT,
            shear_modulus=0.0,
            thickness=thickness,
            surface_density=plate.density,
            barb_bending_normal=_RIGID_BARB,
            barb_bending_in_plane=_RIGID_BARB,
            bending_across=0.0,
            loss_factor=loss,
        ),
        rachis_material=RachisMaterial(
            youngs_modulus=young,
            shear_modulus=0.5 * young,
            cortex_fraction=1.0,
            cortex_density=_WEIGHTLESS,
            loss_factor=loss,
        ),
        rachis=RachisShape(diameter_base=_DIAMETER, diameter_tip=_DIAMETER),
        leading=vane,
        trailing=vane,
    )


def make_shot(
    plates: Sequence[Plate],
    thickness: float,
    quality: str,
    frames: int,
    gravity: float,
    loss: float = 0.1,
    steps: int = 0,
    settle: bool = True,
) -> Shot:
    """Return a shot of plates in vacuum, without friction, each over those before it.

    steps: common ones a frame, 0 by tolerance. settle: whether they hang in balance at first.
    """
    placements = tuple(
        Placement(
            id=f"plate_{k}",
            kind=make_kind(plate, thickness, loss),
            region="plates",
            position=np.array([0.0, 0.0, plate.height]),
            rotation=np.eye(3),
            rank=k,
        )
        for k, plate in enumerate(plates)
    )
    return Shot(
        name="plates",
        source=Path("plates"),
        groom=Groom("plates", Path("plates"), placements),
        first_frame=1,
        last_frame=frames,
        wind=Wind(direction=np.array([1.0, 0.0, 0.0]), speed=0.0, air_density=0.0),
        quality=read_quality(quality),
        gravity=np.array([0.0, 0.0, -gravity]),
        motion=Motion("hold", {}),
        contact=Contact(friction=0.0, steps=steps),
        frames_per_second=24.0,
        settle=settle,
    )
