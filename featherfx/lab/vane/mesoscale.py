"""The vane at the scale of its barbs: stiff and soft bands, isotropic and without Poisson effect.

    longitudinal  s = (P E_B + (1 - P) E_b) e                                        (5.2)
    transverse    s = E_b m (m^2 - 1) / (2 l),  m = (l - P) / (1 - P),  l = sqrt(1 + 2 e)

P share of the barbs in the surface, E_B and E_b moduli of barbs and barbules, e and s strain and
stress of traction; in the transverse case barbs are taken as rigid, and m is the stretch of the
barbules: Jouve 2024, eq. 5.4 in other letters. With barbs of finite stiffness the stretches of both
bands follow from P l_B + (1 - P) l_b = l and E_B l_B (l_B^2 - 1) = E_b l_b (l_b^2 - 1).

The bands are meshed with six-node triangles, one layer across each, which bend as beams do:
E_B w^3 / 12 per thickness. Three-node triangles, as in Jouve 2024, are too stiff in bending, the
more the longer they are.

The vane's membrane beside its bands: shear modulus, slopes at all angles, and the shear band.

Jouve 2024, table 5.2 and figures 5.11 and 5.12. The shear modulus of the membrane is the one whose
tilted test has the slope of the bands'.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from featherfx.algebra.types import Array, Flags
from featherfx.errors import Problem, require
from featherfx.lab.declare import Range, out_of_range, part, value
from featherfx.lab.vane.sample import (
    FORM,
    Membrane,
    Mesh,
    Moduli,
    Sample,
    aligned_mesh,
    corner_rows,
    displacement,
    isotropic,
    membrane,
    sample_problems,
    slope,
    strain_problems,
    strains,
)
from featherfx.lab.vane.statics import MembranePose, Statics
from featherfx.lab.vane.traction import PulledSample, Traction, clamped, pull, pull_test

# strips thinner than this share of the barb spacing are merged with their neighbour
_SLIVER = 0.02
# nodes along a barb, per barb spacing
_NODES = 1.5
# strain to which the slopes of transverse tests were fitted, and the number of points of the fit
TRANSVERSE_STRAIN, FIT_POINTS = 0.4, 200
# Pa, slopes of a swan's longitudinal and transverse tests
_SWAN = (3.6e8, 4.8e4)


@dataclass(frozen=True)
class Bands:
    """barb_fraction: share of the surface. barb_spacing: m, from barb to barb. barb, barbule:
    Young's moduli, Pa. shift: of all bands across the barbs, as a share of the spacing, from the
    place where the bands are symmetric about the middle of a sample."""

    barb_fraction: float = value("Share of the surface.", allowed=Range(0.01, 0.9))
    barb_spacing: float = value("m.", allowed=Range(1e-5, 0.02))
    barb: float = value("Pa.", allowed=Range(1.0, 1e13))
    barbule: float = value("Pa.", allowed=Range(1.0, 1e13))
    shift: float = 0.0


@dataclass(frozen=True)
class SwanBands:
    """Bands whose moduli, where they are not given, are those that have a swan's slopes."""

    barb_fraction: float = value("Share of the surface.", 0.14)
    barb_spacing: float = value("m.", 5e-4)
    barb: float | None = value("Pa.  [default: fitted to 3.6e8 Pa along the barbs]", None)
    barbule: float | None = value("Pa.  [default: fitted to 4.8e4 Pa across them]", None)

    def bands(self) -> Bands:
        """Raises InputError."""
        wanted = Bands(self.barb_fraction, self.barb_spacing, self.barb or 1.0, self.barbule or 1.0)
        require(*out_of_range(wanted, form=FORM))
        fitted = fitted_bands(*_SWAN, self.barb_fraction, self.barb_spacing)
        return replace(
            fitted,
            barb=fitted.barb if self.barb is None else self.barb,
            barbule=fitted.barbule if self.barbule is None else self.barbule,
        )


