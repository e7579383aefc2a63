"""A rectangular sample of a vane between two clamps, and the measures of a traction test.

    strain  e = ((1 + d/H)^2 - 1) / 2,      stress  s = H / (W b (H + d)) f

d displacement of the upper clamp, f force on it, both along y; W, H, b width, height and thickness
of the sample. They are the Green-Lagrange strain and the second Piola-Kirchhoff stress of a sample
that deforms uniformly without change of width. Source: Jouve et al. 2024, eq. 1 and 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, isclose, isfinite, radians, sin
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem

Array = NDArray[np.float64]
Regime = Literal["free", "diagonal", "bridged"]

# how near a corner's barb must pass by the opposite corner to count as joining both
SAME = 1e-9
SIZES = {"width": (1e-5, 1.0), "height": (1e-5, 1.0), "thickness": (1e-7, 0.01)}


@dataclass(frozen=True)
class Sample:
    """A sample that is held along y = 0 and pulled at y = height; its sides are free.

    angle: degrees, from the x axis to the barbs, -90 to 90. width, height, thickness: m.
    """

    angle: float
    width: float
    height: float
    thickness: float = 1.2e-4

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
        """Whether barbs join the clamps: none ("free"), one, the diagonal, or many ("bridged").

        A barb climbs the height H within the width W where tan(angle) exceeds H / W.
        """
        climb = self.width * abs(_sin(self.angle))
        need = self.height * _cos(self.angle)
        if isclose(climb, need, abs_tol=SAME * hypot(self.width, self.height)):
            return "diagonal"
        return "bridged" if climb > need else "free"


@dataclass(frozen=True)
class Moduli:
    """Moduli of the vane membrane, Pa: along the barbs, across them, and in shear (stress over
    engineering shear)."""

    along: float
    across: float
    shear: float

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
    problems = [
        _problem(source, name, value, f"{low:g} to {high:g} m{_hint(name, value, high)}")
        for name, (low, high) in SIZES.items()
        if not low <= (value := getattr(sample, name)) <= high
    ]
    if not -90.0 <= sample.angle <= 90.0:
        problems.append(_problem(source, "angle", sample.angle, "-90 to 90 degrees"))
    return problems


def moduli_problems(moduli: Moduli, source: str = "") -> list[Problem]:
    """Every modulus that is not above zero."""
    return [
        _problem(source, name, value, "above 0 Pa")
        for name in ("along", "across", "shear")
        if not (isfinite(value := getattr(moduli, name)) and value > 0.0)
    ]


def strain_problems(strain: float, steps: int, source: str = "") -> list[Problem]:
    """A largest strain or a number of steps that no sample can take."""
    problems = []
    if not (-0.5 < strain <= 2.0) or strain == 0.0:
        allowed = "above -0.5 (height zero: every element inverts) to 2, not 0"
        problems.append(_problem(source, "strain", strain, allowed))
    if not 1 <= steps <= 1000:
        problems.append(_problem(source, "steps", steps, "1 to 1000"))
    return problems


def require(*problems: Problem) -> None:
    """Raises InputError if there are problems."""
    if problems:
        raise InputError(*problems)


def _problem(source: str, key: str, value: float, allowed: str) -> Problem:
    return Problem(source, key, f"{value:g} is not allowed, must be {allowed}")


def _hint(name: str, value: float, high: float) -> str:
    if not (isfinite(value) and value > high):
        return ""
    unit = "micrometres" if name == "thickness" and value >= 5.0 else "millimetres"
    return f"; is this in {unit}?"


def _cos(degrees: float) -> float:
    return 0.0 if abs(degrees) == 90.0 else cos(radians(degrees))


def _sin(degrees: float) -> float:
    return sin(radians(degrees))
