"""A membrane of fibres torn (Jacquemoud 2007): stresses, elements, where a tear starts."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from featherfx.lab.fibres.rupture import Rupture, RuptureTest, run_rupture
from featherfx.lab.studies.study import Rows, StudyResult, draw, independent, ourselves, published

READ = (
    "the reference is the last equilibrium before the first fibre breaks, E22 = 0.215; it breaks at"
    " (C_r - 1) / 2 = 0.22, where the stress is largest"
)


def rupture(folder: Path) -> StudyResult:
    """Plateau and peak stresses; 1, 9 and 24 elements; weak elements."""
    along, across, narrow, nine = (
        run_rupture(RuptureTest(elements=elements, mu=mu, sigma=sigma, fibres=801))
        for elements, mu, sigma in (
            (1, pi / 2, pi / 2),
            (1, 0.0, pi / 2),
            (1, pi / 2, pi / 6),
            (9, pi / 2, pi / 6),
        )
    )
    weak = run_rupture(RuptureTest(elements=9, sigma=pi / 6, weak=1, fibres=801))
    across_nine = run_rupture(RuptureTest(elements=9, sigma=pi / 6, weak=2, fibres=401))
    two = run_rupture(RuptureTest(elements=24, sigma=pi / 6, weak=2, weak_mu=pi / 12, fibres=401))
    other = independent(
        "another computation with the law of Jacquemoud 2007, whose text prints no stress"
    )
    pulled = (("along", along, 5.41e6), ("across", across, 4.10e6))
    rows = Rows()
    text = "plateau of a fibre, (C_c, C_r) = (1.36, 1.41)"
    rows.compare(text, narrow.fibre.plateau, 15.96e6, 1e-3, other, unit="Pa")
    rows.compare(
        "plateau of a fibre, (1.34, 1.44)", along.fibre.plateau, 13.85e6, 1e-3, other, unit="Pa"
    )
    for name, found, printed in pulled:
        text = f"S22 at E22 = 0.215, fibres {name}"
        rows.compare(text, stress_at(found, 0.215), printed, 3e-3, other, unit="Pa")
    for name, found, printed in pulled:
        text = f"largest S22, fibres {name}"
        rows.compare(text, found.peak.stress, printed, 0.02, other, unit="Pa", note=READ)
    rows.compare("E22 there, fibres along", along.peak.strain, 0.215, 0.03, other, note=READ)
    text = "nine elements against one: largest difference of S22 up to the peak, over the peak"
    note = "Jacquemoud 2007, figure 4-11, shows curves that lie on each other"
    rows.bound(text, apart(nine, narrow), ourselves("one element"), at_most=0.02, note=note)
    text = "E22 where nine equal elements stop being equal"
    rows.report(text, uneven(nine), note="published: the simulation ends sooner with nine")
    text = "element that breaks first, of nine with a weak sixth"
    source = published("Jacquemoud 2007, figure 4-15: element 5 has the fewest fibres")
    rows.compare(text, weak.weakest, 5.0, 0.0, source, absolute=True)
    text = "share of fibres of the 4th element when the 5th has lost nine tenths"
    source = published("Jacquemoud 2007, figure 4-15: in element 4 the rupture has just begun")
    rows.compare(text, share_of(weak, 4, 5, 0.1), 1.0, 0.1, source)
    text = "elements that tear, of nine with a weak 5th and 6th"
    source = published("Jacquemoud 2007, figure 4-16: the tear goes through to the other edge")
    note = "their numbers one after the other"
    rows.compare(text, torn(across_nine), 456.0, 0.0, source, absolute=True, note=note)
    text = "elements that tear, of 24 with a weak 11th and 12th"
    source = published("Jacquemoud 2007, section 4.5.2.2: the same is concluded of 24 elements")
    note = "their numbers; figure A8-6, of the fibres left, is a picture only"
    rows.compare(text, torn(two), 9101112.0, 0.0, source, absolute=True, note=note)
    return StudyResult(rows, draw(folder / "rupture.png", CAPTION, _paint(along, across, narrow)))


CAPTION = "Stress of the specimen against its strain, and the share of its fibres that are whole."


def stress_at(found: Rupture, strain: float) -> float:
    """S_22 (Pa) at a strain before the peak, between the equilibria of its path."""
    strains = [each.strain for each in found.path]
    return float(np.interp(strain, strains, [each.stress for each in found.path]))


def apart(first: Rupture, second: Rupture) -> float:
    """Largest difference of stress at equal strain before the peak of the first, over the peak."""
    last = min(first.peak.strain, second.peak.strain)
    before = [each for each in first.path if each.strain <= last]
    worst = max(abs(each.stress - stress_at(second, each.strain)) for each in before)
    return worst / second.peak.stress


def share_of(found: Rupture, element: int, other: int, left: float) -> float:
    """Share of whole fibres of an element (counted from 1) when another has no more than left."""
    late = next(each for each in found.path if each.intact.flat[other - 1] <= left)
    return float(late.intact.flat[element - 1])


def torn(found: Rupture) -> float:
    """Numbers, from 1 and one after the other, of the elements that have lost fibres at the end."""
    lost = np.flatnonzero(found.path[-1].intact.ravel() < 1.0) + 1
    return float("".join(map(str, lost.tolist())) or 0)


def uneven(found: Rupture) -> float:
    """E_22 at which elements that were given alike first differ by 1e-3 of the strain."""
    for each in found.path:
        if np.ptp(each.strains[..., 1]) > 1e-3 * max(each.strain, 1e-6):
            return each.strain
    return found.path[-1].strain


def _paint(along: Rupture, across: Rupture, narrow: Rupture) -> Any:
    def paint(canvas: Any) -> None:
        left, right = canvas.subplots(1, 2)
        named = (
            (along, "deviation pi/2, along"),
            (across, "deviation pi/2, across"),
            (narrow, "deviation pi/6, along"),
        )
        for found, name in named:
            strains = [each.strain for each in found.path]
            left.plot(strains, [1e-6 * each.stress for each in found.path], label=name)
            right.plot(strains, [each.intact.mean() for each in found.path], label=name)
        left.set(xlabel="E22", ylabel="S22, MPa")
        right.set(xlabel="E22", ylabel="share of whole fibres")
        left.legend()

    return paint
