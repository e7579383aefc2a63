"""Presets beside feathers that were weighed and shaken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from featherfx.feather.build import build_feather
from featherfx.groom.types import FeatherKind, VaneShape
from featherfx.lab.feathers.feather import feather_kind
from featherfx.lab.studies.study import Rows, StudyResult, ourselves, published
from featherfx.mechanics.batch import make_model
from featherfx.solver.step.modes import frequencies

ROWS, COLUMNS, COEFFICIENTS = 41, 6, 2
WEIGHED = "Harvey et al. 2022 (Nature 603), data of AvInertia"


class Weighed(NamedTuple):
    """A primary: number, calamus and vane (mm, along the shaft), width of the calamus, mean width
    of the proximal and the distal vane (mm), mass (g)."""

    number: int
    calamus: float
    vane: float
    width: float
    proximal: float
    distal: float
    mass: float


# printed digits beyond the third are noise of pixels
GULL = (
    Weighed(10, 64.9, 267.2, 5.48, 21.9, 3.29, 1.150),
    Weighed(9, 72.3, 271.0, 5.22, 24.4, 6.64, 1.144),
    Weighed(8, 73.8, 261.4, 5.94, 27.1, 5.87, 1.019),
    Weighed(7, 68.7, 249.1, 5.25, 24.8, 6.31, 0.916),
    Weighed(6, 67.9, 232.4, 5.75, 26.0, 6.72, 0.765),
    Weighed(5, 66.5, 206.8, 4.47, 27.7, 8.37, 0.641),
    Weighed(4, 61.8, 191.2, 4.75, 26.9, 6.47, 0.573),
    Weighed(3, 59.1, 176.7, 4.14, 25.9, 8.06, 0.445),
    Weighed(2, 59.6, 158.5, 4.61, 24.9, 7.57, 0.395),
    Weighed(1, 52.1, 145.7, 3.39, 20.8, 8.73, 0.341),
)
PIGEON = (
    Weighed(10, 30.9, 146.9, 2.53, 10.1, 1.64, 0.28),
    Weighed(9, 40.4, 151.2, 2.64, 12.0, 3.65, 0.29),
    Weighed(8, 43.5, 146.3, 2.52, 13.2, 4.38, 0.27),
    Weighed(7, 44.4, 134.7, 2.82, 13.9, 5.20, 0.23),
    Weighed(6, 44.5, 131.8, 2.96, 15.8, 5.91, 0.21),
    Weighed(5, 42.2, 121.3, 3.33, 15.8, 5.38, 0.18),
    Weighed(4, 40.9, 114.3, 3.02, 16.4, 5.59, 0.16),
    Weighed(3, 38.4, 105.5, 3.00, 13.9, 5.85, 0.14),
    Weighed(2, 37.3, 104.3, 2.90, 14.0, 6.88, 0.12),
    Weighed(1, 33.4, 102.4, 2.71, 12.0, 6.56, 0.10),
)
# increase of the first frequency where the vanes are cut off, percent: middle and half width
RISE = 60.5, 9.5
TRIMMED = published("Deng et al. 2022 (Journal of Bionic Engineering), abstract: 51 to 70 %")
FITTED = ourselves(f"{WEIGHED}; the wall of the shaft was fitted to both birds together")


def as_weighed(kind: FeatherKind, bird: Weighed) -> FeatherKind:
    """A kind with the length, calamus and widths of a primary."""
    length, base = 1e-3 * (bird.calamus + bird.vane), 1e-3 * bird.width
    tip = kind.rachis.diameter_tip * base / kind.rachis.diameter_base
    return replace(
        kind,
        length=length,
        calamus=1e-3 * bird.calamus / length,
        rachis=replace(kind.rachis, diameter_base=base, diameter_tip=tip),
        leading=_widened(kind.leading, 1e-3 * bird.distal / length),
        trailing=_widened(kind.trailing, 1e-3 * bird.proximal / length),
    )


def _widened(vane: VaneShape, mean: float) -> VaneShape:
    """The vane with a mean width, of the feather's length."""
    place, width = np.transpose(vane.outline)
    factor = mean / float(np.trapezoid(width, place) / (place[-1] - place[0]))
    return replace(vane, outline=tuple((a, factor * b) for a, b in vane.outline))


def mass(kind: FeatherKind) -> float:
    """kg."""
    feather = build_feather(kind, ROWS, COLUMNS)
    return float(make_model([feather], [kind], COEFFICIENTS).mass.sum())


def first_frequencies(kind: FeatherKind) -> tuple[float, float]:
    """Hz, of the clamped feather and of its shaft without vanes."""
    bare = replace(kind, leading=VaneShape((), ()), trailing=VaneShape((), ()))
    found = []
    for each, columns, count in ((kind, COLUMNS, COEFFICIENTS), (bare, 1, 0)):
        model = make_model([build_feather(each, ROWS, columns)], [each], count)
        found.append(float(frequencies(model, 0, 1)[0]))
    return found[0], found[1]


def masses(folder: Path) -> StudyResult:
    """Presets with the measures of weighed primaries, and as they are."""
    rows = Rows()
    kinds = {name: feather_kind(name) for name in ("swan_primary", "primary")}
    ratios = {}
    for bird, preset, birds in (("gull", "swan_primary", GULL), ("pigeon", "primary", PIGEON)):
        ratio = [mass(as_weighed(kinds[preset], each)) / (1e-3 * each.mass) for each in birds]
        ratios[bird] = ratio
        rows += _shape(bird, preset, ratio)
    both = np.exp(np.mean(np.log(np.concatenate(list(ratios.values())))))
    rows.compare("mass over measured, all twenty, geometric mean", float(both), 1.0, 0.1, FITTED)
    for preset, birds in (("swan_primary", GULL), ("primary", PIGEON)):
        kind = kinds[preset]
        ours, measured = mass(kind), at_length(birds, kind.length)
        other = 1e3 * kind.rachis.diameter_base
        rows.compare(
            f"mass of {preset}, {kind.length:g} m long",
            1e3 * ours,
            measured,
            0.25,
            published(f"{WEIGHED}: line through the ten, at that length"),
            unit="g",
            note=f"calamus {other:g} mm, theirs {_mean_width(birds):.2g} in the mean",
        )
    for preset, kind in kinds.items():
        whole, bare = first_frequencies(kind)
        rise = 100.0 * (bare / whole - 1.0)
        text = f"first frequency of {preset} without its vanes, more by"
        rows.compare(text, rise, *RISE, TRIMMED, unit="%", absolute=True)
        rows.report(f"first frequency of {preset}, clamped", whole, unit="Hz")
    return StudyResult(rows)


def _shape(bird: str, preset: str, ratio: Sequence[float]) -> Rows:
    text = f"mass of {preset} with the measures of a {bird}'s primary over measured"
    mean = float(np.exp(np.mean(np.log(ratio))))
    rows = Rows()
    rows.compare(f"{text}, geometric mean of ten", mean, 1.0, 0.25, FITTED)
    rows.report(f"{text}, least", min(ratio))
    rows.report(f"{text}, most", max(ratio))
    return rows


def at_length(birds: Sequence[Weighed], length: float) -> float:
    """g, of a feather of a length (m) on the line through the logarithms of all."""
    own = np.log([1e-3 * (each.calamus + each.vane) for each in birds])
    slope, start = np.polyfit(own, np.log([each.mass for each in birds]), 1)
    return float(np.exp(start + slope * np.log(length)))


def _mean_width(birds: Sequence[Weighed]) -> float:
    """mm, of the calamus."""
    return float(np.mean([each.width for each in birds]))
