"""Rotations as unit quaternions (w, x, y, z) and rotation vectors; scalars in, scalars out."""

from math import atan2, cos, sin, sqrt

from featherfx.jit.compiled import kernel

# rad^2: below it power series are as exact as sines, and need no branches and roots
SMALL_SQUARE = 0.1


@kernel
def cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@kernel
def multiply(aw, ax, ay, az, bw, bx, by, bz):
    """Quaternion of rotation b followed by rotation a."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@kernel
def exponential(x, y, z):
    """Quaternion of the rotation vector (x, y, z), rad."""
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
def logarithm(w, x, y, z):
    """Rotation vector, angle within [0, 2 pi], of a unit quaternion.

    Below pi where w > 0. The opposite quaternion gives the same rotation the other way about, so
    that an angle that grows beyond pi goes on smoothly.
    """
    length = sqrt(x * x + y * y + z * z)
    scale = 2.0 if length < 1e-12 else 2.0 * atan2(length, w) / length
    return scale * x, scale * y, scale * z


@kernel
def normalised(w, x, y, z):
    scale = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return scale * w, scale * x, scale * y, scale * z


@kernel
def matrix_into(w, x, y, z, out):
    """Rotation matrix of a unit quaternion, written to out (3, 3)."""
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
def rotate(w, x, y, z, vx, vy, vz):
    """Vector v turned by the unit quaternion."""
    tx = 2.0 * (y * vz - z * vy)
    ty = 2.0 * (z * vx - x * vz)
    tz = 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


@kernel
def same_sign(near, turn):
    """Give the quaternion turn (4,) the sign that is nearer to near (4,), in place."""
    if near[0] * turn[0] + near[1] * turn[1] + near[2] * turn[2] + near[3] * turn[3] < 0.0:
        for k in range(4):
            turn[k] = -turn[k]
