"""The vane's membrane beside its bands: shear modulus, slopes at all angles, and the shear band.

Jouve 2024, table 5.2 and figures 5.11 and 5.12. The shear modulus of the membrane is the one whose
tilted test has the slope of the bands'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.errors import Problem, require
from featherfx.lab.declare import out_of_range, part, value
from featherfx.lab.vane.mesh import Order
from featherfx.lab.vane.mesoscale import (
    Bands,
    SwanBands,
    effective_moduli,
    mean_band_slope,
    pull_bands,
    series_shear,
    transverse_stress,
)
from featherfx.lab.vane.sample import FORM, Moduli, Sample, sample_problems, slope, strains
from featherfx.lab.vane.traction import PulledSample, Traction, pull_test

_WIDTH, _ASPECT, _STRAIN, _STEPS = 13e-3, 1.3, 0.05, 1
_ANGLES = (0.0, 15.0, 30.0, 45.0)
_ASPECTS = (1.2, 1.6, 2.2)
_BAND_WIDTH = 9e-3
_ELEMENTS = 8000
# the shear band lies where barbs have moved by these shares of the clamp's way along them
_EDGES = (0.1, 0.9)


@dataclass(frozen=True)
class FittedShear:
    """moduli: of the membrane, Pa. bands_slope, slope: Pa, of both at the angle of the fit.
    series: Pa, shear modulus of the bands in series."""

    moduli: Moduli
    bands_slope: float
    slope: float
    series: float


@dataclass(frozen=True)
class AngleSlopes:
    """angles: degrees. bands, membrane: slopes, Pa. fitted: the membrane's moduli, of which only
    the shear modulus is fitted, at 45 degrees."""

    angles: tuple[float, ...]
    bands: Array
    membrane: Array
    fitted: FittedShear

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        return {
            "angles": self.angles,
            "slope_mesoscale": self.bands,
            "slope_macroscale": self.membrane,
            **asdict(self.fitted.moduli),
            "shear_series_bound": self.fitted.series,
        }


@dataclass(frozen=True)
class AnglesTest:
    """Fit the membrane's shear modulus to bands at 45 degrees; compare at other angles."""

    bands: SwanBands = part()
    angle: tuple[float, ...] = value("Repeatable.", _ANGLES)
    aspect: tuple[float, ...] = value("Repeatable.", _ASPECTS)


@dataclass(frozen=True)
class ShearBand:
    """A tilted test of one aspect ratio (height over width) in both models. width_bands,
    width_membrane: m, of the shear band across the barbs; width_corners: m, between the barbs
    through the two corners. bands, membrane: the pulled samples, for pictures."""

    aspect: float
    width_bands: float
    width_membrane: float
    width_corners: float
    bands: PulledSample
    membrane: PulledSample

    def as_json(self) -> dict[str, Any]:
        """Plain values by key, SI units."""
        return {
            "aspect": self.aspect,
            "width_mesoscale": self.width_bands,
            "width_macroscale": self.width_membrane,
            "width_between_corners": self.width_corners,
        }


def tilted_sample(angle: float, width: float = _WIDTH, aspect: float = _ASPECT) -> Sample:
    """The sample of the fits."""
    return Sample(angle, width, width * aspect)


