"""Presets beside feathers that were weighed and shaken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.build import build_feather
from featherfx.feather.profiles import at_places
from featherfx.groom.materials import RachisMaterial
from featherfx.groom.presets.kinds import Change, adjusted
from featherfx.groom.presets.presets import load_preset
from featherfx.groom.types import FeatherKind, VaneShape
from featherfx.lab.feather import feather_kind
from featherfx.lab.studies.study import Comparisons, StudyResult, ourselves, published
from featherfx.mechanics.batch import make_model
from featherfx.mechanics.resolution import rachis_mass, rachis_stiffness
from featherfx.solver.damping import fit_branches, frequencies, softening

_ROWS, _COLUMNS, _COEFFICIENTS = 41, 6, 2
_WEIGHED = "Harvey et al. 2022 (Nature 603), data of AvInertia"


class Weighed(NamedTuple):
    """A primary: number, calamus and vane (mm, along the rachis), width of the calamus, mean width
    of the proximal and the distal vane (mm), mass (g)."""

    number: int
    calamus: float
    vane: float
    width: float
    proximal: float
    distal: float
    mass: float


# printed digits beyond the third are noise of pixels
_GULL = (
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
_PIGEON = (
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
# length (mm) and mass (g, to 0.01) of the first to the ninth secondary of the pigeon
_SECONDARIES = (
    (127.5, 0.10),
    (119.7, 0.09),
    (118.2, 0.09),
    (106.0, 0.08),
    (108.6, 0.08),
    (109.4, 0.08),
    (111.1, 0.08),
    (108.1, 0.07),
    (94.3, 0.06),
)
_WEIGHED_TO = 0.005  # g, half of the last digit
_AIR = 1.225  # kg/m^3
# increase of the first frequency in air where the vanes are cut off, percent: middle and half width
_RISE = 60.5, 9.5
_TRIMMED = published("Deng et al. 2022 (Journal of Bionic Engineering), abstract: 51 to 70 %")
_FITTED = ourselves(f"{_WEIGHED}; the wall of the shaft was fitted to both birds together")


def as_weighed(kind: FeatherKind, bird: Weighed) -> FeatherKind:
    """A kind with the length, calamus and widths of a primary."""
    length, base = 1e-3 * (bird.calamus + bird.vane), 1e-3 * bird.width
    tip = kind.rachis.diameter_tip * base / kind.rachis.diameter_base
    vane = adjusted(kind, Change(scale=length / kind.length)).vane_material
    return replace(
        kind,
        vane_material=vane,
        length=length,
        calamus=1e-3 * bird.calamus / length,
        rachis=replace(kind.rachis, diameter_base=base, diameter_tip=tip),
        leading=_widened(kind.leading, 1e-3 * bird.distal / length),
        trailing=_widened(kind.trailing, 1e-3 * bird.proximal / length),
    )


def _trimmed(kind: FeatherKind, coefficients: int) -> float:
    """Percent, by which the first frequency in air is higher without the vanes."""
    blown = _frequencies(kind, _COLUMNS, coefficients, 1, _AIR)[0]
    return float(100.0 * (_frequencies(_bare(kind), 1, 0, 1)[0] / blown - 1.0))


def _widened(vane: VaneShape, mean: float) -> VaneShape:
    """The vane with a mean width, of the feather's length."""
    place, width = np.transpose(vane.outline)
    factor = mean / float(np.trapezoid(width, place) / (place[-1] - place[0]))
    return replace(vane, outline=tuple((a, factor * b) for a, b in vane.outline))


def mass(kind: FeatherKind) -> float:
    """kg."""
    feather = build_feather(kind, _ROWS, _COLUMNS)
    return float(make_model([feather], [kind], _COEFFICIENTS).mass.sum())


def _bare(kind: FeatherKind) -> FeatherKind:
    return replace(kind, leading=VaneShape((), ()), trailing=VaneShape((), ()))


