"""Vane membrane: orthotropic, linear in the Green-Lagrange strain of the barb frame (v, w).

    W = 1/2 b A (E_vv e_vv^2 + E_ww e_ww^2 + 4 E_vw e_vw^2)        per triangle

    e_vv = (a.a - 1)/2,   e_ww = (c.c - 1)/2,   2 e_vw = a.c
    a = F v = (x_1 - x_0) / s,      c = F w = ((x_2 - x_0) - p a) / h

x_0, x_1 the ends of the triangle's barb edge (rest length s), x_2 the opposite node, whose rest
position is p along the barb and h across it; b thickness, A rest area, E_vv, E_ww, E_vw moduli
along barbs, across them and in shear (stress = E_vw times engineering shear 2 e_vw).
Source: Jouve 2024, eq. 4.1. In the barb-curvature kinematics e_vv is zero by construction.

Strains of one cell, triangle A then B: e_ww, 2 e_vw, e_ww, 2 e_vw.

A stretched vane resists being lifted, a compressed one wrinkles: with stresses f = E_ww e_ww and
g = 2 E_vw e_vw (times b A) the second variation holds, besides squares of the strains' variations,
the geometric stiffness

    f |dc|^2 + 2 g da.dc

Compression and shear make it indefinite. Within the triangle's plane it is small against those
squares; along its normal n it is all there is, and there it is the sum of l (n.(p da + q dc))^2
over both eigenvalues l of [[0, g], [g, f]] with unit eigenvectors (p, q): the positive one is its
stabilising part.
"""

from math import sqrt

from featherfx.algebra.vector_kernels import dot, length, normal_of, scale, store, sub
from featherfx.jit.compiled import kernel


@kernel
def membrane_strain(start, end, opposite, rest):
    """Strains (e_ww, 2 e_vw) of one triangle.

    start, end, opposite: (3,) nodes x_0, x_1, x_2. rest: (1/s, p, 1/h).
    """
    a = scale(rest[0], sub(end, start))
    c = scale(rest[2], sub(sub(opposite, start), scale(rest[1], a)))
    return 0.5 * (dot(c, c) - 1.0), dot(a, c)


@kernel
def membrane_slopes(start, end, opposite, rest):
    """Derivatives of both strains by one axis of each node.

    start, end, opposite: that axis of x_0, x_1, x_2. rest: (1/s, p, 1/h). Returns e_ww by
    start, end, opposite, then 2 e_vw.
    """
    edge, slant, reach = rest
    a = (end - start) * edge
    c = (opposite - start - slant * a) * reach
    across_tip, shear_tip = c * reach, a * reach
    across_end = -slant * edge * across_tip
    shear_end = (c - slant * shear_tip) * edge
    return (
        (-across_tip - across_end, across_end, across_tip),
        (-shear_tip - shear_end, shear_end, shear_tip),
    )


@kernel
def membrane_gradient(start, end, opposite, rest, gradient):
    """Gradients, written to gradient (2, 3, 3): strain, node (start, end, opposite), axis."""
    for k in range(3):
        slopes = membrane_slopes(start[k], end[k], opposite[k], (rest[0], rest[1], rest[2]))
        for node in range(3):
            gradient[0, node, k] = slopes[0][node]
            gradient[1, node, k] = slopes[1][node]


@kernel
def membrane_geometric_stiffness(rest, stress_across, stress_shear):
    """Geometric stiffness: factors of the unit matrix, of each pair of a triangle's nodes.

    rest: (1/s, p, 1/h). Returns those of x_0, x_1, x_2 with themselves, halved, and of (x_0, x_1),
    (x_0, x_2), (x_1, x_2).
    """
    edge, reach = rest[0], rest[2]
    slant = reach * rest[1] * edge
    dd = stress_across * reach * reach
    de = reach * (stress_shear * edge - stress_across * slant)
    ee = slant * (stress_across * slant - 2.0 * stress_shear * edge)
    return 0.5 * (dd + ee) + de, 0.5 * ee, 0.5 * dd, -de - ee, -dd - de, de


@kernel
def membrane_normal_stiffness(start, end, opposite, rest, stresses, stiffness, gradient):
    """Geometric stiffness along the triangle's normal, split by sign.

    stresses: (f, g). Written: stiffness (2,), the positive and the negative eigenvalue, and
    gradient (2, 3, 3) of n.(p a + q c) at fixed n for each: node (start, end, opposite), axis.
    """
    across, shear = stresses
    root = sqrt(across * across + 4.0 * shear * shear)
    normal = normal_of(start, end, opposite)
    size = length(normal)
    inverse = 1.0 / size if size > 0.0 else 0.0
    for e in range(2):
        value = 0.5 * (across + root) if e == 0 else 0.5 * (across - root)
        size = sqrt(value * value + shear * shear)
        p, q = 0.0, 0.0
        if size > 0.0:
            p, q = shear / size, value / size
        stiffness[e] = value
        by_opposite = q * rest[2] * inverse
        by_end = (p * inverse - by_opposite * rest[1]) * rest[0]
        store(gradient[e, 0], scale(-(by_opposite + by_end), normal))
        store(gradient[e, 1], scale(by_end, normal))
        store(gradient[e, 2], scale(by_opposite, normal))