def fit_shear(
    bands: Bands,
    order: Order = 2,
    *,
    largest: float = _STRAIN,
    barbs_times: float = 1.0,
) -> FittedShear:
    """Shear modulus of the membrane from a tilted test of bands.

    largest: strain. For comparison only: order 1, bands of three-node triangles, too stiff in
    bending; barbs_times, the factor by which the barbs of the bands, not of the membrane, are
    stiffened: a large one keeps them from bending. Raises InputError.
    """
    require(*out_of_range(bands, form=FORM))
    sample, strain = tilted_sample(45.0), strains(largest, max(_STEPS, round(largest / _STRAIN)))
    stiffened = replace(bands, barb=barbs_times * bands.barb)
    target = mean_band_slope(sample, stiffened, strain, order)
    guesses = [series_shear(bands), 1.2 * series_shear(bands)]
    found = [_membrane_slope(sample, effective_moduli(bands, each), strain) for each in guesses]
    for _ in range(3):
        rate = (found[-1] - found[-2]) / (guesses[-1] - guesses[-2])
        guesses.append(guesses[-1] + (target - found[-1]) / rate)
        found.append(_membrane_slope(sample, effective_moduli(bands, guesses[-1]), strain))
        if abs(found[-1] / target - 1.0) < 1e-5:
            break
    moduli = effective_moduli(bands, guesses[-1])
    return FittedShear(moduli, target, found[-1], series_shear(bands))


def angle_slopes(bands: Bands, angles: Sequence[float] = _ANGLES) -> AngleSlopes:
    """Slopes of bands and membrane at angles, the shear modulus fitted at 45 degrees.

    Raises InputError for angles at which barbs join both clamps.
    """
    samples = [tilted_sample(float(angle)) for angle in angles]
    problems = [problem for each in samples for problem in sample_problems(each)]
    problems += [
        Problem("", "angle", f"{each.angle:g}: barbs join both clamps, must be below the diagonal")
        for each in samples
        if each.regime != "free"
    ]
    require(*problems)
    fitted = fit_shear(bands)
    strain = strains(_STRAIN, _STEPS)
    by_bands, by_membrane = [], []
    for sample in samples:
        if sample.angle == 0.0:
            by_bands.append(slope(strain, transverse_stress(bands, strain, rigid=False)))
        elif sample.angle == 45.0:
            by_bands.append(fitted.bands_slope)
        else:
            by_bands.append(mean_band_slope(sample, bands, strain))
        by_membrane.append(_membrane_slope(sample, fitted.moduli, strain))
    return AngleSlopes(tuple(angles), np.array(by_bands), np.array(by_membrane), fitted)


def shear_bands(
    bands: Bands, moduli: Moduli, aspects: Sequence[float] = _ASPECTS
) -> tuple[ShearBand, ...]:
    """Tilted tests of several aspect ratios, above 1, in both models. Raises InputError."""
    wrong = [each for each in aspects if not 1.0 < each <= 5.0]
    require(*(Problem("", "aspect", f"{each:g}: must be above 1 to 5") for each in wrong))
    found = []
    for aspect in aspects:
        sample = tilted_sample(45.0, _BAND_WIDTH, aspect)
        strain = strains(_STRAIN, _STEPS)
        meso = pull_bands(sample, replace(bands, shift=0.25), strain)
        macro = pull_test(Traction(sample, moduli, _STRAIN, _STEPS, _ELEMENTS))
        corners = sample.height * sample.across[1] + sample.width * sample.across[0]
        widths = [band_width(sample, each) for each in (meso, macro)]
        found.append(ShearBand(aspect, widths[0], widths[1], float(corners), meso, macro))
    return tuple(found)


def band_width(sample: Sample, pulled: PulledSample) -> float:
    """m, across the barbs, over which barbs go from one clamp's motion to the other's.

    Measured between 10 and 90 % of the motion and scaled to the whole, as if it were even.
    """
    rest = pulled.statics.membrane.points
    moved = (pulled.pose.positions - rest) @ sample.barb
    place = rest @ sample.across
    rows, inverse = np.unique(np.round(place / sample.height, 7), return_inverse=True)
    mean = np.bincount(inverse, moved) / np.bincount(inverse)
    moved_by = np.maximum.accumulate(mean / mean.max())
    low, high = np.interp(_EDGES, moved_by, rows * sample.height)
    return float((high - low) / (_EDGES[1] - _EDGES[0]))


def _membrane_slope(sample: Sample, moduli: Moduli, strain: Array) -> float:
    return pull_test(Traction(sample, moduli, float(strain[-1]), len(strain), _ELEMENTS)).slope
