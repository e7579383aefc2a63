"""Materials of vanes and rachises, in SI units, and looks: colours, patterns, drawn barbs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Annotated, Any

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.keys.problems import Place, Problems
from featherfx.groom.keys.values import ArrayOf, Default, Either, Number, Table, Text, keys_of

Curve = tuple[tuple[float, float], ...]
MIN_PROFILE_FACTOR, MAX_PROFILE_FACTOR = 1e-3, 1e3
PROFILE_POINTS = ArrayOf(ArrayOf(Number(0, MAX_PROFILE_FACTOR), 2, 2), 0, 50)
PROFILE_MEANING = "[share, factor], straight between points and constant beyond; empty: 1."


@dataclass(frozen=True)
class Profile:
    """Factors of a figure of the vane: a curve along the shaft times one along the barbs."""

    rachis: Annotated[Curve, PROFILE_POINTS, f"Along the vane's length: {PROFILE_MEANING}"] = ()
    barb: Annotated[
        Curve,
        PROFILE_POINTS,
        f"Along each barb, from its root (0) to its end (1): {PROFILE_MEANING}",
    ] = ()


_STIFFNESS = Number(1e-10, 10, "N m")
_YIELD = Number(1.0, 1e9, "Pa")
_COMPLIANCE = Number(0, 1e9, "rad/N")
_LOSS = Number(0, 1)
_LOSS_MEANS = "Damping: tangent of the loss angle within `loss_band`."
# of a band: highest over lowest frequency; up to it three branches hold a loss to 8 %
MAX_LOSS_BAND_RATIO = 300.0
_BAND = ArrayOf(Number(1e-3, 1e6, "Hz"), 2, 2)
_BAND_MEANS = (
    "Lowest and highest frequency between which the loss factor holds, the highest up to 300 times "
    "the lowest; it falls below them and grows above."
)
_REFERENCE = Number(0, 1e6, "Hz")

_REFERENCE_MEANS = (
    "Frequency at which the moduli hold; 0: at rest. A material is stiffer the faster it moves."
)


def _by_vane(number: Number) -> Either:
    return Either({int: number, float: number, list: ArrayOf(number, 2, 2)})


@dataclass(frozen=True, kw_only=True)
class VaneMaterial:
    """The vane as a barb-and-barbule membrane (references: Jouve 2024, tables 5.1, 5.2, 6.1).

    Both barb stiffnesses are those at the barb's root, and floored at 5 % of it further out. Barbs
    stay straight where the vane bends across them.
    """

    modulus_along_barbs: Annotated[
        float, Number(1e2, 1e12, "Pa"), "Modulus of the vane along the barbs."
    ]
    modulus_across_barbs: Annotated[
        float, Number(1e-6, 1e10, "Pa"), "Modulus across the barbs (barbules)."
    ]
    shear_modulus: Annotated[
        float, Number(0, 1e10, "Pa"), "Shear modulus, against engineering shear."
    ]
    thickness: Annotated[float, Number(1e-6, 0.01, "m"), "Thickness of the vane."]
    surface_density: Annotated[float, Number(1e-5, 10, "kg/m^2"), "Mass of the vane per area."]
    barb_bending_normal: Annotated[
        float, _STIFFNESS, "Bending stiffness of barbs out of the vane, per metre of vane."
    ]
    barb_bending_in_plane: Annotated[
        float, _STIFFNESS, "Bending stiffness of barbs within the vane, per metre of vane."
    ]
    barb_taper: Annotated[
        float,
        Number(0, 5),
        "Exponent p: both barb stiffnesses fall as (1 - s)^p to the barb's end.",
    ] = 0.0
    bending_across: Annotated[
        float, Number(0, 10, "N m"), "Bending modulus of the vane across the barbs."
    ]
    thickness_profile: Annotated[
        Profile,
        "Factors of the thickness from place to place. Mass per area goes with it, bending of "
        "barbs and across them with its cube; contact keeps to `thickness`.",
        Default({}),
    ] = Profile()
    across_barbs_profile: Annotated[
        Profile,
        "Factors of `modulus_across_barbs`, `shear_modulus` and `bending_across`.",
        Default({}),
    ] = Profile()
    along_barbs_profile: Annotated[
        Profile, "Factors of `modulus_along_barbs` and of the bending of barbs.", Default({})
    ] = Profile()
    twist_ratio: Annotated[
        float,
        Number(0, 1e4),
        "Twist modulus D_66 of the vane over `bending_across`; 0.5 is that of a plate without "
        "Poisson's effect. On barbs at an angle to the shaft twist is that between the barbs' "
        "direction and the shaft's.",
    ] = 0.5
    ribbon: Annotated[
        bool,
        "Whether shaft and vanes are one flat strip, as a single long barb or a filoplume: "
        "developable where it is thin, it bends with `bending_across`, twists at the cost of its "
        "curvature and lets the air at its width. Both vanes together are its width; hooks and "
        "the moduli of barbs and membrane do not count, nor what the shaft bears.",
    ] = False
    poissons_ratio: Annotated[float, Number(0, 0.5), "Poisson's ratio of a ribbon."] = 0.3
    loss_factor: Annotated[float, _LOSS, _LOSS_MEANS] = 0.1
    loss_band: Annotated[tuple[float, ...], _BAND, _BAND_MEANS] = (1.0, 200.0)
    reference_frequency: Annotated[float, _REFERENCE, _REFERENCE_MEANS] = 0.0
    permeability: Annotated[
        float | tuple[float, ...],
        _by_vane(Number(0, 1)),
        "Part of the vane's area that is open to air, or of the leading and the trailing vane: 0 "
        "is closed, 1 neither feels nor carries air.",
    ] = 0.0
    transmissivity: Annotated[
        float | tuple[float, ...],
        _by_vane(Number(0, 100, "m/(s Pa)")),
        "Speed per pressure of air that seeps through the vane, or through the leading and the "
        "trailing one; 0: no loss beside that of the openings of `permeability`.",
    ] = 0.0
    attached_coefficient: Annotated[
        float,
        Number(0, 3),
        "Most that air adds to the force coefficient across the vane while it flows along it from "
        "edge to edge: some 0.8 for a plate; 0: the flow leaves the vane at every angle.",
    ] = 0.0
    compression_guard: Annotated[
        float,
        Number(0, 1e12, "Pa"),
        "Modulus of a penalty on lost area, so that the vane wrinkles before it closes; 0: none.",
    ] = 0.0
    barb_clamp_normal: Annotated[
        float,
        _COMPLIANCE,
        "Compliance of the barbs' roots out of the vane: turn under 1 N m per metre of vane; 0: "
        "rigid.",
    ] = 0.0
    barb_clamp_in_plane: Annotated[
        float, _COMPLIANCE, "The same for turns of the barbs' roots within the vane."
    ] = 0.0
    hooks: Annotated[
        str,
        Text(("closed", "slip", "open")),
        "What hooks between barbs do under load: hold; slip and keep the slip; slip, then open.",
    ] = "closed"
    hook_yield_across: Annotated[
        float, _YIELD, "Stress across the barbs at which hooks begin to slip."
    ] = 6e3
    hook_yield_shear: Annotated[float, _YIELD, "The same in shear."] = 4e3
    hook_strength: Annotated[
        float, _YIELD, "Stress across the barbs at which a gap opens; the yield stress or more."
    ] = 1.92e4
    hook_slip: Annotated[
        float, Number(0, 0.01, "m"), "Slip of a gap on the way from yield to strength."
    ] = 2.5e-5
    hook_release: Annotated[
        float,
        Number(1e-8, 0.01, "m"),
        "Opening over which a gap that gives way loses its strength.",
    ] = 5e-5
    hook_healing_rate: Annotated[
        float,
        Number(0, 1e3, "1/s"),
        "Rate at which open gaps whose edges touch hook again by themselves.",
    ] = 0.0
    hook_scatter: Annotated[
        float, Number(0, 0.5), "Deviation of the strength from gap to gap, a share of it."
    ] = 0.05


@dataclass(frozen=True, kw_only=True)
class RachisMaterial:
    """The shaft's keratin cortex around a light core."""

    youngs_modulus: Annotated[float, Number(1e3, 1e12, "Pa"), "Young's modulus of the cortex."]
    shear_modulus: Annotated[float, Number(1e3, 1e12, "Pa"), "Shear modulus of the cortex."]
    modulus_profile: Annotated[
        Curve, PROFILE_POINTS, f"Factors of both moduli along the shaft's length: {PROFILE_MEANING}"
    ] = ()
    cortex_fraction: Annotated[
        float, Number(0.01, 1), "Share of the radius that is cortex; 1 is solid."
    ]
    flattening: Annotated[
        float, Number(0.05, 20), "Height of the section (across the vane) over its width."
    ] = 1.0
    cortex_density: Annotated[float, Number(1, 2e4, "kg/m^3"), "Density of the cortex."]
    core_density: Annotated[float, Number(0, 2e4, "kg/m^3"), "Density of the core."] = 0.0
    loss_factor: Annotated[float, _LOSS, _LOSS_MEANS] = 0.1
    loss_band: Annotated[tuple[float, ...], _BAND, _BAND_MEANS] = (1.0, 200.0)
    reference_frequency: Annotated[float, _REFERENCE, _REFERENCE_MEANS] = 0.0


