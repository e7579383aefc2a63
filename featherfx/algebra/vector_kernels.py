"""Arithmetic of kernels: vectors, rotations, angles of lanes, loops over lines.

Vectors are 3-tuples and rotations unit quaternions (w, x, y, z) as 4-tuples, or arrays (3,) and
(4,) where they are read; rotation vectors are in rad. Results are tuples.

Angles come four at a time (lanes), since LLVM calls the system's library for single ones and makes
no vectors of that. Source: the rational function of Cephes (S. L. Moshier), atan.c: below 0.66

    atan r = r + r z P(z) / Q(z),      z = r^2

to 2e-16 of itself; beyond it atan t = pi / 4 + atan((t - 1) / (t + 1)). Cosines are Taylor's series
around the nearest multiple of pi, to 3e-16 and what the angle itself is rounded by.

Loops over arrays make no temporaries, which expressions of arrays would allocate.
"""

from __future__ import annotations

from math import atan2, cos, factorial, pi, sin, sqrt

import numpy as np

from featherfx.algebra.views import chosen, spread
from featherfx.jit.compiled import kernel, loop_kernel


@kernel
def add(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def sub(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel
def scale(s, a):
    return s * a[0], s * a[1], s * a[2]


@kernel
def over(a, s):
    """a / s."""
    return a[0] / s, a[1] / s, a[2] / s


@kernel
def combined(s, a, t, b):
    """s a + t b."""
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


@kernel
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def length(a):
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@kernel
def normal_of(start, first, second):
    """(first - start) x (second - start): twice the area of a triangle along its normal."""
    return cross(sub(first, start), sub(second, start))


@kernel
def store(array, a):
    """array (3,) = a."""
    array[0], array[1], array[2] = a[0], a[1], a[2]


@kernel
def accumulate(array, s, a):
    """array (3,) += s a."""
    array[0] += s * a[0]
    array[1] += s * a[1]
    array[2] += s * a[2]


# rad^2: below it power series are as exact as sines, and need no branches and roots
SMALL_SQUARE = 0.1


@kernel
def multiply(a, b):
    """Quaternion of rotation b followed by rotation a."""
    aw, ax, ay, az = a[0], a[1], a[2], a[3]
    bw, bx, by, bz = b[0], b[1], b[2], b[3]
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@kernel
def conjugate(q):
    """The rotation the other way about."""
    return q[0], -q[1], -q[2], -q[3]


@kernel
def exponential(v):
    """Quaternion of a rotation vector."""
    x, y, z = v[0], v[1], v[2]
    square = x * x + y * y + z * z
    if square < SMALL_SQUARE:
        # the terms left out are below rounding
        q = 0.25 * square
        half = 0.5 - q * (1.0 / 12.0 - q * (1.0 / 240.0 - q * (1.0 / 10080.0 - q / 725760.0)))
        w = 1.0 / 720.0 - q * (1.0 / 40320.0 - q / 3628800.0)
        w = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * w))
    else:
        angle = sqrt(square)
        half = sin(0.5 * angle) / angle
        w = cos(0.5 * angle)
    return w, half * x, half * y, half * z


@kernel
def logarithm(q):
    """Rotation vector, angle within [0, 2 pi], of a unit quaternion.

    Below pi where w > 0. The opposite quaternion gives the same rotation the other way about, so
    that an angle that grows beyond pi goes on smoothly.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    length = sqrt(x * x + y * y + z * z)
    scale = 2.0 if length < 1e-12 else 2.0 * atan2(length, w) / length
    return scale * x, scale * y, scale * z


@kernel
def normalised(q):
    w, x, y, z = q[0], q[1], q[2], q[3]
    scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return scale * w, scale * x, scale * y, scale * z


@kernel
def halfway_between(a, b):
    """Quaternion halfway between two that are not opposite."""
    return normalised((a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]))


@kernel
def matrix_into(q, out):
    """Rotation matrix of a unit quaternion, written to out (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[0, 1] = 2.0 * (x * y - w * z)
    out[0, 2] = 2.0 * (x * z + w * y)
    out[1, 0] = 2.0 * (x * y + w * z)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[1, 2] = 2.0 * (y * z - w * x)
    out[2, 0] = 2.0 * (x * z - w * y)
    out[2, 1] = 2.0 * (y * z + w * x)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel
def rotate(q, v):
    """Vector v turned by the unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    vx, vy, vz = v[0], v[1], v[2]
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


@kernel
def store_rotation(array, q):
    """array (4,) = q."""
    array[0], array[1], array[2], array[3] = q[0], q[1], q[2], q[3]


@kernel
def same_sign(near, quat):
    """Give the quaternion quat (4,) the sign that is nearer to near (4,), in place."""
    if near[0] * quat[0] + near[1] * quat[1] + near[2] * quat[2] + near[3] * quat[3] < 0.0:
        for k in range(4):
            quat[k] = -quat[k]


_CUT = 0.66
# of r^0, r^2, ... r^22
_COSINE = tuple((-1) ** k / factorial(2 * k) for k in range(12))


@kernel
def arctan2(y, x):
    """atan2 of lanes."""
    zero, up, along = spread(0.0), max(y, -y), max(x, -x)
    large, small = max(up, along), min(up, along)
    cut = _CUT * large
    r = chosen(small, cut, small - large, small) / chosen(small, cut, small + large, large)
    z = r * r
    p = -16.15753718733365076637 + z * -0.8750608600031904122785
    p = -122.8866684490136173410 + z * (-75.00855792314704667340 + z * p)
    p = -64.85021904942025371773 + z * p
    q = 165.0270098316988542046 + z * (24.85846490142306297962 + z)
    q = 485.3903996359136964868 + z * (432.8810604912902668951 + z * q)
    q = 194.5506571482613964425 + z * q
    angle = r + r * (z * p / q)
    angle = chosen(small, cut, 0.25 * pi + angle, angle)
    angle = chosen(up, along, 0.5 * pi - angle, angle)
    angle = chosen(zero, x, pi - angle, angle)
    return chosen(zero, y, -angle, angle)


@kernel
def cosine(angle):
    """cos of one angle of many in a loop, rad."""
    turns = np.floor(angle / pi + 0.5)
    r = angle - pi * turns
    z, c = r * r, _COSINE
    total = c[8] + z * (c[9] + z * (c[10] + z * c[11]))
    total = c[4] + z * (c[5] + z * (c[6] + z * (c[7] + z * total)))
    total = c[0] + z * (c[1] + z * (c[2] + z * (c[3] + z * total)))
    odd = turns - 2.0 * np.floor(0.5 * turns)
    return total - 2.0 * odd * total


@kernel
def copy_values(source, target):
    """target[...] = source for arrays of one shape and contiguous memory."""
    from_flat, to_flat = source.flat, target.flat
    for i in range(source.size):
        to_flat[i] = from_flat[i]


@loop_kernel
def add_scaled(factor, line, to):
    """to += factor line for lines (N,) that do not overlap."""
    for k in range(to.shape[0]):
        to[k] += factor * line[k]


@kernel
def product(a, b):
    """The sum of a_k b_k of lines (N,)."""
    total = 0.0
    for k in range(a.shape[0]):
        total += a[k] * b[k]
    return total
