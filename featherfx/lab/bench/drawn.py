"""Feathers of random cases, far beyond what grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from featherfx.errors import InputError
from featherfx.feather.build import build_feather
from featherfx.feather.types import Feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape

# share of cases with narrow vanes, and of vanes that are missing
_SLIVERS, _MISSING = 0.15, 0.12
# barb bending over that of a plate of the barb modulus, measured on swan feathers
_BARB_OVER_PLATE = 4.8


@dataclass(frozen=True)
class Drawn:
    """A random feather. ratio: barb over across modulus, 1 to 1e8; rachis: factor on the shaft's
    stiffness, 1e-4 to 1e4; sliver: whether its vanes are narrow."""

    feather: Feather
    kind: FeatherKind
    ratio: float
    rachis: float
    sliver: bool


def log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is evenly spread."""
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def draw_feather(random: np.random.Generator, rows: int, columns: int) -> Drawn:
    """A feather of 5 mm to 2 m; shapes that cannot be built are drawn again."""
    while True:
        drawn = _draw_kind(random)
        kind, ratio, rachis, sliver = drawn
        try:
            return Drawn(build_feather(kind, rows, columns), kind, ratio, rachis, sliver)
        except InputError:
            continue


def _draw_kind(random: np.random.Generator) -> tuple[FeatherKind, float, float, bool]:
    length = log_uniform(random, 5e-3, 2.0)
    ratio, rachis = log_uniform(random, 1.0, 1e8), log_uniform(random, 1e-4, 1e4)
    sliver = bool(random.random() < _SLIVERS)
    base = 0.017 * length * log_uniform(random, 0.3, 2.0)
    shape = RachisShape(
        diameter_base=base,
        diameter_tip=base * log_uniform(random, 0.02, 1.0),
        taper=random.uniform(0.3, 2.0),
        camber=random.uniform(-30.0, 90.0),
        sweep=random.uniform(-30.0, 90.0),
        twist=random.uniform(-60.0, 60.0),
    )
    kind = FeatherKind(
        name="stress",
        length=length,
        calamus=float(random.choice([0.0, 0.05, 0.15, 0.4])),
        barb_spacing=5e-4,
        rachis=shape,
        leading=_draw_vane(random, sliver),
        trailing=_draw_vane(random, sliver),
        vane_material=_draw_vane_material(random, ratio),
        rachis_material=_draw_rachis_material(random, rachis),
    )
    return kind, ratio, rachis, sliver


def _draw_vane(random: np.random.Generator, sliver: bool) -> VaneShape:
    if random.random() < _MISSING:
        return VaneShape((), ())
    width = log_uniform(random, 2e-4, 5e-3) if sliver else random.uniform(0.005, 0.2)
    outline = (
        (0.0, width * float(random.choice([0.0, 0.5]))),
        (random.uniform(0.05, 0.2), width * random.uniform(0.6, 1.0)),
        (random.uniform(0.4, 0.6), width),
        (random.uniform(0.8, 0.9), width * random.uniform(0.3, 0.9)),
        (random.uniform(0.97, 1.05), 0.0),
    )
    base = random.uniform(10.0, 90.0)
    tip = random.uniform(10.0, base)
    camber = random.uniform(-20.0, 60.0)
    guides = tuple(
        BarbGuide(position, angle, random.uniform(-0.2, 0.6) * angle, camber)
        for position, angle in ((0.0, base), (0.5, 0.5 * (base + tip)), (1.0, tip))
    )
    return VaneShape(outline, guides)


def _draw_vane_material(random: np.random.Generator, ratio: float) -> VaneMaterial:
    thickness = log_uniform(random, 1e-5, 1e-3)
    across = log_uniform(random, 1e3, 1e6)
    bending = _BARB_OVER_PLATE * ratio * across * thickness**3 / 12.0
    return VaneMaterial(
        modulus_along_barbs=ratio * across,
        modulus_across_barbs=across,
        shear_modulus=across * log_uniform(random, 0.05, 2.0),
        thickness=thickness,
        surface_density=400.0 * thickness,
        barb_bending_normal=bending,
        barb_bending_in_plane=bending * log_uniform(random, 1.0, 100.0),
        barb_taper=random.uniform(0.0, 3.0),
        bending_across=across * thickness**3 / 12.0,
        loss_factor=float(random.choice([0.0, 0.02, 0.3])),
    )


def _draw_rachis_material(random: np.random.Generator, factor: float) -> RachisMaterial:
    return RachisMaterial(
        youngs_modulus=5e9 * factor,
        shear_modulus=1.5e9 * factor,
        cortex_fraction=random.uniform(0.05, 1.0),
        flattening=random.uniform(0.3, 1.5),
        cortex_density=1300.0,
        core_density=100.0,
        loss_factor=float(random.choice([0.0, 0.02, 0.3])),
    )