_PLACE = Number(0, 1)
_FILM = Number(0, 3e-6, "m")
_COLOUR = ArrayOf(Number(0, 1), 3, 3)
_TILT = Number(-90, 90, "deg")
Shade = tuple[float, float, float]
# of patterns that name none; chosen by eye
# linear, of keratin without colours
VANE_COLOUR, RACHIS_COLOUR = (0.80, 0.76, 0.69), (0.42, 0.33, 0.24)
# by which pigments filter red, green and blue light. Melanins: d'Eon et al. 2011, An
# Energy-Conserving Hair Reflectance Model, section 6.1; carotenoid by eye. An amount q from 0 to 1
# is a concentration of -ln(1 - q), as in Blender's Principled Hair BSDF.
ABSORPTION = {
    "eumelanin": (0.419, 0.697, 1.37),
    "pheomelanin": (0.187, 0.4, 1.05),
    "carotenoid": (0.0, 0.15, 1.37),
}
PIGMENTS = tuple(ABSORPTION)
_MIN_UNPIGMENTED = 1e-4  # as there
# values of places on vanes, besides colours, that shaders take
SHADING = ("film", "barbule_tilt", *PIGMENTS)
DEFAULT_PATTERN_SIZES = {"bars": 0.4, "spots": 0.02, "eye": 0.08, "fringe": 0.01, "streak": 0.01}
_MARKED = "As that of the feather, as far as the mark covers; default: as below it."
_DEFAULTS = ", ".join(f"{size:g} of {kind}" for kind, size in DEFAULT_PATTERN_SIZES.items())


