"""Locking: error of a tilted test against the number of elements, for ratios of the moduli.

45 degrees, 13 by 18 mm, 5 % strain: Jouve 2024, figures 4.4 and 4.7, and Jouve et al. 2024,
figure 5. The reference of each ratio is an aligned mesh of about 40,000 elements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from featherfx.errors import InputError, Problem, require
from featherfx.lab.declare import value
from featherfx.lab.vane.sample import Moduli, Sample
from featherfx.lab.vane.traction import Meshing, Model, Traction, pull_test, traction_problems

_SAMPLE = Sample(45.0, 13e-3, 18e-3, 1.2e-4)
_ACROSS, _SHEAR, _STRAIN = 4.8e4, 2.8e4, 0.05
RATIOS = (1.0, 1e2, 1e4, 1e6)
_ELEMENTS = (128, 512, 2048, 8192)
_REFERENCE = 40_000
# Descents on locked meshes pass thousands of shallow minima; they end when a step wins less than
# this share of the energy, which moves their stress by 2 %, against errors of several times it.
_ACCURACY = 1e-3
# unaligned meshes of a higher ratio take descents of minutes beyond this size
_STIFF, _LARGEST_STIFF = 1e3, 2048


class LockingPoint(NamedTuple):
    """ratio: of the moduli along and across. elements: of the mesh. stress: Pa at the strain; nan
    where no equilibrium was found. error: relative to the reference of the ratio. turned: elements
    that are turned over. model: "shell" or "inextensible", whose ratio is infinite."""

    mesh: Meshing
    model: Model
    elements: int
    turned: int
    ratio: float
    stress: float
    error: float


class Reference(NamedTuple):
    """Stress, Pa, of a ratio on the finest mesh, and its elements."""

    ratio: float
    stress: float
    elements: int


@dataclass(frozen=True)
class LockingTest:
    """Aligned and unaligned meshes at 45 degrees and 5 % strain, 13 by 18 mm."""

    ratio: tuple[float, ...] = value("Repeatable.", RATIOS)
    elements: tuple[int, ...] = value("Repeatable.", _ELEMENTS)


@dataclass(frozen=True)
class Locking:
    """points of all meshes; references of all ratios."""

    points: tuple[LockingPoint, ...]
    references: tuple[Reference, ...]

    def error(self, mesh: Meshing, ratio: float) -> list[tuple[int, float]]:
        """(elements, error) of the shell on such meshes at a ratio; infinite: the limit."""
        return [(p.elements, p.error) for p in self.points if (p.mesh, p.ratio) == (mesh, ratio)]


def run_locking(
    ratios: Sequence[float] = RATIOS,
    elements: Sequence[int] = _ELEMENTS,
    reference: int = _REFERENCE,
) -> Locking:
    """Errors on aligned and unaligned meshes, and of the inextensible limit on aligned ones.

    Raises InputError for ratios below 1 or too few elements.
    """
    wrong = [each for each in ratios if not 1.0 <= each <= 1e9]
    problems = [Problem("", "ratio", f"{each:g}: must be 1 to 1e9") for each in wrong]
    for count in (*elements, reference):
        problems += traction_problems(_test(1.0, count, "aligned", "shell"))
    require(*problems)
    points: list[LockingPoint] = []
    references = []
    for ratio in ratios:
        exact, found = _stress(ratio, reference, "aligned", "shell")[:2]
        references.append(Reference(ratio, exact, found))
        for count in elements:
            points.append(_point(ratio, count, "aligned", "shell", exact))
            if ratio < _STIFF or count <= _LARGEST_STIFF:
                points.append(_point(ratio, count, "unaligned", "shell", exact))
    exact, found = _stress(math.inf, reference // 2, "aligned", "inextensible")[:2]
    references.append(Reference(math.inf, exact, found))
    points += [_point(math.inf, count, "aligned", "inextensible", exact) for count in elements]
    return Locking(tuple(points), tuple(references))


def _test(ratio: float, elements: int, mesh: Meshing, model: Model) -> Traction:
    along = _ACROSS * (ratio if math.isfinite(ratio) else 1.0)
    return Traction(_SAMPLE, Moduli(along, _ACROSS, _SHEAR), _STRAIN, 1, elements, mesh, model)


def _stress(ratio: float, elements: int, mesh: Meshing, model: Model) -> tuple[float, int, int]:
    """Pa, elements and turned elements; locked meshes may fold."""
    free = mesh == "unaligned"
    test = _test(ratio, elements, mesh, model)
    pulled = pull_test(test, folding=free, accuracy=_ACCURACY if free else 1e-10)
    turned = pulled.statics.system.turned(pulled.pose.positions)
    return float(pulled.stress[-1]), len(pulled.statics.membrane.nodes), turned


def _point(ratio: float, elements: int, mesh: Meshing, model: Model, exact: float) -> LockingPoint:
    try:
        stress, count, turned = _stress(ratio, elements, mesh, model)
    except InputError:
        stress, count, turned = math.nan, elements, 0
    return LockingPoint(mesh, model, count, turned, ratio, stress, abs(stress / exact - 1.0))