def longitudinal_stress(bands: Bands, strain: Array) -> Array:
    """Eq. 5.2; Pa, of strains (n,)."""
    fraction = bands.barb_fraction
    return (fraction * bands.barb + (1.0 - fraction) * bands.barbule) * strain


def transverse_stress(bands: Bands, strain: Array, *, rigid: bool = True) -> Array:
    """Pa, of strains (n,); rigid: eq. 5.4, else with barbs of finite stiffness."""
    fraction = bands.barb_fraction
    whole = np.sqrt(1.0 + 2.0 * strain)
    soft = (whole - fraction) / (1.0 - fraction)
    if not rigid:
        for _ in range(50):
            target = bands.barbule * soft * (soft**2 - 1.0) / bands.barb
            stiff = _stretch_of(target)
            soft = (whole - fraction * stiff) / (1.0 - fraction)
    return bands.barbule * soft * (soft**2 - 1.0) / (2.0 * whole)


def fitted_bands(longitudinal: float, transverse: float, fraction: float, spacing: float) -> Bands:
    """Bands with the given slopes, Pa, of a longitudinal and of a transverse test up to 0.4."""
    strain = np.linspace(0.0, TRANSVERSE_STRAIN, FIT_POINTS + 1)[1:]
    unit = Bands(fraction, spacing, 1.0, 1.0)
    barbule = transverse / slope(strain, transverse_stress(unit, strain))
    barb = (longitudinal - (1.0 - fraction) * barbule) / fraction
    return Bands(fraction, spacing, barb, barbule)


def series_shear(bands: Bands) -> float:
    """Pa, shear modulus of the two bands in series, without bending of barbs: a lower bound."""
    fraction = bands.barb_fraction
    return 0.5 / (fraction / bands.barb + (1.0 - fraction) / bands.barbule)


def band_mesh(sample: Sample, bands: Bands, triangle: float = 0.0) -> tuple[Mesh, Array]:
    """Mesh and moduli (M, 3), Pa, of a sample with a barb in the middle, or two about it.

    triangle: m, length of three-node triangles along the bands; 0: that of six-node ones.
    """
    rows, stiff = band_rows(sample, bands)
    mesh = aligned_mesh(sample, rows, triangle or bands.barb_spacing / _NODES)
    moduli = np.array([isotropic(bands.barbule).as_array(), isotropic(bands.barb).as_array()])
    return mesh, moduli[stiff[mesh.strip].astype(int)]


def band_rows(sample: Sample, bands: Bands) -> tuple[Array, Flags]:
    """(R,) m, rows on all borders of bands and through all corners; (R - 1,) whether barb."""
    corners = corner_rows(sample)
    low, high = corners[0], corners[-1]
    spacing, half = bands.barb_spacing, 0.5 * bands.barb_spacing * bands.barb_fraction
    count = max(1, round((high - low) / spacing))
    middle = 0.5 * (low + high)
    places = middle + spacing * (np.arange(-1, count + 1) - 0.5 * (count - 1) + bands.shift)
    borders = np.concatenate([places - half, places + half])
    tiny = _SLIVER * spacing * bands.barb_fraction
    inner = borders[(borders > low + tiny) & (borders < high - tiny)]
    inner = inner[np.min(np.abs(inner[:, None] - corners), axis=1) > tiny]
    rows = np.sort(
        np.concatenate([inner, corners[np.concatenate([[True], np.diff(corners) > tiny])]])
    )
    centre = 0.5 * (rows[1:] + rows[:-1])
    return rows, np.min(np.abs(centre[:, None] - places), axis=1) < half


def pull_bands(sample: Sample, bands: Bands, strain: Array, triangle: float = 0.0) -> PulledSample:
    """Pull a sample of bands through the strains (n,); triangle: of band_mesh."""
    mesh, moduli = band_mesh(sample, bands, triangle)
    body = membrane(sample, mesh, moduli, 1 if triangle else 2)
    return pull(sample, Statics(body, clamped(sample, body)), strain)


