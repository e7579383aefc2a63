"""What becomes of a feather's materials when its size, stiffness or weight is changed.

A feather s times as long keeps its shape: diameters, thickness and distance of barbs grow with s,
and what its materials are given by per area or per metre of vane follows, with moduli m times as
large:

    quantity                                       factor
    length, diameters, thickness, barb spacing,
      slip and release of hooks                    s
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

from featherfx.groom.types import FeatherKind, RachisMaterial, VaneMaterial


def materials_resized(kind: FeatherKind, size: float) -> FeatherKind:
    """The kind with the materials that it has `size` times as large; its shape is left alone."""
    if size == 1.0 or kind.scaling == "fixed_vane":
        return kind
    moduli = size if kind.scaling == "behaviour" else 1.0
    return replace(
        kind,
        barb_spacing=kind.barb_spacing * size,
        vane_material=_thicker(_stiffer(kind.vane_material, moduli), size),
        rachis_material=_stiffer_shaft(kind.rachis_material, moduli),
    )


def dialled(kind: FeatherKind, stiffness: float, weight: float) -> FeatherKind:
    """The kind with all its stiffnesses and all its masses multiplied."""
    if (stiffness, weight) == (1.0, 1.0):
        return kind
    vane, shaft = kind.vane_material, kind.rachis_material
    vane = replace(vane, surface_density=vane.surface_density * weight)
    shaft = replace(
        shaft,
        cortex_density=shaft.cortex_density * weight,
        core_density=shaft.core_density * weight,
    )
    return replace(
        kind,
        vane_material=_stiffer(vane, stiffness),
        rachis_material=_stiffer_shaft(shaft, stiffness),
    )


def _stiffer(vane: VaneMaterial, factor: float) -> VaneMaterial:
    return replace(
        vane,
        along=vane.along * factor,
        across=vane.across * factor,
        shear=vane.shear * factor,
        barb_bending_normal=vane.barb_bending_normal * factor,
        barb_bending_in_plane=vane.barb_bending_in_plane * factor,
        bending_across=vane.bending_across * factor,
        compression_guard=vane.compression_guard * factor,
        hook_yield_across=vane.hook_yield_across * factor,
        hook_yield_shear=vane.hook_yield_shear * factor,
        hook_strength=vane.hook_strength * factor,
        barb_clamp_normal=vane.barb_clamp_normal / factor,
        barb_clamp_in_plane=vane.barb_clamp_in_plane / factor,
    )


def _thicker(vane: VaneMaterial, size: float) -> VaneMaterial:
    """`size` times as thick, with barbs `size` times as long and as thick."""
    return replace(
        vane,
        thickness=vane.thickness * size,
        hook_slip=vane.hook_slip * size,
        hook_release=vane.hook_release * size,
        surface_density=vane.surface_density * size,
        barb_bending_normal=vane.barb_bending_normal * size**3,
        barb_bending_in_plane=vane.barb_bending_in_plane * size**3,
        bending_across=vane.bending_across * size**3,
        barb_clamp_normal=vane.barb_clamp_normal / size**2,
        barb_clamp_in_plane=vane.barb_clamp_in_plane / size**2,
    )


def _stiffer_shaft(shaft: RachisMaterial, factor: float) -> RachisMaterial:
    return replace(shaft, young=shaft.young * factor, shear=shaft.shear * factor)
