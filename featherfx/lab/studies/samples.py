"""The measured samples of Jouve 2024: sizes of table 3.1, tilted tests, Poisson effect, share of
barbs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from featherfx.lab.feathers.feather import feather_kind
from featherfx.lab.studies.study import Comparisons, StudyResult, draw, ourselves, published
from featherfx.lab.studies.vane import RESOLVED
from featherfx.lab.vane.mesoscale import SwanBands, effective_moduli, pull_bands, series_shear
from featherfx.lab.vane.sample import Moduli, Sample, strains
from featherfx.lab.vane.traction import PulledSample, Traction, pull_test

_THESIS = "Jouve 2024"
# table 3.1: width and height in mm, thickness in micrometres
_TRANSVERSE = (
    *((15, 14, 120), (8, 14, 100), (12, 11, 120), (10, 11, 110), (10, 13, 95), (12, 11, 140)),
    *((11, 13, 120), (10, 15, 100), (17, 14, 112), (10, 13, 125), (11, 12, 120), (12, 16, 150)),
    *((8, 10, 110), (11, 12, 120)),
)
_LONGITUDINAL = (
    *((9, 18, 73), (7, 15, 133), (9, 23, 60), (8, 13, 120), (9, 16, 129), (4, 12, 116)),
    *((10, 11, 80), (7, 19, 125), (10, 10, 117), (6, 6, 100), (7, 10, 145), (2, 6, 130)),
    (5, 11, 140),
)
# without that of 16 by 16 mm, where one barb joins both clamps
_TILTED = (
    *((12, 16, 155), (14, 19, 114), (13, 18, 103), (8, 14, 143)),
    *((9, 16, 132), (6, 15, 120), (3, 14, 110)),
)
# figure D.3: slopes of a swan's vane, Pa
_SCATTER = {"modulus_across_barbs": (37e3, 61e3), "modulus_along_barbs": (263e6, 457e6)}
_SPACING, _STRAIN, _STEPS, _ELEMENTS = 5e-4, 0.1, 2, 4000
# of the tilted ones, those that are pulled
_PULLED = (_TILTED[0], _TILTED[2], _TILTED[5], _TILTED[6])
# share of barbs in the surface: figure 5.8, and the bounds of both texts
_FRACTIONS = (0.11, 0.12, 0.14, 0.16, 0.19)


def samples(folder: Path) -> StudyResult:
    """All samples of table 3.1, and what figures 5.6 and 5.8 are drawn of."""
    bands = SwanBands(0.14, _SPACING).bands()
    moduli = effective_moduli(bands, series_shear(bands))
    tilted = [_sample(45.0, each) for each in _PULLED]
    strain = strains(_STRAIN, _STEPS)
    by_bands = [pull_bands(each, bands, strain) for each in tilted]
    by_membrane = [pull_test(Traction(each, moduli, _STRAIN, _STEPS, _ELEMENTS)) for each in tilted]
    rows = Comparisons()
    rows += _scatter()
    rows += _uniform()
    for sample, meso, macro in zip(tilted, by_bands, by_membrane, strict=True):
        text = f"{1e3 * sample.width:g} by {1e3 * sample.height:g} mm, tilted"
        ratio = float(macro.stress[-1] / meso.stress[-1])
        note = f"bands: {meso.stress[-1]:.4g} Pa at {100 * _STRAIN:g} % strain"
        rows.compare(
            f"stress of the membrane over the bands', {text}",
            ratio,
            1.0,
            0.1,
            RESOLVED,
            note=f"{note}; one place of the barbs, which moves the bands by some 5 %",
        )
        rows.compare(
            f"Poisson's ratio at half height of the membrane, {text}",
            poisson(sample, macro),
            poisson(sample, meso),
            0.1,
            RESOLVED,
            absolute=True,
        )
    widest, narrowest = by_bands[0].stress[-1], by_bands[-1].stress[-1]
    words = published(f"{_THESIS}, section 3.3, in words: narrow samples are much softer")
    text = "stress of the narrowest tilted sample over the widest's"
    rows.bound(text, narrowest / widest, words, at_most=1.0)
    rows += _poisson(moduli)
    rows += _fractions()
    caption = (
        "Tilted tests of the samples of table 3.1 (figure 5.6 of Jouve 2024, without its measured"
        " curves, which are a picture): bands (lines) and membrane (dots), by width and height."
    )

    def paint(canvas: Any) -> None:
        axes = canvas.add_subplot()
        for k, (sample, meso, macro) in enumerate(zip(tilted, by_bands, by_membrane, strict=True)):
            label = f"{1e3 * sample.width:g} x {1e3 * sample.height:g} mm"
            drawn = np.append(0.0, strain), np.append(0.0, 1e-3 * meso.stress)
            axes.plot(*drawn, color=f"C{k % 6}", label=label)
            axes.plot(strain, 1e-3 * macro.stress, "o", color=f"C{k % 6}", ms=4)
        axes.set(xlabel="Green-Lagrange strain", ylabel="second Piola-Kirchhoff stress, kPa")
        axes.legend(fontsize=8)

    return StudyResult(rows, draw(folder / "vane_samples.png", caption, paint))


def poisson(sample: Sample, pulled: PulledSample) -> float:
    """Equation 3.1 with the width at half height: - e_xx / e_yy of the last strain."""
    rest, now = pulled.statics.membrane.points, pulled.pose.positions
    sides = []
    for place in (0.0, sample.width):
        edge = np.flatnonzero(np.abs(rest[:, 0] - place) < 1e-9)
        edge = edge[np.argsort(rest[edge, 1])]
        sides.append(np.interp(0.5 * sample.height, rest[edge, 1], now[edge, 0]))
    across = 0.5 * (((sides[1] - sides[0]) / sample.width) ** 2 - 1.0)
    return -float(across / pulled.strain[-1])


def _sample(angle: float, size: tuple[int, int, int]) -> Sample:
    return Sample(angle, 1e-3 * size[0], 1e-3 * size[1], 1e-6 * size[2])


def _scatter() -> Comparisons:
    """The shipped vane within what was measured."""
    vane = feather_kind("swan_primary").vane_material
    source = ourselves(
        f"{_THESIS}, figure D.3: 37 to 61 kPa and 263 to 457 MPa, of which the preset is the mean"
    )
    rows = Comparisons()
    for name, (low, high) in _SCATTER.items():
        modulus = name.replace("_", " ")
        text = f"{modulus} of the preset swan_primary, in the middle of what was measured"
        half = 0.5 * (high - low)
        middle, found = 0.5 * (low + high), getattr(vane, name)
        rows.compare(text, found, middle, half, source, unit="Pa", absolute=True)
    return rows


def _uniform() -> Comparisons:
    """The measure does not depend on the size of samples that deform evenly."""
    swan = Moduli(3.6e8, 4.8e4, 2.78e4)
    worst = max(
        abs(pull_test(Traction(_sample(angle, size), swan, 0.01, 1, 128)).slope / modulus - 1.0)
        for angle, sizes, modulus in (
            (0.0, _TRANSVERSE, swan.across),
            (90.0, _LONGITUDINAL, swan.along),
        )
        for size in sizes
    )
    text = f"slope of {len(_TRANSVERSE) + len(_LONGITUDINAL)} samples of table 3.1, largest error"
    given = ourselves("the modulus that was given to the samples, which are pulled evenly")
    rows = Comparisons()
    rows.bound(text, worst, given, at_most=1e-8)
    return rows


def _poisson(moduli: Moduli) -> Comparisons:
    """Section 3.3: none in transverse samples, a strong one in tilted ones."""
    across = _sample(0.0, _TRANSVERSE[0])
    pulled = pull_test(Traction(across, moduli, _STRAIN, _STEPS, 500))
    tilted = _sample(45.0, (13, 18, 103))
    isotropic = pull_test(Traction(tilted, moduli, _STRAIN, 1, 500, model="isotropic"))
    none = ourselves(f"true by construction; {_THESIS}, section 3.3, measured none either")
    rows = Comparisons()
    rows.bound("Poisson's ratio, transverse", abs(poisson(across, pulled)), none, at_most=1e-3)
    text = "Poisson's ratio of an isotropic membrane without Poisson effect, 13 by 18 mm, tilted"
    found = poisson(tilted, isotropic)
    rows.report(text, found, note="so the effect of tilted samples is that of the barbs")
    return rows


def _fractions() -> Comparisons:
    """Figure 5.8: the share of barbs hardly matters to what bands carry."""
    sample = _sample(45.0, (13, 18, 103))
    strain = strains(0.5 * _STRAIN, 1)
    found = {
        fraction: pull_bands(sample, SwanBands(fraction, _SPACING).bands(), strain).stress[-1]
        for fraction in _FRACTIONS
    }
    printed = [found[fraction] for fraction in (0.12, 0.14, 0.16)]
    words = published(f"{_THESIS}, figure 5.8, in words: not much impacted")
    rows = Comparisons()
    text = "spread of the stress over shares of barbs of 0.12 to 0.16, aspect 1.38"
    rows.bound(text, float(np.ptp(printed) / printed[1]), words, at_most=0.1)
    text = "the same over 0.11 to 0.19"
    note = "bounds of 0.14 +- 0.03 and 0.16 +- 0.03, the shares of the two texts"
    rows.report(text, float(np.ptp(list(found.values())) / printed[1]), note=note)
    return rows
