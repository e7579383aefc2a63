"""Vane membrane: orthotropic, linear in the Green-Lagrange strain of the barb frame (v, w).

    W = 1/2 b A (E_vv e_vv^2 + E_ww e_ww^2 + 4 E_vw e_vw^2)        per triangle

    e_vv = (a.a - 1)/2,   e_ww = (c.c - 1)/2,   2 e_vw = a.c
    a = F v = (x_1 - x_0) / s,      c = F w = ((x_2 - x_0) - p a) / h

x_0, x_1 the ends of the triangle's barb edge (rest length s), x_2 the opposite node, whose rest
position is p along the barb and h across it; b thickness, A rest area, E_vv, E_ww, E_vw moduli
along barbs, across them and in shear (stress = E_vw times engineering shear 2 e_vw).
Source: Jouve 2024, eq. 4.1. In the barb-curvature kinematics e_vv is zero by construction.

Strains of one cell, triangle A then B: e_ww, 2 e_vw, e_ww, 2 e_vw.
"""

from featherfx.compiled import kernel


@kernel
def membrane_strain(start, end, opposite, rest):
    """Strains (e_ww, 2 e_vw) of one triangle.

    start, end, opposite: (3,) nodes x_0, x_1, x_2. rest: (1/s, p, 1/h).
    """
    across, shear = 0.0, 0.0
    for k in range(3):
        a = (end[k] - start[k]) * rest[0]
        c = (opposite[k] - start[k] - rest[1] * a) * rest[2]
        across += c * c
        shear += a * c
    return 0.5 * (across - 1.0), shear


@kernel
def membrane_gradient(start, end, opposite, rest, gradient):
    """Gradients, written to gradient (2, 3, 3): strain, node (start, end, opposite), axis."""
    for k in range(3):
        a = (end[k] - start[k]) * rest[0]
        c = (opposite[k] - start[k] - rest[1] * a) * rest[2]
        by_opposite = c * rest[2]
        by_end = -rest[1] * rest[0] * by_opposite
        gradient[0, 2, k] = by_opposite
        gradient[0, 1, k] = by_end
        gradient[0, 0, k] = -by_opposite - by_end
        by_opposite = a * rest[2]
        by_end = (c - rest[1] * by_opposite) * rest[0]
        gradient[1, 2, k] = by_opposite
        gradient[1, 1, k] = by_end
        gradient[1, 0, k] = -by_opposite - by_end
