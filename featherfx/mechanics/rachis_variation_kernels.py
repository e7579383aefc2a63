"""Second variation of a rachis element's strains under its stress, for turns of any size.

With the symbols of rachis_kernels, world force F and moment M in the element, D = r_b - r_a, axis a
and angle w of the relative turn p, T = tan(w/4)/2, the halfway frame turns to second order by

    o1 = (u_a + u_b)/2 + T (u_b - u_a) x a
    o2 = T/2 [(o1 (a.(u_b - u_a))) - (|u_b|^2 - |u_a|^2)/2 a]

and the force part of the second variation is, with K = F x D,

    2 o1.(F x dD) + (o1.D)(o1.F) - (F.D)|o1|^2 + 2 o2.K

The moment part follows from exp(-u_a) exp(u_b) = exp(u_b - u_a - u_a x u_b / 2 + ...) and from the
derivative of the inverse left Jacobian L = I - [p]/2 + c [p]^2, with [p] the cross product's matrix
and c(w) = 1/w^2 - cot(w/2)/(2 w):

    -g.(u_a x u_b) + (u_b - u_a).W (u_b - u_a),      g = L^T m
    W = (c (1 - c w^2) - 1/4)(m.p) I + (c'/w + c^2)(m.p) p p^T + sym(z p^T)
    z = (1/4 - c' w - 2 c) m + c/2 p x m + c g

where p and m = M seen from row a are taken to the world (all derived here; checked by second
differences in the tests).
"""

from math import cos, sin, sqrt, tan

from featherfx.algebra.rotation_kernels import cross
from featherfx.jit.compiled import kernel


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _combined(s, a, t, b):
    """s a + t b of two vectors."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@kernel
def _crossed(a, b):
    return cross(a[0], a[1], a[2], b[0], b[1], b[2])


@kernel
def _cross_entry(v, i, j):
    """Entry (i, j) of the cross product's matrix [v]."""
    if i == j:
        return 0.0
    return v[3 - i - j] if (j - i) % 3 == 2 else -v[3 - i - j]


@kernel
def _to_world(halfway, x, y, z):
    return (
        halfway[0, 0] * x + halfway[0, 1] * y + halfway[0, 2] * z,
        halfway[1, 0] * x + halfway[1, 1] * y + halfway[1, 2] * z,
        halfway[2, 0] * x + halfway[2, 1] * y + halfway[2, 2] * z,
    )


@kernel
def _inverse_slopes(angle):
    """c and c'/w of the inverse left Jacobian."""
    if angle < 0.03:
        square = angle * angle
        return 1.0 / 12.0 + square / 720.0, 1.0 / 360.0 + square / 7560.0
    sine = sin(0.5 * angle)
    cotangent = cos(0.5 * angle) / sine
    square = angle * angle
    c = 1.0 / square - 0.5 * cotangent / angle
    slope = (-2.0 / angle + 0.5 * cotangent) / square + 0.25 / (angle * sine * sine)
    return c, slope / angle


@kernel
def _add_moment(turn, angle, axis, moment, matrix):
    """Moment part; turn p and moment M, as the halfway frame sees it, in the world."""
    # from the halfway frame to row a: back by half the turn
    half = -0.5 * angle
    s, v = sin(half), 1.0 - cos(half)
    side = _crossed(axis, moment)
    m = _combined(1.0, moment, s, side)
    m = _combined(1.0, m, v, _crossed(axis, side))
    c, slope = _inverse_slopes(angle)
    square = angle * angle
    across = _crossed(turn, m)
    g = _combined(0.5, across, c, _crossed(turn, across))
    g = _combined(1.0, m, 1.0, g)
    work = _dot(m, turn)
    z = _combined(0.25 - slope * square - 2.0 * c, m, 0.5 * c, across)
    z = _combined(1.0, z, c, g)
    diagonal = (c * (1.0 - c * square) - 0.25) * work
    outer = (slope + c * c) * work
    for i in range(3):
        for j in range(3):
            value = outer * turn[i] * turn[j] + 0.5 * (z[i] * turn[j] + turn[i] * z[j])
            if i == j:
                value += diagonal
            if j <= i:
                matrix[3 + i, 3 + j] += value
                matrix[9 + i, 9 + j] += value
            matrix[9 + i, 3 + j] -= value + 0.5 * _cross_entry(g, i, j)


@kernel
def _add_force(force, span, lever, axis, matrix):
    """Force part; span: D, lever: T."""
    work, along = _dot(force, span), _dot(axis, force)
    couple = _crossed(force, span)
    twist = 0.5 * lever * _dot(couple, axis)
    d, f, k = _crossed(axis, span), _crossed(axis, force), _crossed(axis, couple)
    da, db = _combined(0.5, span, -lever, d), _combined(0.5, span, lever, d)
    fa, fb = _combined(0.5, force, -lever, f), _combined(0.5, force, lever, f)
    ka, kb = _combined(0.5, couple, -lever, k), _combined(0.5, couple, lever, k)
    tilt = 0.5 * lever
    for i in range(3):
        for j in range(3):
            same = 1.0 if i == j else 0.0
            flat = lever * lever * (same - axis[i] * axis[j])
            turn = 0.5 * _cross_entry(force, i, j)
            lean = lever * (force[i] * axis[j] - same * along)
            if j <= i:
                own = -work * (0.25 * same + flat)
                matrix[3 + i, 3 + j] += own + 0.5 * (da[i] * fa[j] + fa[i] * da[j]) + twist * same
                matrix[3 + i, 3 + j] -= tilt * (ka[i] * axis[j] + axis[i] * ka[j])
                matrix[9 + i, 9 + j] += own + 0.5 * (db[i] * fb[j] + fb[i] * db[j]) - twist * same
                matrix[9 + i, 9 + j] += tilt * (kb[i] * axis[j] + axis[i] * kb[j])
            both = 0.25 * same - flat + lever * _cross_entry(axis, i, j)
            matrix[9 + i, 3 + j] += 0.5 * (db[i] * fa[j] + fb[i] * da[j]) - work * both
            matrix[9 + i, 3 + j] += tilt * (axis[i] * ka[j] - kb[i] * axis[j])
            matrix[3 + i, j] -= turn - lean
            matrix[9 + i, j] -= turn + lean
            matrix[9 + i, 6 + j] += turn + lean
            # block (r_b, u_a) is the transpose of (u_a, r_b)
            matrix[6 + j, 3 + i] += turn - lean


@kernel
def rachis_variation(point_a, point_b, length, halfway, strain, stress, matrix):
    """Second variation of one element, added to the lower part of matrix (12, 12).

    strain, stress: (6,), as in rachis_kernels; the matrix is for (dr_a, u_a, dr_b, u_b).
    """
    angle = sqrt(strain[3] ** 2 + strain[4] ** 2 + strain[5] ** 2)
    turn = _to_world(halfway, strain[3], strain[4], strain[5])
    axis = (0.0, 0.0, 0.0)
    if angle > 1e-8:
        axis = _combined(1.0 / angle, turn, 0.0, turn)
    force = _to_world(halfway, stress[0] / length, stress[1] / length, stress[2] / length)
    span = (point_b[0] - point_a[0], point_b[1] - point_a[1], point_b[2] - point_a[2])
    _add_force(force, span, 0.5 * tan(0.25 * angle), axis, matrix)
    moment = _to_world(halfway, stress[3], stress[4], stress[5])
    _add_moment(turn, angle, axis, moment, matrix)
