"""Section of the rachis: a hollow ellipse of keratin cortex around a light core.

    area A = pi/4 w h,   I_2 = pi/64 w h^3,   I_3 = pi/64 h w^3,   J = pi/16 w^3 h^3/(w^2 + h^2)

w outer width (along d2), h outer height (along d3). The core is the same ellipse scaled by
c = 1 - wall, so the cortex has A (1 - c^2), I (1 - c^4), J (1 - c^4). The core carries mass, no
load. Shear areas are 9/10 of a solid section's cortex and half of a thin tube's, linear between.
Sources: ellipse formulas are textbook ones; the shear factors bound Cowper 1966 within 10 %.
"""

from __future__ import annotations

import numpy as np

from featherfx.algebra.types import Array
from featherfx.groom.materials import RachisMaterial, VaneMaterial

# bending of a strip within its plane over that out of it, at most: more shows nowhere (by 4e-4 of
# the length in the strip of docs/hooks.md), but Newton's method takes 30 times as many iterations
_EDGEWISE_RATIO = 1e3


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
