"""Number of curvature coefficients that a feather's barbs need, and of rows that its rachis needs.

A barb under a pressure q on its vane is a cantilever with the stiffness D b(s) per metre of vane
(b: featherfx/mechanics/vane_rest.py) and the load q; its end goes down by

    d = (q L^4 / D) integral_0^1 (1 - s)^3 / (2 b(s)) ds          (L^4 q / (8 D) for b = 1)

and at most by about its length. C coefficients miss a share r_C of that: the distance between the
barb's end with C coefficients and with eight over the deflection, largest over loads that are
uniform, grow towards the end, and stand at it, tapers 0 to 2 and deflections of 1 to 50 % of the
length, six segments (tests/mechanics/test_resolution.py measures it again).

A rachis under a load p per length is a cantilever, too, whose tip goes down by

    d = integral_0^L M(s) (L - s) / EI(s) ds,     M(s) = integral_s^L p(t) (t - s) dt

and at most by about its length. The rows are of second order: n of them miss c d / (n - 1)^2.
c is 0.2 to 1.3 for points of the rachis, and up to 7 for those of broad vanes, whose outline the
rows cut (the shipped presets under gravity and ten times that, 6 to 21 rows against 81).

Section of the rachis: a hollow ellipse of keratin cortex around a light core.

    area A = pi/4 w h,   I_2 = pi/64 w h^3,   I_3 = pi/64 h w^3,   J = pi/16 w^3 h^3/(w^2 + h^2)

w outer width (along d2), h outer height (along d3). The core is the same ellipse scaled by
c = 1 - wall, so the cortex has A (1 - c^2), I (1 - c^4), J (1 - c^4). The core carries mass, no
load. Shear areas are 9/10 of a solid section's cortex and half of a thin tube's, linear between.
Sources: ellipse formulas are textbook ones; the shear factors bound Cowper 1966 within 10 %.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np

from featherfx.algebra.types import Array
from featherfx.feather.profiles import at_places, barb_bending, vane_shares
from featherfx.feather.types import Feather
from featherfx.groom.materials import RachisMaterial, VaneMaterial
from featherfx.groom.types import FeatherKind

# bending of a strip within its plane over that out of it, at most: more shows nowhere (by 4e-4 of
# the length in the strip of docs/hooks.md), but Newton's method takes 30 times as many iterations
_EDGEWISE_RATIO = 1e3
MIN_BARB_STIFFNESS = 0.05


def _section(width: Array, height: Array) -> tuple[Array, Array, Array, Array]:
    area = np.pi / 4 * width * height
    about_second = np.pi / 64 * width * height**3
    about_third = np.pi / 64 * height * width**3
    torsion = np.pi / 16 * (width * height) ** 3 / (width**2 + height**2)
    return area, about_second, about_third, torsion


def rachis_stiffness(width: Array, height: Array, material: RachisMaterial) -> tuple[Array, Array]:
    """((k, 3) EA, GA_2, GA_3 in N; (k, 3) GJ, EI_2, EI_3 in N m^2) of sections (k,), m."""
    area, about_second, about_third, torsion = _section(width, height)
    core = 1.0 - material.cortex_fraction
    cortex = area * (1.0 - core**2)
    shear = material.shear_modulus * cortex * (0.5 + 0.4 * material.cortex_fraction)
    hollow = 1.0 - core**4
    bend = [
        material.shear_modulus * torsion * hollow,
        material.youngs_modulus * about_second * hollow,
        material.youngs_modulus * about_third * hollow,
    ]
    return np.stack([material.youngs_modulus * cortex, shear, shear], -1), np.stack(bend, -1)


def strip_stiffness(width: Array, vane: VaneMaterial) -> tuple[Array, Array]:
    """As rachis_stiffness, of flat strips as thick as a vane, as rods: Y h^3 = 12 (1 - nu^2) D."""
    beam = (1.0 - vane.poissons_ratio**2) * vane.bending_across * width
    stretch = 12.0 * beam / vane.thickness**2
    shear = 5.0 / 12.0 * stretch / (1.0 + vane.poissons_ratio)
    twist = 2.0 * beam / (1.0 + vane.poissons_ratio)
    bend = [twist, beam, beam * np.minimum((width / vane.thickness) ** 2, _EDGEWISE_RATIO)]
    return np.stack([stretch, shear, shear], -1), np.stack(bend, -1)


def rachis_mass(
    width: Array, height: Array, material: RachisMaterial
) -> tuple[Array, Array, Array]:
    """Mass per length (kg/m) and its second moments about d2 and d3 (kg m) of sections (k,)."""
    area, about_second, about_third, _ = _section(width, height)
    core = 1.0 - material.cortex_fraction

    def weighted(solid: Array, power: int) -> Array:
        inner = core**power
        return solid * (material.cortex_density * (1.0 - inner) + material.core_density * inner)

    return weighted(area, 2), weighted(about_second, 4), weighted(about_third, 4)


# share of the deflection that C = 0, 1, ... coefficients miss
MISSED_DEFLECTION = (1.0, 0.16, 0.004, 0.0006, 0.0001)
# c of the rows, and the numbers of them that are chosen from: each twice the work of the second
# before, few enough that feathers of one kind stay together
_MISSED_BY_ROWS = 7.0
_EVEN = (np.arange(200) + 0.5) / 200
ROW_NUMBERS = (6, 8, 11, 15, 21, 29, 41, 57, 81, 113, 161, 225, 321)


def barb_deflection(feather: Feather, kind: FeatherKind, pressure: float) -> float:
    """m, how far a pressure (Pa) moves the end of the longest barb; at most the barb's length."""
    return min(barb_load(feather, kind, pressure), float(feather.barb_length.max()))


