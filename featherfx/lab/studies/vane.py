"""Studies of vane samples: traction, locking, mesoscale, calibration, angles, size effect."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.lab.studies.study import (
    Comparisons,
    Source,
    StudyResult,
    independent,
    ourselves,
    published,
)
from featherfx.lab.vane import angles as tilted
from featherfx.lab.vane import pictures
from featherfx.lab.vane.calibrate import CALIBRATED, calibrate
from featherfx.lab.vane.curves import MeasuredCurve
from featherfx.lab.vane.locking import RATIOS, run_locking
from featherfx.lab.vane.mesoscale import (
    FIT_POINTS,
    TRANSVERSE_STRAIN,
    Bands,
    SwanBands,
    fitted_bands,
    longitudinal_stress,
    press_membrane,
    pull_bands,
    run_size_effect,
    transverse_stress,
    whole_periods,
)
from featherfx.lab.vane.sample import Moduli, Sample, slope, strains
from featherfx.lab.vane.traction import Traction, pull_test

_SPACING = 5e-4
# Jouve 2024, tables 5.1 and 5.2: barb fraction, barbules and barbs, shear modulus of the membrane
_TABLES = (
    (0.12, 4.04e4, 2.8e9, 2.65e4),
    (0.14, 3.92e4, 2.57e9, 2.78e4),
    (0.16, 3.79e4, 2.25e9, 2.88e4),
)
# the same thesis, table D.2, for 0.14
_SHEAR_D2 = 2.27e4
# Jouve et al. 2024, table 1: barb fraction, barbules and barbs, modulus across, shear modulus
_TABLE_1 = (
    (0.13, 4.0e4, 2.8e9, 4.7e4, 2.9e4),
    (0.16, 3.7e4, 2.3e9, 4.5e4, 3.1e4),
    (0.19, 3.6e4, 1.9e9, 4.6e4, 3.4e4),
)
_SWAN = Moduli(3.6e8, 4.8e4, 2.78e4)
_SIZE = (13e-3, 18e-3)
_SEED, _NOISE = 11, 0.02
_LINEAR = "one layer of three-node triangles across each band, too stiff in bending"


# another model of the vane: no number goes from one to the other but the moduli of the bands
RESOLVED = independent(
    "bands of barbs and barbules, resolved one by one (another model, the same kind of elements)"
)


def traction(folder: Path) -> StudyResult:
    """Closed forms, and convergence of the slope at all angles below the bridging one."""
    rows = Comparisons()
    given = ourselves("the modulus that was given to the sample, which is pulled evenly")
    for angle, modulus in ((0.0, _SWAN.across), (90.0, _SWAN.along)):
        found = pull_test(Traction(Sample(angle, *_SIZE), _SWAN, 0.05, 5, 2000)).slope
        rows.compare(f"slope at {angle:g} degrees", found, modulus, 1e-8, given, unit="Pa")
    mesh = ourselves("an aligned mesh of 60,000 elements")
    for angle, allowed in ((15.0, 0.01), (30.0, 0.01), (45.0, 0.02), (50.0, 0.02), (53.0, 0.02)):
        test = Traction(Sample(angle, *_SIZE), _SWAN, 1e-3, 1, 8000)
        fine = pull_test(replace(test, elements=60_000)).slope
        name = f"slope at {angle:g} degrees with 8,000 elements"
        rows.compare(name, pull_test(test).slope, fine, allowed, mesh, unit="Pa")
    return StudyResult(rows)


def locking(folder: Path) -> StudyResult:
    """Errors of aligned and unaligned meshes for all ratios."""
    found = run_locking()
    rows = Comparisons()
    mesh = ourselves("the finest aligned mesh")
    for ratio in RATIOS:
        count, error = found.error("aligned", ratio)[-1]
        rows.bound(f"error, aligned, ratio {ratio:g}, {count} elements", error, mesh, at_most=0.02)
        count, error = found.error("unaligned", ratio)[2]
        name = f"error, unaligned, ratio {ratio:g}, {count} elements"
        if ratio == 1.0:
            rows.bound(name, error, mesh, at_most=0.02)
        else:
            note = (
                "locks: Jouve 2024, figure 4.4, shows the same, without numbers; the bound is ours"
            )
            rows.bound(name, error, mesh, at_least=0.1, note=note)
    count, error = found.error("aligned", math.inf)[-1]
    rows.bound(f"error, inextensible limit, {count} elements", error, mesh, at_most=0.02)
    file = folder / "vane_locking.png"
    return StudyResult(rows, pictures.locking_picture(file, found))


def mesoscale(folder: Path) -> StudyResult:
    """Closed forms of the bands, and table 5.1."""
    rows = Comparisons()
    bands = SwanBands(0.14, _SPACING).bands()
    for angle, largest, form, allowed, name in (
        (90.0, 0.01, longitudinal_stress, 1e-8, "eq. 5.2"),
        (0.0, 0.4, transverse_stress, 1e-4, "eq. 5.4"),
    ):
        sample, strain = whole_periods(Sample(angle, 6e-3, 6e-3), bands), strains(largest, 4)
        ratio = pull_bands(sample, bands, strain).stress / form(bands, strain)
        worst = ratio[np.argmax(np.abs(ratio - 1.0))]
        closed = independent(f"closed form, Jouve 2024, {name}")
        rows.compare(f"stress over that of {name}, worst", worst, 1.0, allowed, closed)
    table = published("Jouve 2024, table 5.1")
    for fraction, barbule, barb, _ in _TABLES:
        ours = fitted_bands(_SWAN.along, _SWAN.across, fraction, _SPACING)
        rows.compare(
            f"barbules, fraction {fraction}", ours.barbule, barbule, 0.01, table, unit="Pa"
        )
        parallel = fraction * barb + (1.0 - fraction) * barbule
        note = f"the printed value gives {parallel:.3g} Pa along the barbs by eq. 5.3"
        rows.compare(
            f"barbs, fraction {fraction}", ours.barb, barb, 0.01, table, unit="Pa", note=note
        )
    return StudyResult(rows)


def size_effect(folder: Path) -> StudyResult:
    """Appendix A.3: stress in compression against the width of the barbs."""
    found = run_size_effect()
    rows = Comparisons()
    rows.bound(
        "share of the stress that constant + quadratic / N^2 leaves unexplained",
        found.unexplained,
        ourselves("a bound of ours"),
        at_most=0.01,
        note="Jouve 2024, figure A.6, says so in words: almost quadratic in the width",
    )
    rows.report("constant over the barbs' modulus", found.constant, note="what barbules hold")
    for count, stresses in zip(found.counts, found.stress_over_barb_modulus, strict=True):
        rows.report(f"stress over the barbs' modulus, N = {count}", float(stresses[-1]))
    for count, stresses in zip(found.counts, found.stress_over_barb_modulus, strict=True):
        bands = float(stresses[-1])
        text = f"on 12 by 12 cells over the bands', N = {count}"
        rows.compare(
            f"stress of the membrane with barbs' bending, {text}",
            press_membrane(count, True) / bands,
            1.0,
            0.1,
            RESOLVED,
            note=f"without that energy {press_membrane(count, False) / bands:.3g}",
        )
    return StudyResult(rows, pictures.size_picture(folder / "vane_size.png", found))


# largest strain of the paper's transverse fits, chosen here: it fits all three of table 1
_PAPER_STRAIN = 0.2
# how the texts tie shear stress to shear strain, and the modulus over that of the first
_CONVENTIONS = (("sigma = E 2 eps", 1.0), ("sigma = E eps", 2.0))


def shear_modulus(folder: Path) -> StudyResult:
    """Shear modulus of the membrane from tilted tests of bands, in both conventions."""
    rows = Comparisons()
    table = published("Jouve 2024, table 5.2; equation 4.1 has sigma = E 2 eps, A.5 sigma = E eps")
    for fraction, _, _, printed in _TABLES:
        bands = SwanBands(fraction, _SPACING).bands()
        ours = tilted.fit_shear(bands)
        note = _why(ours)
        rows += _both(f"fraction {fraction}", ours.moduli.shear, printed, table, note)
        if fraction == 0.14:
            other = published("Jouve 2024, table D.2; section D.3 has sigma = E eps")
            rows += _both(f"fraction {fraction}, D.2", ours.moduli.shear, _SHEAR_D2, other, note)
            rows += _hindered(bands, printed)
    table = published("Jouve et al. 2024, table 1; equation 4 has sigma = E 2 eps")
    for fraction, barbule, barb, across, printed in _TABLE_1:
        bands = Bands(fraction, _SPACING, barb, barbule)
        name = f"fraction {fraction}, table 1"
        slopes = [
            _transverse_slope(bands, largest) for largest in (_PAPER_STRAIN, TRANSVERSE_STRAIN)
        ]
        text = f"modulus across of its bands, {name}"
        note = (
            f"fitted up to a strain of {_PAPER_STRAIN:g}, chosen here as none is printed; up to"
            f" {TRANSVERSE_STRAIN:g}, as in the thesis, {slopes[1]:.3g} Pa"
        )
        rows.compare(text, slopes[0], across, 0.03, table, unit="Pa", note=note)
        along = fraction * barb + (1.0 - fraction) * barbule
        note = "not printed; by equation 9 of the bands that are"
        rows.report(f"modulus along of its bands, {name}", along, unit="Pa", note=note)
        ours = tilted.fit_shear(bands)
        rows += _both(name, ours.moduli.shear, printed, table, _why(ours))
    return StudyResult(rows)


def _transverse_slope(bands: Bands, largest: float) -> float:
    """Pa, of bands pulled across, up to a strain."""
    strain = np.linspace(0.0, largest, FIT_POINTS + 1)[1:]
    return slope(strain, transverse_stress(bands, strain))


def _why(ours: tilted.FittedShear) -> str:
    """Describe the parts of the fitted shear modulus."""
    return (
        f"converged bands shear as in series ({ours.series:.4g} Pa with 2 eps) and hardly bend:"
        f" fitted over series {ours.moduli.shear / ours.series:.3f}"
    )


def _both(name: str, ours: float, printed: float, table: Source, note: str) -> Comparisons:
    rows = Comparisons()
    for form, times in _CONVENTIONS:
        text = f"shear modulus, {name}, {form}"
        rows.compare(text, times * ours, printed, 0.05, table, unit="Pa", note=note)
    return rows


def _hindered(bands: Bands, printed: float) -> Comparisons:
    """Shear moduli where the barbs' bending is hindered, or the strain is larger."""
    rows = Comparisons()
    for name, order, times, largest, note in (
        ("10 % strain", 2, 1.0, 0.1, "range of strain"),
        ("linear elements, 5 %", 1, 1.0, 0.05, _LINEAR),
        ("linear elements, 10 %", 1, 1.0, 0.1, _LINEAR),
        ("barbs 1e4 times as stiff, 10 %", 2, 1e4, 0.1, "barbs that cannot bend"),
    ):
        found = tilted.fit_shear(
            bands, order=1 if order == 1 else 2, largest=largest, barbs_times=times
        ).moduli.shear
        quantity = f"shear modulus, fraction {bands.barb_fraction}, {name}"
        note = f"{note}; over table 5.2: {found / printed:.3f}"
        rows.report(quantity, found, unit="Pa", note=note)
    return rows


