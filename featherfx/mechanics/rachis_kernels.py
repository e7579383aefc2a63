"""Rachis: geometrically exact (Cosserat) beam between two rows a and b.

    W = 1/2 l sum_k c_k (v_k - v0_k)^2 + 1/(2 l) sum_k d_k (p_k - p0_k)^2

    v = R^T (r_b - r_a) / l    stretch (axis 1) and shears, in the frame R halfway between the
                               row frames R_a and R_b
    p = log(R_a^T R_b)         twist (axis 1) and bending angles over the element, rad
    c = (EA, GA_2, GA_3)  N,   d = (GJ, EI_2, EI_3)  N m^2,   l  m at rest;  v0, p0  at rest

Source: Simo 1985, Reissner 1981; one point per element, so it does not lock. With a the axis and
w the angle of p, world rotation increments u_a, u_b of the frames give (all derivatives here are
our own; checked by finite differences in the tests)

    dp = S R^T (u_b - u_a),                  S = f I + (1 - f) a a^T,  f = (w/2) / sin(w/2)
    dm = (u_a + u_b)/2 + T (u_b - u_a) x (R a)     rotation of the halfway frame, T = tan(w/4)/2
    dv = R^T (dr_b - dr_a - dm x (r_b - r_a)) / l

both smooth up to a relative turn of 2 pi of two neighbouring rows.

Geometric stiffness is the second variation of the strains under their stress, for turns of any
size. With world force F and moment M in the element, D = r_b - r_a and a in the world, the halfway
frame turns to second order by

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

where p and m = M seen from row a are taken to the world.
"""

from math import cos, sin, tan

from featherfx.algebra.vector_kernels import (
    add,
    combined,
    conjugate,
    cross,
    dot,
    halfway_between,
    length,
    logarithm,
    matrix_into,
    multiply,
    over,
    scale,
    store,
    sub,
)
from featherfx.jit.compiled import kernel

# rad: below it a turn has no axis
_NO_TURN = 1e-8


@kernel
def _column(matrix, k):
    return matrix[0, k], matrix[1, k], matrix[2, k]


@kernel
def _to_world(halfway, v):
    return dot(halfway[0], v), dot(halfway[1], v), dot(halfway[2], v)


@kernel
def rachis_strain(row_a, row_b, point_a, point_b, rest_length, halfway, strain):
    """Strains of one element.

    The quaternions' signs tell turns beyond pi from those the other way about: q and -q are the
    same frame, but only one of them is where the row came from.

    row_a, row_b: (4,) quaternions. point_a, point_b: (3,). Written: halfway (3, 3), the frame R,
    and strain (6,): v then p.
    """
    matrix_into(halfway_between(row_a, row_b), halfway)
    span = over(sub(point_b, point_a), rest_length)
    for k in range(3):
        strain[k] = dot(_column(halfway, k), span)
    store(strain[3:], logarithm(multiply(conjugate(row_a), row_b)))


@kernel
def rachis_gradient(point_a, point_b, rest_length, halfway, strain, gradient):
    """Gradient of the six strains: gradient (6, 12) for (r_a, u_a, r_b, u_b)."""
    angle = length(strain[3:])
    factor, lever, axis = 1.0, 0.0, (0.0, 0.0, 0.0)
    if angle > _NO_TURN:
        factor = 0.5 * angle / sin(0.5 * angle)
        lever = 0.5 * tan(0.25 * angle)
        axis = over(strain[3:], angle)
    world = _to_world(halfway, axis)
    span = over(sub(point_b, point_a), rest_length)
    for k in range(3):
        normal, stretch, bend = _column(halfway, k), gradient[k], gradient[k + 3]
        # dv_k = n.(dr_b - dr_a)/l - (d x n).dm, dm = (u_a + u_b)/2 + T (u_b - u_a) x (R a)
        moment = cross(span, normal)
        twist = cross(moment, world)
        by_end = over(normal, rest_length)
        store(stretch, scale(-1.0, by_end))
        store(stretch[3:], combined(-0.5, moment, -lever, twist))
        store(stretch[6:], by_end)
        store(stretch[9:], combined(-0.5, moment, lever, twist))
        by_turn = combined(factor, normal, (1.0 - factor) * axis[k], world)
        bend[:] = 0.0
        store(bend[3:], scale(-1.0, by_turn))
        store(bend[9:], by_turn)


@kernel
def rachis_stabilising_stiffness(point_a, point_b, rest_length, halfway, stress, matrix):
    """Add the stiffness of an element's tension against turning to the lower part of (12, 12).

    stress: (6,) derivative of the energy by the strains. Nothing is added under compression: this
    is the part of rachis_geometric_stiffness that never destabilises.
    """
    span = sub(point_b, point_a)
    work, square = 0.0, dot(span, span)
    for i in range(3):
        for k in range(3):
            work += halfway[i, k] * stress[k] / rest_length * span[i]
    if work <= 0.0 or square == 0.0:
        return
    for i in range(3):
        for j in range(3):
            value = -work / square * span[i] * span[j] / square
            if i == j:
                value += work / square
            if j <= i:
                matrix[i, j] += value
                matrix[6 + i, 6 + j] += value
            matrix[6 + i, j] -= value


@kernel
def _cross_entry(v, i, j):
    """Entry (i, j) of the cross product's matrix [v]."""
    if i == j:
        return 0.0
    return v[3 - i - j] if (j - i) % 3 == 2 else -v[3 - i - j]


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
    side = cross(axis, moment)
    m = add(moment, scale(s, side))
    m = add(m, scale(v, cross(axis, side)))
    c, slope = _inverse_slopes(angle)
    square = angle * angle
    arm = cross(turn, m)
    g = combined(0.5, arm, c, cross(turn, arm))
    g = add(m, g)
    work = dot(m, turn)
    z = combined(0.25 - slope * square - 2.0 * c, m, 0.5 * c, arm)
    z = add(z, scale(c, g))
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
    work, along = dot(force, span), dot(axis, force)
    couple = cross(force, span)
    twist = 0.5 * lever * dot(couple, axis)
    d, f, k = cross(axis, span), cross(axis, force), cross(axis, couple)
    da, db = combined(0.5, span, -lever, d), combined(0.5, span, lever, d)
    fa, fb = combined(0.5, force, -lever, f), combined(0.5, force, lever, f)
    ka, kb = combined(0.5, couple, -lever, k), combined(0.5, couple, lever, k)
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
def rachis_geometric_stiffness(point_a, point_b, rest_length, halfway, strain, stress, matrix):
    """Geometric stiffness of one element, added to the lower part of matrix (12, 12).

    strain: (6,). stress: (6,), derivative of the energy by the strains.
    """
    angle = length(strain[3:])
    turn = _to_world(halfway, strain[3:])
    axis = (0.0, 0.0, 0.0)
    if angle > _NO_TURN:
        axis = scale(1.0 / angle, turn)
    force = _to_world(halfway, over(stress, rest_length))
    _add_force(force, sub(point_b, point_a), 0.5 * tan(0.25 * angle), axis, matrix)
    _add_moment(turn, angle, axis, _to_world(halfway, stress[3:]), matrix)
