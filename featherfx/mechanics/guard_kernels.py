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

Guard against neighbouring rows of a rachis that turn all the way round against each other.

    W = G y^3 / (1 - y),      y = (w^2 - w0^2) / (4 pi^2 - w0^2),  0 at least,    w0 = 4 rad

w is the angle of p, the turn over an element (rachis_kernels), G (N m) the largest stiffness of
the feather's elements against bending or twist (derived here). At w = 2 pi the frame halfway
between two rows is any of a circle: the energy of stretch and bending has a kink there, which no
step gets over, however short. Barbs so far round would have passed through their neighbours long
before. W and its first two derivatives are zero up to w0 and smooth, and W is convex in p.
"""

from math import inf, pi, sqrt

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


# rad^2: where it begins, and from there to its end
_FROM = 4.0**2
_RANGE = 4.0 * pi * pi - _FROM


@kernel
def _guard(stiffness, excess):
    """W (J) and its first two derivatives by w^2. stiffness: G. excess: w^2 - w0^2, above zero."""
    y = excess / _RANGE
    left = 1.0 - y
    if left <= 0.0:
        return inf, inf, inf
    scale = stiffness / left
    first = y * y * (3.0 - 2.0 * y) / left
    second = 2.0 * y * (3.0 + y * (y - 3.0)) / (left * left)
    return scale * y**3, scale * first / _RANGE, scale * second / (_RANGE * _RANGE)


@kernel
def _turn(model, f, i, strain):
    """p of element i (rad); strain: (6,) from rest."""
    rest = model.rachis_rest[f, i]
    return strain[3] + rest[3], strain[4] + rest[4], strain[5] + rest[5]


@kernel
def _excess(turn):
    return turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] - _FROM


@kernel
def _stiffest(stiffness):
    """G of a feather; stiffness: (n-1, 6), of its elements."""
    most = 0.0
    for i in range(stiffness.shape[0]):
        for k in range(3, 6):
            most = max(most, stiffness[i, k])
    return most


@kernel
def turn_guard_total(model, f, strains):
    """W of all elements of feather f (J); strains: (n-1, 6) from rest."""
    total = 0.0
    for i in range(strains.shape[0]):
        excess = _excess(_turn(model, f, i, strains[i]))
        if excess > 0.0:
            total += _guard(_stiffest(model.rachis_stiffness[f]), excess)[0]
    return total


@kernel
def add_turn_guard_stress(model, f, i, strain, stress):
    """Adds dW/dp to the stress (6,) of element i."""
    turn = _turn(model, f, i, strain)
    excess = _excess(turn)
    if excess > 0.0:
        slope = 2.0 * _guard(_stiffest(model.rachis_stiffness[f]), excess)[1]
        for k in range(3):
            stress[3 + k] += slope * turn[k]


@kernel
def add_turn_guard_stiffness(model, f, i, strain, gradient, matrix):
    """Adds d2W to the lower part of element i's matrix (12, 12).

    gradient: (6, 12) of its strains.
    """
    turn = _turn(model, f, i, strain)
    excess = _excess(turn)
    if excess <= 0.0:
        return
    w = _guard(_stiffest(model.rachis_stiffness[f]), excess)
    for a in range(12):
        along = 0.0
        for k in range(3):
            along += turn[k] * gradient[3 + k, a]
        for b in range(a + 1):
            both, other = 0.0, 0.0
            for k in range(3):
                both += gradient[3 + k, a] * gradient[3 + k, b]
                other += turn[k] * gradient[3 + k, b]
            matrix[a, b] += 2.0 * w[1] * both + 4.0 * w[2] * along * other