def penalty(folder: Path) -> StudyResult:
    """Figure 6 of the paper: iterations and evenness of the curve against the barbs' modulus."""
    sample = Sample(45.0, *_SIZE)
    strain = strains(0.2, 8)
    rows = Comparisons()
    bound = ourselves("a bound of ours")
    curves = {}
    for ratio in (1e2, 1e4, 1e6, math.inf):
        limit = math.isinf(ratio)
        moduli = replace(_SWAN, along=_SWAN.across * (1.0 if limit else ratio))
        model = Traction(sample, moduli, 0.2, 8, 1000, model="inextensible" if limit else "shell")
        name = "barbs of constant length" if limit else f"ratio {ratio:g}"
        pulled = pull_test(model)
        curves[ratio] = pulled.stress
        text = f"Newton's iterations a step, {name}"
        count = pulled.pose.iterations / len(strain)
        note = "the text's solver ran for 50 and 100 in all"
        rows.bound(text, count, bound, at_most=6.0, note=note)
        bumps = float(np.abs(np.diff(pulled.stress, 3)).max() / pulled.stress[-1])
        rows.bound(f"unevenness of the curve, {name}", bumps, bound, at_most=0.01)
        if not limit:
            plain = pull_test(model, textbook=True)
            text = f"iterations a step as the textbook has them, {name}"
            note = f"{plain.pose.descents} steps found only by following the energy downhill"
            rows.report(text, plain.pose.iterations / len(strain), note=note)
    gap = float(curves[1e6][-1] / curves[math.inf][-1])
    words = ourselves("barbs of constant length")
    rows.compare("stress at the ratio 1e6 over the limit's", gap, 1.0, 0.02, words)
    return StudyResult(rows)


