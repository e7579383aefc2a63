"""Vane membrane: orthotropic, linear in the Green-Lagrange strain of the barb frame (v, w).

    W = 1/2 b A (E_vv e_vv^2 + E_ww e_ww^2 + 4 E_vw e_vw^2)        per triangle

    e_vv = (a.a - 1)/2,   e_ww = (c.c - 1)/2,   2 e_vw = a.c
    a = F v = (x_1 - x_0) / s,      c = F w = ((x_2 - x_0) - p a) / h

x_0, x_1 the ends of the triangle's barb edge (rest length s), x_2 the opposite node, whose rest
position is p along the barb and h across it; b thickness, A rest area, E_vv, E_ww, E_vw moduli
along barbs, across them and in shear (stress = E_vw times engineering shear 2 e_vw).
Source: Jouve 2024, eq. 4.1. In the barb-curvature kinematics e_vv is zero by construction.

Strains of one cell, triangle A then B: e_ww, 2 e_vw, e_ww, 2 e_vw.

A stretched vane resists being lifted, a compressed one wrinkles: with stresses s = E_ww e_ww and
t = 2 E_vw e_vw the second variation holds s |dc|^2 + 2 t da.dc besides the squares of the strain
variations. Within the triangle's plane it is small against those; along its normal n it is all
there is. It is the sum of l (n.(p da + q dc))^2 over both eigenvalues l of [[0, t], [t, s]] with
unit eigenvectors (p, q).
"""

from math import sqrt

from featherfx.jit.compiled import kernel


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
def membrane_slopes(start, end, opposite, edge, slant, reach):
    """Derivatives of both strains by one axis of each node.

    start, end, opposite: that axis of x_0, x_1, x_2. edge, slant, reach: 1/s, p, 1/h. Returns e_ww
    by start, end, opposite, then 2 e_vw.
    """
    a = (end - start) * edge
    c = (opposite - start - slant * a) * reach
    across, shear = c * reach, a * reach
    across_end = -slant * edge * across
    shear_end = (c - slant * shear) * edge
    return -across - across_end, across_end, across, -shear - shear_end, shear_end, shear


@kernel
def membrane_gradient(start, end, opposite, rest, gradient):
    """Gradients, written to gradient (2, 3, 3): strain, node (start, end, opposite), axis."""
    for k in range(3):
        slopes = membrane_slopes(start[k], end[k], opposite[k], rest[0], rest[1], rest[2])
        for node in range(3):
            gradient[0, node, k] = slopes[node]
            gradient[1, node, k] = slopes[3 + node]


@kernel
def membrane_lift(start, end, opposite, rest, across, shear, stiffness, gradient):
    """Geometric stiffness along the triangle's normal.

    across, shear: stresses s, t (times b A). Written: stiffness (2,), the positive and the
    negative eigenvalue, and gradient (2, 3, 3) of n.(p a + q c) at fixed n for each: node (start,
    end, opposite), axis.
    """
    root = sqrt(across * across + 4.0 * shear * shear)
    ux, uy, uz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    vx, vy, vz = opposite[0] - start[0], opposite[1] - start[1], opposite[2] - start[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = sqrt(nx * nx + ny * ny + nz * nz)
    scale = 1.0 / length if length > 0.0 else 0.0
    for e in range(2):
        value = 0.5 * (across + root) if e == 0 else 0.5 * (across - root)
        size = sqrt(value * value + shear * shear)
        p, q = 0.0, 0.0
        if size > 0.0:
            p, q = shear / size, value / size
        stiffness[e] = value
        by_opposite = q * rest[2] * scale
        by_end = (p * scale - by_opposite * rest[1]) * rest[0]
        for k in range(3):
            n = nx if k == 0 else (ny if k == 1 else nz)
            gradient[e, 0, k] = -(by_opposite + by_end) * n
            gradient[e, 1, k] = by_end * n
            gradient[e, 2, k] = by_opposite * n