def _frequencies(
    kind: FeatherKind, columns: int, coefficients: int, count: int, air: float = 0.0
) -> Array:
    """(count,) Hz, of the clamped feather, in still air of a density (kg/m^3)."""
    model = make_model([build_feather(kind, _ROWS, columns)], [kind], coefficients)
    return frequencies(model, 0, count, air)


def masses(folder: Path) -> StudyResult:
    """Presets with the measures of weighed primaries, and as they are."""
    rows, ratios = Comparisons(), []
    for bird, preset, birds in (("gull", "swan_primary", _GULL), ("pigeon", "primary", _PIGEON)):
        kinds = [as_weighed(feather_kind(preset), each) for each in birds]
        ours = [1e3 * mass(each) for each in kinds]
        ratios.append([one / each.mass for one, each in zip(ours, birds, strict=True)])
        rows += _shape(bird, preset, ratios[-1])
    both = float(np.exp(np.mean(np.log(ratios))))
    rows.compare("mass over measured, all twenty, geometric mean", both, 1.0, 0.1, _FITTED)
    for preset, birds in (("swan_primary", _GULL), ("primary", _PIGEON)):
        kind = feather_kind(preset)
        text = f"mass of {preset}, {kind.length:g} m long"
        other = 1e3 * kind.rachis.diameter_base
        note = f"calamus {other:g} mm, theirs {_mean_width(birds):.2g} in the mean"
        text_of_line = "line through the ten, at that length; the wall was fitted to such masses"
        source = ourselves(f"{_WEIGHED}: {text_of_line}")
        measured = at_length(birds, kind.length)
        rows.compare(text, 1e3 * mass(kind), measured, 0.25, source, unit="g", note=note)
    ours = [1e3 * _grown_mass("secondary", 1e-3 * length) for length, _ in _SECONDARIES]
    weighed, text = [each for _, each in _SECONDARIES], "mean mass of nine secondaries of a pigeon"
    source = published(f"{_WEIGHED}, weighed to 0.01 g")
    note = "secondary at their lengths; nothing was fitted to them"
    values = float(np.mean(ours)), float(np.mean(weighed)), _WEIGHED_TO
    rows.compare(text, *values, source, unit="g", absolute=True, note=note)
    for preset, bird, birds in (("swan_primary", "gull", _GULL), ("primary", "pigeon", _PIGEON)):
        kind = feather_kind(preset)
        whole, edgewise = _frequencies(kind, _COLUMNS, _COEFFICIENTS, 2)
        bare = _frequencies(_bare(kind), 1, 0, 2)
        outer = as_weighed(kind, birds[0])
        rise = _trimmed(kind, _COEFFICIENTS)
        text = f"first frequency of {preset} without its vanes, more by"
        note = f"with rigid barbs by {_trimmed(kind, 0):.0f}: those of the preset swing at the"
        note += " shaft's own frequency, by a stiffness chosen by eye (Jouve 2024, section 6.4);"
        note += f" in vacuum by {100.0 * (bare[0] / whole - 1.0):.0f}, in the vane's plane, where"
        note += f" air is not pushed, by {100.0 * (bare[1] / edgewise - 1.0):.0f}; of a {bird}'s"
        note += f" outermost primary, as weighed, by {_trimmed(outer, _COEFFICIENTS):.0f}, with"
        note += f" rigid barbs {_trimmed(outer, 0):.0f}. The abstract names no feather"
        rows.compare(text, rise, *_RISE, _TRIMMED, unit="%", absolute=True, note=note)
        rows.report(f"first frequency of {preset}, clamped", whole, unit="Hz")
    return StudyResult([*rows, *_grown(), *_keratin(), *_along(), *_train()])


# Dawson 2005: power of the length with which primaries of a wing weigh, mean and deviation
_POWER = 2.41, 0.42
_DAWSON = published(
    "Dawson 2005 (Ibis 147), abstract: 2.41, s.d. 0.42, of 120 species, inwards of the wing's tip"
)


def _grown_mass(preset: str, length: float) -> float:
    """kg, of a preset scaled to a length (m)."""
    kind = feather_kind(preset)
    return mass(adjusted(kind, Change(scale=length / kind.length)))


