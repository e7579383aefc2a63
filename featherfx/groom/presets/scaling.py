"""Materials of a feather whose size, stiffness or weight is changed.

A feather s times as long keeps its shape: diameters and thickness grow with s, and what its
materials are given by per area or per metre of vane follows, with moduli m times as large. Barbs do
not stand apart as much, e is the kind's `barb_spacing_exponent`:

    quantity                                       factor
    length, diameters, thickness, release of hooks s
    barb spacing, slip of hooks                    s^e
    densities of cortex and core                   1
    mass of the vane per area                      s
    moduli, stresses at which hooks give way (Pa)  m
    bending of barbs, bending across (N m)         m s^3
    compliance of the barbs' roots (rad/N)         1 / (m s^2)

All elastic energies then grow as m s^3, masses as s^3 and the work of gravity as s^4, so that

    droop over length ~ s / m,    frequencies ~ sqrt(m) / s

    similar      m = 1: the same keratin. Twice the size hangs twice as far, for its length, and
                 swings at half the rate. Primaries of birds of all sizes are nearly so: they are
                 geometrically, not elastically similar (Worcester 1987, honors thesis, University
                 of Utah; 1996, J. Zool. 239: 609).
    behaviour    m = s: stiffer as it grows (Froude's similarity). It hangs as before, for its
                 length, and moves as before at 1 / sqrt(s) of the rate, in winds of sqrt(s) times
                 the speed too, since moduli grow as their pressure.
    fixed_vane   only the shaft grows; the vane's figures stay as they are written, so that barbs
                 hang s^3 times as far for their length.

Stiffness and weight multiply all stiffnesses and all masses: frequencies go as the square root of
stiffness over weight, the droop as weight over stiffness.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind

Material = TypeVar("Material", VaneMaterial, RachisMaterial)


def materials_resized(kind: FeatherKind, size: float) -> FeatherKind:
    """The kind with the materials that it has `size` times as large; its shape is left alone."""
    if size == 1.0 or kind.scaling == "fixed_vane":
        return kind
    moduli = size if kind.scaling == "behaviour" else 1.0
    wider = size**kind.barb_spacing_exponent
    vane = _times(_thicker(_stiffer(kind.vane_material, moduli), size), wider, "hook_slip")
    return replace(
        kind,
        barb_spacing=kind.barb_spacing * wider,
        vane_material=vane,
        rachis_material=_times(kind.rachis_material, moduli, *_MODULI),
    )


def dialled(kind: FeatherKind, stiffness: float, weight: float) -> FeatherKind:
    """The kind with all its stiffnesses and all its masses multiplied."""
    if (stiffness, weight) == (1.0, 1.0):
        return kind
    vane = _times(kind.vane_material, weight, "surface_density")
    shaft = _times(kind.rachis_material, weight, "cortex_density", "core_density")
    return replace(
        kind,
        vane_material=_stiffer(vane, stiffness),
        rachis_material=_times(shaft, stiffness, *_MODULI),
    )


def varied(vane: VaneMaterial, across: float, along: float, thickness: float) -> VaneMaterial:
    """A vane with other moduli across the barbs and along them, and another thickness, of the same
    barbs and weight. Factors."""
    if (across, along, thickness) == (1.0, 1.0, 1.0):
        return vane
    vane = _times(vane, across, "modulus_across_barbs", "shear_modulus", "bending_across")
    vane = _times(
        vane, along, "modulus_along_barbs", "barb_bending_normal", "barb_bending_in_plane"
    )
    return _times(vane, thickness, "thickness")


# of the shaft
_MODULI = "youngs_modulus", "shear_modulus"
# of a vane: what grows with the moduli; bending; compliance of the barbs' roots
_BENDING = "barb_bending_normal", "barb_bending_in_plane", "bending_across"
_COMPLIANCE = "barb_clamp_normal", "barb_clamp_in_plane"
_STIFF = (
    *(
        "modulus_along_barbs",
        "modulus_across_barbs",
        "shear_modulus",
        "compression_guard",
        *_BENDING,
    ),
    *("hook_yield_across", "hook_yield_shear", "hook_strength"),
)


def _times(part: Material, factor: float, *names: str) -> Material:
    """A material with some of its figures multiplied."""
    if factor == 1.0:
        return part
    return replace(part, **{name: getattr(part, name) * factor for name in names})


def _stiffer(vane: VaneMaterial, factor: float) -> VaneMaterial:
    return _less_compliant(_times(vane, factor, *_STIFF), factor)


def _less_compliant(vane: VaneMaterial, factor: float) -> VaneMaterial:
    if factor == 1.0:
        return vane
    return replace(vane, **{name: getattr(vane, name) / factor for name in _COMPLIANCE})


def _thicker(vane: VaneMaterial, size: float) -> VaneMaterial:
    """`size` times as thick, with barbs `size` times as long and as thick."""
    vane = _times(vane, size, "thickness", "hook_release", "surface_density")
    return _less_compliant(_times(vane, size**3, *_BENDING), size**2)
