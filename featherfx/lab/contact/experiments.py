"""Plates that lie on each other and bear each other's load, beside their closed forms.

The tips of a stack droop and swing as that of one beam (plates.py), if contact carries.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from featherfx.algebra.types import Array
from featherfx.api import simulate
from featherfx.errors import require
from featherfx.lab.contact.plates import (
    BENDING,
    Plate,
    droop_of,
    frequency_of,
    make_shot,
)
from featherfx.lab.declare import Range, out_of_range, value
from featherfx.shot.frames import Frame

Case = Literal["plates", "stack"]

_GRAVITY, _DENSITY = 1.0, 0.1
# kg/m^2, of plates of a stack that weigh next to nothing
_LIGHT = 1e-4
# steps a frame and frames of plates that are let go, and their loss factor
_STEPS, _FRAMES, _LOSS = 16, 48, 0.1
_FRAMES_PER_SECOND = 24.0


@dataclass(frozen=True)
class ContactTest:
    """Let plates droop on each other, and let them go.

    plates: a soft one on one four times as stiff. stack: n alike, of which the top one alone weighs
    anything.
    """

    case: Case = value("plates: two of different stiffness. stack: n, the top one loaded.")
    n: int = value("Plates of a stack.", 2, Range(1, 50))
    thickness: float = value("m, of a plate.", 5e-4, Range(1e-6, 0.01, unit="m"))
    quality: str = value("Preset of the quality.", "preview")


@dataclass(frozen=True)
class ContactRun:
    """Outcome of a ContactTest.

    droop: m, mean height of the tips over their rest once settled; droop_exact: of one beam.
    frequency: Hz, of the tips once let go from the straight pose; frequency_exact: of one beam.
    weight: N, of all plates. depth: m, deepest that settled plates are in each other.
    """

    droop: float
    droop_exact: float
    frequency: float
    frequency_exact: float
    weight: float
    depth: float


def run_contact(test: ContactTest) -> ContactRun:
    """Run a test. Raises InputError with every wrong value."""
    require(*out_of_range(test))
    plates = make_plates(test)
    shot = make_shot(plates, test.thickness, test.quality, 1, _GRAVITY, _LOSS)
    simulation = simulate(shot)
    settled = _tips(simulation, plates)
    free = make_shot(
        plates, test.thickness, test.quality, _FRAMES, _GRAVITY, _LOSS, settle=False, steps=_STEPS
    )
    return ContactRun(
        droop=float(settled[0].mean()),
        droop_exact=droop_of(plates, _GRAVITY),
        frequency=_measure_frequency(_tips(simulate(free), plates).mean(axis=1)),
        frequency_exact=frequency_of(plates),
        weight=_GRAVITY * sum(plate.mass for plate in plates),
        depth=float(simulation.report["contact"]["depth_after_settling"]),
    )


def make_plates(test: ContactTest) -> list[Plate]:
    """Return the plates of a test, the lowest first."""
    t = test.thickness
    if test.case == "plates":
        return [Plate(4.0 * BENDING, _DENSITY, 0.0), Plate(BENDING, _DENSITY, t)]
    loaded = 0.4 * _DENSITY * test.n
    density = [*(_LIGHT for _ in range(test.n - 1)), loaded]
    return [Plate(BENDING, each, k * t) for k, each in enumerate(density)]


def _tips(frames: Iterable[Frame], plates: list[Plate]) -> Array:
    """(T, P) m, heights of the plates' tips over their rest in all frames."""
    rest = [plate.height for plate in plates]
    return np.array([[points[-1, 0, 2] for points in frame.points] for frame in frames]) - rest


def _measure_frequency(heights: Array) -> float:
    """Return the frequency (Hz) of a damped swing (T,) m that begins at rest."""
    from scipy.optimize import curve_fit

    times = np.arange(len(heights)) / _FRAMES_PER_SECOND

    def swing(t: Array, middle: float, decay: float, frequency: float) -> Array:
        swung = np.exp(-decay * t) * np.cos(2.0 * np.pi * frequency * t)
        return np.asarray(middle * (1.0 - swung))

    middle = float(heights.mean())
    tried = [
        curve_fit(swing, times, heights, [middle, 1.0, each], full_output=True, maxfev=4000)
        for each in np.linspace(2.0, 6.0, 5)
    ]
    best = min(tried, key=lambda found: float(np.square(found[2]["fvec"]).sum()))
    return float(best[0][2])
