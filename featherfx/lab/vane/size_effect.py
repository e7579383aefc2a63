"""Size effect: barbs pressed along their length bend, and bending depends on their width.

The sample is pressed along its barbs; N is its width over the barb spacing. The barbs buckle
within the vane, so what they carry is their bending: with their width w at a fixed share of the
spacing the force of a barb goes with w^3, the stress with w^2. Jouve 2024, appendix A.3, figures
A.5 and A.6: ratio of the moduli 6.2e4, strain down to -3 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from featherfx.errors import InputError, Problem
from featherfx.lab.declare import require
from featherfx.lab.vane.descent import NoEquilibrium
from featherfx.lab.vane.elements import membrane
from featherfx.lab.vane.mesoscale import Bands, band_mesh
from featherfx.lab.vane.sample import Sample, displacement, stress
from featherfx.lab.vane.statics import Pose, Statics
from featherfx.lab.vane.traction import clamped

Array = NDArray[np.float64]

RATIO, BARB, FRACTION = 6.2e4, 2.43e9, 0.14
SIZE = 13e-3
COUNTS = (8, 12, 16, 25)
STRAIN, STEPS = -0.03, 3
# sideways deflection of the start from which the barbs are let go, as a share of the height
PUSH = 0.02


@dataclass(frozen=True)
class SizeEffect:
    """counts: (k,) N, width over barb spacing. strain: (n,). stress_over_barb_modulus:
    (k, n). constant, quadratic: of the fit constant + quadratic / N^2 to the last stresses; the
    constant is what the barbules hold. unexplained: 1 - R^2 of that fit."""

    counts: tuple[int, ...]
    strain: Array
    stress_over_barb_modulus: Array
    constant: float
    quadratic: float
    unexplained: float


def run_size_effect(counts: Sequence[int] = COUNTS, fraction: float = FRACTION) -> SizeEffect:
    """Press square samples of N barbs each. Raises InputError for fewer than 4 barbs or 3 N."""
    wrong = [n for n in counts if not 4 <= n <= 60]
    require(*(Problem("", "counts", f"{n} is not allowed, must be 4 to 60") for n in wrong))
    require(*([Problem("", "counts", "needs three or more")] if len(set(counts)) < 3 else []))
    strain = STRAIN * np.arange(1, STEPS + 1) / STEPS
    stresses = np.array([_press(n, fraction, strain) for n in counts]) / BARB
    last, inverse = stresses[:, -1], np.array(counts, dtype=float) ** -2
    quadratic, constant = np.polyfit(inverse, last, 1)
    left = float(np.var(last - constant - quadratic * inverse) / np.var(last))
    return SizeEffect(tuple(counts), strain, stresses, float(constant), float(quadratic), left)


def _press(count: int, fraction: float, strain: Array) -> Array:
    """(n,) Pa."""
    sample = Sample(90.0, SIZE, SIZE)
    bands = Bands(fraction, SIZE / count, BARB, BARB / RATIO)
    mesh, moduli = band_mesh(sample, bands)
    body = membrane(sample, mesh, moduli, 2)
    statics = Statics(body, clamped(sample, body))
    rest = body.points
    top = rest[:, 1] >= sample.height
    # the straight sample is an equilibrium too, an unstable one: start aside of it
    share = rest[:, 1] / sample.height
    aside = PUSH * sample.height * np.sin(np.pi * share) ** 2
    pose: Pose = statics.rest()
    first = displacement(float(strain[0]), sample.height)
    begin = rest + np.column_stack([aside, first * share])
    pose = Pose(begin, statics.stresses(begin), pose.tensions)
    found = []
    for value in strain:
        moved = displacement(float(value), sample.height)
        try:
            pose = statics.descend(pose, rest + np.outer(top, [0.0, moved]))
        except NoEquilibrium as error:
            message = f"{count}: no equilibrium at the strain {value:g}: {error}"
            raise InputError(Problem("", "counts", message)) from error
        force = float(statics.forces(pose)[top, 1].sum())
        found.append(stress(force, moved, sample))
    return np.array(found)
