"""Rods at rest, vibrating and let go, against solutions that share no line with the solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from featherfx.lab.contact import ContactTest, run_contact
from featherfx.lab.plates import FRAMES_PER_SECOND
from featherfx.lab.ribbons.oracles import (
    WAVE_NUMBERS,
    elastica_tip,
    kirchhoff_tip,
    link_chain,
    taper_frequencies,
)
from featherfx.lab.ribbons.rod import ReleaseTest, Rod, bend, natural_frequencies, release
from featherfx.lab.studies.study import Comparisons, StudyResult, independent, ourselves, published

_SEGMENTS = 40
_TABLE = published("Mattiasson 1981, table 1")
# F L^2 / EI: (shortening, deflection) / L
_MATTIASSON = {
    1.0: (0.05643, 0.30172),
    2.0: (0.16064, 0.49346),
    5.0: (0.38763, 0.71379),
    10.0: (0.55500, 0.81061),
}
_EIGHT_ELEMENTS = published("Simo and Vu-Quoc 1986, 45 degree bend with 8 elements")
_SHOOTING = independent("Kirchhoff's rod, by shooting")
# force: tip, out of plane last
_BEND_TIPS = {
    300.0: (58.84, 22.33, 40.08),
    450.0: (52.32, 18.62, 48.39),
    600.0: (47.23, 15.79, 53.37),
}
_ARC = 100.0 * np.pi / 4.0
_SWING, _LINKS = 1.5, (8, 16)


def elastica(folder: Path) -> StudyResult:
    """A clamped rod under a dead force across its tip."""
    rows = Comparisons()
    for load, (shortening, deflection) in _MATTIASSON.items():
        tip = bend(Rod(1.0, 1.0, segments=_SEGMENTS), (0.0, 0.0, -load)).tip
        text = f"at F L^2 / EI = {load:g}"
        rows.compare(f"shortening / L {text}", 1.0 - tip[0], shortening, 1e-3, _TABLE)
        rows.compare(f"deflection / L {text}", -tip[2], deflection, 1e-3, _TABLE)
        x, drop = elastica_tip(load)
        error = float(np.linalg.norm(tip - [x, 0.0, -drop]))
        closed = independent("closed form in elliptic integrals")
        rows.bound(f"tip from the closed form, over L, {text}", error, closed, at_most=1e-4)
    return StudyResult(rows)


def heavy(folder: Path) -> StudyResult:
    """A clamped rod, uniform or tapered, under its weight."""
    rows = Comparisons()
    for taper in (0.0, 0.7):
        for load, allowed in ((1.0, 1e-3), (10.0, 1e-3), (100.0, 5e-3)):
            tip = bend(Rod(1.0, 1.0, line_weight=load, taper=taper, segments=_SEGMENTS)).tip
            expected = kirchhoff_tip(1.0, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), load, taper)
            text = f"tip error / L, weight {load:g} EI / L^2, taper {taper:g}"
            error = float(np.linalg.norm(tip - expected))
            rows.bound(text, error, _SHOOTING, at_most=allowed)
    return StudyResult(rows)


def bend_of_45_degrees(folder: Path) -> StudyResult:
    """An eighth of a circle, loaded out of its plane."""
    rows = Comparisons()
    rod = Rod(_ARC, ei=1e7 / 12.0, gj=0.5e7 / 6.0, rest_curvature=0.01, segments=_SEGMENTS)
    stiffness = (0.5e7 / 6.0, 1e7 / 12.0, 1e7 / 12.0)
    note = "the error of 8 elements is 0.2 % of the length"
    for force, printed in _BEND_TIPS.items():
        tip = bend(rod, (0.0, 0.0, force)).tip
        exact = kirchhoff_tip(_ARC, stiffness, (0.0, 0.0, force), curvature=0.01)
        for axis, ours, theirs in zip("xyz", tip, printed, strict=True):
            text = f"tip {axis} at force {force:g}"
            rows.compare(
                text,
                ours,
                theirs,
                0.0025 * _ARC,
                _EIGHT_ELEMENTS,
                absolute=True,
                unit="m",
                note=note,
            )
        error = float(np.linalg.norm(tip - exact)) / _ARC
        rows.bound(f"tip from shooting, over length, {force:g}", error, _SHOOTING, at_most=1e-3)
    return StudyResult(rows)


def frequencies(folder: Path) -> StudyResult:
    """Natural frequencies of clamped rods, uniform and tapered."""
    rows = Comparisons()
    for taper in (0.0, 0.7):
        rod = Rod(0.3, ei=2e-3, line_mass=0.01, taper=taper, segments=_SEGMENTS)
        found = natural_frequencies(rod, 8)[::2]
        if taper:
            exact = taper_frequencies(0.3, 2e-3, 0.01, taper, 4)
        else:
            exact = WAVE_NUMBERS**2 * np.sqrt(2e-3 / 0.01) / 0.3**2 / (2.0 * np.pi)
        other = independent("Rayleigh and Ritz" if taper else "roots of cosh x cos x = -1")
        for k, (ours, theirs) in enumerate(zip(found, exact, strict=True)):
            text = f"frequency {k + 1}, taper {taper:g}"
            allowed = 2e-3 if k == 0 else 1e-2
            rows.compare(text, ours, theirs, allowed, other, unit="Hz")
    return StudyResult(rows)


def released(folder: Path) -> StudyResult:
    """A rod let go from the horizontal, against a chain of rigid links."""
    times = np.linspace(0.0, _SWING, 31)
    coarse, fine = (link_chain(count, 1.0, 1.0, 1.0, 10.0, times) for count in _LINKS)
    expected = fine + (fine - coarse) / 3.0
    rod = Rod(1.0, 1.0, line_mass=1.0, line_weight=10.0, segments=_SEGMENTS)
    swing = release(ReleaseTest(rod, _SWING, samples=30))
    error = np.linalg.norm(swing.tip[:, [0, 2]] - expected, axis=1)
    chain = independent("chain of rigid links, extrapolated from 8 and 16; its error dominates")
    rows = Comparisons()
    rows.bound("largest tip distance of the first swing, / L", error.max(), chain, at_most=0.01)
    rows.compare("lowest tip / L", swing.tip[:, 2].min(), expected[:, 1].min(), 0.01, chain)
    rows.report("steps", swing.steps)
    rows.report("seconds", swing.seconds, unit="s")
    return StudyResult(rows)


_BEAM = independent("one slender cantilever of the plates' sums (Timoshenko and Young 1961)")
_COULOMB = independent("Coulomb's friction")
_ALPHA = independent("generalised-alpha of an oscillator (Chung and Hulbert 1993)")
# identities and bounds, which confirm no more than that the program agrees with itself
_NEWTON, _NO_WORK = ourselves("Newton's third law"), ourselves("no work is done")
_TOLERANCES, _STEPS = (6e-4, 1.5e-4, 2e-5), (4, 16, 64)


def plates_at_rest(folder: Path) -> StudyResult:
    """Plates that hang on each other, and one that rests on an edge, by tolerance."""
    rows = Comparisons()
    for test, allowed in (
        (ContactTest(case="plates"), 0.01),
        (ContactTest(case="stack", n=8), 0.02),
        (ContactTest(case="graded", n=8), 0.02),
        (ContactTest(case="wedge"), 0.02),
    ):
        for tolerance in _TOLERANCES:
            found = run_contact(replace(test, tolerance=tolerance, at_rest=True))
            text = f"of {test.case}, tolerance {tolerance:g} m"
            assert found.droop is not None
            assert found.droop_exact is not None
            off = abs(found.droop - found.droop_exact) / tolerance
            if tolerance == _TOLERANCES[-1]:
                droops = found.droop, found.droop_exact, allowed, _BEAM
                note = f"{off:.2f} of its tolerance off"
                rows.compare(f"droop {text}", *droops, unit="m", note=note)
            else:
                rows.bound(f"droop {text}, off over that tolerance", off, _BEAM, at_most=1.0)
            if found.weight:
                assert found.reaction_sum is not None
                values = found.reaction_sum, found.weight, allowed, _NEWTON
                rows.compare(f"sum of reactions {text}", *values, unit="N")
    return StudyResult(rows)


def stepped_frequency(frequency: float, step: float) -> float:
    """Return the frequency (Hz) with which generalised-alpha of the spectral radius 0 swings an
    oscillator without loss in steps (s).

    Of am = -1, af = 0, b = 1, g = 3/2 (solver/step/integrator_kernels) and x, h v, h^2 a.
    """
    square = (2.0 * np.pi * frequency * step) ** 2
    after = np.array([[1.0 + 0.5 * square, 0.0, 0.0], [0.0, 1.0, -1.5], [0.5 * square, 0.0, 1.0]])
    before = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, -0.5], [0.0, 0.0, 0.5]])
    turns = np.linalg.eigvals(np.linalg.solve(after, before))
    return float(np.angle(turns).max() / (2.0 * np.pi * step))


def plates_in_motion(folder: Path) -> StudyResult:
    """Plates that swing, slide and collide, by steps a frame of 1/24 s, 0 as the tolerance asks."""
    rows, names = Comparisons(), {"frequency": "Hz", "acceleration": "m/s^2", "momentum": "N s"}
    for case, name, allowed, source in (
        ("plates", "frequency", 0.02, _BEAM),
        ("slide", "acceleration", 0.02, _COULOMB),
        ("collide", "momentum", 1e-3, _NEWTON),
    ):
        for steps in (0, *_STEPS):
            found = run_contact(ContactTest(case=case, steps=steps))  # type: ignore[arg-type]
            text = f"of {case}, {steps} steps"
            ours, exact = getattr(found, name), getattr(found, f"{name}_exact")
            note = ""
            if found.steps_a_frame is not None:
                swung = stepped_frequency(exact, 1.0 / (found.steps_a_frame * FRAMES_PER_SECOND))
                note = f"in {found.steps_a_frame:.3g} steps a frame an oscillator that touches"
                note += f" nothing is {1.0 - swung / exact:.1%} slow"
                if steps > 0:
                    rows.compare(f"{name} {text}, so stepped", ours, swung, 0.01, _ALPHA, unit="Hz")
            if steps in (0, _STEPS[-1]):
                whole = f"{name} {text}"
                rows.compare(whole, ours, exact, allowed, source, unit=names[name], note=note)
            else:
                rows.report(f"{name} {text}, over {source.text}", ours / exact)
            assert found.energy_gain is not None
            text = f"energy gained over the largest kinetic energy {text}"
            rows.bound(text, found.energy_gain, _NO_WORK, at_most=1e-3)
    return StudyResult(rows)
