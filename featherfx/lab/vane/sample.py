"""A rectangular sample of a vane between two clamps, and the measures of a traction test.

    strain  e = ((1 + d/H)^2 - 1) / 2,      stress  s = H / (W b (H + d)) f

d displacement of the upper clamp, f force on it, both along y; W, H, b width, height and thickness
of the sample. They are the Green-Lagrange strain and the second Piola-Kirchhoff stress of a sample
that deforms uniformly without change of width. Source: Jouve et al. 2024, eq. 1 and 2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, hypot, inf, isclose, isfinite, radians, sin
from typing import Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem
from featherfx.lab.declare import Range, out_of_range, value

Regime = Literal["free", "diagonal", "bridged"]

# how near a corner's barb must pass by the opposite corner to count as joining both
_SAME = 1e-9
_SIZE, _THICKNESS = Range(1e-5, 1.0, unit="m"), Range(1e-7, 0.01, unit="m")
_MODULUS = Range(0.0, above=True, unit="Pa")
FORM = "{value:g} is not allowed. Give {allowed}"


@dataclass(frozen=True)
class Sample:
    """A sample that is held along y = 0 and pulled at y = height; its sides are free."""

    angle: float = value(
        "Degrees from the x axis to the barbs.", allowed=Range(-90.0, 90.0, unit="degrees")
    )
    width: float = value("m.", allowed=_SIZE)
    height: float = value("m, between the clamps.", allowed=_SIZE)
    thickness: float = value("m.", 1.2e-4, _THICKNESS)

    @property
    def barb(self) -> Array:
        """(2,) unit vector along the barbs."""
        return np.array([_cos(self.angle), _sin(self.angle)])

    @property
    def across(self) -> Array:
        """(2,) unit vector across the barbs, a quarter turn from `barb`."""
        return np.array([-_sin(self.angle), _cos(self.angle)])

    @property
    def regime(self) -> Regime:
        """Class of a sample by barbs that join the clamps: none ("free"), the diagonal, "bridged".

        A barb climbs the height H within the width W where tan(angle) exceeds H / W.
        """
        climb = self.width * abs(_sin(self.angle))
        need = self.height * _cos(self.angle)
        if isclose(climb, need, abs_tol=_SAME * hypot(self.width, self.height)):
            return "diagonal"
        return "bridged" if climb > need else "free"


@dataclass(frozen=True)
class Moduli:
    """Moduli of the vane membrane, Pa: along the barbs, across them, and in shear (stress over
    engineering shear)."""

    along: float = value("Pa.", allowed=_MODULUS)
    across: float = value("Pa.", allowed=_MODULUS)
    shear: float = value("Pa.", allowed=_MODULUS)

    def as_array(self) -> Array:
        """(3,) along, across, shear."""
        return np.array([self.along, self.across, self.shear])


def isotropic(modulus: float) -> Moduli:
    """Moduli of a material of this Young's modulus (Pa) without Poisson effect."""
    return Moduli(modulus, modulus, 0.5 * modulus)


def displacement(strain: float, height: float) -> float:
    """Displacement of the clamp, m, at a strain above -1/2."""
    return height * (float(np.sqrt(1.0 + 2.0 * strain)) - 1.0)


def stress(force: float, moved: float, sample: Sample) -> float:
    """Stress, Pa, of a force (N) on the clamp that has moved by `moved` (m)."""
    area = sample.width * sample.thickness
    return force * sample.height / (area * (sample.height + moved))


def slope(strain: Array, stresses: Array) -> float:
    """Least-squares slope through the origin, Pa, of stresses (n,) over strains (n,)."""
    return float(strain @ stresses / (strain @ strain))


def strains(largest: float, steps: int) -> Array:
    """(steps,) equal steps of strain up to the largest, without zero."""
    return largest * np.arange(1, steps + 1) / steps


def sample_problems(sample: Sample, source: str = "") -> list[Problem]:
    """Every value of the sample that is out of its range."""
    found = out_of_range(sample, source, FORM)
    return [
        replace(each, message=each.message + _hint(each.key, getattr(sample, each.key)))
        for each in found
    ]


def strain_problems(strain: float, steps: int) -> list[Problem]:
    """A largest strain or a number of steps that no sample can take."""
    problems = []
    if not (-0.5 < strain <= 2.0) or strain == 0.0:
        allowed = "above -0.5 (height zero: every element inverts) to 2, not 0"
        problems.append(Problem("", "strain", FORM.format(value=strain, allowed=allowed)))
    if not 1 <= steps <= 1000:
        problems.append(Problem("", "steps", FORM.format(value=steps, allowed="1 to 1000")))
    return problems


def _hint(name: str, found: float) -> str:
    high = {"thickness": _THICKNESS.high, "angle": inf}.get(name, _SIZE.high)
    if not (isfinite(found) and found > high):
        return ""
    unit = "micrometres" if name == "thickness" and found >= 5.0 else "millimetres"
    return f". Is this in {unit}?"


def _cos(degrees: float) -> float:
    return 0.0 if abs(degrees) == 90.0 else cos(radians(degrees))


def _sin(degrees: float) -> float:
    return sin(radians(degrees))
