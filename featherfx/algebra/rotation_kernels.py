"""Rotations in kernels: unit quaternions (w, x, y, z) and rotation vectors (rad).

Quaternions are 4-tuples, vectors 3-tuples, or arrays (4,) and (3,) where they are read; results
are tuples.
"""

from math import atan2, cos, sin, sqrt

from featherfx.jit.compiled import kernel

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