def _grown() -> Comparisons:
    """Compare how primaries of wings weigh, as wings scale them."""
    rows = Comparisons()
    for bird, measured in (("pigeon", _PIGEON), ("gull", _GULL)):
        _, tree = load_preset(f"wing/{bird}")
        row = tree["primaries"]
        length = row["lengths"].value
        inner = length[: int(np.argmax(length))]
        ours = [_grown_mass(row["kind"].value, each) for each in inner]
        power = np.polyfit(np.log(inner), np.log(ours), 1)[0]
        every = [each.calamus + each.vane for each in measured]
        first = 1 + int(np.argmax(every))
        weighed = [each.mass for each in measured[first:]]
        told = np.polyfit(np.log(every[first:]), np.log(weighed), 1)
        left = np.log(weighed) - np.polyval(told, np.log(every[first:]))
        text = f"power of the length with which inner primaries of a {bird}'s wing weigh"
        note = f"weighed {told[0]:.3g}, each within {left.std(ddof=2):.1%} ({_WEIGHED})"
        rows.compare(text, power, *_POWER, _DAWSON, absolute=True, note=note)
    return rows


def _keratin() -> Comparisons:
    """Compare flight_rachis and keratin_rachis with measured rachises."""
    flight, one = feather_kind("primary").rachis_material, np.ones(1)
    material = feather_kind("ornamental_plume").rachis_material
    stretch, bend = (each[0] for each in rachis_stiffness(one, one, material))
    macleod = published(
        "MacLeod 1980 (J. exp. Biol. 87), abstract, distal shafts of contour feathers"
    )
    schmitz = "Schmitz et al. 2015 (J. Morphology 276), abstract, pigeon and three birds of prey"
    deng = "Deng et al. 2023 (Applied Physics A 129), section 1"
    swan = feather_kind("swan_primary").rachis_material
    rows = Comparisons()
    for text, ours, low, high, source, note in (
        (
            "Young's modulus of flight_rachis, GPa",
            1e-9 * flight.youngs_modulus,
            5.9,
            8.4,
            ourselves(f"{schmitz}, of which it is the middle"),
            "keratin_rachis has the 2.50 of Bonser and Purslow 1995, abstract, of eight species",
        ),
        (
            "the same before any of its loss, beside pulled shafts",
            1e-9 * flight.youngs_modulus * _instantaneous(flight),
            1e-3 * min(stiff for stiff, _, _ in _PULLED),
            1e-3 * max(stiff for stiff, _, _ in _PULLED),
            published(f"{_OWL}, table 1, instantaneous, of five pigeons"),
            "of a spring in series, which alone bears what is quick; whole shafts",
        ),
        (
            "bending stiffness of keratin_rachis over that of a solid rod's section, MPa",
            1e-6 * bend[1] / (np.pi / 64.0),
            457.0,
            1850.0,
            macleod,
            "proximal 5 to 24: a shaft that softens towards its base is not in the presets",
        ),
        (
            "the same in extension, MPa",
            1e-6 * stretch[0] / (0.25 * np.pi),
            210.0,
            682.0,
            macleod,
            "proximal 45 to 181",
        ),
        (
            "loss factor of swan_primary's shaft",
            swan.loss_factor,
            0.03,
            0.07,
            ourselves(f"{deng}, of swans, of which it is the middle"),
            "",
        ),
        (
            "loss factor of flight_rachis",
            flight.loss_factor,
            2.0 * 0.034,
            2.0 * 0.268,
            published(f"{deng}, of pigeons, tip to base, twice the damping ratio"),
            "the 0.896 that is cited there is of slow pulls, see the next row",
        ),
    ):
        printed = replace(source, text=f"{source.text}: {low:g} to {high:g}")
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        rows.compare(text, ours, middle, half, printed, absolute=True, note=note)
    text = "largest loss factor of the law that table 1 fits to pulled shafts, five pigeons"
    loss = [_largest_loss(*each) for each in _PULLED]
    rate = float(np.mean([rate for _, rate in loss]))
    fast = float(np.mean([stiff / (2.0 * np.pi * 20.0 * drag) for stiff, _, drag in _PULLED]))
    note = f"at {rate:.2g} rad/s; at 20 Hz that law has {fast:.1g}: it tells nothing of vibrations"
    mean = float(np.mean([largest for largest, _ in loss]))
    slow = published(f"{_OWL}, abstract: 0.896 +- 0.082")
    rows.compare(text, mean, 0.896, 0.082, slow, absolute=True, note=note)
    return rows


