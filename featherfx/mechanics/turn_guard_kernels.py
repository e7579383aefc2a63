"""Guard against neighbouring rows of a rachis that turn all the way round against each other.

    W = G y^3 / (1 - y),      y = (w^2 - w0^2) / (4 pi^2 - w0^2),  0 at least,    w0 = 4 rad

w is the angle of p, the turn over an element (rachis_kernels), G (N m) the largest stiffness of
the feather's elements against bending or twist (derived here). At w = 2 pi the frame halfway
between two rows is any of a circle: the energy of stretch and bending has a kink there, which no
step gets over, however short. Barbs so far round would have passed through their neighbours long
before. W and its first two derivatives are zero up to w0 and smooth, and W is convex in p.
"""

from math import inf, pi

from featherfx.jit.compiled import kernel

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
