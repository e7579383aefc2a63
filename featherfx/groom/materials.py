"""Materials of vanes and rachises, in SI units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from featherfx.groom.keys.values import ArrayOf, Default, Either, Number, Text

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