@dataclass(frozen=True, kw_only=True)
class Pattern:
    """A mark on both vanes, over those before it (featherfx/feather/colours.py)."""

    kind: Annotated[
        str,
        Text(("bars", "spots", "fringe", "gradient", "eye", "streak")),
        "bars across the feather; spots, a row on either vane; fringe along the edge; gradient "
        "from base to tip; eye, round about the shaft; streak along the shaft.",
    ]
    colour: Annotated[
        Shade | None,
        _COLOUR,
        "Red, green and blue as displays show them (sRGB); default: as below it.",
    ] = None
    start: Annotated[float, _PLACE, "Where it begins, a share of the vane's length."] = 0.0
    end: Annotated[float, _PLACE, "Where it ends; later than start."] = 1.0
    count: Annotated[int, Number(1, 1000, whole=True), "Of bars, or of spots of a row."] = 6
    size: Annotated[
        float | None,
        Number(0.001, 1),
        "Of bars the share of their distance that is dark; of spots and eye the radius, of fringe "
        "and streak the width, a share of the feather's length; default: "
        f"{_DEFAULTS}.",
    ] = None
    soft: Annotated[float, _PLACE, "Share of the size over which its border fades."] = 0.3
    strength: Annotated[float, _PLACE, "How far it covers what is below."] = 1.0
    slant: Annotated[
        float, Number(-80, 80, "deg"), "Of bars, how far they lean to the tip on the leading vane."
    ] = 0.0
    film: Annotated[
        float | None,
        _FILM,
        "As that of the feather, where the mark covers more than half; default: as below it.",
    ] = None
    barbule_tilt: Annotated[float | None, _TILT, _MARKED] = None
    eumelanin: Annotated[float | None, _PLACE, _MARKED] = None
    pheomelanin: Annotated[float | None, _PLACE, _MARKED] = None
    carotenoid: Annotated[float | None, _PLACE, _MARKED] = None


@dataclass(frozen=True, kw_only=True)
class Colour:
    """Colours of a feather, in sRGB. base: None draws it as plain keratin."""

    base: Annotated[
        Shade | None, _COLOUR, "Of the vanes; without it the feather has no colour of its own."
    ] = None
    rachis: Annotated[Shade | None, _COLOUR, "Of the shaft; default: darker than the vanes."] = None
    patterns: Annotated[
        tuple[Pattern, ...],
        ArrayOf(Table(keys_of(Pattern), "table of a pattern"), 0, 50),
        "Marks, each over those before it.",
    ] = ()
    brightness_variation: Annotated[
        float, Number(0, 1), "Deviation of the brightness from feather to feather, a share."
    ] = 0.0
    film: Annotated[
        float,
        _FILM,
        "Thickness of a film on the vanes that shines by interference, for shaders; 0: none.",
    ] = 0.0
    barbule_tilt: Annotated[
        float, _TILT, "Angle of barbules out of their vane, by which a film shines, for shaders."
    ] = 0.0
    eumelanin: Annotated[
        float, _PLACE, "Brown to black pigment, which filters the base; 1: all light."
    ] = 0.0
    pheomelanin: Annotated[float, _PLACE, "Rufous pigment, as eumelanin."] = 0.0
    carotenoid: Annotated[float, _PLACE, "Yellow pigment, as eumelanin."] = 0.0

    @property
    def is_plain(self) -> bool:
        """True if there is nothing to write."""
        return self.base is None and not self.shading

    @property
    def shading(self) -> tuple[str, ...]:
        """Names of SHADING that differ from 0 anywhere."""
        each = (self, *self.patterns)
        return tuple(name for name in SHADING if any(getattr(own, name) for own in each))


