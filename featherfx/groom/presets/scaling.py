"""Materials of a feather whose size, stiffness or weight is changed.

A feather s times as long keeps its shape. Its thickness, of the vane and of the shaft's wall, grows
with t = s^e, and what its materials are given by per area or per metre of vane follows, with moduli
m times as large. Barbs do not stand apart as much. e is the kind's `thickness_exponent`, b its
`barb_spacing_exponent`:

    quantity                                       factor
    length, diameters                              s
    thickness, release of hooks                    t
    cortex, share of the radius                    t / s, up to a solid shaft
    barb spacing, slip of hooks                    s^b
    densities of cortex and core                   1
    mass of the vane per area                      t
    moduli, stresses at which hooks give way (Pa)  m
    bending of barbs, bending across (N m)         m t^3
    compliance of the barbs' roots (rad/N)         1 / (m t^2)

A shaft with a thin wall weighs as s^2 t and its bending energy goes as m s^2 t, so that of shafts,
and where e is 1 of whole feathers,

    droop over length ~ s / m,    frequencies ~ sqrt(m) / s

    similar      m = 1: the same keratin. Twice the size hangs twice as far, for its length, and
                 swings at half the rate. Primaries of birds of all sizes are nearly so: they are
                 geometrically, not elastically similar (Worcester 1987, honors thesis, University
                 of Utah; 1996, J. Zool. 239: 609), but for their walls: e is below 1.
    behaviour    m = s: stiffer as it grows (Froude's similarity). It hangs as before, for its
                 length, and moves as before at 1 / sqrt(s) of the rate, in winds of sqrt(s) times
                 the speed too, since moduli grow as their pressure.
    fixed_vane   only the shaft grows; the vane's figures stay as they are written, so that barbs
                 hang s^3 times as far for their length.

Stiffness and weight multiply all stiffnesses and all masses: frequencies go as the square root of
stiffness over weight, the droop as weight over stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind

Material = TypeVar("Material", VaneMaterial, RachisMaterial)

_BENDING_ALONG = "barb_bending_normal", "barb_bending_in_plane"
# powers of m and t with which figures of a vane grow, but for hook_slip
_POWERS = {
    **dict.fromkeys(("modulus_along_barbs", "modulus_across_barbs", "shear_modulus"), (1, 0)),
    **dict.fromkeys(("compression_guard", "hook_strength"), (1, 0)),
    **dict.fromkeys(("hook_yield_across", "hook_yield_shear"), (1, 0)),
    **dict.fromkeys((*_BENDING_ALONG, "bending_across"), (1, 3)),
    **dict.fromkeys(("barb_clamp_normal", "barb_clamp_in_plane"), (-1, -2)),
    **dict.fromkeys(("thickness", "hook_release", "surface_density"), (0, 1)),
}


def change_materials(
    kind: FeatherKind,
    size: float,
    stiffness: float,
    weight: float,
    drawn: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> dict[str, Any]:
    """Return the fields of a kind that is `size` times as large, with its stiffnesses and masses
    multiplied, which its materials change.

    drawn: factors of the vane's moduli across the barbs, along them, and of its thickness, of the
    same barbs and weight.
    """
    moduli = stiffness * (size if kind.scaling == "behaviour" else 1.0)
    grown = 1.0 if kind.scaling == "fixed_vane" else size
    wider, thicker = grown**kind.barb_spacing_exponent, grown**kind.thickness_exponent
    vane = {name: moduli**m * thicker**t for name, (m, t) in _POWERS.items()}
    vane["hook_slip"] = wider
    vane["surface_density"] *= weight
    across, along, thickness = drawn
    for name in ("modulus_across_barbs", "shear_modulus", "bending_across"):
        vane[name] *= across
    for name in ("modulus_along_barbs", *_BENDING_ALONG):
        vane[name] *= along
    vane["thickness"] *= thickness
    shaft = {"youngs_modulus": moduli, "shear_modulus": moduli}
    shaft |= {"cortex_density": weight, "core_density": weight}
    wall = size ** (kind.thickness_exponent - 1.0)
    shaft["cortex_fraction"] = min(wall, 1.0 / kind.rachis_material.cortex_fraction)
    return {
        "barb_spacing": kind.barb_spacing * wider,
        "vane_material": _times(kind.vane_material, vane),
        "rachis_material": _times(kind.rachis_material, shaft),
    }


def _times(part: Material, factors: Mapping[str, float]) -> Material:
    """A material with some of its figures multiplied."""
    changed = {name: getattr(part, name) * f for name, f in factors.items() if f != 1.0}
    return replace(part, **changed) if changed else part
