"""Compression guard of the vane: a cubic penalty on the loss of a triangle's area.

    W = b A k / 12 ((n - J) / 6)^3 = G (n - J)^3     for J < n, else 0;      G = b A k / 2592

    J^2 = (Q + d) / (1 + d),     Q = |a x c|^2 = 1 + 2 e_ww - (2 e_vw)^2

a and c are the barb's direction and the material direction across it, carried along, e_ww and
2 e_vw the strains of featherfx/mechanics/vane_membrane_kernels.py; J is the ratio of areas, k the
guard's modulus (Pa), b thickness, A rest area. Barbs keep their length (|a| = 1), so J follows
from these two strains alone, in both kinematics, and is that of their distance. n is 1 for a vane:
value, slope and curvature are zero at rest. Loose barbs are free to come nearer until the fibres
between two of them touch, n the part of the vane that these fill (mechanics/batch.py).

Without it a membrane that is linear in Green-Lagrange strain grows softer under compression and
yields nothing at all at J = 0, where the triangle turns over. J itself has a cone there; d rounds
it off, so that a vane can pass through a complete fold. Strained barbs (|a| < 1, nodal kinematics)
may bring Q below zero: from J^2 = d / 2 down J is taken as its tangent there.
Source: Kikuuwe et al. 2009 in the form of Jouve 2024, eq. 6.6; the derivatives are our own:

    dJ = (de_ww - s ds) / (J (1 + d)),     s = 2 e_vw
"""

from math import sqrt

from featherfx.algebra.views import shaped
from featherfx.jit.compiled import kernel, loop_kernel

GUARD_ROUNDING = 1e-3  # d
_MIN_AREA_RATIO = 0.5 * GUARD_ROUNDING  # of J^2, below which J goes on linearly in it


@kernel
def _ratio_and_root(strain_across, strain_shear):
    """J, and the root that dJ / d(J^2) = 1 / (2 root) holds."""
    unrounded = 1.0 + 2.0 * strain_across - strain_shear * strain_shear
    square = (unrounded + GUARD_ROUNDING) / (1.0 + GUARD_ROUNDING)
    root = sqrt(max(square, _MIN_AREA_RATIO))
    return root + 0.5 * min(square - _MIN_AREA_RATIO, 0.0) / root, root


@kernel
def area_ratio(strain_across, strain_shear):
    """J of strains e_ww and 2 e_vw."""
    ratio, _ = _ratio_and_root(strain_across, strain_shear)
    return ratio


@kernel
def is_apart(guard, strain_across, strain_shear):
    """Return whether a triangle feels nothing, J >= n; guard: (G, n)."""
    unrounded = 1.0 + 2.0 * strain_across - strain_shear * strain_shear
    return unrounded + GUARD_ROUNDING >= guard[1] * guard[1] * (1.0 + GUARD_ROUNDING)


@kernel
def guard_energy(guard, strain_across, strain_shear):
    """W of one triangle; guard: (G, n)."""
    if is_apart(guard, strain_across, strain_shear):
        return 0.0
    loss = guard[1] - area_ratio(strain_across, strain_shear)
    return guard[0] * loss * loss * loss if loss > 0.0 else 0.0


@kernel
def guard_slopes(guard, strain_across, strain_shear):
    """(dW/dJ, d2W/dJ2, dJ/de_ww, dJ/d(2 e_vw)) of one triangle; the first two 0 if J >= n."""
    ratio, root = _ratio_and_root(strain_across, strain_shear)
    loss = max(guard[1] - ratio, 0.0)
    by_across = 1.0 / (root * (1.0 + GUARD_ROUNDING))
    slope = -3.0 * guard[0] * loss * loss
    return slope, 6.0 * guard[0] * loss, by_across, -strain_shear * by_across


@kernel
def ratio_slopes(strain_across, strain_shear):
    """(dJ/de_ww, dJ/d(2 e_vw))."""
    _, _, by_across, by_shear = guard_slopes((1.0, 1.0), strain_across, strain_shear)
    return by_across, by_shear


@loop_kernel
def _pressed(guard, strains, count):
    """Number of triangles that feel their guard; guard, strains: (2 count,) or more."""
    found = 0
    for k in range(count):
        apart = is_apart((guard[2 * k], guard[2 * k + 1]), strains[2 * k], strains[2 * k + 1])
        found += 0 if apart else 1
    return found


@kernel
def is_pressed(guard, strains):
    """Return whether any triangle of a feather feels its guard; both as of guard_total."""
    count = guard.size // 2
    if count == 0:
        return False
    return _pressed(shaped(guard, (guard.size,)), shaped(strains, (strains.size,)), count) > 0


@kernel
def guard_total(guard, strains):
    """Energy of all triangles of a feather (J).

    guard: (G, n) of every triangle, (2, n-1, m, 2, 2), or of size 0 for none. strains: e_ww and
    2 e_vw, triangle by triangle in that order.
    """
    if not is_pressed(guard, strains):
        return 0.0
    total, each, strain = 0.0, guard.flat, strains.flat
    for a in range(guard.size // 2):
        own = each[2 * a], each[2 * a + 1]
        total += guard_energy(own, strain[2 * a], strain[2 * a + 1])
    return total