@dataclass(frozen=True)
class BandTest:
    """Pull a sample of bands; at 0 and 90 degrees beside the closed forms.

    At 0 and 90 degrees the sample is rounded to whole barb spacings.
    """

    sample: Sample = part("thickness", angle=0.0, width=13e-3, height=16.9e-3)
    bands: SwanBands = part()
    strain: float = value("Largest, along y.", 0.05)
    steps: int = value("Equal steps of strain.", 4)


def run_bands(test: BandTest) -> dict[str, Any]:
    """Plain values by key, SI units: strain, stress, slope, closed_form (stress, at 0 and 90
    degrees), and size of the problem. Raises InputError."""
    bands = test.bands.bands()
    require(*sample_problems(test.sample), *strain_problems(test.strain, test.steps))
    begin, sample, closed = time.perf_counter(), test.sample, None
    strain = strains(test.strain, test.steps)
    if sample.regime == "diagonal":
        require(
            Problem(
                "",
                "angle",
                f"{sample.angle:g}: one barb joins both clamps, and the system is singular",
            )
        )
    if abs(sample.angle) in (0.0, 90.0):
        sample = whole_periods(sample, bands)
        form = transverse_stress if sample.angle == 0.0 else longitudinal_stress
        closed = form(bands, strain).tolist()
    pulled = pull_bands(sample, bands, strain)
    return {
        "strain": strain.tolist(),
        "stress": pulled.stress.tolist(),
        "slope": pulled.slope,
        "closed_form": closed,
        "barb": bands.barb,
        "barbule": bands.barbule,
        "regime": sample.regime,
        "elements": len(pulled.statics.membrane.nodes),
        "unknowns": pulled.statics.unknowns,
        "iterations": pulled.pose.iterations,
        "seconds": time.perf_counter() - begin,
    }


def mean_band_slope(sample: Sample, bands: Bands, strain: Array, triangle: float = 0.0) -> float:
    """Pa, slope of a traction test of bands, averaged over their places in the sample.

    How many gaps lie between the last barb of one clamp and the first of the other depends on where
    the barbs happen to lie; shifts of a quarter and three quarters mirror each other.
    """
    slopes = [
        pull_bands(sample, replace(bands, shift=shift), strain, triangle).slope
        for shift in (0.0, 0.25, 0.5)
    ]
    return 0.25 * slopes[0] + 0.5 * slopes[1] + 0.25 * slopes[2]


def effective_moduli(bands: Bands, shear: float) -> Moduli:
    """Moduli of the vane whose longitudinal and transverse slopes are those of the bands."""
    strain = np.linspace(0.0, TRANSVERSE_STRAIN, FIT_POINTS + 1)[1:]
    along = (bands.barb_fraction * bands.barb) + (1.0 - bands.barb_fraction) * bands.barbule
    return Moduli(along, slope(strain, transverse_stress(bands, strain)), shear)


def whole_periods(sample: Sample, bands: Bands) -> Sample:
    """The sample with its height (angle 0) or width (angle 90) rounded to whole barb spacings, so
    that the share of barbs in it is that of the bands."""
    spacing = bands.barb_spacing
    if sample.angle == 0.0:
        return replace(sample, height=max(1, round(sample.height / spacing)) * spacing)
    return replace(sample, width=max(1, round(sample.width / spacing)) * spacing)


def _stretch_of(target: Array) -> Array:
    """Root l > 0.6 of l (l^2 - 1) = target, near 1, by Newton's iterations."""
    found = np.ones_like(target)
    for _ in range(30):
        found -= (found * (found**2 - 1.0) - target) / (3.0 * found**2 - 1.0)
    return found


_RATIO, _BARB, _FRACTION = 6.2e4, 2.43e9, 0.14
_SIZE = 13e-3
_SQUARE = Sample(90.0, _SIZE, _SIZE)
_COUNTS = (8, 12, 16, 25)
_STRAIN, _STEPS = -0.03, 3
# of the coarse mesh of the membrane, along and across
_CELLS = 12
# sideways deflection of the start from which the barbs are let go, as a share of the height
_PUSH = 0.02


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