# A rachis of a pigeon pulled slowly (Viscoelastic characterization of long-eared owl flight feather
# rachis, table 1): a spring, MPa, in series with a spring, MPa, beside a damper, MPa s
_OWL = "Shock and Vibration 2014, 709367"
_PULLED = (
    (10087.0, 2411.0, 597359.0),
    (9590.0, 2314.0, 981513.0),
    (11103.0, 3851.0, 836727.0),
    (10201.0, 3373.0, 680685.0),
    (10404.0, 2296.0, 896814.0),
)


def _instantaneous(material: RachisMaterial) -> float:
    """Modulus before any branch relaxes, over that at the material's reference frequency."""
    _, _, weights = fit_branches(material.loss_factor, material.loss_band)
    return softening(material) * (1.0 + float(weights.sum()))


def _largest_loss(spring: float, beside: float, damper: float) -> tuple[float, float]:
    """Loss factor where it is largest, and rad/s there. Its compliance 1 / E1 + 1 / (E2 + i w d)
    has the loss factor E1 w d / (E2 (E1 + E2) + (w d)^2)."""
    together = np.sqrt(beside * (spring + beside))
    return float(0.5 * spring / together), float(together / damper)


def _along() -> Comparisons:
    """Compare how a rachis changes from its base to its tip."""
    kind = feather_kind("swan_primary")
    feather = build_feather(kind, _ROWS, _COLUMNS)
    size, material = (feather.width, feather.height), kind.rachis_material
    modulus = at_places(material.modulus_profile, feather.station / feather.station[-1])
    bending = modulus * rachis_stiffness(*size, material)[1][:, 1]
    solid = np.pi / 64.0 * feather.width * feather.height**3
    density = rachis_mass(*size, material)[0] / (0.25 * np.pi * feather.width * feather.height)
    specific = bending / solid / density
    gulls = "Wang and Meyers 2017 (Acta Biomaterialia 48), abstract, of gulls"
    rows = Comparisons()
    rows.bound(
        "bending stiffness of swan_primary's shaft, tip over base",
        bending[-1] / bending[0],
        published(f"{gulls}, in words: all decreases towards the tip"),
        at_most=1.0,
    )
    note = "the wall is one part of the radius along the whole shaft"
    text = "its stiffness over that of a solid rod's section and over its density, tip over base"
    source = ourselves(f"{gulls}: increases by a factor of 2, as the modulus was made to")
    rows.compare(text, specific[-1] / specific[0], 2.0, 0.25, source, note=note)
    return rows


# Hz, of the train-rattling of 14 peacocks
_RATTLE = 25.6


def _train() -> Comparisons:
    found = _frequencies(_bare(feather_kind("peacock_tail")), 1, 0, 20)
    note = (
        "Dakin et al. 2016 (PLoS ONE 11), abstract: peacocks rattle at 25.6 Hz, driven; barbs are"
    )
    note += " left out here, and the abstract has no resonance of a single feather"
    rows = Comparisons()
    rows.report("first frequency of the shaft of peacock_tail, clamped", found[0], unit="Hz")
    nearest = found[np.argmin(np.abs(found - _RATTLE))]
    rows.report("its frequency nearest to the train-rattling", nearest, unit="Hz", note=note)
    return rows


def _shape(bird: str, preset: str, ratio: Sequence[float]) -> Comparisons:
    text = f"mass of {preset} with the measures of a {bird}'s primary over measured"
    mean = float(np.exp(np.mean(np.log(ratio))))
    rows = Comparisons()
    rows.compare(f"{text}, geometric mean of ten", mean, 1.0, 0.25, _FITTED)
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
