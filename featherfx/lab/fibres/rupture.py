"""`lab rupture`: a square of skin is pulled until it tears (Jacquemoud 2007, sections 4.5, 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from featherfx.errors import Problem
from featherfx.lab.declare import POSITIVE, Range, out_of_range, require, value
from featherfx.lab.fibres.law import EXPONENT, STIFFNESS, Fibre
from featherfx.lab.fibres.specimen import Pulled, Specimen, pull

# rows and columns of the specimens of section 4.5; of the 24 elements only the number is printed
SHAPES = {1: (1, 1), 9: (3, 3), 24: (6, 4)}
# weak elements, counted from 1 along the rows from the fixed clamp: figure 4-12, appendix 8
WEAK = {9: (6, 5), 24: (12, 11)}
# (C_c, C_r) of the sections with narrow (4.5) and with wide (4.6) distributions of fibres
NARROW, WIDE = (1.36, 1.41), (1.34, 1.44)
FURTHEST = 0.3


@dataclass(frozen=True)
class RuptureTest:
    """Pull a square of fibrous membrane (skin) until its fibres break, past the peak."""

    elements: int = value("Elements: 1, 9 or 24.", 1)
    sigma: float = value(
        "rad, deviation of the fibres' directions.", pi / 2, Range(0.01, 100.0, unit="rad")
    )
    mu: float = value(
        "rad, main direction of the fibres; pi/2: along the pull.", pi / 2, Range(-10, 10)
    )
    critical: float | None = value(
        "Square of the stretch at which a fibre yields; without: 1.36 for a sigma up to 1, else "
        "1.34, as published.",
        None,
        Range(1.0, 4.0, above=True),
    )
    release: float | None = value(
        "Square of the stretch at which it breaks; without: 1.41 or 1.44.",
        None,
        Range(1.0, 4.0, above=True),
    )
    stiffness: float = value("Pa, of the fibres (a).", STIFFNESS, POSITIVE)
    exponent: float = value("Exponent of the fibres (b).", EXPONENT, Range(0.0, 100.0, above=True))
    weak: int = value("Elements with another main direction, 0 to 2.", 0, Range(0, 2))
    weak_mu: float = value("rad, their main direction.", pi / 3, Range(-10, 10))
    scatter: float = value(
        "rad, deviation of the main direction from element to element (published: 1.4).",
        0.0,
        Range(0.0, 10.0),
    )
    seed: int = value("Of the scatter.", 0, Range(0, 2**31))
    step: float = value(
        "m, in the space of all displacements (published: 5e-5 to 1e-4).",
        5e-5,
        Range(1e-7, 1e-3),
    )
    fibres: int = value("Directions of fibres at each point.", 1571, Range(8, 20000))

    def fibre(self) -> Fibre:
        """The law of its fibres."""
        critical, release = NARROW if self.sigma <= 1.0 else WIDE
        return Fibre(
            critical if self.critical is None else self.critical,
            release if self.release is None else self.release,
            self.stiffness,
            self.exponent,
        )

    def means(self) -> np.ndarray:
        """(rows, columns) rad, main directions."""
        shape = SHAPES[self.elements]
        rng = np.random.default_rng(self.seed)
        means = self.mu + self.scatter * rng.normal(size=shape)
        for number in WEAK.get(self.elements, ())[: self.weak]:
            means.flat[number - 1] = self.weak_mu
        return means


@dataclass(frozen=True)
class Rupture:
    """path: equilibria, unloaded first. fibre: their law. weakest: element that lost most fibres
    at the end, counted from 1."""

    path: Sequence[Pulled]
    fibre: Fibre
    weakest: int

    @property
    def peak(self) -> Pulled:
        """The equilibrium of the largest stress."""
        return max(self.path, key=lambda each: each.stress)

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        return {
            "plateau_stress": self.fibre.plateau,
            "peak_stress": self.peak.stress,
            "strain_at_peak": self.peak.strain,
            "strain": [each.strain for each in self.path],
            "stress": [each.stress for each in self.path],
            "intact": [float(each.intact.mean()) for each in self.path],
            "weakest_element": self.weakest,
            "intact_at_end": self.path[-1].intact,
        }


def run_rupture(test: RuptureTest) -> Rupture:
    """InputError for values out of range."""
    problems = out_of_range(test, "rupture")
    if test.elements not in SHAPES:
        allowed = ", ".join(str(each) for each in SHAPES)
        problems.append(Problem("rupture", "elements", f"{test.elements}; allowed: {allowed}"))
    elif test.weak > 0 and test.elements not in WEAK:
        problems.append(Problem("rupture", "weak", "one element alone has no weaker neighbour"))
    fibre = test.fibre()
    if not problems and fibre.release < fibre.critical:
        text = f"{fibre.release:g}; allowed: {fibre.critical:g} (critical) or more"
        problems.append(Problem("rupture", "release", text))
    require(*problems)
    specimen = Specimen(fibre, test.means(), test.sigma, fibres=test.fibres)
    path = list(pull(specimen, test.step, FURTHEST))
    return Rupture(path, fibre, int(np.argmin(path[-1].intact)) + 1)