def run_size_effect(counts: Sequence[int] = _COUNTS, fraction: float = _FRACTION) -> SizeEffect:
    """Press square samples of N barbs each. Raises InputError for fewer than 4 barbs or 3 N."""
    wrong = [n for n in counts if not 4 <= n <= 60]
    require(*(Problem("", "counts", f"{n} is not allowed, must be 4 to 60") for n in wrong))
    require(*([Problem("", "counts", "needs three or more")] if len(set(counts)) < 3 else []))
    strain = _STRAIN * np.arange(1, _STEPS + 1) / _STEPS
    stresses = np.array([_press(n, fraction, strain) for n in counts]) / _BARB
    last, inverse = stresses[:, -1], np.array(counts, dtype=float) ** -2
    quadratic, constant = np.polyfit(inverse, last, 1)
    left = float(np.var(last - constant - quadratic * inverse) / np.var(last))
    return SizeEffect(tuple(counts), strain, stresses, float(constant), float(quadratic), left)


def _press(count: int, fraction: float, strain: Array) -> Array:
    """(n,) Pa."""
    bands = Bands(fraction, _SIZE / count, _BARB, _BARB / _RATIO)
    mesh, moduli = band_mesh(_SQUARE, bands)
    return _pressed(membrane(_SQUARE, mesh, moduli, 2), strain, count)


def press_membrane(count: int, gradient: bool) -> float:
    """Stress over the barbs' modulus of a homogeneous membrane at the strain of the size effect.

    count: N of the bands that it stands for. gradient: with the energy that their barbs' bending
    has, E_B P^3 T^2 / 12 |d2x / dv2|^2 / 2 (P share, T spacing). Raises InputError
    where it has no equilibrium.
    """
    bands = Bands(_FRACTION, _SIZE / count, _BARB, _BARB / _RATIO)
    low, *_, high = corner_rows(_SQUARE)
    mesh = aligned_mesh(_SQUARE, np.linspace(low, high, _CELLS + 1), _SIZE / _CELLS)
    stiffness = _BARB * _FRACTION**3 * bands.barb_spacing**2 / 12.0 if gradient else 0.0
    moduli = effective_moduli(bands, series_shear(bands)).as_array()
    body = membrane(_SQUARE, mesh, moduli, barb_bending=stiffness)
    strain = _STRAIN * np.arange(1, _STEPS + 1) / _STEPS
    return float(_pressed(body, strain, count)[-1]) / _BARB


def _pressed(body: Membrane, strain: Array, count: int) -> Array:
    """(n,) Pa."""
    sample = _SQUARE
    statics = Statics(body, clamped(sample, body))
    rest = body.points
    # the straight sample is an equilibrium too, an unstable one: start aside of it
    level = rest[:, 1] / sample.height
    aside = _PUSH * sample.height * np.sin(np.pi * level) ** 2
    first = displacement(float(strain[0]), sample.height)
    begin = rest + np.column_stack([aside, first * level])
    pose = MembranePose(begin, statics.system.stresses(begin), statics.rest().tensions)
    return pull(sample, statics, strain, pose, Statics.descend, f"{count} bands").stress


_WIDTH, _ASPECT, _ANGLE_STRAIN, _ANGLE_STEPS = 13e-3, 1.3, 0.05, 1
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


def fit_shear(bands: Bands, triangle: float = 0.0) -> FittedShear:
    """Shear modulus of the membrane from a tilted test of bands; triangle: of band_mesh.

    Raises InputError.
    """
    require(*out_of_range(bands, form=FORM))
    sample, strain = tilted_sample(45.0), strains(_ANGLE_STRAIN, _ANGLE_STEPS)
    target = mean_band_slope(sample, bands, strain, triangle)
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
    strain = strains(_ANGLE_STRAIN, _ANGLE_STEPS)
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
        strain = strains(_ANGLE_STRAIN, _ANGLE_STEPS)
        meso = pull_bands(sample, replace(bands, shift=0.25), strain)
        macro = pull_test(Traction(sample, moduli, _ANGLE_STRAIN, _ANGLE_STEPS, _ELEMENTS))
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
