"""Feather kinds for trial, written out in full, and a strategy for random ones."""

from __future__ import annotations

from hypothesis import strategies as st

from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import BarbGuide, FeatherKind, RachisShape, VaneShape

VANE_MATERIAL = VaneMaterial(
    modulus_along_barbs=3.6e8,
    modulus_across_barbs=4.8e4,
    shear_modulus=2.8e4,
    thickness=1.2e-4,
    surface_density=0.05,
    barb_bending_normal=2.5e-4,
    barb_bending_in_plane=2.5e-3,
    barb_taper=1.0,
    bending_across=1e-6,
    loss_factor=0.1,
)
RACHIS_MATERIAL = RachisMaterial(
    youngs_modulus=5e9,
    shear_modulus=1.5e9,
    cortex_fraction=0.2,
    flattening=0.9,
    cortex_density=1300.0,
    core_density=100.0,
    loss_factor=0.05,
)
NO_VANE = VaneShape((), ())


def feather_kind(
    leading: VaneShape,
    trailing: VaneShape,
    *,
    length: float = 0.35,
    calamus: float = 0.15,
    camber: float = 8.0,
    sweep: float = 12.0,
    twist: float = 5.0,
) -> FeatherKind:
    return FeatherKind(
        name="trial",
        length=length,
        calamus=calamus,
        barb_spacing=5e-4,
        rachis=RachisShape(0.006, 0.0008, 1.2, camber, sweep, twist),
        leading=leading,
        trailing=trailing,
        vane_material=VANE_MATERIAL,
        rachis_material=RACHIS_MATERIAL,
    )


LEADING_VANE = VaneShape(
    ((0.0, 0.0), (0.08, 0.022), (0.3, 0.035), (0.7, 0.036), (0.93, 0.022), (1.01, 0.0)),
    (
        BarbGuide(0.0, 35.0, 5.0, 3.0),
        BarbGuide(0.5, 28.0, 8.0, 3.0),
        BarbGuide(1.0, 22.0, 6.0, 2.0),
    ),
)
TRAILING_VANE = VaneShape(
    ((0.0, 0.0), (0.03, 0.05), (0.15, 0.1), (0.45, 0.12), (0.75, 0.1), (0.94, 0.05), (1.01, 0.0)),
    (
        BarbGuide(0.0, 65.0, 25.0, 8.0),
        BarbGuide(0.4, 48.0, 18.0, 8.0),
        BarbGuide(0.8, 40.0, 14.0, 5.0),
        BarbGuide(1.0, 25.0, 8.0, 3.0),
    ),
)
SWAN_PRIMARY = feather_kind(LEADING_VANE, TRAILING_VANE)


@st.composite
def vanes(draw: st.DrawFn, *, flat: bool = False) -> VaneShape:
    """Vanes that an artist may draw: any width to a fifth of the length, pointed or blunt base,
    barbs that spread towards the base, curl of either sign that ends short of the rachis."""
    if draw(st.integers(0, 9)) == 0:
        return NO_VANE
    width = draw(st.floats(0.005, 0.2))
    outline = (
        (0.0, width * draw(st.sampled_from([0.0, 0.5]))),
        (draw(st.floats(0.05, 0.2)), width * draw(st.floats(0.6, 1.0))),
        (draw(st.floats(0.4, 0.6)), width),
        (draw(st.floats(0.8, 0.9)), width * draw(st.floats(0.3, 0.9))),
        (draw(st.floats(0.97, 1.05)), 0.0),
    )
    base = draw(st.floats(15.0, 90.0))
    tip = draw(st.floats(15.0, base))
    camber = 0.0 if flat else draw(st.floats(-10.0, 30.0))
    guides = tuple(
        BarbGuide(position, angle, draw(st.floats(-0.2, 0.6)) * angle, camber)
        for position, angle in ((0.0, base), (0.5, 0.5 * (base + tip)), (1.0, tip))
    )
    return VaneShape(outline, guides)


@st.composite
def kinds(draw: st.DrawFn, *, flat: bool = False) -> FeatherKind:
    """Feather kinds; flat ones have no camber, sweep or twist at all."""
    camber, sweep, twist = 0.0, 0.0, 0.0
    if not flat:
        camber, sweep = draw(st.floats(-20.0, 60.0)), draw(st.floats(-20.0, 60.0))
        twist = draw(st.floats(-30.0, 30.0))
    return feather_kind(
        draw(vanes(flat=flat)),
        draw(vanes(flat=flat)),
        length=draw(st.floats(0.01, 1.0)),
        calamus=draw(st.sampled_from([0.0, 0.05, 0.15, 0.4])),
        camber=camber,
        sweep=sweep,
        twist=twist,
    )