@dataclass(frozen=True, kw_only=True)
class BarbLook:
    """Deviation of drawn barbs from smooth ones (featherfx/feather/barb_looks.py)."""

    clump: Annotated[
        float, _PLACE, "How far the ends of barbs come together in clumps, a share of the distance."
    ] = 0.0
    clump_count: Annotated[
        int, Number(1, 1000, whole=True), "Number of clumps along each vane."
    ] = 16
    clump_shape: Annotated[
        float,
        Number(0.2, 10),
        "Exponent by which barbs come together along their length; large: at the ends alone.",
    ] = 2.0
    frizz: Annotated[
        float, Number(0, 0.02, "m"), "How far the ends of barbs wave, across and out of the vane."
    ] = 0.0
    frizz_waves: Annotated[float, Number(0, 100), "Waves along a barb."] = 2.0
    jitter: Annotated[
        float, Number(0, 0.95), "Most that a barb is shortened, a share of its length."
    ] = 0.0
    loose: Annotated[
        float,
        _PLACE,
        "Part of a barb, from its end, that hooks nowhere: pictures show it apart from its "
        "neighbours, and edges as soft as it is long. 0: as long as a few barbs lie apart.",
    ] = 0.0
    seed: Annotated[int, Number(0, 2**31 - 1, whole=True), "Seed of what is drawn."] = 1
    variants: Annotated[
        int, Number(1, 1000, whole=True), "Different draws among feathers, each by its id."
    ] = 8

    @property
    def moves_barbs(self) -> bool:
        """True if barbs are drawn away from the vane's own."""
        return max(self.clump, self.frizz, self.jitter) > 0.0


@lru_cache(maxsize=4096)
def look_text(look: BarbLook) -> str:
    """Write the values of a look that are no defaults, for caches; empty if there are none."""
    return _text(look, BarbLook())


@lru_cache(maxsize=4096)
def look_of(text: str) -> BarbLook:
    """The look that a text is of. Raises InputError for other texts."""
    return BarbLook(**_read(text, BarbLook, "look of barbs"))


@lru_cache(maxsize=4096)
def colour_text(colour: Colour) -> str:
    """Write the values of a colour that are no defaults, for caches; empty if there are none."""
    return _text(colour, Colour())


@lru_cache(maxsize=4096)
def colour_of(text: str) -> Colour:
    """The colour that a text is of. Raises InputError for other texts."""
    told = _read(text, Colour, "colour of a feather")
    return Colour(**{**told, "patterns": tuple(Pattern(**each) for each in told["patterns"])})


def _text(chosen: Any, usual: Any) -> str:
    as_usual = asdict(usual)
    told = {name: value for name, value in asdict(chosen).items() if value != as_usual[name]}
    if "patterns" in told:
        told["patterns"] = [
            {name: value for name, value in each.items() if value is not None}
            for each in told["patterns"]
        ]
    return json.dumps(told, separators=(",", ":")) if told else ""


def _read(text: str, kind: type, name: str) -> dict[str, Any]:
    problems = Problems()
    place = Place("", "", problems)
    try:
        told = json.loads(text or "{}")
    except (ValueError, RecursionError) as error:
        told = place.fail(f"is no {name}: {error}")
    found = Table(keys_of(kind), name).check(told, place, False)
    problems.raise_any()
    return dict(found)


def filtered(light: Array, pigments: Mapping[str, Array]) -> Array:
    """(P, 3) what amounts (P,) of PIGMENTS, 0 to 1, leave of linear light (P, 3)."""
    for name, amount in pigments.items():
        left = np.maximum(1.0 - amount, _MIN_UNPIGMENTED)
        light = light * left[:, None] ** np.array(ABSORPTION[name])
    return light


def linear(colour: Array) -> Array:
    """Light of colours as displays show them."""
    low = colour <= 0.04045
    return np.where(low, colour / 12.92, ((np.maximum(colour, 0) + 0.055) / 1.055) ** 2.4)


def displayed(light: Array) -> Array:
    """Colours as displays show them of light, 0 to 1; undoes `linear`."""
    light = np.clip(light, 0.0, 1.0)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