def calibration(folder: Path) -> StudyResult:
    """Round trips of the calibration, without noise and with 2 %."""
    clean = [_curve(0.0, 0.3), _curve(90.0, 0.01), _curve(45.0, 0.1)]
    generator = np.random.default_rng(_SEED)
    noisy = [
        replace(c, stress=c.stress * (1.0 + _NOISE * generator.standard_normal(c.stress.shape)))
        for c in clean
    ]
    rows = Comparisons()
    given = ourselves("the moduli that the curves were made with, by the model that is inverted")
    for curves, allowed, name in ((clean, 1e-3, "no noise"), (noisy, 0.05, "2 % noise")):
        found = calibrate(curves)
        for key in CALIBRATED:
            text = f"{key}, {name}"
            rows.compare(
                text, getattr(found.moduli, key), getattr(_SWAN, key), allowed, given, unit="Pa"
            )
    return StudyResult(rows)


def angles(folder: Path) -> StudyResult:
    """Figures 5.11 and 5.12: slopes at all angles, and the shear band."""
    bands = SwanBands(0.14, _SPACING).bands()
    slopes = tilted.angle_slopes(bands)
    fitted = ourselves("the bands at the angle that the shear modulus was fitted at")
    rows = Comparisons()
    for angle, ratio in zip(slopes.angles, slopes.membrane / slopes.bands, strict=True):
        text = f"slope of the membrane over the bands', {angle:g} degrees, 5 % strain"
        rows.compare(text, ratio, 1.0, 0.05, fitted if angle == 45.0 else RESOLVED)
    found = tilted.shear_bands(bands, slopes.fitted.moduli)
    for band in found:
        rows.compare(
            f"width of the shear band, aspect {band.aspect:g}",
            band.width_membrane,
            band.width_bands,
            _SPACING,
            RESOLVED,
            unit="m",
            absolute=True,
            note="allowed is one barb spacing",
        )
    figures = (
        *pictures.angles_picture(folder / "vane_angles.png", slopes, bands.barbule),
        *pictures.band_picture(folder / "vane_bands.png", found),
    )
    return StudyResult(rows, figures)


def _curve(angle: float, largest: float) -> MeasuredCurve:
    sample = Sample(angle, *_SIZE)
    pulled = pull_test(Traction(sample, _SWAN, largest, 8, 8000))
    return MeasuredCurve(sample, pulled.strain, pulled.stress)
