"""Strain and energy of the vanes as they are drawn, per face, by the mechanics' own strain.

    density = 1/2 b (E_ww e_ww^2 + 4 E_vw e_vw^2)        J per square metre of the vane at rest

e_ww, e_vw Green-Lagrange strain across the barbs and in shear, b thickness, E_ww and E_vw moduli
(featherfx/mechanics/vane_membrane_kernels.py). A face of the shaft has none: zero.
"""

from featherfx.jit.compiled import kernel
from featherfx.mechanics.vane_membrane_kernels import membrane_strain


@kernel
def face_strains(world, corners, rest, across, shear):
    """e_ww and e_vw (T,) of faces.

    world: (V, 3). corners: (T, 3) ends of the barb edge and the third point. rest: (T, 3) 1/s, p,
    1/h, zero for a face without strain.
    """
    for t in range(corners.shape[0]):
        across[t], shear[t] = 0.0, 0.0
        if rest[t, 0] > 0.0:
            start, end, opposite = corners[t, 0], corners[t, 1], corners[t, 2]
            first, second = membrane_strain(world[start], world[end], world[opposite], rest[t])
            across[t], shear[t] = first, 0.5 * second


@kernel
def energy_density(across, shear, across_stiffness, shear_stiffness, out):
    """(T,) J/m^2 of strains (T,). Stiffnesses: N/m, modulus times thickness."""
    for t in range(out.shape[0]):
        stretched = across_stiffness * across[t] * across[t]
        out[t] = 0.5 * (stretched + 4.0 * shear_stiffness * shear[t] * shear[t])
