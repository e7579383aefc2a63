"""Flat plates as feathers, shots of them, and closed forms of how they bend and slide.

A plate is a straight shaft that carries all bending stiffness EI, with a rectangular vane of rigid
barbs that carries all mass, clamped at x = 0 unless it is free. Plates of a stack lie on each other
without friction, a thickness apart, and bend as one beam of the sum of their stiffnesses. With line
weight q, line mass m and length L,

    w = q L^4 / (8 EI)                              tip of a slender cantilever
    W = 1.8751^2 sqrt(EI / (m L^4))                 its first angular frequency without loss
    P = q (6 L^2 - 4 L a + a^2) / (8 a)             force of an edge below it at x = a
    w = q L^4 / (8 EI) - P a^2 (3 L - a) / (6 EI)   tip of a plate that rests on that edge

(Timoshenko and Young 1961; Gere and Timoshenko 1997, appendix G). A material of the modulus
E(p) = E (1 + t p + sum g_i p t_i / (1 + p t_i)) (solver/damping) bends in the shape that it has
without loss, and swings as exp(p s) where

    p^2 + W^2 E(p) / E = 0,      f = Im p / (2 pi)

(correspondence principle: Christensen 1982, chapter 2). A plate slides on a slope s where
tan s > mu, and then with (Coulomb 1785)

    a = g (sin s - mu cos s)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, pi, radians, sin, sqrt
from pathlib import Path

import numpy as np

from featherfx.algebra.types import Array
from featherfx.api import read_quality
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, Groom, Placement, RachisShape, VaneShape
from featherfx.shot.types import Contact, Motion, Shot, Wind
from featherfx.solver.damping import fit_branches

LENGTH, WIDTH = 0.2, 0.04
FRAMES_PER_SECOND = 24.0
# N m^2; m, diameter of the shaft that has it; kg/m^3, of a shaft that weighs nothing
BENDING = 1.2355e-4
_DIAMETER, _WEIGHTLESS = 1e-3, 1.0
# rigid barbs, and barbules that bear nothing
_RIGID_BARB, _SOFT = 1e-2, 1e-6
# eigenvalue of the first mode of a cantilever
_FIRST_MODE = 1.8751040687
# fixed-point iterations of the damped frequency, each of which errs by about the loss factor less
_ROOT_ITERATIONS = 30


@dataclass(frozen=True)
class Plate:
    """A plate. bending: N m^2. density: kg/m^2. height: m, of its middle at the root. x: m, of its
    root. slope: degrees, by which it falls. is_free: whether it flies."""

    bending: float
    density: float
    height: float = 0.0
    x: float = 0.0
    slope: float = 0.0
    is_free: bool = False

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


def frequency_of(plates: Sequence[Plate], loss: float = 0.0) -> float:
    """Return the first frequency (Hz) of plates that bend as one. loss: loss factor."""
    mass, stiffness = sum(p.line_mass for p in plates), sum(p.bending for p in plates)
    lossless = _FIRST_MODE**2 * sqrt(stiffness / (mass * LENGTH**4))
    dashpot, times, weights = fit_branches(loss, RachisMaterial.loss_band)
    p = 1j * lossless
    for _ in range(_ROOT_ITERATIONS):
        stiffer = 1.0 + dashpot * p + (weights * p * times / (1.0 + p * times)).sum()
        p = 1j * lossless * np.sqrt(stiffer)
    return float(p.imag) / (2.0 * pi)


def sliding_of(slope: float, friction: float, gravity: float) -> float:
    """Return the acceleration (m/s^2) down a slope (rad)."""
    return gravity * max(0.0, sin(slope) - friction * cos(slope))


def prop_force(plate: Plate, at: float, gravity: float) -> float:
    """Return the force (N) on a plate of an edge below it at x (m)."""
    load = plate.line_mass * gravity
    return load * (6.0 * LENGTH**2 - 4.0 * LENGTH * at + at**2) / (8.0 * at)


def propped_tip(plate: Plate, at: float, gravity: float) -> float:
    """Return the height (m) of the tip of a plate that rests on an edge at x (m)."""
    lift = prop_force(plate, at, gravity) * at**2 * (3.0 * LENGTH - at) / (6.0 * plate.bending)
    return droop_of([plate], gravity) + lift


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


@dataclass(frozen=True)
class PlateSetup:
    """Surroundings of plates, and how they are solved.

    thickness: m. gravity: m/s^2. incline: rad, of x below the horizon. loss: loss factor.
    tolerance: m, of a step, None: the quality's. steps: common ones a frame, 0: by tolerance.
    """

    thickness: float
    quality: str
    gravity: float = 1.0
    incline: float = 0.0
    friction: float = 0.0
    loss: float = 0.1
    tolerance: float | None = None
    steps: int = 0

    @property
    def weight(self) -> Array:
        """(3,) m/s^2."""
        return self.gravity * np.array([sin(self.incline), 0.0, -cos(self.incline)])


def make_shot(plates: Sequence[Plate], setup: PlateSetup) -> Shot:
    """Return a shot of plates in vacuum, each over those before it."""
    quality = read_quality(setup.quality)
    if setup.tolerance is not None:
        quality = replace(quality, tolerance=setup.tolerance)
    placements = tuple(
        Placement(
            id=f"plate_{k}",
            kind=make_kind(plate, setup.thickness, setup.loss),
            region="plates",
            position=np.array([plate.x, 0.0, plate.height]),
            rotation=_tilted(radians(plate.slope)),
            rank=k,
        )
        for k, plate in enumerate(plates)
    )
    return Shot(
        name="plates",
        source=Path("plates"),
        groom=Groom("plates", Path("plates"), placements),
        first_frame=1,
        last_frame=1000,
        wind=Wind(direction=np.array([1.0, 0.0, 0.0]), speed=0.0, air_density=0.0),
        quality=quality,
        gravity=setup.weight,
        motion=Motion("hold", {}),
        contact=Contact(friction=setup.friction, steps=setup.steps),
        frames_per_second=FRAMES_PER_SECOND,
        sleep=False,
    )


def _tilted(slope: float) -> Array:
    """(3, 3) frame of a plate that falls by a slope (rad)."""
    s, c = sin(slope), cos(slope)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