def barb_load(feather: Feather, kind: FeatherKind, pressure: float) -> float:
    """m, how far a pressure (Pa) would move the end of the longest barb if it bent in proportion:
    a load over a stiffness, however far."""
    vane = kind.vane_material
    if vane.ribbon:
        return 0.0
    s = _EVEN
    stiffness = stiffness_along(vane.barb_taper, s) * barb_bending(vane, s)
    flexibility = float(np.mean((1.0 - s) ** 3 / (2.0 * stiffness)))
    length = float(feather.barb_length.max())
    shares = np.linspace(0.0, 1.0, feather.rows)
    thick = at_places(vane.thickness_profile.rachis, shares)
    weakest = (at_places(vane.along_barbs_profile.rachis, shares) * thick**3).min()
    return float(pressure * length**4 / (vane.barb_bending_normal * weakest) * flexibility)


# What the grid may miss, over the tolerance of a single step: steps within the tolerance add up to
# trajectories that err by 6 to 20 times as much (docs/benchmarks.md), so a finer grid would not
# show.
GRID_SCALE = 5.0


def coefficients_for(feather: Feather, kind: FeatherKind, pressure: float, tolerance: float) -> int:
    """Fewest coefficients whose error stays below a tolerance (m) under a pressure (Pa).

    tolerance: of what the grid may miss, see GRID_SCALE.
    """
    deflection = barb_deflection(feather, kind, pressure)
    for count, missed in enumerate(MISSED_DEFLECTION):
        if missed * deflection <= tolerance:
            return count
    return len(MISSED_DEFLECTION) - 1


def vane_width(feather: Feather) -> np.ndarray:
    """(n,) m, how far both vanes together reach from the rachis at every row."""
    m = feather.columns
    nodes, lateral = feather.rest.nodes, feather.rest.directors[:, 0]
    ends = nodes[:, [m, 2 * m]] - nodes[:, :1]
    return np.asarray(np.abs(np.einsum("nsk,nk->ns", ends, lateral)).sum(axis=1))


def rachis_deflection(
    feather: Feather, kind: FeatherKind, acceleration: float, pressure: float
) -> float:
    """m, how far the tip goes under an acceleration (m/s^2) across the vane and a pressure (Pa)."""
    section = kind.rachis_material
    line, _, _ = rachis_mass(feather.width, feather.height, section)
    s = feather.station
    _, bending = rachis_stiffness(feather.width, feather.height, section)
    bending = bending * at_places(section.modulus_profile, s / s[-1])[:, None]
    width = vane_width(feather)
    if kind.vane_material.ribbon:
        _, flat = strip_stiffness(width, kind.vane_material)
        bending = np.where(width[:, None] > 0.0, flat, bending)
    thick = kind.vane_material.thickness_profile
    on_rachis = at_places(thick.rachis, vane_shares(kind, s))
    density = kind.vane_material.surface_density * on_rachis * np.mean(at_places(thick.barb, _EVEN))
    load = line * acceleration + width * (density * acceleration + pressure)
    step = np.diff(s)

    def beyond(values: np.ndarray) -> np.ndarray:
        """(n,) integral from every row to the tip, by trapezoids."""
        parts = 0.5 * step * (values[1:] + values[:-1])
        return np.append(np.cumsum(parts[::-1])[::-1], 0.0)

    moment = beyond(beyond(load))
    deflection = float(beyond(moment * (s[-1] - s) / bending[:, 1])[0])
    return min(deflection, kind.length)


def rows_for(deflection: float, tolerance: float, most: int) -> int:
    """Fewest rows, at most `most`, whose error stays below a tolerance (m) at a deflection (m)."""
    for rows in ROW_NUMBERS:
        if rows >= most or _MISSED_BY_ROWS * deflection <= tolerance * (rows - 1) ** 2:
            return min(rows, most)
    return most


def has_elastic_clamp(kind: FeatherKind) -> bool:
    """Return whether the barbs turn at their roots."""
    vane = kind.vane_material
    return vane.barb_clamp_normal > 0.0 or vane.barb_clamp_in_plane > 0.0


def barb_course(kind: FeatherKind) -> Hashable:
    """Return what the shapes of bent barbs depend on: how their stiffness changes along them."""
    vane = kind.vane_material
    return vane.barb_taper, vane.along_barbs_profile.barb, vane.thickness_profile.barb


def may_slip(kind: FeatherKind) -> bool:
    """Return whether gaps between the barbs slip, are open or are closed, and keep what they
    slipped."""
    return kind.vane_material.hooks != "closed" or kind.is_split


def is_guarded(kind: FeatherKind, touching: bool) -> bool:
    """Return whether triangles are kept from being crushed, or loose barbs from passing through
    each other; those that are loose by their kind only where they touch."""
    if kind.vane_material.compression_guard > 0.0 or may_open(kind):
        return True
    loose = any(
        fraction < 1.0
        for vane in (kind.leading, kind.trailing)
        for curve in (vane.hooked.rachis, vane.hooked.barb)
        for _, fraction in curve
    )
    return touching and loose


def may_open(kind: FeatherKind) -> bool:
    return kind.vane_material.hooks == "open" or kind.is_split


def stiffness_along(taper: float, places: Array) -> Array:
    """(K,) b at places (K,) of a barb without factors of its own."""
    return np.maximum((1.0 - places) ** taper, MIN_BARB_STIFFNESS)
